"""`stadera identify`: links, friction and rotor inertia of legs from logs of a robot on a stand."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stadera.cli import parse
from stadera.cli.outputs import check_outputs, text_of, write_outputs
from stadera.cli.terminal import progress, show
from stadera.cli.topics import ImuTopic, JointTopic, log_file

if TYPE_CHECKING:
    from stadera.identify.result import Identification
    from stadera.identify.settings import IdentifySettings
    from stadera.recording import LogFile
    from stadera.robot import Robot


class Method(StrEnum):
    """How the parameters are solved for."""

    CONSISTENT = "consistent"
    NULL_SPACE = "null-space"


def identify(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs to fit; several are merged.")],
    robot: Annotated[str, typer.Option("--robot", metavar="R", help="A robot's name, or a path to a URDF or MJCF.")],
    legs: Annotated[
        str | None, typer.Option(metavar="RH,...", help="Legs to identify [default: all]. LF, RF, LH, RH in any case.")
    ] = None,
    validate: Annotated[
        list[Path] | None, typer.Option(metavar="LOG", help="Judge on this log instead of a part of LOG; repeatable.")
    ] = None,
    split: Annotated[
        str | None,
        typer.Option(metavar="SHARE", help="Share of each LOG to fit [default: 0.5]; 'none' fits all, judges on it."),
    ] = None,
    method: Annotated[
        Method, typer.Option(help="Physically consistent, or CAD in the null space.")
    ] = Method.CONSISTENT,
    friction: Annotated[
        str,
        typer.Option(metavar="TERMS", help="Joint terms to fit: some of armature,viscous,coulomb,offset; or 'none'."),
    ] = "armature,viscous,coulomb,offset",
    cutoff: Annotated[
        str, typer.Option(metavar="HZ|auto|none", help="Low-pass cut-off; 'auto' takes it from the motion.")
    ] = "auto",
    torque_lag: Annotated[
        str, typer.Option(metavar="SECONDS|auto", help="How much later torques act than stamped; 'auto' finds it.")
    ] = "auto",
    up: Annotated[
        str, typer.Option(metavar="X,Y,Z|auto", help="The vertical in the trunk's axes; 'auto': the IMU's, else level.")
    ] = "auto",
    joint_topic: JointTopic = None,
    imu_topic: ImuTopic = None,
    json: Annotated[Path | None, typer.Option("--json", metavar="F", help="Write the result as JSON.")] = None,
    report: Annotated[Path | None, typer.Option(metavar="F.html", help="Write a report to open in a browser.")] = None,
    export: Annotated[
        Path | None, typer.Option(metavar="F.urdf", help="Write the model file with the identified values put in.")
    ] = None,
) -> None:
    """Identify legs from logs of a robot on a stand, legs in the air.

    Finds mass, centre of mass and inertia of each link as far as the motion shows them, and each joint's rotor
    inertia, friction and torque offset; says what could not be told, and how well torques are predicted.
    """
    if validate and split is not None:
        raise typer.BadParameter("give --validate or --split, not both", param_hint="--split")
    chosen_legs, chosen_terms = parse.names(legs), parse.terms(friction)
    cutoff_hz, lag, vertical = parse.cutoff(cutoff), parse.torque_lag(torque_lag), parse.direction(up)
    share = 1.0 if validate else parse.split(split or "0.5")

    from stadera.identify.settings import IdentifySettings
    from stadera.regressors.friction import FrictionModel
    from stadera.report.tables import identification_tables
    from stadera.robot import load_robot
    from stadera.robot.export import check_export

    settings = IdentifySettings(
        chosen_legs, method.value, FrictionModel(chosen_terms), cutoff_hz, torque_lag=lag, up=vertical, split=share
    )
    model = load_robot(robot)
    check_outputs((json, report, export), inputs=[*logs, *(validate or ())])
    if export is not None:
        check_export(model, export)
    fitted, judged = ([log_file(path, joint_topic, imu_topic) for path in paths] for paths in (logs, validate or ()))
    result = _identified(model, fitted, judged, settings)
    _write(result, json, report, export)
    show(*identification_tables(result))


def _identified(
    robot: Robot, fitted: list[LogFile], judged: list[LogFile], settings: IdentifySettings
) -> Identification:
    from stadera.identify.legs import identify as identify_legs

    with progress() as watch:
        return identify_legs(robot, fitted, settings, judged or None, watch)


def _write(result: Identification, json: Path | None, report: Path | None, export: Path | None) -> None:
    """All outputs or none."""
    from stadera.report.json import identification_json, json_text
    from stadera.robot.export import export_model

    def page() -> str:
        from stadera.report.html import identification_html

        return identification_html(result)

    write_outputs(
        (json, text_of(lambda: json_text(identification_json(result)))),
        (report, text_of(page)),
        (export, lambda draft: export_model(result.identified_robot(), draft)),
    )
