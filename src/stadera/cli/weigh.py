"""`stadera weigh`: mass and centre of mass of a standing robot's trunk, and of what was put on it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stadera.cli import parse
from stadera.cli.outputs import check_outputs, text_of, write_outputs
from stadera.cli.terminal import progress, show
from stadera.cli.topics import ImuTopic, JointTopic, log_file

if TYPE_CHECKING:
    from stadera.recording import LogFile
    from stadera.robot import Robot
    from stadera.simulate.truth import Truth
    from stadera.weigh import MotionWeighing, Weighing, WeighSettings


def weigh(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Of a robot that stands still, at least at times.")],
    robot: Annotated[str, typer.Option("--robot", metavar="R", help="A robot's name, or a path to a URDF or MJCF.")],
    method: Annotated[
        str | None,
        typer.Option(
            metavar="walking|contact|orientation|poses|combined",
            help="How; walking needs no rest, poses and combined no IMU [default: contact, or poses without an IMU].",
        ),
    ] = None,
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
        typer.Option(metavar="F.urdf", help="Write the model (URDF, MJCF): payload as a link; trunk without --tare."),
    ] = None,
) -> None:
    """Weigh a robot from its log: trunk with payload, where its centre of mass is, when the load changed.

    With --method walking from any motion, every instant of it. Else from the times at rest: the mass is the ground's
    upward force (eq. 7) where the robot stands still, and refused elsewhere. --tare tells the payload by the
    difference.
    """
    springs = None if stiffness is None else parse.point(stiffness)
    chosen_tare = None if tare is None else _tare(tare, joint_topic, imu_topic)

    from stadera.simulate.truth import read_truth
    from stadera.weigh import WeighSettings

    settings = WeighSettings(method, chosen_tare, imu_frame, springs)
    model = _robot(robot, legs)
    outputs = _Outputs(json, report, export)
    outputs.check(log, model)
    known = None if truth is None else read_truth(truth)
    weigh_and_show = _in_motion if method == "walking" else _at_rest
    weigh_and_show(model, log_file(log, joint_topic, imu_topic), settings, known, outputs)


@dataclass(frozen=True)
class _Outputs:
    """The files asked for."""

    json: Path | None
    report: Path | None
    export: Path | None

    def check(self, log: Path, robot: Robot) -> None:
        """What can be known of them before the work."""
        check_outputs((self.json, self.report, self.export), inputs=[log])
        if self.export is not None:
            from stadera.robot.export import check_export

            check_export(robot, self.export)


def _tare(given: str, joint_topic: str | None, imu_topic: str | None) -> tuple[float, float] | LogFile:
    """A range of time, or another log."""
    chosen = parse.tare(given)
    return log_file(chosen, joint_topic, imu_topic) if isinstance(chosen, Path) else chosen


def _robot(name: str, legs: Path | None) -> Robot:
    """The robot, with its legs as identified where they are given."""
    from stadera.robot import load_robot
    from stadera.robot.identified import with_identified_legs

    robot = load_robot(name)
    return robot if legs is None else with_identified_legs(robot, legs)


def _in_motion(robot: Robot, log: LogFile, settings: WeighSettings, truth: Truth | None, outputs: _Outputs) -> None:
    """Weighs a robot that moves, writes all outputs or none, and shows what was found."""
    from stadera.report.json import json_text
    from stadera.report.motion import motion_json, motion_tables
    from stadera.weigh import weigh_in_motion

    def page() -> str:
        from stadera.report.motion_html import motion_html

        return motion_html(result, truth)

    with progress() as watch:
        result = weigh_in_motion(robot, log, settings.tare, settings.imu_frame, watch)
    write_outputs(
        (outputs.json, text_of(lambda: json_text(motion_json(result)))),
        (outputs.report, text_of(page)),
        (outputs.export, lambda draft: _export(result, draft)),
    )
    show(*motion_tables(result, truth))


def _at_rest(robot: Robot, log: LogFile, settings: WeighSettings, truth: Truth | None, outputs: _Outputs) -> None:
    """Weighs a robot at its times at rest, writes all outputs or none, and shows what was found."""
    from stadera.report.json import json_text
    from stadera.report.weighing import weighing_json, weighing_tables
    from stadera.weigh import weigh as weigh_log

    def page() -> str:
        from stadera.report.weighing_html import weighing_html

        return weighing_html(result, truth)

    with progress() as watch:
        result = weigh_log(robot, log, settings, watch)
    write_outputs(
        (outputs.json, text_of(lambda: json_text(weighing_json(result)))),
        (outputs.report, text_of(page)),
        (outputs.export, lambda draft: _export(result, draft)),
    )
    show(*weighing_tables(result, truth))


def _export(result: Weighing | MotionWeighing, path: Path) -> None:
    """The model as weighed."""
    from stadera.robot.export import export_model
    from stadera.weigh import weighed_model

    model = weighed_model(result)
    export_model(model.robot, path, model.payload, model.note)
