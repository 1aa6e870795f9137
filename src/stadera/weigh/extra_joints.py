"""Prepares robot and logs for joints that belong to no leg: of an arm, or a lidar that turns.

Where a log has their positions they move as recorded, and the trunk's values are those with them where they are at the
log's beginning. Where it lacks them they are held at the model's zero.
"""

from dataclasses import replace

from stadera.errors import RecordingError
from stadera.logs import Recording, stream
from stadera.logs.reader import HEAD_ROWS
from stadera.logs.recording import OtherJoints
from stadera.robot.model import Robot
from stadera.weigh.settings import Source

_COMPLETE = 0.9  # share of the samples that must have them


def with_extra_joints(robot: Robot, *logs: Source) -> tuple[Robot, tuple[Source, ...], tuple[str, ...]]:
    """Returns the robot posed as at the beginning of the first of the logs that has its joints outside the legs, the
    logs with instructions to read these joints, and notes. A robot without such joints is returned unchanged.
    """
    extra = robot.extra
    if extra is None:
        return robot, logs, ()
    read = [_reading_others(robot, log, extra.joints) for log in logs]
    notes: list[str] = []
    for log, recorded in read:
        if lacking := [joint for joint in extra.joints if recorded is None or joint not in recorded.names]:
            notes.append(f"{_listed(lacking)} of no leg: not in {log.name}, held at the model's zero")
    posed = posed_as(robot, next((recorded for _, recorded in read if recorded is not None), None))
    if posed is not robot and posed.extra is not None:
        angles = ", ".join(f"{value:.3g}" for value in posed.extra.reference)
        notes.append(
            f"{_listed(extra.joints)} of no leg: they move as recorded, with the model's inertia; the trunk's "
            f"values are those with them at {angles} (rad or m), as at the beginning"
        )
    return posed, tuple(log for log, _ in read), tuple(dict.fromkeys(notes))


def posed_as(robot: Robot, recorded: OtherJoints | None) -> Robot:
    """The robot with its joints outside the legs where they are at the beginning of a recording, if it has them."""
    if recorded is None:
        return robot
    return robot.posed(dict(zip(recorded.names, recorded.position[0].tolist(), strict=True)))


def _reading_others(robot: Robot, log: Source, joints: tuple[str, ...]) -> tuple[Source, OtherJoints | None]:
    """The log that also reads these joints, and what it begins with; the log itself if it lacks them or has gaps."""
    if isinstance(log, Recording):
        other: Source = log.with_others(joints)
    else:
        other = replace(log, reading=replace(log.reading, others=joints))
    try:
        first = next(stream(other, joints=robot.tree.joints, rows=HEAD_ROWS), None)
        if first is not None and first.others is not None:
            whole = next(stream(log, joints=robot.tree.joints, rows=HEAD_ROWS))
            if len(first) >= _COMPLETE * len(whole):
                return other, first.others
    except RecordingError:
        pass  # whoever reads the log says why
    return log, None


def _listed(joints: list[str] | tuple[str, ...]) -> str:
    return f"joint{'s' * (len(joints) > 1)} {', '.join(joints)}"
