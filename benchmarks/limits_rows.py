"""Rows of a simulated log with all model errors as unknowns. The rows are those of the estimator,
`stadera.trunk.rows`, in the unit of `unit_of_rows`,

    A θ + C p = b + e

and for legs in the air three rows of their joints more, S p = -(h - τ), with h the torques of the model's rigid bodies:

    rotor, friction, offset, lag            as in `stadera.trunk.swing`
    gain                                    τ
    links, encoders, axes of the IMU        derivatives of h by differences; h is linear in the links' ten parameters
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from limits_truth import ERRORS, PLACES
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from stadera.body import Body, Motion
from stadera.inertia import InertialParameters
from stadera.robot import Robot
from stadera.robot.imu import ImuMount
from stadera.trunk.block_rows import BlockRows
from stadera.trunk.front import Front
from stadera.trunk.samples import SampleBuffer, Samples
from stadera.trunk.segment import robot_weight, unit_of_rows
from stadera.trunk.settings import TrunkSettings
from stadera.trunk.window import half_window
from stadera.types import Array, Bools

_STEP, _SHIFT = 1e-5, 1e-3  # rad; m or s, of differences
_OF_TRUNK = ("angular_velocity", "angular_acceleration", "specific_force")
_AXES = np.eye(3)


@dataclass(frozen=True, eq=False)
class LogRows:
    """All rows of a log, with B blocks and n swing rows.

    Attributes:
        time: (B,) [s]. matrix: (B, 6, 10), A. errors: (B, 6, ERRORS), C. target: (B, 6), b.
        swing: (n, ERRORS), S. swing_target: (n,), -(h - τ) [N·m]. swing_at: (n, 2), block and joint.
    """

    time: Array
    matrix: Array
    errors: Array
    target: Array
    swing: Array
    swing_target: Array
    swing_at: Array

    @classmethod
    def of(
        cls, robot: Robot, samples: Samples, trunk: InertialParameters, errors: Array, settings: TrunkSettings
    ) -> LogRows:
        """Of all blocks that the estimator would use; with the true trunk, at which errors of the IMU are linearised,
        and the true model errors (ERRORS,), with which all legs in the air are found.
        """
        maker = Front(robot, ImuMount.of(robot), settings)
        maker.shape = trunk
        known = errors[PLACES["rotor"].start : PLACES["coulomb"].stop].reshape(3, 12)
        maker.know_joints(known, np.zeros((3, 12)))
        made: list[tuple[BlockRows, tuple[Array, Array]]] = []
        before: Array | None = None
        for stretch in SampleBuffer(robot.tree.joints, settings).take(samples.table):
            if stretch.gap:
                maker.interrupt()
            for table in stretch.blocks:
                block, times = maker.blocks(table, (len(table) - 2,))[0], table[1:-1, 0]
                if block.rows is not None and not block.struck and before is not None:
                    made.append((block.rows, (before, times)))
                before = times
        return cls._of(made, robot, _JointEffects(robot, samples) if any(r.swing.air.any() for r, _ in made) else None)

    @classmethod
    def _of(
        cls, made: list[tuple[BlockRows, tuple[Array, Array]]], robot: Robot, joints: _JointEffects | None
    ) -> LogRows:
        unit = unit_of_rows(robot_weight(robot), robot.leg_length)
        columns = np.array([rows.columns for rows, _ in made]) / unit[:, None]
        swing = [
            (b, *_swing_rows(rows, joints.averaged(*times)))
            for b, (rows, times) in enumerate(made)
            if joints is not None and rows.swing.air.any()
        ]
        C = columns[:, :, 11:].copy()
        for name in ("sampling", "common_gain"):  # noise, noise, and the mean of `gain`
            C[:, :, PLACES[name]] = 0.0
        return cls(
            np.array([rows.time for rows, _ in made]),
            columns[:, :, :10],
            C,
            columns[:, :, 10],
            np.concatenate([s[1] for s in swing]) if swing else np.zeros((0, ERRORS)),
            np.concatenate([s[2] for s in swing]) if swing else np.zeros(0),
            np.array([(s[0], j) for s in swing for j in s[3]], dtype=int).reshape(-1, 2),
        )

    def chosen(self, which: Bools) -> LogRows:
        """The rows of some blocks (B,) alone."""
        swinging, place = which[self.swing_at[:, 0]], np.cumsum(which) - 1
        at = self.swing_at[swinging]
        at[:, 0] = place[at[:, 0]]
        loaded = (self.time[which], self.matrix[which], self.errors[which], self.target[which])
        return LogRows(*loaded, self.swing[swinging], self.swing_target[swinging], at)


def _swing_rows(rows: BlockRows, effects: Array) -> tuple[Array, Array, NDArray[np.int_]]:
    """Rows (k, ERRORS), targets (k,) and joints (k,) of the legs in the air in one block."""
    swing, each = rows.swing, np.arange(12)
    S = effects.copy()
    for term, name in enumerate(("rotor", "viscous", "coulomb", "load_friction", "offset")):
        S[each, PLACES[name].start + each] = swing.terms[term]
    S[:, PLACES["torque_lag"].start] = -swing.rate
    used = np.flatnonzero(swing.air.repeat(3))
    return S[used], -swing.residual[used], used


class _JointEffects:
    """Derivatives of h - τ by gains, links, encoders, IMU axes and lag of the velocities, at all samples of a log."""

    def __init__(self, robot: Robot, samples: Samples) -> None:
        self.time, legs = samples.time[1:-1], Body.of(robot).in_legs.reshape(4, 3)
        motion, jerk = _motion(robot, samples)
        h, tau = _torque(robot, motion), samples.effort[1:-1][:, legs]
        own: list[tuple[str, int, Array]] = []  # kind of error, joint or link of each leg, effect (n, 4, 3)
        shared: list[tuple[str, int, Array]] = []  # one error for all legs
        for k in range(3):
            own.append(("gain", k, tau * _AXES[k]))
            step = np.zeros(motion.position.shape[1])
            step[legs[:, k]] = _STEP
            moved = motion._replace(position=motion.position + step)
            own.append(("encoder", k, (h - _torque(robot, moved)) / _STEP))
            own.append(("link_mass", k, _torque(_with_links(robot, k, 2.0, np.zeros(3)), motion) - h))
            for axis in range(3):
                other = _with_links(robot, k, 1.0, _SHIFT * _AXES[axis])
                own.append(("link_com", 12 * axis + k, (_torque(other, motion) - h) / _SHIFT))
            turn = Rotation.from_rotvec(-_STEP * _AXES[k]).as_matrix()
            tilted = motion._replace(**{name: getattr(motion, name) @ turn.T for name in _OF_TRUNK})
            shared.append(("imu_rotation", k, (_torque(robot, tilted) - h) / _STEP))
        late = motion._replace(acceleration=motion.acceleration + _SHIFT * jerk)
        shared.append(("velocity_lag", 0, (_torque(robot, late) - h) / _SHIFT))
        self._values = np.stack([effect.reshape(-1, 12) for *_, effect in own + shared], axis=-1)
        # each error's column, by joint (12, errors)
        legs = 3 * (np.arange(12)[:, None] // 3)
        starts = np.array([PLACES[name].start + k for name, k, _ in own + shared])
        self._columns = starts + legs * (np.arange(len(starts)) < len(own))

    def averaged(self, first: Array, second: Array) -> Array:
        """(12, ERRORS), over the window of two blocks, by the times of their samples."""
        out, total = np.zeros((12, ERRORS)), np.zeros(self._values.shape[1:])
        for times, falls in ((first, False), (second, True)):
            weights = half_window(len(times))
            begin = int(np.searchsorted(self.time, times[0] - 1e-9))
            total += np.tensordot(weights[:: -1 if falls else 1], self._values[begin : begin + len(times)], 1)
        out[np.arange(12)[:, None], self._columns] = total
        return out


def _motion(robot: Robot, samples: Samples) -> tuple[Motion, Array]:
    """The motion at all samples but the first and last, and the rates of the joints' accelerations."""
    lever = ImuMount.of(robot).translation
    span, omega = (samples.time[2:] - samples.time[:-2])[:, None], samples.angular_velocity[1:-1]
    alpha = (samples.angular_velocity[2:] - samples.angular_velocity[:-2]) / span
    a = samples.specific_force[1:-1] - np.cross(alpha, lever) - np.cross(omega, np.cross(omega, lever))
    q, v = samples.position[1:-1], samples.velocity
    acceleration = (v[2:] - v[:-2]) / span
    jerk = (v[2:] - 2.0 * v[1:-1] + v[:-2]) / (0.5 * span) ** 2
    up = _AXES[2]  # of the ground, which no torque h depends on
    return Motion(q, v[1:-1], acceleration, omega, alpha, a, up), jerk


def _torque(robot: Robot, motion: Motion) -> Array:
    """h (n, 4, 3)."""
    body = Body.of(robot, others=False)
    return body.left(body.at(motion), motion, np.zeros(motion.position.shape)).reshape(-1, 4, 3)


def _with_links(robot: Robot, k: int, scale: float, shift: Array) -> Robot:
    """The robot with the k-th link of every leg scaled and shifted."""
    changed = {
        leg.links[k]: InertialParameters(scale * robot.inertias[leg.links[k]].vector).shifted(shift)
        for leg in robot.legs
    }
    return replace(robot, inertias={**robot.inertias, **changed})
