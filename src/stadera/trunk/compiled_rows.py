"""`RowMaker` by compiled functions where numba is installed, several times as fast."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from stadera.compiled import kernel
from stadera.inertia import InertialParameters
from stadera.legs.base_wrench import BaseWrenchRegressor
from stadera.legs.friction import STICTION_VELOCITY
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trunk.error_model import ERRORS, PLACES
from stadera.trunk.noise import lower_quartile
from stadera.trunk.rows import LATELY, BlockResult, BlockRows, RowMaker, SwingRows, half_window
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
)
"""Order in which the compiled function is given the places of the errors."""

_PLACES = np.array([11 + PLACES[name].start for name in NAMES])


def row_maker(robot: Robot, mount: ImuMount, swing: SwingDetection) -> RowMaker:
    """The fastest `RowMaker` of this installation."""
    compiled = kernel("stadera.trunk.kernels.block")
    return RowMaker(robot, mount, swing) if compiled is None else CompiledRowMaker(robot, mount, swing, compiled)


class CompiledRowMaker(RowMaker):
    """The same rows as `RowMaker`, up to rounding.

    Args:
        compiled: the module `stadera.trunk.kernels.block`.
    """

    def __init__(self, robot: Robot, mount: ImuMount, swing: SwingDetection, compiled: ModuleType) -> None:
        super().__init__(robot, mount, swing)
        self._compiled, model = compiled, self.regressor
        self._columns = np.ascontiguousarray(model.columns.ravel(), dtype=np.int64)
        self._links, self._feet = link_constants(model), foot_constants(model)
        weight, length = self._weight, model.length
        self._limits = np.array(
            [self._flat, (swing.load * weight) ** 2, swing.carried * weight, swing.lift * length, STICTION_VELOCITY]
        )
        self._lever = np.ascontiguousarray(self._lever, dtype=float)
        self._halves = np.zeros((2, compiled.HALF))
        self._latest, self._known = 0, False
        self._state = np.zeros(10)
        self._ring, self._count = np.zeros((LATELY, 12)), 0

    def restart(self) -> None:
        """Discards the unfinished window: the next samples do not continue the previous ones."""
        self._known = False

    def forget(self) -> None:
        """Also discards the history of the motion: the trunk's rotation until the next samples is unknown."""
        self.restart()
        self._state[:] = 0.0

    def block(self, samples: Samples, normal: Array, trunk: InertialParameters) -> BlockResult:
        """Processes one block: see `RowMaker.block`."""
        n = len(samples) - 2
        half, feet, force = self._halves[1 - self._latest], np.empty((3, 4)), np.empty((3, 4))
        singular = self._compiled.block(
            samples.table,
            samples.position.shape[1],
            self._columns,
            self._links,
            self._feet,
            self._lever,
            normal,
            half_window(n),
            self.noise.variance,
            self.noise.prior_variance,
            lower_quartile(n - 1) if n > 1 else 0.0,
            self._standing,
            self._limits,
            half,
            feet,
            force,
        )
        if singular >= 0:
            self.restart()
            return BlockResult(None, feet, np.zeros((3, 4)), singular)
        if self._extra is not None and samples.extra.size:
            wrench, rising = self._extra_wrench(self._extra, samples), half_window(n)
            for sums, weights in ((half, rising), (half[self._compiled.SUMS :], rising[::-1])):
                sums[self._compiled.TARGET : self._compiled.TARGET + 6] -= wrench @ weights
        made = self._rows_of(self._halves[self._latest], half, trunk) if self._known else None
        self._latest, self._known = 1 - self._latest, True
        return BlockResult(made, feet, force)

    def _rows_of(self, first: Array, second: Array, trunk: InertialParameters) -> BlockRows:
        c = self._compiled
        total, columns, white = np.empty(c.SUMS), np.empty((6, 11 + ERRORS)), np.empty(6)
        elapsed = c.rows(
            first,
            second,
            trunk.vector.copy(),  # not read-only
            self._lever,
            TRUNK_MAP,
            self.noise.variance,
            self._state,
            self._ring,
            self._count,
            _PLACES,
            total,
            columns,
            white,
        )
        self._count += 1
        air = (first[c.AIR : c.AIR + 4] * second[c.AIR : c.AIR + 4]).astype(bool)
        joint = total[c.JOINT : c.JOINT + 72].reshape(6, 12)
        return BlockRows(float(second[c.END]), elapsed, columns, white, SwingRows(air, joint[:4], joint[4], joint[5]))


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


def foot_constants(model: BaseWrenchRegressor) -> Array:
    """(4, 4) [m]: each foot's centre in the last link, and its radius."""
    return np.ascontiguousarray(np.column_stack([model.foot[..., 0].T, model.radius]))
