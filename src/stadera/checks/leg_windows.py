"""Checks legs, torques and gyro against each other while the robot moves, window by window.

- A foot that is raised and moves relative to the standing feet carries no load. If the load computed from the torques,
  -up · J^-T τ, is on raised feet instead of standing ones, torques and encoders belong to different legs.
- Feet that stand do not move relative to each other: with foot i at p_i moving by u_i = J_i q̇_i in the trunk, which
  rotates with ω,

      (u_i - u_j) + ω x (p_i - p_j) = 0.

  So the right gyro is the one that leaves least of this: as recorded, rotated about the vertical, reversed, or zero.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from stadera.body.statics import LegModel, cross
from stadera.checks.limits import WindowLimits
from stadera.checks.units import DEGREE
from stadera.checks.windows import WindowFault, Windows, joint_faults
from stadera.constants import GRAVITY
from stadera.logs.recording import Recording
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trust import Verdict
from stadera.types import Array, Bools

_AT_ONCE = 4096  # samples whose legs are computed at a time, which bounds the memory
_GYROS = {
    "reads the opposite of its rotation": -np.eye(3),
    "is turned by 90° about the vertical": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "is turned by -90° about the vertical": np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "is turned by 180° about the vertical": np.diag([-1.0, -1.0, 1.0]),
    "has roll and yaw reversed, as if left and right were swapped": np.diag([-1.0, 1.0, -1.0]),
}

_SURVIVED = {"position"}
"""Channels whose lasting faults only change geometry, which the error bars cover up to a few degrees."""


class _Feet:
    """State of the legs at some samples: (samples, 4, ...), trunk axes."""

    def __init__(self, recording: Recording, robot: Robot, mount: ImuMount, limits: WindowLimits) -> None:
        time = recording.time
        every = max(1, round(1.0 / (limits.rate * float(np.median(np.diff(time))))))
        kept = slice(None, None, every)
        model, joints = LegModel.of(robot), robot.tree.joints
        imu = recording.imu
        assert imu is not None
        position, velocity, effort = (
            recording.channel(name, joints)[kept][:, model.columns] for name in ("position", "velocity", "effort")
        )
        self.time = time[kept]
        self.force = mount.in_trunk_axes(imu.linear_acceleration[kept])
        self.gyro = mount.in_trunk_axes(imu.angular_velocity[kept])
        count = min(len(self.time), max(1, round(limits.levelled / float(np.median(np.diff(self.time))))))
        up = _upwards(self.force, self.gyro, self.time, count)
        pieces = [slice(k, k + _AT_ONCE) for k in range(0, len(self.time), _AT_ONCE)]
        parts = [_of_legs(model, position[k], velocity[k], effort[k], self.force[k]) for k in pieces]
        self.place, self.motion, forces = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        self.load = np.einsum("nli,ni->nl", forces, up) / (robot.mass * GRAVITY)
        self.height = np.einsum("nli,ni->nl", self.place, up) / model.length
        self.windows = Windows.of(self.time, limits.length)


def _upwards(force: Array, gyro: Array, time: Array, count: int) -> Array:
    """The vertical (samples, 3), trunk axes: the mean of the specific force over `count` samples, turned by what the
    gyro says the trunk has turned since their middle, u̇ = -ω x u. Without that a trunk that pitches as it bounds seems
    to lift its feet.
    """
    ones, steps = np.ones(count), np.diff(time, prepend=time[:1])[:, None]
    near = np.convolve(np.ones(len(time)), ones, "same")[:, None]
    turned = np.cumsum(gyro * steps, axis=0)
    away = turned - np.column_stack([np.convolve(x, ones, "same") for x in turned.T]) / near
    mean = np.column_stack([np.convolve(x, ones, "same") for x in force.T]) / near
    up = mean - np.cross(away, mean)
    return np.asarray(up / np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-9))


def _of_legs(
    model: LegModel, position: Array, velocity: Array, effort: Array, force: Array
) -> tuple[Array, Array, Array]:
    """Positions and velocities of the feet in the trunk, and contact forces, (samples, 4, 3), trunk axes."""
    statics = model.statics(position, force / np.linalg.norm(force, axis=1, keepdims=True))
    pose = statics.pose
    jacobian = cross(pose.axis, pose.feet[:, :, None] - pose.joints)
    motion = (jacobian * velocity.transpose(1, 2, 0)).sum(axis=2)
    carried = statics.force(statics.torque(force) - effort.transpose(1, 2, 0))
    return pose.feet.transpose(2, 1, 0), motion.transpose(2, 1, 0), carried.transpose(2, 1, 0)


def leg_faults(recording: Recording, robot: Robot, mount: ImuMount, limits: WindowLimits) -> Iterator[WindowFault]:
    """Yields faults that show between legs, torques and gyro, of a recording with the robot's joints, their velocities
    and torques, and an IMU.
    """
    if len(recording) < limits.fewest or recording.imu is None:
        return
    feet = _Feet(recording, robot, mount, limits)
    raised, low = _swinging(feet, limits)
    yield from _loads(feet, raised, low, robot, limits)
    yield from _gyro(feet, ~raised & (feet.load > limits.carries[0]), limits)


def _swinging(feet: _Feet, limits: WindowLimits) -> tuple[Bools, Bools]:
    """Feet that swing, and feet that are near their lowest position in the window, (samples, 4).

    A foot swings if it is higher above its own lowest position than two others are above theirs, by a share of the
    leg's length, and moves relative to them.
    """
    lowest = np.array(
        [np.percentile(feet.height[feet.windows.of_sample == k], 10, axis=0) for k in range(len(feet.windows))]
    )
    above = feet.height - lowest[feet.windows.of_sample]
    order = np.argsort(above, axis=1)
    above = above - np.take_along_axis(above, order[:, :2], axis=1).mean(axis=1)[:, None]
    pair = np.take_along_axis(feet.motion + cross_rows(feet.gyro, feet.place), order[:, :2, None], axis=1).mean(axis=1)
    speed = np.linalg.norm(feet.motion + cross_rows(feet.gyro, feet.place) - pair[:, None], axis=-1)
    raised = (above > limits.raised[0]) & (speed > limits.raised[1])
    return raised, above < 0.5 * limits.raised[0]


def cross_rows(vector: Array, points: Array) -> Array:
    """ω x p of vectors (samples, 3) with points (samples, 4, 3)."""
    return np.cross(vector[:, None], points)


def _loads(feet: _Feet, raised: Bools, low: Bools, robot: Robot, limits: WindowLimits) -> Iterator[WindowFault]:
    windows = feet.windows
    count = np.maximum(np.bincount(windows.of_sample, minlength=len(windows)), 1)[:, None]

    def mean(which: Bools) -> tuple[Array, Array]:
        number = windows.sums(which.astype(float))
        return windows.sums(np.where(which, feet.load, 0.0)) / np.maximum(number, 1.0), number / count

    (up, share_up), (down, share_down) = mean(raised), mean(low)
    seen = (share_up > limits.share) & (share_down > limits.share)
    wrong = seen & (up > limits.carries[0]) & (up > limits.carries[1] * down)
    often = wrong.sum(axis=0) > limits.often * np.maximum(seen.sum(axis=0), 1)
    often &= (wrong.sum(axis=0) > 1) & (often.sum() > 1)  # two legs are swapped, and not just for a moment
    for k, leg in enumerate(robot.legs):
        if often[k]:
            chosen = wrong[:, k]
            text = (
                f"carries {100 * float(np.median(up[chosen, k])):.0f} % of the weight while its foot is raised, and "
                f"{100 * float(np.median(down[chosen, k])):.0f} % while it is down: torques are another leg's"
            )
            yield WindowFault("legs", f"leg {leg.name}", text, windows.spans(chosen), lasting=True)


def _gyro(feet: _Feet, standing: Bools, limits: WindowLimits) -> Iterator[WindowFault]:
    """Finds the gyro that leaves least relative motion of the standing feet. Errors of successive samples are
    correlated.
    """
    pairs = [(i, j, standing[:, i] & standing[:, j]) for i, j in combinations(range(4), 2)]
    moved = np.concatenate([(feet.motion[:, i] - feet.motion[:, j])[both] for i, j, both in pairs])
    apart = np.concatenate([(feet.place[:, i] - feet.place[:, j])[both] for i, j, both in pairs])
    gyro = np.concatenate([feet.gyro[both] for _, _, both in pairs])
    if len(moved) < limits.fewest:
        return
    slips = limits.slip**2

    def left(turn: Array) -> float:
        rest = moved + np.cross(gyro @ turn.T, apart)
        return float(np.minimum((rest**2).sum(axis=1), slips).mean())

    own, none = left(np.eye(3)), left(np.zeros((3, 3)))
    others = {name: left(turn) for name, turn in _GYROS.items()}
    best = min(others, key=lambda name: others[name])
    independent = len(moved) / limits.repeated
    spans = feet.windows.spans(np.ones(len(feet.windows), dtype=bool))
    evidence = independent * (min(own, none) / max(others[best], 1e-12) - 1.0)
    # better than no rotation, too, of which noise at rest cannot be told
    if evidence > limits.evidence and others[best] < limits.turned * own:
        yield WindowFault("imu", "the gyro", f"{best}, by the feet that stand", spans, lasting=True)
    elif none < limits.better * own:
        text = "contradicts the feet that stand, which turn less"
        if left(DEGREE * np.eye(3)) < limits.better * own:
            text += ", as one in deg/s would (add --units gyro=deg/s)"
        yield WindowFault("imu", "the gyro", text, spans, lasting=True)


def window_faults(
    recording: Recording, robot: Robot, imu_frame: str | None = None, limits: WindowLimits | None = None
) -> tuple[WindowFault, ...]:
    """Finds contradictions between the signals of a log with all of the robot's joints, window by window. Velocities as
    measured, None if they were not; IMU frame None for the recording's own, else the model's. Raises UnknownNameError:
    no such frame.
    """
    limits = limits or WindowLimits()
    found = list(joint_faults(recording, robot, limits))
    imu = recording.imu
    complete = recording.velocity is not None and recording.effort is not None and robot.quadruped
    if imu is not None and complete and not any(fault.channel == "velocity" for fault in found):
        found += leg_faults(recording, robot, ImuMount.of(robot, imu_frame or imu.frame), limits)
    return tuple(found)


def with_verdicts(
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
