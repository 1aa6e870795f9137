"""Commands of the laboratory: `simulate`, `demo`, `replay` (of a log's torques in MuJoCo), and `reproduce`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stadera.cli import options as opt
from stadera.cli import parse
from stadera.cli.options import argument, flag, grouped, limits_of, option, refuse
from stadera.cli.outputs import ResultFiles, check_outputs, check_report, check_table, json_of, page_of, write_outputs
from stadera.cli.terminal import progress, show
from stadera.errors import RecordingError
from stadera.report.numbers import number

if TYPE_CHECKING:
    from stadera.lab.experiments.runner import ExperimentResult, Skipped
    from stadera.lab.scenarios.catalog import SimulateSettings
    from stadera.lab.scenarios.run import Run
    from stadera.report.figures import Figure
    from stadera.report.table import TableData


_SCENARIOS = (
    "stand|stand-load|poses|ramp|crawl|crawl-load|trot|trot-load|errands|"
    "shake|shake-load|squat|step|step-load|swing|motion"
)


@dataclass(frozen=True)
class RunOptions:
    """Options for a run of the test-bed."""

    errors: Annotated[
        str,
        option(
            "ideal|standard|harsh|real|real-unit-gain", "Kind of sensor errors; real: also of the robot and the ground."
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

    def settings(self) -> SimulateSettings:
        """The settings of a run. Raises BadParameter: options that need --load; and as `SimulateSettings`."""
        if self.load is None:
            refuse("needs --load", {"--at": self.at, "--on": self.on})

        from stadera.lab.scenarios.catalog import Load, SimulateSettings
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
    robot: opt.RobotName = "hyq",
    leg: Annotated[str | None, option("LF|all", "The leg that swings [default: all].")] = None,
    limit: opt.LimitValues = None,
    model: Annotated[
        Path | None,
        option("F.urdf", "Write the model to weigh with, which harsh errors modify.", "--model", "--believed"),
    ] = None,
    *,
    options: RunOptions,
    shape: opt.ModelOptions,
) -> None:
    """Simulate a robot that stands, walks or swings its legs in the air, and write its sensor values as a log.

    The ground truth is written separately: LOG.truth.json has the trunk's mass and centre of mass over time and the
    controller's stiffness, LOG.truth.csv (or .parquet) the true motion and contact forces.
    """
    if scenario != "swing":
        refuse("needs the scenario swing", {"--leg": leg})

    from stadera.lab import require_lab

    require_lab("stadera simulate")
    from stadera.lab.scenarios.catalog import SWING, scenario_named
    from stadera.lab.scenarios.run import simulate as run_scenario
    from stadera.lab.scenarios.run import swing

    if scenario != SWING:
        scenario_named(scenario)
    settings = options.settings()
    truth = shape.load(robot, limits_of(limit))
    check_table(out)
    check_outputs((out, model))
    with progress() as watch:
        if scenario == SWING:
            run = swing(truth, leg or "all", settings, watch)
        else:
            run = run_scenario(truth, scenario, settings, watch)
    _write(run, out, model)
    _print(run, out)


def _write(run: Run, out: Path, model: Path | None) -> None:
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


_DEMO = Path("out") / "demo.html"


def demo(
    report: Annotated[Path, option("F.html", "Write an HTML report.")] = _DEMO,
    json: opt.JsonFile = None,
    seed: Annotated[int, option("N", "Seed of the sensor errors.", min=0)] = 0,
    classic: Annotated[
        bool, flag("Stop and weigh at rest, as in the paper, instead of while walking.", "--classic")
    ] = False,
) -> None:
    """HyQ crawls, and a 30 kg box lands on a corner of its back: without identification it falls.

    With identification it weighs the box while walking and walks on. Takes half a minute on two cores. The report shows
    both walks as animations.
    """
    from stadera.lab import require_lab

    require_lab("stadera demo")
    from stadera.lab.demo import DemoSettings, run_demo
    from stadera.lab.report.demo import demo_html, demo_tables

    if report == _DEMO:
        report.parent.mkdir(exist_ok=True)
    check_outputs((report, json))
    check_report(report)
    with progress() as watch:
        if watch:
            watch("both walks", 0, 0)
        result = run_demo(DemoSettings(seed=seed, classic=classic))
    write_outputs((report, page_of(lambda: demo_html(result))), (json, json_of(result.to_dict)))
    show(*demo_tables(result))


@grouped
def replay(
    log: Annotated[Path, argument("LOG", "A log of legs in the air.")],
    robot: Annotated[str, option("IDENTIFIED", "The model to test, or the JSON of `identify`.", "--robot")],
    against: Annotated[str, option("CAD", "The model to compare it with, into which a JSON is put.", "--against")],
    gains: Annotated[
        str | None,
        option("KP,KD", "Torques are commands of a controller with these gains, which is replayed [default: of --pd]."),
    ] = None,
    skip: Annotated[
        float, option("SHARE", "Share of LOG left out at its beginning, which was fitted.", "--skip", min=0.0, max=0.99)
    ] = 0.5,
    torque_lag: Annotated[
        str, option("SECONDS|auto", "Delay of the torques relative to their stamps; 'auto': of the JSON, else none.")
    ] = "auto",
    force: opt.Force = False,
    *,
    shape: opt.ModelOptions,
    options: opt.LogOptions,
    files: ResultFiles,
) -> None:
    """Replay a log in MuJoCo: do the identified values predict the robot's motion better?

    The recorded torques, or the controller that made them, drive each model from the recorded state, for up to a second
    at a time. Prints the root mean square error of the joints' paths over 0.25, 0.5 and 1 s. The trunk is held.
    """
    lag = parse.torque_lag(torque_lag)

    from stadera.lab import require_lab
    from stadera.logs.topics import PdGains
    from stadera.report.table import rich_table

    require_lab("replaying a log")
    from stadera.lab.replay import ReplaySettings, replayed_models
    from stadera.lab.replay import replay as replay_log

    try:
        commanded = options.reading.pd if gains is None else PdGains.parse(gains)
    except RecordingError as error:
        raise typer.BadParameter(str(error), param_hint="--gains") from None
    files.check()
    load = partial(shape.load, limits=options.reading.limits)
    models, stated = replayed_models(robot, against, force=force, load=load)
    settings = ReplaySettings(skip=skip)
    with progress() as watch:
        found = stated or 0.0 if lag is None else lag
        result = replay_log(
            options.log(log), models, lag=found, gains=commanded, settings=settings, fix=options.fix, force=force,
            progress=watch,
        )  # fmt: skip
    files.write_result(result)
    show(*map(rich_table, result.to_tables()[:1]))


@grouped
def reproduce(
    name: Annotated[
        str,
        argument(
            "table1..table5|fig4..fig6|inertial_share|alarms|reality|faults|humanoids|identified|mini_cheetah|all",
            "Table or figure; all excludes the studies alarms, reality, faults, humanoids, identified, mini_cheetah.",
        ),
    ],
    folder: Annotated[Path | None, argument("FOLDER", "Folder of real logs, as --data.")] = None,
    seed: Annotated[int, option("N", "Seed of all random draws.", min=0)] = 0,
    quick: Annotated[bool, flag("A short, coarse version.", "--quick")] = False,
    data: Annotated[
        Path | None, option("FOLDER", "Folder of real logs [default: $STADERA_DATA, else ../shared/data].")
    ] = None,
    keep: Annotated[
        Path | None, option("FOLDER", "Folder in which long studies keep finished runs, to resume from.")
    ] = None,
    seeds: Annotated[
        int | None,
        option("N", "For alarms, reality, faults, humanoids, identified: repetitions of the whole grid.", min=1),
    ] = None,
    robots: Annotated[str | None, option("A,B,...", "For the same: of its robots these only.")] = None,
    *,
    processes: opt.PoolOptions,
    files: ResultFiles,
) -> None:
    """Reproduce tables and figures of the paper, and compare them with their bounds.

    A bound that is not met is reported in terminal, page and JSON; it is a measurement, not an error.
    """
    pool, chosen = processes.pool(), parse.names(robots) or ()

    from stadera.lab import require_lab

    require_lab("stadera reproduce")
    from stadera.lab.experiments import ReproduceSettings, experiments_named, run_experiments
    from stadera.lab.report.experiments import experiment_renderables

    experiments = experiments_named(name)
    files.check()
    results = []
    with progress() as watch:
        settings = ReproduceSettings(seed, quick, folder or data, keep, seeds, chosen, pool)
        for result in run_experiments(experiments, settings, watch or (lambda *_: None)):
            results.append(result)
    _write_all(results, files)
    for result in results:
        show(*experiment_renderables(result))


def _write_all(results: list[ExperimentResult | Skipped], files: ResultFiles) -> None:
    """Writes all outputs or none. Figures of several experiments are prefixed with the experiment's name:
    fig6-figure-1.
    """
    from stadera.lab.experiments.runner import ExperimentResult
    from stadera.lab.report.experiments import experiments_html
    from stadera.report.table import latex as latex_of

    done = [result for result in results if isinstance(result, ExperimentResult)]
    records = [record.to_dict() for result in done for record in result.records]

    def drawn() -> Mapping[str, Figure | TableData]:
        if len(done) == 1:
            return done[0].to_figures()
        return {f"{result.name}-{name}": shown for result in done for name, shown in result.to_figures().items()}

    files.write(
        values=lambda: records,
        page=lambda: experiments_html(results),
        latex=lambda: latex_of(table for result in done for table in result.tables),
        figures=drawn,
    )
