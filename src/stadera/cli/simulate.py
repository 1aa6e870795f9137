"""`stadera simulate`: a run of the test-bed as a log, with the ground truth."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stadera.cli import parse
from stadera.cli.options import LimitValues, RobotName, argument, grouped, limits_of, option
from stadera.cli.outputs import check_outputs, check_table, json_of, write_outputs
from stadera.cli.terminal import progress, show

if TYPE_CHECKING:
    from stadera.cli.terminal import Progress
    from stadera.lab.scenarios.run import Run
    from stadera.lab.scenarios.settings import SimulateSettings
    from stadera.robot import Robot

_SCENARIOS = "stand|stand-load|poses|ramp|crawl|crawl-load|trot|trot-load|shake|shake-load|squat|swing|motion"


@dataclass(frozen=True)
class RunOptions:
    """Options for a run of the test-bed."""

    errors: Annotated[
        str,
        option(
            "ideal|standard|harsh|real|real-unit-gain|real-varying",
            "Kind of sensor errors; real: also of the robot and the ground.",
        ),
    ] = "standard"
    load: Annotated[
        str | None, option("5kg|50N", "A mass on the trunk or --on a link, or the paper's virtual force.")
    ] = None
    at: Annotated[
        str | None, option("X,Y,Z", "Position of the load, frame of the trunk or of --on [m] [default: behind, left].")
    ] = None
    on: Annotated[str | None, option("LINK", "The link or frame that carries the load, such as a hand.")] = None
    load_time: Annotated[float | None, option("S", "Time at which it lands [s] [default: the scenario's own].")] = None
    speed: Annotated[float | None, option("M/S", "Speed of a walk [m/s] [default: the scenario's own].")] = None
    turn: Annotated[float, option("DEG/S", "Turning rate of a walk, to the left [°/s].")] = 0.0
    motion: Annotated[Path | None, option("F.csv", "Table of joint positions that the scenario motion plays.")] = None
    amplitude: Annotated[float, option("X", "Amplitude of a shake: X times 3°.")] = 1.0
    arms: Annotated[float, option("RAD", "Amplitude with which joints outside the legs swing [rad].")] = 0.0
    slope: Annotated[float | None, option("DEG", "Slope of the ground [°].")] = None
    stones: Annotated[float, option("M", "Make the ground stepping stones with heights within ±M [m].")] = 0.0
    duration: Annotated[float | None, option("S", "Duration [s] [default: the scenario's own].")] = None
    rate: Annotated[
        float | None, option("HZ", "Rate of the log [Hz]: 1000 over an integer [default: 250, or as drawn].")
    ] = None
    seed: Annotated[int, option("N", "The same seed gives the same log.", min=0)] = 0

    def settings(self, scenario: str) -> SimulateSettings:
        """The settings of a run. Raises BadParameter: options that do not go together; and as `SimulateSettings`."""
        for name, given in {"--at": self.at, "--on": self.on}.items():
            if self.load is None and given is not None:
                raise typer.BadParameter("needs --load", param_hint=name)
        if (self.motion is None) == (scenario == "motion"):
            raise typer.BadParameter("goes with the scenario motion", param_hint="--motion")

        from stadera.lab.scenarios.settings import Load, SimulateSettings
        from stadera.logs import read

        place = None if self.at is None else parse.point(self.at)
        load = None if self.load is None else Load(*parse.load(self.load), place, self.on)
        table = None if self.motion is None else read(self.motion)
        twice = None if table is None else 2.0 * (float(table.time[-1] - table.time[0]) + 1.5)
        slope = None if self.slope is None else radians(self.slope)
        duration = twice if self.duration is None else self.duration
        return SimulateSettings(
            self.errors, load, slope, duration, self.rate, self.seed, self.load_time, self.speed, radians(self.turn),
            self.amplitude, self.stones, arms=self.arms, motion=table,
        )  # fmt: skip


@grouped
def simulate(
    scenario: Annotated[str, argument(_SCENARIOS, "Motion of the robot.")],
    out: Annotated[Path, option("LOG", "Write the log, .csv or .parquet, and the truth.")],
    robot: RobotName = "hyq",
    leg: Annotated[str | None, option("LF|all", "The leg that swings [default: all].")] = None,
    limit: LimitValues = None,
    model: Annotated[
        Path | None,
        option("F.urdf", "Write the model to weigh with, which harsh errors modify.", "--model", "--believed"),
    ] = None,
    *,
    options: RunOptions,
) -> None:
    """Simulate a robot that stands, walks or swings its legs in the air, and write its sensor values as a log.

    The ground truth is written separately: LOG.truth.json has the trunk's mass and centre of mass over time and the
    controller's stiffness, LOG.truth.csv (or .parquet) the true motion and contact forces.
    """
    if leg is not None and scenario != "swing":
        raise typer.BadParameter("needs the scenario swing", param_hint="--leg")

    from stadera.lab import require_lab

    require_lab("stadera simulate")
    from stadera.lab.scenarios.catalog import SWING, scenario_named
    from stadera.robot import load_robot

    if scenario != SWING:
        scenario_named(scenario)
    settings = options.settings(scenario)
    truth = load_robot(robot, limits_of(limit))
    check_table(out)
    check_outputs((out, model))
    with progress() as watch:
        run = _run(truth, scenario, settings, leg, watch)
    _write(run, out, model)
    _print(run, out)


def _run(robot: Robot, scenario: str, settings: SimulateSettings, leg: str | None, watch: Progress | None) -> Run:
    from stadera.lab.scenarios.catalog import SWING
    from stadera.lab.scenarios.run import simulate as run_scenario
    from stadera.lab.scenarios.swing import swing

    if scenario == SWING:
        return swing(robot, leg or "all", settings, watch)
    return run_scenario(robot, scenario, settings, watch)


def _write(run: Run, out: Path, model: Path | None) -> None:
    """Writes all files or none."""
    from stadera.lab.truth import truth_json, truth_paths
    from stadera.logs import write_table
    from stadera.robot.export import export_model

    truth, motion = truth_paths(out)
    write_outputs(
        (out, lambda draft: write_table(run.recording, draft)),
        (truth, json_of(lambda: truth_json(run.truth))),
        (motion, lambda draft: write_table(run.true_motion, draft)),
        (model, lambda draft: export_model(run.model, draft)),
    )


def _print(run: Run, out: Path) -> None:
    from stadera.lab.truth import truth_paths
    from stadera.report.numbers import number

    log, last = run.recording, run.truth.moments[-1]
    com = ", ".join(number(value) for value in last.com)
    show(
        f"{out}: {len(log)} samples, {log.time[-1] - log.time[0]:.3f} s, {run.truth.errors} sensors, seed "
        f"{run.truth.seed}",
        f"truth, at the end: trunk with payload {number(last.mass)} kg, centre of mass ({com}) m; "
        f"in {truth_paths(out)[0]}",
    )
    if run.truth.fell is not None:
        time, how = run.truth.fell
        show(f"the robot fell: {how}, at {time:.2f} s")
    if run.truth.stiffness:
        show(f"for --method orientation: --stiffness {','.join(f'{k:.6g}' for k in run.truth.stiffness)}")
