"""Joint torques (and the wrench on the trunk) as rows in the inertial parameters: the paper's eq. 2, Y(q, q̇, q̈) φ = τ.

By virtual power. Let joint j turn at unit rate and everything else be frozen: link i then has angular velocity s and
its origin the velocity v, both in link i's axes. The torque of joint j that link i's inertia asks for is the power of
its
inertial wrench along that motion::

    τ_j = Σ_i  v · f_i + s · n_i
    f_i = m a + α x h + ω x (ω x h)              h = m c
    n_i = h x a + I α + ω x I ω                  about the link's origin

which is linear in (m, h, I), with coefficients (u = s x ω)::

    m:  v · a
    h:  v x α + (ω·v) ω - (ω·ω) v + a x s
    I:  Ixx: s_x α_x + u_x ω_x     Ixy: s_x α_y + s_y α_x + u_x ω_y + u_y ω_x     and so on

The six trunk rows are the same with s, v the unit motions of the trunk. No matrix is built per sample and nothing loops
over samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stadera.errors import IdentificationError
from stadera.inertia import ORDER
from stadera.regressors.friction import FrictionModel
from stadera.regressors.motion import (
    JointMotion,
    JointRotation,
    TrunkMotion,
    component_major,
    cross,
    dot,
)
from stadera.regressors.rows import Rows
from stadera.robot.model import Tree

Array = NDArray[np.float64]

TRUNK_ROWS: tuple[str, ...] = ("force.x", "force.y", "force.z", "moment.x", "moment.y", "moment.z")
"""Names of the six trunk rows: force [N] and moment about the trunk's origin [N·m], trunk axes."""


