"""`stadera weigh`: mass and centre of mass of a standing robot's trunk, and of what was put on it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stadera.cli import parse
from stadera.cli.terminal import progress, show
from stadera.cli.topics import ImuTopic, JointTopic, log_file

if TYPE_CHECKING:
    from stadera.recording import LogFile
    from stadera.robot import Robot
    from stadera.simulate.truth import Truth
    from stadera.weigh import Weighing, WeighSettings


def weigh(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Of a robot that stands still, at least at times.")],
    robot: Annotated[str, typer.Option("--robot", metavar="R", help="A robot's name, or a path to a URDF or MJCF.")],
    method: Annotated[
        str, typer.Option(metavar="walking|contact|orientation|poses|combined", help="How; 'walking' needs no rest.")
    ] = "contact",
    tare: Annotated[
        str | None,
        typer.Option(metavar="T0:T1|LOG", help="Time [s] in LOG, or another log, without the payload."),
    ] = None,
    stiffness: Annotated[
        str | None,
        typer.Option(metavar="KX,KY,KZ", help="Of the trunk controller about its axes [N·m/rad], for 'orientation'."),
    ] = None,
    legs: Annotated[
        Path | None,
        typer.Option("--legs", metavar="F.json", help="Legs, friction and rotor inertia as `identify --json` found."),
    ] = None,
    imu_frame: Annotated[
        str | None, typer.Option(metavar="NAME", help="Frame that the IMU's values are in [default: the model's IMU].")
    ] = None,
    joint_topic: JointTopic = None,
    imu_topic: ImuTopic = None,
    truth: Annotated[
        Path | None, typer.Option(metavar="F.truth.json", help="Of a simulated log, to be shown beside what was found.")
    ] = None,
    json: Annotated[Path | None, typer.Option("--json", metavar="F", help="Write the result as JSON.")] = None,
    report: Annotated[Path | None, typer.Option(metavar="F.html", help="Write a report to open in a browser.")] = None,
    export: Annotated[
        Path | None,
        typer.Option(metavar="F.urdf", help="Write the model (URDF, MJCF) with the payload as a link; needs --tare."),
    ] = None,
) -> None:
    """Weigh a robot from its log: trunk with payload, where its centre of mass is, when the load changed.

    With --method walking from any motion, every instant of it. Else from the times at rest: the mass is the ground's
    upward force (eq. 7) where the robot stands still, and refused elsewhere. --tare tells the payload by the
    difference.
    """
    chosen_tare: tuple[float, float] | Path | LogFile | None = None if tare is None else parse.tare(tare)
    springs = None if stiffness is None else parse.point(stiffness)
    if export is not None and tare is None:
        raise typer.BadParameter("needs --tare: a payload is told by the difference", param_hint="--export")

    from stadera.report.weighing import weighing_tables
    from stadera.robot import load_robot
    from stadera.simulate.truth import read_truth
    from stadera.weigh import WeighSettings
    from stadera.weigh import weigh as weigh_log

    if isinstance(chosen_tare, Path):
        chosen_tare = log_file(chosen_tare, joint_topic, imu_topic)
    settings = WeighSettings(method, chosen_tare, imu_frame, springs)
    model = load_robot(robot)
    if legs is not None:
        from stadera.robot.identified import with_identified_legs

        model = with_identified_legs(model, legs)
    if method == "walking" and export is not None:
        raise typer.BadParameter("is for robots weighed at rest, by another --method", param_hint="--export")
    _check_outputs(log, json, report, export)
    if export is not None:
        from stadera.robot.export import check_export

        check_export(model, export)
    known = None if truth is None else read_truth(truth)
    if method == "walking":
        _in_motion(model, log_file(log, joint_topic, imu_topic), settings, known, json, report)
        return
    with progress() as watch:
        result = weigh_log(model, log_file(log, joint_topic, imu_topic), settings, watch)
    _write(result, known, json, report, export)
    show(*weighing_tables(result, known))


def _in_motion(
    robot: Robot, log: LogFile, settings: WeighSettings, truth: Truth | None, json: Path | None, report: Path | None
) -> None:
    """Weighs a robot that moves, writes all outputs or none, and shows what was found."""
    from stadera.files import written_together
    from stadera.report.json import json_text
    from stadera.report.motion import motion_json, motion_tables
    from stadera.weigh import weigh_in_motion

    with progress() as watch:
        result = weigh_in_motion(robot, log, settings.tare, settings.imu_frame, watch)
    with written_together([path for path in (json, report) if path is not None]) as drafts:
        waiting = iter(drafts)
        if json is not None:
            next(waiting).write_text(json_text(motion_json(result)), encoding="utf-8")
        if report is not None:
            from stadera.report.motion_html import motion_html

            next(waiting).write_text(motion_html(result, truth), encoding="utf-8")
    show(*motion_tables(result, truth))


def _check_outputs(log: Path, *outputs: Path | None) -> None:
    from stadera.errors import StaderaError
    from stadera.files import require_writable

    for path in outputs:
        if path is not None and require_writable(path).resolve() == log.resolve():
            raise StaderaError(f"{path}: would replace an input")


def _write(result: Weighing, truth: Truth | None, json: Path | None, report: Path | None, export: Path | None) -> None:
    """All outputs or none."""
    from stadera.files import written_together
    from stadera.report.json import json_text
    from stadera.report.weighing import weighing_json

    with written_together([path for path in (json, report, export) if path is not None]) as drafts:
        waiting = iter(drafts)
        if json is not None:
            next(waiting).write_text(json_text(weighing_json(result)), encoding="utf-8")
        if report is not None:
            from stadera.report.weighing_html import weighing_html

            next(waiting).write_text(weighing_html(result, truth), encoding="utf-8")
        if export is not None and result.payload is not None:
            from stadera.robot.export import export_model
            from stadera.weigh import payload_link

            link = payload_link(result.payload, result.robot.inertias[result.robot.trunk].com)
            export_model(result.robot, next(waiting), link)
