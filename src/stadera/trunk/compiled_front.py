"""`Front` by compiled functions where numba is installed."""

from __future__ import annotations

from math import sqrt
from types import ModuleType

import numpy as np

from stadera.compiled import kernel
from stadera.constants import GRAVITY
from stadera.inertia import InertialParameters
from stadera.legs.base_wrench import BaseWrenchRegressor
from stadera.legs.friction import STICTION_VELOCITY
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trunk.error_model import ERRORS, PLACES
from stadera.trunk.front import BLIND, Front, Made
from stadera.trunk.ground import LEAST_LOAD
from stadera.trunk.noise import lower_quartile
from stadera.trunk.rows import LATELY, RESOLVED, BlockRows, SwingRows, half_window
from stadera.trunk.samples import Samples
from stadera.trunk.settings import SwingDetection
from stadera.trunk.wrench import TRUNK_MAP
from stadera.types import Array

NAMES = (
    "rotor",
    "viscous",
    "coulomb",
    "offset",
    "torque_lag",
    "gain",
    "stiction",
    "encoder",
    "contact",
    "link_mass",
    "link_com",
    "imu_lever",
    "imu_rotation",
    "accelerometer",
    "velocity_lag",
    "common_gain",
    "regression",
    "sampling",
    "imu_response",
)
"""Order in which the compiled function is given the places of the errors."""

_PLACES = np.array([11 + PLACES[name].start for name in NAMES])


def front(robot: Robot, mount: ImuMount, swing: SwingDetection) -> Front:
    """The fastest `Front` of this installation."""
    compiled = kernel("stadera.trunk.kernels.block")
    return Front(robot, mount, swing) if compiled is None else CompiledFront(robot, mount, swing, compiled)