def inertial_columns(links: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the inertial parameters of some links: `<link>.m`, `<link>.mcx`, ... in the one order."""
    return tuple(f"{link}.{name}" for link in links for name in ORDER)


@dataclass(frozen=True, eq=False)
class JointTorqueRegressor:
    """Makes one set of rows a joint: inertial parameters of the links it carries, and its own friction columns.

    Attributes:
        tree: of the whole robot, or of one leg.
        friction: which joint-side columns to add, see `FrictionModel`.
        trunk_rows: also make the six rows of the wrench that the outside does to the trunk, `force.*`, `moment.*`.

    Columns are only those that can differ from zero for this tree (a knee's torque does not depend on the hip's mass);
    which ones is found once, from random motion.
    """

    tree: Tree
    friction: FrictionModel = field(default_factory=FrictionModel)
    trunk_rows: bool = False

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """What rows are made for: the trunk's six if asked for, then the joints."""
        return (TRUNK_ROWS if self.trunk_rows else ()) + self.tree.joints

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """All parameters: ten a link (with the trunk's when `trunk_rows`), then the friction columns, joint by
        joint.
        """
        links = self.tree.links if self.trunk_rows else self.tree.links[1:]
        return inertial_columns(links) + tuple(c for joint in self.tree.joints for c in self.friction.columns(joint))

    def rows(
        self, joints: JointMotion, torque: Array, trunk: TrunkMotion | None = None, std: Array | float = 1.0
    ) -> Iterator[Rows]:
        """One `Rows` for each output, in the order of `outputs`.

        Args:
            joints: motion of the tree's joints, (samples, joints).
            torque: (samples, outputs) [N·m, N]: what the actuators do to the joints, and the wrench on the trunk.
            trunk: motion of the trunk; a level trunk held still if not given.
            std: noise of the torque, one number or one for each output [N·m, N].

        Raises:
            IdentificationError: shapes that do not fit the tree.
        """
        if torque.shape != (len(joints), len(self.outputs)):
            raise IdentificationError(
                f"torque needs shape {(len(joints), len(self.outputs))} for {self.outputs}, got {torque.shape}"
            )
        noise = np.broadcast_to(std, len(self.outputs))
        for k, columns, matrix in self._matrices(joints, trunk):
            yield Rows(columns, matrix, torque[:, k], float(noise[k]))

    def predict(self, joints: JointMotion, parameters: dict[str, float], trunk: TrunkMotion | None = None) -> Array:
        """Torques [N·m] (and trunk wrench) that the parameters would give, (samples, outputs); absent ones are zero."""
        out = np.empty((len(joints), len(self.outputs)))
        for k, columns, matrix in self._matrices(joints, trunk):
            out[:, k] = matrix @ np.array([parameters.get(c, 0.0) for c in columns])
        return out

    def _matrices(self, joints: JointMotion, trunk: TrunkMotion | None) -> Iterator[tuple[int, tuple[str, ...], Array]]:
        """Output index, column names and matrix (samples, columns; column-major) for each output."""
        if joints.position.shape[1] != len(self.tree.joints):
            raise IdentificationError(
                f"motion has {joints.position.shape[1]} joints, the tree {len(self.tree.joints)}: {self.tree.joints}"
            )
        links = list(_walk(self.tree, joints, trunk or TrunkMotion.held(), self.trunk_rows))
        for k, (columns, picks) in enumerate(self._patterns):
            joint = k - (len(TRUNK_ROWS) if self.trunk_rows else 0)
            extra = self.friction.columns(self.tree.joints[joint]) if joint >= 0 else ()
            block = np.empty((len(columns) + len(extra), len(joints)))
            at = 0
            for link, wanted in picks:
                links[link].coefficients(k, wanted, block[at : at + len(wanted)])
                at += len(wanted)
            if extra:
                self.friction.fill(joints.velocity[:, joint], joints.acceleration[:, joint], block[at:])
            yield k, columns + extra, block.T

    @cached_property
    def _patterns(self) -> tuple[tuple[tuple[str, ...], tuple[tuple[int, tuple[int, ...]], ...]], ...]:
        """For each output: names of its inertial columns that can be non-zero, and which they are, link by link."""
        rng = np.random.default_rng(0)
        n = len(self.tree.joints)
        motion = JointMotion(*rng.uniform(-2.0, 2.0, (3, 64, n)))
        trunk = (
            TrunkMotion(*rng.uniform(-3.0, 3.0, (3, 64, 3))) if self.trunk_rows else TrunkMotion.held((0.3, -0.5, 1))
        )
        links = list(_walk(self.tree, motion, trunk, self.trunk_rows))
        patterns = []
        for k in range(len(self.outputs)):
            picks, names = [], []
            for i, link in enumerate(links):
                if k not in link.unit_motions:
                    continue
                full = np.empty((10, 64))
                link.coefficients(k, tuple(range(10)), full)
                wanted = tuple(int(c) for c in np.flatnonzero(np.abs(full).max(axis=1) > 1e-12))
                picks.append((i, wanted))
                names += [f"{link.name}.{ORDER[c]}" for c in wanted]
            patterns.append((tuple(names), tuple(picks)))
        return tuple(patterns)


@dataclass(frozen=True, eq=False)
class _LinkMotion:
    """Motion of one link: ω, α, a (3, samples), and for each output its unit motion (s, v) of this link."""

    name: str
    omega: Array
    alpha: Array
    a: Array
    unit_motions: dict[int, tuple[Array, Array]]

    @cached_property
    def _omega_squared(self) -> Array:
        return dot(self.omega, self.omega)

    def coefficients(self, output: int, wanted: tuple[int, ...], out: Array) -> None:
        """The wanted ones of the ten coefficients of an output's row, written into out (len(wanted), samples)."""
        s, v = self.unit_motions[output]
        omega, alpha, a = self.omega, self.alpha, self.a
        moment = cross(a, s)
        if v.any():
            moment = moment + cross(v, alpha) + dot(omega, v) * omega - self._omega_squared * v
        u = cross(s, omega)
        for row, c in zip(out, wanted, strict=True):
            if c == 0:
                row[:] = dot(v, a)
            elif c < 4:
                row[:] = moment[c - 1]
            else:
                i, j = _TENSOR[c - 4]
                if i == j:
                    row[:] = s[i] * alpha[i] + u[i] * omega[i]
                else:
                    row[:] = s[i] * alpha[j] + s[j] * alpha[i] + u[i] * omega[j] + u[j] * omega[i]


_TENSOR = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def _walk(tree: Tree, joints: JointMotion, trunk: TrunkMotion, trunk_rows: bool) -> Iterator[_LinkMotion]:
    """The links' motions in tree order; the trunk itself only with `trunk_rows`. See `stadera.regressors.motion`."""
    unit: dict[int, tuple[Array, Array]] = {}
    if trunk_rows:
        zero, basis = np.zeros((3, 1)), np.eye(3)
        unit = {k: (zero, basis[:, k : k + 1]) for k in range(3)} | {
            3 + k: (basis[:, k : k + 1], zero) for k in range(3)
        }
    base = _LinkMotion(
        tree.links[0],
        component_major(trunk.angular_velocity),
        component_major(trunk.angular_acceleration),
        component_major(trunk.specific_force),
        unit,
    )
    if trunk_rows:
        yield base
    done = [base]
    for i, name in enumerate(tree.joints):
        parent = done[tree.parents[i]]
        turn = JointRotation.of(tree, i, np.ascontiguousarray(joints.position[:, i]))
        t = tree.translations[i][:, None]
        axis = tree.axes[i][:, None]
        velocity, acceleration = joints.velocity[:, i], joints.acceleration[:, i]
        carried = turn(parent.omega)
        at_joint = parent.a + cross(parent.alpha, t) + cross(parent.omega, cross(parent.omega, t))
        moved = {k: (turn(s), turn(v + cross(s, t))) for k, (s, v) in parent.unit_motions.items()}
        moved[i + len(unit)] = (axis, np.zeros((3, 1)))
        link = _LinkMotion(
            tree.links[i + 1],
            omega=carried + axis * velocity,
            alpha=turn(parent.alpha) + cross(carried, axis) * velocity + axis * acceleration,
            a=turn(at_joint),
            unit_motions=moved,
        )
        done.append(link)
        yield link
        del name
