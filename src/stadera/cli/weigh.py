"""`stadera weigh`: mass and centre of mass of a robot's trunk and of its payload."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stadera.cli import parse
from stadera.cli.options import (
    Columns,
    FigureFiles,
    Fix,
    Force,
    GearRatio,
    ImuTopic,
    JointTopic,
    JsonFile,
    LatexFile,
    LimitValues,
    LogOptions,
    PdGains,
    ReportFile,
    RobotOfLog,
    RrdFile,
    Units,
    View,
)
from stadera.cli.outputs import ResultFiles, figure_files
from stadera.cli.terminal import progress, show
from stadera.cli.viewing import watching

if TYPE_CHECKING:
    from stadera.limits import Limits
    from stadera.logs import LogFile
    from stadera.report.figures import Figure
    from stadera.robot import Robot
    from stadera.weigh.truth import Truth


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
    joint_topic: JointTopic = None,
    imu_topic: ImuTopic = None,
    columns: Columns = None,
    units: Units = None,
    pd: PdGains = None,
    gear: GearRatio = None,
    fix: Fix = False,
    limit: LimitValues = None,
    truth: Annotated[
        Path | None,
        typer.Option(metavar="F.truth.json", help="Ground truth of a simulated log, shown with the result."),
    ] = None,
    json: JsonFile = None,
    report: ReportFile = None,
    figure: FigureFiles = None,
    latex: LatexFile = None,
    export: Annotated[
        Path | None,
        typer.Option(metavar="F.urdf", help="Write the weighed model (URDF, MJCF), with the payload as a link."),
    ] = None,
    view: View = False,
    rrd: RrdFile = None,
) -> None:
    """Weigh a robot from its log: trunk with payload, centre of mass, and changes of the load.

    In motion every instant is used, standing included. At rest the mass follows from the upward contact force (eq. 7),
    and times in motion are ignored. --tare gives the payload as the difference. A result on which model and log
    contradict each other is refused (exit code 1) unless --force is given.
    """
    springs = None if stiffness is None else parse.point(stiffness)
    reading = LogOptions.of(joint_topic, imu_topic, columns, units, pd, limit, gear)
    chosen_tare = None if tare is None else _tare(tare, reading)

    from stadera.weigh.settings import check_choice
    from stadera.weigh.weigh import weigh as weigh_log

    check_choice(method, springs)
    files = ResultFiles(json, report, export, figure_files(figure), latex)
    model = robot_with_legs(reading.robot(robot, log), legs, reading.reading.limits)
    files.check(model)
    known = _truth(truth)
    with watching(model, view, rrd) as watch, progress() as bar:
        result = weigh_log(
            model,
            reading.log(log),
            chosen_tare,
            method,
            imu_frame=imu_frame,
            stiffness=springs,
            force=force,
            fix=fix,
            progress=bar,
            watch=watch,
        )

    def page() -> str:
        from stadera.report.weigh.page import weighing_html

        return weighing_html(result, known)

    def figures() -> Mapping[str, Figure]:
        from stadera.report.weigh.plots import figures as figures_of

        return figures_of(result, known)

    from stadera.report.weigh.tables import weighing_tables

    files.write(result, page, figures)
    show(*weighing_tables(result, known))


def _truth(path: Path | None) -> Truth | None:
    """The ground truth of a simulated log, if given."""
    if path is None:
        return None
    from stadera.weigh.truth import read_truth

    return read_truth(path)


def _tare(given: str, reading: LogOptions) -> tuple[float, float] | LogFile:
    """Parses a tare: a range of time, or another log."""
    chosen = parse.tare(given)
    return reading.log(chosen) if isinstance(chosen, Path) else chosen


def robot_with_legs(name: str, legs: Path | None, limits: Limits) -> Robot:
    """Loads the robot, with identified legs if given."""
    from stadera.identify.schema import with_identified_legs
    from stadera.robot import load_robot

    robot = load_robot(name, limits)
    return robot if legs is None else with_identified_legs(robot, legs)
