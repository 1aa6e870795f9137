"""Regressor of joint torques (and of the wrench on the trunk): the paper's eq. 2, Y(q, q̇, q̈) φ = τ.

With X_j the inertial wrench of link j as columns of its ten parameters, and r_kᵀ w the torque that joint k needs for a
wrench w, joint k has the row r_kᵀ X_j of every link j that it moves (`stadera.body.kernel`). The six trunk rows are
those of all links.

The specific force of a frame's origin is its acceleration minus gravity. A trunk that moves with angular velocity ω and
specific force a obeys the equations of one at rest in gravity-free space accelerated by a, so neither orientation nor
gravity nor velocity of the trunk appears.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stadera.body.friction import FrictionModel
from stadera.body.kernel import torque_columns
from stadera.body.rows import Rows
from stadera.constants import GRAVITY, NOTHING, ROUNDING
from stadera.errors import IdentificationError
from stadera.inertia import ORDER
from stadera.robot.model import Tree
from stadera.types import Array

TRUNK_ROWS: tuple[str, ...] = ("force.x", "force.y", "force.z", "moment.x", "moment.y", "moment.z")
"""Names of the six trunk rows: force [N] and moment about the trunk's origin [N·m], trunk axes."""


@dataclass(frozen=True, eq=False)
class TrunkMotion:
    """Motion of the trunk, in its own frame and at its origin: specific force (acceleration minus gravity) [m/s²],
    angular velocity [rad/s] and acceleration [rad/s²], each (samples, 3), or (3,) if constant.
    """

    specific_force: Array
    angular_velocity: Array
    angular_acceleration: Array

    @classmethod
    def held(cls, up: ArrayLike = (0.0, 0.0, 1.0), gravity: float = GRAVITY) -> TrunkMotion:
        """A trunk held still. `up` is the vertical in trunk axes (need not be of unit length)."""
        direction = np.asarray(up, dtype=float)
        norm = np.linalg.norm(direction)
        if direction.shape != (3,) or not np.isfinite(norm) or norm == 0:
            raise IdentificationError(f"the vertical needs three numbers, not all zero; got {up!r}")
        return cls(gravity * direction / norm, np.zeros(3), np.zeros(3))

    @property
    def turns(self) -> bool:
        """True if the trunk rotates."""
        return bool(self.angular_velocity.any() or self.angular_acceleration.any())


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Motion of the joints: position [rad], velocity [rad/s], acceleration [rad/s²], each (samples, joints)."""

    position: Array
    velocity: Array
    acceleration: Array

    def __post_init__(self) -> None:
        if not self.position.shape == self.velocity.shape == self.acceleration.shape or self.position.ndim != 2:
            shapes = (self.position.shape, self.velocity.shape, self.acceleration.shape)
            raise IdentificationError(f"joint motion needs three arrays of shape (samples, joints), got {shapes}")

    def __len__(self) -> int:
        return len(self.position)

    def slice(self, samples: slice) -> JointMotion:
        """A slice of the samples."""
        return JointMotion(self.position[samples], self.velocity[samples], self.acceleration[samples])


@dataclass(frozen=True, eq=False)
class _Pattern:
    """Structure of one output's row."""

    columns: tuple[str, ...]  # names of all columns that can be nonzero, friction's last
    # (k, 3), which columns are computed, as of `torque_columns`; the other columns depend on these
    picks: NDArray[np.int64]
    mixing: Array  # (computed and friction, columns), maps the computed columns to all


