"""`stadera simulate`: a run of the test-bed as a log, with the ground truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from stadera.cli import parse
from stadera.cli.options import LimitValues, RobotName, argument, limits_of, option
from stadera.cli.outputs import check_outputs, check_table, json_of, write_outputs
from stadera.cli.terminal import progress, show

if TYPE_CHECKING:
    from stadera.cli.terminal import Progress
    from stadera.lab.scenarios.run import Run
    from stadera.lab.scenarios.settings import SimulateSettings
    from stadera.robot import Robot

_SCENARIOS = "stand|stand-load|poses|ramp|crawl|crawl-load|trot|trot-load|shake|shake-load|squat|swing|motion"


def simulate(
    scenario: Annotated[str, argument(_SCENARIOS, "Motion of the robot.")],
    out: Annotated[Path, option("LOG", "Write the log, .csv or .parquet, and the truth.")],
    robot: RobotName = "hyq",
    errors: Annotated[
        str,
        option(
            "ideal|standard|harsh|real|real-unit-gain|real-varying",
            "Kind of sensor errors; real: also of the robot and the ground.",
        ),
    ] = "standard",
    load: Annotated[
        str | None, option("5kg|50N", "A mass on the trunk or --on a link, or the paper's virtual force.")
    ] = None,
    at: Annotated[
        str | None, option("X,Y,Z", "Position of the load, frame of the trunk or of --on [m] [default: behind, left].")
    ] = None,
    on: Annotated[str | None, option("LINK", "The link or frame that carries the load, such as a hand.")] = None,
    load_time: Annotated[float | None, option("S", "Time at which it lands [s] [default: the scenario's own].")] = None,
    speed: Annotated[float | None, option("M/S", "Speed of a walk [m/s] [default: the scenario's own].")] = None,
    turn: Annotated[float, option("DEG/S", "Turning rate of a walk, to the left [°/s].")] = 0.0,
    motion: Annotated[Path | None, option("F.csv", "Table of joint positions that the scenario motion plays.")] = None,
    leg: Annotated[str | None, option("LF|all", "The leg that swings [default: all].")] = None,
    amplitude: Annotated[float, option("X", "Amplitude of a shake: X times 3°.")] = 1.0,
    arms: Annotated[float, option("RAD", "Amplitude with which joints outside the legs swing [rad].")] = 0.0,
    slope: Annotated[float | None, option("DEG", "Slope of the ground [°].")] = None,
    stones: Annotated[float, option("M", "Make the ground stepping stones with heights within ±M [m].")] = 0.0,
    duration: Annotated[float | None, option("S", "Duration [s] [default: the scenario's own].")] = None,
    rate: Annotated[
        float | None, option("HZ", "Rate of the log [Hz]: 1000 over an integer [default: 250, or as drawn].")
    ] = None,
    limit: LimitValues = None,
    seed: Annotated[int, option("N", "The same seed gives the same log.", min=0)] = 0,
    model: Annotated[
        Path | None,
        option("F.urdf", "Write the model to weigh with, which harsh errors modify.", "--model", "--believed"),
    ] = None,
) -> None:
    """Simulate a robot that stands, walks or swings its legs in the air, and write its sensor values as a log.

    The ground truth is written separately: LOG.truth.json has the trunk's mass and centre of mass over time and the
    controller's stiffness, LOG.truth.csv (or .parquet) the true motion and contact forces.
    """
    amount, place = _load(load, at, on)
    if leg is not None and scenario != "swing":
        raise typer.BadParameter("needs the scenario swing", param_hint="--leg")
    if (motion is None) == (scenario == "motion"):
        raise typer.BadParameter("goes with the scenario motion", param_hint="--motion")

    from stadera.lab import require_lab

    require_lab("stadera simulate")
    from math import radians

    from stadera.lab.scenarios.catalog import SWING, scenario_named
    from stadera.lab.scenarios.settings import Load, SimulateSettings
    from stadera.robot import load_robot

    if scenario != SWING:
        scenario_named(scenario)
    loaded = None if amount is None else Load(*amount, place, on)
    table = None
    if motion is not None:
        from stadera.logs import read

        table = read(motion)
        duration = duration or 2.0 * (float(table.time[-1] - table.time[0]) + 1.5)
    rise = None if slope is None else radians(slope)
    settings = SimulateSettings(
        errors,
        loaded,
        rise,
        duration,
        rate,
        seed,
        load_time,
        speed,
        radians(turn),
        amplitude,
        stones,
        arms=arms,
        motion=table,
    )
    truth = load_robot(robot, limits_of(limit))
    check_table(out)
    check_outputs((out, model))
    with progress() as watch:
        run = _run(truth, scenario, settings, leg, watch)
    _write(run, out, model)
    _print(run, out)


def _load(
    load: str | None, at: str | None, on: str | None
) -> tuple[tuple[float, Literal["kg", "N"]] | None, parse.Point | None]:
    """The load and its position, each if given."""
    for name, given in {"--at": at, "--on": on}.items():
        if load is None and given is not None:
            raise typer.BadParameter("needs --load", param_hint=name)
    return None if load is None else parse.load(load), None if at is None else parse.point(at)


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
    if run.truth.stiffness:
        show(f"for --method orientation: --stiffness {','.join(f'{k:.6g}' for k in run.truth.stiffness)}")
