"""`stadera simulate`: a run of the test-bed as a log, the truth beside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stadera.cli import parse
from stadera.cli.outputs import check_outputs, check_table, text_of, write_outputs
from stadera.cli.terminal import progress, show

if TYPE_CHECKING:
    from stadera.simulate import Run

_SCENARIOS = "stand|stand-load|poses|ramp|crawl|crawl-load|trot|trot-load|shake|shake-load"


def simulate(
    scenario: Annotated[str, typer.Argument(metavar=_SCENARIOS, help="What the robot does.")],
    out: Annotated[Path, typer.Option(metavar="LOG", help="Write the log, .csv or .parquet; the truth beside it.")],
    robot: Annotated[
        str, typer.Option("--robot", metavar="R", help="A robot's name, or a path to a URDF or MJCF.")
    ] = "hyq",
    errors: Annotated[str, typer.Option(metavar="ideal|standard|harsh", help="Of the sensors.")] = "standard",
    load: Annotated[
        str | None, typer.Option(metavar="5kg|50N", help="A mass on the trunk, or the paper's virtual force.")
    ] = None,
    at: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Where, trunk frame [m] [default: behind, to the left].")
    ] = None,
    load_time: Annotated[
        float | None, typer.Option(metavar="S", help="When it is put on [s] [default: the scenario's own].")
    ] = None,
    speed: Annotated[
        float | None, typer.Option(metavar="M/S", help="Of a walk [m/s] [default: the scenario's own].")
    ] = None,
    turn: Annotated[float, typer.Option(metavar="DEG/S", help="Of a walk, to the left [°/s].")] = 0.0,
    amplitude: Annotated[float, typer.Option(metavar="X", help="Of a shake: X times 3°.")] = 1.0,
    slope: Annotated[float | None, typer.Option(metavar="DEG", help="Of the ground [°].")] = None,
    stones: Annotated[
        float, typer.Option(metavar="M", help="The ground is stepping stones, their heights within ±M [m].")
    ] = 0.0,
    duration: Annotated[float | None, typer.Option(metavar="S", help="[s] [default: the scenario's own].")] = None,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Of the log [Hz]: 1000 over a whole number.")] = 250.0,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="The same seed gives the same log.")] = 0,
    believed: Annotated[
        Path | None,
        typer.Option(metavar="F.urdf", help="Write the model to weigh with: harsh errors make it a wrong one."),
    ] = None,
) -> None:
    """Simulate a robot that stands or walks and write what its sensors say as a log.

    What was true is kept apart: LOG.truth.json has the trunk's mass and centre of mass over time and the controller's
    stiffness, LOG.truth.csv (or .parquet) the true motion and the ground's forces.
    """
    amount = None if load is None else parse.load(load)
    place = None if at is None else parse.point(at)
    if amount is None and place is not None:
        raise typer.BadParameter("needs --load", param_hint="--at")

    from math import radians

    from stadera.robot import load_robot
    from stadera.simulate import Load, SimulateSettings, scenario_named
    from stadera.simulate import simulate as run_scenario

    scenario_named(scenario)
    loaded, rise = None if amount is None else Load(*amount, place), None if slope is None else radians(slope)
    settings = SimulateSettings(
        errors, loaded, rise, duration, rate, seed, load_time, speed, radians(turn), amplitude, stones
    )
    model = load_robot(robot)
    check_table(out)
    check_outputs((out, believed))
    with progress() as watch:
        run = run_scenario(model, scenario, settings, watch)
    _write(run, out, believed)
    _tell(run, out)


def _write(run: Run, out: Path, believed: Path | None) -> None:
    """All files or none."""
    from stadera.recording import write_table
    from stadera.report.json import json_text
    from stadera.robot.export import export_model
    from stadera.simulate import truth_json, truth_paths

    truth, motion = truth_paths(out)
    write_outputs(
        (out, lambda draft: write_table(run.recording, draft)),
        (truth, text_of(lambda: json_text(truth_json(run.truth)))),
        (motion, lambda draft: write_table(run.true_motion, draft)),
        (believed, lambda draft: export_model(run.believed, draft)),
    )


def _tell(run: Run, out: Path) -> None:
    from stadera.report.numbers import number
    from stadera.simulate import truth_paths

    log, last = run.recording, run.truth.moments[-1]
    com = ", ".join(number(value) for value in last.com)
    show(
        f"{out}: {len(log)} samples, {log.time[-1] - log.time[0]:.3f} s, {run.truth.errors} sensors, seed "
        f"{run.truth.seed}",
        f"truth, at the end: trunk with payload {number(last.mass)} kg, centre of mass ({com}) m; "
        f"in {truth_paths(out)[0]}",
        f"for --method orientation: --stiffness {','.join(f'{k:.6g}' for k in run.truth.stiffness)}",
    )
