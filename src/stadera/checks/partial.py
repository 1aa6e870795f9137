"""Faults in part of a log: found by all checks over windows, and what is to be done about each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from stadera.checks.leg_windows import leg_faults
from stadera.checks.limits import WindowLimits
from stadera.checks.windows import WindowFault, joint_faults
from stadera.logs.recording import Recording
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trust import Verdict

_SURVIVED = {"position"}
"""Channels whose lasting faults change geometry alone, which the error bars contain up to a few degrees."""


def window_faults(
    recording: Recording, robot: Robot, imu_frame: str | None = None, limits: WindowLimits | None = None
) -> tuple[WindowFault, ...]:
    """What the signals of a log say against each other, window by window.

    Args:
        recording: with all of the robot's joints; velocities as they were measured, None where they were not.
        robot: its model.
        imu_frame: frame of the IMU's values; None for the recording's own, else the model's.
        limits: None for the defaults.

    Raises:
        UnknownNameError: no such frame.
    """
    limits = limits or WindowLimits()
    found = list(joint_faults(recording, robot, limits))
    imu = recording.imu
    complete = recording.velocity is not None and recording.effort is not None
    if imu is not None and complete and not any(fault.channel == "velocity" for fault in found):
        found += leg_faults(recording, robot, ImuMount.of(robot, imu_frame or imu.frame), limits)
    return tuple(found)


def judged(
    faults: Sequence[WindowFault], duration: float, limits: WindowLimits
) -> Iterator[tuple[WindowFault, Verdict | None]]:
    """Each fault with the verdict that the log falls to; None where its windows are left out instead.

    Windows are left out while all that are left out come to a small part of the log [s].
    """
    out: set[tuple[float, float]] = set()
    for fault in sorted(faults, key=lambda fault: len(fault.windows)):
        with_it = out | set(fault.windows)
        if fault.lasting:
            yield fault, "doubtful" if fault.channel in _SURVIVED else "bad"
        elif sum(end - begin for begin, end in with_it) <= limits.left_out * duration:
            out = with_it
            yield fault, None
        else:
            yield fault, "bad"