class CompiledFront(Front):
    """The same rows as `Front`, up to rounding.

    Args:
        compiled: the module `stadera.trunk.kernels.block`.
    """

    def __init__(self, robot: Robot, mount: ImuMount, swing: SwingDetection, compiled: ModuleType) -> None:
        super().__init__(robot, mount, swing)
        self._compiled, model, noise = compiled, self._maker.regressor, self._maker.noise
        self._noise, self._prior = noise.variance, noise.prior_variance
        lift, lever = swing.lift * model.length, np.array(mount.translation, dtype=float)
        weight = self._maker.weight
        limits = [self._maker.flat, (swing.load * weight) ** 2, swing.carried * weight, lift, STICTION_VELOCITY]
        columns = np.ascontiguousarray(model.columns.ravel(), dtype=np.int64)
        self._constants = self._joints, columns, workspace(model, compiled.ROOM), lever
        limits += [LEAST_LOAD * weight, swing.load * weight]
        more = [weight**2, (swing.speed * sqrt(GRAVITY * model.length)) ** 2, swing.part]
        self._lever, self._limits = lever, np.concatenate([limits, np.zeros(72), more])
        self._standing, self._usual, self._state = np.zeros(4), np.zeros(0), np.zeros(compiled.STATE)
        self._first, self._second = np.zeros(compiled.HALF), np.zeros(compiled.HALF)
        self._total, self._cleaned, self._continues = np.empty(compiled.SUMS), np.empty((0, 0)), False
        self._trunk: InertialParameters | None = None  # of the vector
        self._vector = np.zeros(10)
        self._sign = 1.0  # of alternating sums: goes on from block to block, also where these have odd numbers
        self._calibration = np.zeros(10)
        self._speeds, self._count = np.zeros((LATELY, 12)), 0

    @property
    def torque_noise(self) -> Array:
        """Standard deviation of the torques' white noise, (12,) [N·m]."""
        return np.asarray(np.sqrt(self._noise[:12]))

    @property
    def spikes(self) -> int:
        """Number of samples of which single wild values were replaced."""
        return int(self._state[self._compiled.SPIKES])

    def interrupt(self) -> None:
        """Announces that the next samples do not continue the previous ones."""
        self._continues = False

    def forget(self) -> None:
        """Also discards the ground's normal and the history of the motion."""
        self.interrupt()
        self._calibration[:] = 0.0
        self._state[self._compiled.LINES :] = 0.0

    def know_joints(self, mean: Array, std: Array) -> None:
        """See `Front.know_joints`."""
        self._limits[7:79] = np.concatenate([mean.ravel(), std.ravel()])

    def block(self, table: Array, trunk: InertialParameters) -> Made:
        """Processes one block: see `Front.block`."""
        n, compiled, half, cleaned = len(table) - 2, self._compiled, self._second, self._cleaned
        if cleaned.shape != table.shape:
            self._cleaned = cleaned = np.empty(table.shape)
        if len(self._usual) != table.shape[1]:
            self._usual = np.zeros(table.shape[1])
        refused = compiled.block(
            np.ascontiguousarray(table),
            *self._constants,
            half_window(n),
            self._noise,
            self._prior,
            lower_quartile(n - 1) if n > 1 else 0.0,
            self._limits,
            self._standing,
            self._usual,
            self._state,
            cleaned,
            half,
        )
        if refused >= 0:
            self.interrupt()
            return Made(None, BLIND if refused == 4 else refused)
        if self._maker.extra is not None and table.shape[1] > 7 + 3 * self._joints:
            self._take_out_extra(Samples.of_table(cleaned, self._joints), half)
        rows = self._rows(self._first, half, trunk, n) if self._continues else None
        self._first, self._second, self._continues = half, self._first, True
        self._sign *= 1.0 - 2.0 * (n % 2)
        return Made(rows)

    def _rows(self, first: Array, second: Array, trunk: InertialParameters, n: int) -> BlockRows:
        if trunk is not self._trunk:
            self._trunk, self._vector = trunk, trunk.vector.copy()  # not read-only
        columns, white, joint, air = np.empty((6, 11 + ERRORS)), np.empty(6), np.empty((6, 12)), np.empty(4, np.bool_)
        elapsed = self._compiled.rows(
            first,
            second,
            self._vector,
            self._lever,
            TRUNK_MAP,
            self._noise,
            self._calibration,
            self._speeds,
            self._count,
            _PLACES,
            self._sign if n >= RESOLVED else 0.0,
            self._total,
            columns,
            white,
            joint,
            air,
        )
        self._count += 1
        end = float(second[self._compiled.END])
        return BlockRows(end, elapsed, columns, white, SwingRows(air, joint[:4], joint[4], joint[5]))

    def _take_out_extra(self, samples: Samples, half: Array) -> None:
        """Subtracts what the joints outside the legs add by moving."""
        wrench, rising = self._maker.extra_wrench(samples), half_window(len(samples) - 2)
        for sums, weights in ((half, rising), (half[self._compiled.SUMS :], rising[::-1])):
            sums[self._compiled.TARGET : self._compiled.TARGET + 6] -= wrench @ weights


def link_constants(model: BaseWrenchRegressor) -> Array:
    """(4, 3, 50), by leg and link: three rotations (by columns), arm, axis, mass, first moment, inertia, rotor inertia,
    viscous and Coulomb friction, and offset; see `stadera.trunk.kernels.block`.
    """
    friction = model.friction
    turns = [turn[..., 0].transpose(2, 3, 1, 0).reshape(4, 3, 9) for turn in model.turns]
    tensor = model.tensor[..., 0].transpose(2, 3, 1, 0).reshape(4, 3, 9)
    arm, axis, moment = (x[..., 0].transpose(1, 2, 0) for x in (model.arms, model.axes, model.moment))
    scalars = (model.link_mass, model.armature[..., 0], friction.viscous, friction.coulomb, friction.offset)
    mass, *others = (x[..., None] for x in scalars)
    return np.ascontiguousarray(np.concatenate([*turns, arm, axis, mass, moment, tensor, *others], axis=-1))


def workspace(model: BaseWrenchRegressor, rows: int) -> Array:
    """(4 rows,): rows of one number for each leg, of which the first are constants of its links, the centre of its foot
    in the last link [m], and the foot's radius [m].
    """
    constants = np.column_stack([link_constants(model).reshape(4, -1), model.foot[..., 0].T, model.radius])
    out = np.zeros((rows, 4))
    out[: constants.shape[1]] = constants.T
    return out.ravel()
