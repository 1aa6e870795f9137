"""Regressor of the joint torques of a robot whose trunk does not turn: the paper's eq. 2, Y(q, q̇, q̈) φ = τ.

With X_j the inertial wrench of link j as columns of its ten parameters, and r_kᵀ w the torque that joint k needs for a
wrench w, joint k has the row r_kᵀ X_j of every link j that it moves (`stadera.body.kernel`).
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


@dataclass(frozen=True, eq=False)
class TrunkMotion:
    """Specific force (acceleration minus gravity) of a trunk that does not turn, its own axes, (samples, 3), or (3,) if
    constant [m/s²].
    """

    specific_force: Array

    @classmethod
    def held(cls, up: ArrayLike = (0.0, 0.0, 1.0), gravity: float = GRAVITY) -> TrunkMotion:
        """A trunk held still. `up` is the vertical in trunk axes (need not be of unit length)."""
        direction = np.asarray(up, dtype=float)
        norm = np.linalg.norm(direction)
        if direction.shape != (3,) or not np.isfinite(norm) or norm == 0:
            raise IdentificationError(f"the vertical needs three numbers, not all zero; got {up!r}")
        return cls(gravity * direction / norm)


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
    """Structure of one joint's row."""

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

    Columns that are always zero for this tree are left out (a knee's torque does not depend on the hip's mass). Of the
    others only linearly independent ones are computed: a hip's 23 columns have rank 17 in any motion. They are
    determined once, from random motion.
    """

    tree: Tree  # of the whole robot, or of one leg
    friction: FrictionModel = field(default_factory=FrictionModel)  # the joint-side columns to add, see `FrictionModel`

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of all parameters: ten for each link but the trunk, then the friction columns by joint."""
        friction = tuple(c for joint in self.tree.joints for c in self.friction.columns(joint))
        return inertial_columns(self.tree.links[1:]) + friction

    def rows(
        self, joints: JointMotion, torque: Array, trunk: TrunkMotion | None = None, std: Array | float = 1.0
    ) -> Iterator[Rows]:
        """Yields one `Rows` for each joint. Raises IdentificationError: shapes that do not fit the tree.

        Args:
            joints: motion of the tree's joints, (samples, joints).
            torque: (samples, joints) [N·m], of the actuators.
            trunk: motion of the trunk; None for a level trunk held still.
            std: noise of the torque, one number or one for each joint [N·m].
        """
        names = self.tree.joints
        if torque.shape != (len(joints), len(names)):
            raise IdentificationError(f"torque needs shape {(len(joints), len(names))} for {names}, got {torque.shape}")
        noise = np.broadcast_to(std, len(names))
        for k, pattern, reduced in self._reduced(joints, trunk):
            yield Rows(pattern.columns, reduced, torque[:, k], float(noise[k]), pattern.mixing)

    def predict(self, joints: JointMotion, parameters: dict[str, float], trunk: TrunkMotion | None = None) -> Array:
        """Torques (samples, joints) [N·m] given parameters; missing ones count as zero."""
        out = np.empty((len(joints), len(self.tree.joints)))
        for k, pattern, reduced in self._reduced(joints, trunk):
            out[:, k] = reduced @ (pattern.mixing @ [parameters.get(c, 0.0) for c in pattern.columns])
        return out

    def _reduced(self, joints: JointMotion, trunk: TrunkMotion | None) -> Iterator[tuple[int, _Pattern, Array]]:
        """Yields index, pattern and the computed columns (samples, k; column-major) of each joint."""
        if joints.position.shape[1] != len(self.tree.joints):
            raise IdentificationError(
                f"motion has {joints.position.shape[1]} joints, the tree {len(self.tree.joints)}: {self.tree.joints}"
            )
        patterns = _patterns(self.tree, self.friction)
        picks = np.concatenate([pattern.picks for pattern in patterns])
        computed, begin = _computed(self.tree, joints, trunk or TrunkMotion.held(), picks), 0
        for k, pattern in enumerate(patterns):
            rigid = len(pattern.picks)
            block = computed[begin : begin + rigid]
            if len(pattern.mixing) > rigid:
                block = np.concatenate([block, np.empty((len(pattern.mixing) - rigid, len(joints)))])
                self.friction.fill(joints.velocity[:, k], joints.acceleration[:, k], block[rigid:])
            yield k, pattern, block.T
            begin += rigid


def _computed(tree: Tree, joints: JointMotion, trunk: TrunkMotion, picks: NDArray[np.int64]) -> Array:
    """Columns of the rows, (k, samples), of some of the joints' and links' parameters (k, 3)."""
    n = len(tree.joints)
    states = np.ascontiguousarray(np.stack([joints.position, joints.velocity, joints.acceleration], axis=2))
    parents = np.array([p - 1 if p > 0 else n for p in tree.parents], dtype=np.int64)
    turns, arms, axes = (np.array(x) for x in (tree.rotations, tree.translations, tree.axes))
    force, out = np.ascontiguousarray(np.atleast_2d(trunk.specific_force)), np.empty((len(picks), len(joints)))
    torque_columns(parents, turns, arms, axes, states, force, np.ascontiguousarray(picks), out)
    return out


@lru_cache(maxsize=64)
def _patterns(tree: Tree, friction: FrictionModel) -> tuple[_Pattern, ...]:
    """The nonzero columns of each joint and their linear dependence, determined from random motion of the joints and
    random specific force of the trunk.
    """
    rng, n, found = np.random.default_rng(0), len(tree.joints), []
    samples = 20 * len(tree.links) + 40
    motion = JointMotion(*rng.uniform(-2.0, 2.0, (3, samples, n)))
    trunk = TrunkMotion(rng.uniform(-3.0, 3.0, (samples, 3)))
    for joint, name in enumerate(tree.joints):
        moved = [j for j in range(n) if joint in tree.ancestors(j)]
        every = np.array([(joint, j, c) for j in moved for c in range(len(ORDER))], dtype=np.int64)
        full = _computed(tree, motion, trunk, every)
        present = np.abs(full).max(axis=1) > NOTHING
        kept, mixing = _independent(full[present].T)
        named = every[present]
        names = tuple(f"{tree.links[j + 1]}.{ORDER[c]}" for _, j, c in named)
        extra = friction.columns(name)
        whole = np.eye(len(mixing) + len(extra), len(names) + len(extra), len(names) - len(mixing))
        whole[: len(mixing), : len(names)] = mixing
        found.append(_Pattern(names + extra, named[kept], whole))
    return tuple(found)


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