def inertial_columns(links: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the inertial parameters of some links: `<link>.m`, `<link>.mcx`, ... in standard order."""
    return tuple(f"{link}.{name}" for link in links for name in ORDER)


@dataclass(frozen=True, eq=False)
class JointTorqueRegressor:
    """Computes one set of rows for each joint: inertial parameters of the links it moves, and its friction columns.

    Columns that are always zero for this tree are left out (a knee's torque does not depend on the hip's mass),
    separately for a rotating and a non-rotating trunk. Of the others only linearly independent ones are computed: a
    hip's 23 columns have rank 17 in any motion. They are determined once, from random motion.
    """

    tree: Tree  # of the whole robot, or of one leg
    friction: FrictionModel = field(default_factory=FrictionModel)  # the joint-side columns to add, see `FrictionModel`
    trunk_rows: bool = False  # also compute the six rows of the external wrench on the trunk, `force.*`, `moment.*`

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs: the six trunk rows if requested, then the joints."""
        return (TRUNK_ROWS if self.trunk_rows else ()) + self.tree.joints

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of all parameters: ten for each link (the trunk's too with `trunk_rows`), then the friction columns by
        joint.
        """
        links = self.tree.links if self.trunk_rows else self.tree.links[1:]
        return inertial_columns(links) + tuple(c for joint in self.tree.joints for c in self.friction.columns(joint))

    def rows(
        self, joints: JointMotion, torque: Array, trunk: TrunkMotion | None = None, std: Array | float = 1.0
    ) -> Iterator[Rows]:
        """Yields one `Rows` for each output, in the order of `outputs`. Raises IdentificationError: shapes that do not
        fit the tree.

        Args:
            joints: motion of the tree's joints, (samples, joints).
            torque: (samples, outputs) [N·m, N]: actuator torques of the joints, and the external wrench on the trunk.
            trunk: motion of the trunk; None for a level trunk held still.
            std: noise of the torque, one number or one for each output [N·m, N].
        """
        if torque.shape != (len(joints), len(self.outputs)):
            raise IdentificationError(
                f"torque needs shape {(len(joints), len(self.outputs))} for {self.outputs}, got {torque.shape}"
            )
        noise = np.broadcast_to(std, len(self.outputs))
        for k, pattern, reduced in self._reduced(joints, trunk):
            yield Rows(pattern.columns, reduced, torque[:, k], float(noise[k]), pattern.mixing)

    def predict(self, joints: JointMotion, parameters: dict[str, float], trunk: TrunkMotion | None = None) -> Array:
        """Torques [N·m] (and trunk wrench) given parameters, (samples, outputs); missing parameters count as zero."""
        out = np.empty((len(joints), len(self.outputs)))
        for k, pattern, reduced in self._reduced(joints, trunk):
            out[:, k] = reduced @ (pattern.mixing @ [parameters.get(c, 0.0) for c in pattern.columns])
        return out

    def _reduced(self, joints: JointMotion, trunk: TrunkMotion | None) -> Iterator[tuple[int, _Pattern, Array]]:
        """Yields output index, pattern and the computed columns (samples, k; column-major) for each output."""
        if joints.position.shape[1] != len(self.tree.joints):
            raise IdentificationError(
                f"motion has {joints.position.shape[1]} joints, the tree {len(self.tree.joints)}: {self.tree.joints}"
            )
        trunk = trunk or TrunkMotion.held()
        turns = self.trunk_rows or trunk.turns
        structure = _Structure.of(self.tree, self.friction, self.trunk_rows)
        patterns = structure.patterns(turns)
        computed = structure.computed(joints, trunk, np.concatenate([pattern.picks for pattern in patterns]))
        begin = 0
        for k, pattern in enumerate(patterns):
            rigid, joint = len(pattern.picks), k - (len(TRUNK_ROWS) if self.trunk_rows else 0)
            block = computed[begin : begin + rigid]
            if len(pattern.mixing) > rigid:
                block = np.concatenate([block, np.empty((len(pattern.mixing) - rigid, len(joints)))])
                self.friction.fill(joints.velocity[:, joint], joints.acceleration[:, joint], block[rigid:])
            yield k, pattern, block.T
            begin += rigid


@dataclass(frozen=True, eq=False)
class _Structure:
    """What a regressor's rows have in common in any motion; the same for all regressors of a tree."""

    tree: Tree
    friction: FrictionModel
    trunk_rows: bool

    @staticmethod
    @lru_cache(maxsize=64)
    def of(tree: Tree, friction: FrictionModel, trunk_rows: bool) -> _Structure:
        """The structure, cached."""
        return _Structure(tree, friction, trunk_rows)

    def patterns(self, turning: bool) -> tuple[_Pattern, ...]:
        """By output, for a trunk that rotates or not."""
        return self._turning if turning else self._held

    def computed(self, joints: JointMotion, trunk: TrunkMotion, picks: NDArray[np.int64]) -> Array:
        """Columns of the rows, (k, samples), of some of the outputs' and links' parameters (k, 3)."""
        tree, n, samples = self.tree, len(self.tree.joints), len(joints)
        given = trunk.angular_velocity, trunk.angular_acceleration, trunk.specific_force
        varies = any(values.ndim > 1 for values in given)
        states, motion = np.empty((samples, n, 3)), np.empty((samples if varies else 1, 3, 3))
        for k, values in enumerate((joints.position, joints.velocity, joints.acceleration)):
            states[:, :, k] = values
        for k, values in enumerate(given):
            motion[:, k] = values
        parents = np.array([p - 1 if p > 0 else n for p in tree.parents], dtype=np.int64)
        turns, arms, axes = (np.array(x) for x in (tree.rotations, tree.translations, tree.axes))
        slides, out = np.zeros(n, dtype=bool), np.empty((len(picks), samples))
        torque_columns(parents, turns, arms, axes, slides, states, motion, np.ascontiguousarray(picks), out)
        return out

    @cached_property
    def _held(self) -> tuple[_Pattern, ...]:
        return self._patterns(turning=False)

    @cached_property
    def _turning(self) -> tuple[_Pattern, ...]:
        return self._patterns(turning=True)

    def _patterns(self, *, turning: bool) -> tuple[_Pattern, ...]:
        """The nonzero columns of each output and their linear dependence, determined from random motion of the joints
        and of a trunk that either turns or only has a specific force.
        """
        rng = np.random.default_rng(0)
        samples = 20 * len(self.tree.links) + 40
        motion = JointMotion(*rng.uniform(-2.0, 2.0, (3, samples, len(self.tree.joints))))
        force, omega, alpha = rng.uniform(-3.0, 3.0, (3, samples, 3))
        trunk = TrunkMotion(force, omega, alpha) if turning else TrunkMotion(force, np.zeros(3), np.zeros(3))
        outputs = len(self.tree.joints) + (len(TRUNK_ROWS) if self.trunk_rows else 0)
        return tuple(self._pattern(k, motion, trunk) for k in range(outputs))

    def _pattern(self, output: int, motion: JointMotion, trunk: TrunkMotion) -> _Pattern:
        n, joint = len(self.tree.joints), output - (len(TRUNK_ROWS) if self.trunk_rows else 0)
        row = joint if joint >= 0 else n + output
        moved = [j for j in range(n) if joint < 0 or joint in self.tree.ancestors(j)]
        links = [n, *moved] if joint < 0 else moved  # the trunk's first
        every = np.array([(row, j, c) for j in links for c in range(len(ORDER))], dtype=np.int64)
        full = self.computed(motion, trunk, every)
        present = np.abs(full).max(axis=1) > NOTHING
        kept, mixing = _independent(full[present].T)
        named = every[present]
        names = tuple(f"{self.tree.links[(j + 1) % (n + 1)]}.{ORDER[c]}" for _, j, c in named)
        extra = self.friction.columns(self.tree.joints[joint]) if joint >= 0 else ()
        whole = np.eye(len(mixing) + len(extra), len(names) + len(extra), len(names) - len(mixing))
        whole[: len(mixing), : len(names)] = mixing
        return _Pattern(names + extra, named[kept], whole)


def _independent(matrix: Array) -> tuple[list[int], Array]:
    """Independent columns on which all columns of a matrix (rows, n) depend, and the mixing: matrix[:, kept] @ mixing.

    Columns are chosen by the part that the earlier ones do not explain (QR with pivoting), each in units of its norm.
    """
    from scipy.linalg import qr

    size = np.linalg.norm(matrix, axis=0)
    _, R, order = qr(matrix / size, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(R))
    kept = np.sort(order[: int(np.sum(diagonal > ROUNDING * diagonal[0]))])
    mixing = np.linalg.lstsq(matrix[:, kept] / size[kept], matrix, rcond=None)[0] / size[kept, None]
    mixing[:, kept] = np.eye(len(kept))
    return kept.tolist(), mixing
