"""Faults in part of a log: finds them by all checks over windows, and decides what to do about each."""

from collections.abc import Iterator, Sequence

from stadera.checks.leg_windows import leg_faults
from stadera.checks.limits import WindowLimits
from stadera.checks.windows import WindowFault, joint_faults
from stadera.logs.recording import Recording
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trust import Verdict

_SURVIVED = {"position"}
"""Channels whose lasting faults only change geometry, which the error bars cover up to a few degrees."""


def window_faults(
    recording: Recording, robot: Robot, imu_frame: str | None = None, limits: WindowLimits | None = None
) -> tuple[WindowFault, ...]:
    """Finds contradictions between the signals of a log, window by window.

    Args:
        recording: with all of the robot's joints; velocities as measured, None if they were not.
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
    """Yields each fault with its verdict on the log; None if its windows are skipped instead.

    Windows are skipped as long as all skipped ones cover a small part of the log [s].
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
