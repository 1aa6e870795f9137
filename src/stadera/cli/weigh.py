"""`stadera weigh`: mass and centre of mass of a robot's trunk and of its payload."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stadera.cli import parse
from stadera.cli.options import Force, LogOptions, RobotOfLog, RrdFile, View, grouped
from stadera.cli.outputs import ResultFiles
from stadera.cli.terminal import progress, show
from stadera.cli.viewing import watching

if TYPE_CHECKING:
    from stadera.limits import Limits
    from stadera.robot import Robot


@grouped
def weigh(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Log of a robot on its feet, walking or standing.")],
    robot: RobotOfLog = None,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="walking|contact|orientation|poses|combined",
            help="walking: any motion; others: at rest, poses and combined without an IMU "
            "[default: walking with an IMU and 50 samples a second, else contact, or poses without an IMU].",
        ),
    ] = None,
    tare: Annotated[
        str | None,
        typer.Option(metavar="T0:T1|LOG", help="Time [s] in LOG without the payload, or another log without it."),
    ] = None,
    stiffness: Annotated[
        str | None,
        typer.Option(metavar="KX,KY,KZ", help="Stiffness of the trunk controller [N·m/rad], for 'orientation'."),
    ] = None,
    legs: Annotated[
        Path | None,
        typer.Option("--legs", metavar="F.json", help="Legs, friction and rotor inertia from `identify --json`."),
    ] = None,
    force: Force = False,
    imu_frame: Annotated[
        str | None, typer.Option(metavar="NAME", help="Frame of the IMU's values [default: the model's IMU].")
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(metavar="F.truth.json", help="Ground truth of a simulated log, shown with the result."),
    ] = None,
    export: Annotated[
        Path | None,
        typer.Option(metavar="F.urdf", help="Write the weighed model (URDF, MJCF), with the payload as a link."),
    ] = None,
    view: View = False,
    rrd: RrdFile = None,
    *,
    options: LogOptions,
    files: ResultFiles,
) -> None:
    """Weigh a robot from its log: trunk with payload, centre of mass, and changes of the load.

    In motion every instant is used, standing included. At rest the mass follows from the upward contact force (eq. 7),
    and times in motion are ignored. --tare gives the payload as the difference. A result on which model and log
    contradict each other is refused (exit code 1) unless --force is given.
    """
    springs = None if stiffness is None else parse.point(stiffness)
    chosen_tare = None if tare is None else parse.tare(tare)

    from stadera.report.weigh.tables import weighing_tables
    from stadera.robot.export import check_export
    from stadera.weigh.settings import check_choice
    from stadera.weigh.truth import read_truth
    from stadera.weigh.weigh import weigh as weigh_log

    check_choice(method, springs)
    model = robot_with_legs(options.robot(robot, log), legs, options.reading.limits)
    files.check(export)
    if export is not None:
        check_export(model, export)
    known = None if truth is None else read_truth(truth)
    with watching(model, view, rrd) as watch, progress() as bar:
        result = weigh_log(
            model,
            options.log(log),
            options.log(chosen_tare) if isinstance(chosen_tare, Path) else chosen_tare,
            method,
            imu_frame=imu_frame,
            stiffness=springs,
            force=force,
            fix=options.fix,
            progress=bar,
            watch=watch,
        )
    files.write(
        (export, result.save_urdf),
        values=result.to_dict,
        page=lambda: result.to_html(known),
        latex=result.to_latex,
        figures=lambda: result.to_figures(known),
    )
    show(*weighing_tables(result, known))


def robot_with_legs(name: str, legs: Path | None, limits: Limits) -> Robot:
    """Loads the robot, with identified legs if given."""
    from stadera.identify.schema import with_identified_legs
    from stadera.robot import load_robot

    robot = load_robot(name, limits)
    return robot if legs is None else with_identified_legs(robot, legs)
