"""Regressor of joint torques (and of the wrench on the trunk): the paper's eq. 2, Y(q, q̇, q̈) φ = τ.

Derived from virtual power. Let joint j turn at unit rate while all other joints are fixed: link i then has angular
velocity s and its origin the velocity v, both in link i's axes. Link i's contribution to the torque of joint j is the
power of its inertial wrench along that motion::

    τ_j = Σ_i  v · f_i + s · n_i
    f_i = m a + α x h + ω x (ω x h)              h = m c
    n_i = h x a + I α + ω x I ω                  about the link's origin

which is linear in (m, h, I), with coefficients (u = s x ω)::

    m:  v · a
    h:  v x α + (ω·v) ω - (ω·ω) v + a x s
    I:  Ixx: s_x α_x + u_x ω_x     Ixy: s_x α_y + s_y α_x + u_x ω_y + u_y ω_x     and so on

The six trunk rows are the same with s, v the unit motions of the trunk. No matrix is built for single samples and no
Python loop runs over samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from stadera.compiled import kernel
from stadera.constants import NOTHING, ROUNDING
from stadera.errors import IdentificationError
from stadera.inertia import ORDER
from stadera.legs.components import ZERO, Component, Vector, add, cross, dot, minus, plus, scale, times, vector
from stadera.legs.friction import FrictionModel
from stadera.legs.motion import JointMotion, JointRotation, TrunkMotion
from stadera.legs.rows import Rows
from stadera.legs.tape import Recorder, Tape
from stadera.robot.model import Tree
from stadera.types import Array

TRUNK_ROWS: tuple[str, ...] = ("force.x", "force.y", "force.z", "moment.x", "moment.y", "moment.z")
"""Names of the six trunk rows: force [N] and moment about the trunk's origin [N·m], trunk axes."""

_WORTH_COMPILED = 4096
"""Samples in a piece above which a tape is recorded and compiled code is loaded, which takes as long as many pieces."""


@dataclass(frozen=True, eq=False)
class _Pattern:
    """Structure of one output's row."""

    columns: tuple[str, ...]  # names of all columns that can be nonzero, friction's last
    # for each link, the coefficients (of ten) that are computed; the other columns depend on these
    picks: tuple[tuple[int, tuple[int, ...]], ...]
    mixing: Array  # (computed and friction, columns), maps the computed columns to all

    @property
    def rigid(self) -> int:
        """Number of computed columns, without friction's."""
        return sum(len(wanted) for _, wanted in self.picks)


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
        inputs, sizes = _inputs(joints, trunk), [len(pattern.mixing) for pattern in patterns]
        rows = np.empty((sum(sizes), len(joints)))
        blocks = np.split(rows, np.cumsum(sizes)[:-1])
        tape = structure.tape(turns, trunk) if len(joints) >= _WORTH_COMPILED else None
        if tape is not None and float(np.abs(joints.position).max()) < tape.kernel.LARGEST:
            tape.run(inputs, rows)
        else:
            structure.fill(blocks, patterns, _Signals.of(inputs, trunk))
        for k, (pattern, block) in enumerate(zip(patterns, blocks, strict=True)):
            if pattern.rigid < len(block):
                joint = k - (len(TRUNK_ROWS) if self.trunk_rows else 0)
                self.friction.fill(joints.velocity[:, joint], joints.acceleration[:, joint], block[pattern.rigid :])
            yield k, pattern, block.T


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

    def fill(self, blocks: Sequence[Array], patterns: Sequence[_Pattern], signals: _Signals) -> None:
        """Writes the computed columns of each output into its block (columns, samples)."""
        links = list(_walk(self.tree, signals, self.trunk_rows))
        for k, (block, pattern) in enumerate(zip(blocks, patterns, strict=True)):
            for row, values in zip(block, _picked(links, k, pattern), strict=False):
                row[:] = values

    def tape(self, turning: bool, trunk: TrunkMotion) -> Tape | None:
        """The computed columns of all outputs as a tape; None without numba."""
        compiled = kernel("stadera.legs.kernels.tape")
        if compiled is None:
            return None
        constant = tuple(None if x.ndim > 1 else tuple(x.tolist()) for x in _of_trunk(trunk))
        if (turning, constant) not in self._tapes:
            recorder = Recorder(3 * (len(self.tree.joints) + constant.count(None)))
            links = list(_walk(self.tree, _Signals.recorded(recorder, trunk), self.trunk_rows))
            rows: list[Component | None] = []
            for k, pattern in enumerate(self.patterns(turning)):
                rows += [*_picked(links, k, pattern), *[None] * (len(pattern.mixing) - pattern.rigid)]
            self._tapes[turning, constant] = recorder.tape(rows, compiled)
        return self._tapes[turning, constant]

    @cached_property
    def _tapes(self) -> dict[tuple[bool, tuple[tuple[float, ...] | None, ...]], Tape]:
        """Tapes by whether the trunk rotates, and by what of its motion is constant."""
        return {}

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
        links = list(_walk(self.tree, _Signals.of(_inputs(motion, trunk), trunk), self.trunk_rows))
        outputs = len(self.tree.joints) + (len(TRUNK_ROWS) if self.trunk_rows else 0)
        return tuple(self._pattern(k, links, samples) for k in range(outputs))

    def _pattern(self, output: int, links: list[_LinkMotion], samples: int) -> _Pattern:
        carried = [i for i, link in enumerate(links) if output in link.unit_motions]
        full = np.empty((len(carried), 10, samples))
        for block, i in zip(full, carried, strict=True):
            for row, values in zip(block, links[i].coefficients(output, tuple(range(10))), strict=True):
                row[:] = values
        present = np.abs(full).max(axis=2) > NOTHING
        kept, mixing = _independent(full[present].T)
        places = np.argwhere(present)
        names = tuple(f"{links[carried[a]].name}.{ORDER[c]}" for a, c in places)
        chosen = places[kept]
        picks = tuple((carried[a], tuple(chosen[chosen[:, 0] == a, 1].tolist())) for a in np.unique(chosen[:, 0]))
        joint = output - (len(TRUNK_ROWS) if self.trunk_rows else 0)
        extra = self.friction.columns(self.tree.joints[joint]) if joint >= 0 else ()
        whole = np.eye(len(mixing) + len(extra), len(names) + len(extra), len(names) - len(mixing))
        whole[: len(mixing), : len(names)] = mixing
        return _Pattern(names + extra, picks, whole)


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


@dataclass(frozen=True, eq=False)
class _LinkMotion:
    """Motion of one link: ω, α, a, and the unit motion (s, v) of this link for each output."""

    name: str
    omega: Vector
    alpha: Vector
    a: Vector
    unit_motions: dict[int, tuple[Vector, Vector]]

    @cached_property
    def _omega_squared(self) -> Component:
        return dot(self.omega, self.omega)

    def coefficients(self, output: int, wanted: tuple[int, ...]) -> Iterator[Component]:
        """Yields the wanted ones of the ten coefficients of an output's row."""
        s, v = self.unit_motions[output]
        omega, alpha, a = self.omega, self.alpha, self.a
        u = cross(s, omega)
        moment = add(cross(a, s), cross(v, alpha))
        along, minus_squared = dot(omega, v), minus(0.0, self._omega_squared)
        moment = add(moment, scale(along, omega), scale(minus_squared, v))
        for c in wanted:
            if c == 0:
                yield dot(v, a)
            elif c < 4:
                yield moment[c - 1]
            else:
                i, j = _TENSOR[c - 4]
                value = plus(times(s[i], alpha[j]), times(u[i], omega[j]))
                if i != j:
                    value = plus(value, plus(times(s[j], alpha[i]), times(u[j], omega[i])))
                yield value


_TENSOR = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_UNIT: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class _Signals(NamedTuple):
    """Motion by components: by joint, and of the trunk."""

    cos: Sequence[Component]
    sin: Sequence[Component]
    velocity: Sequence[Component]
    acceleration: Sequence[Component]
    omega: Vector
    alpha: Vector
    a: Vector

    @classmethod
    def of(cls, inputs: Array, trunk: TrunkMotion) -> _Signals:
        """From `_inputs`."""
        n = _joints(len(inputs), trunk)
        return cls._of(tuple(np.cos(inputs[:n])), tuple(np.sin(inputs[:n])), tuple(inputs[n:]), trunk)

    @classmethod
    def recorded(cls, recorder: Recorder, trunk: TrunkMotion) -> _Signals:
        """From what stands for `_inputs`."""
        n = _joints(len(recorder.inputs), trunk)
        cos, sin = zip(*map(recorder.cosine_and_sine, recorder.inputs[:n]), strict=True)
        return cls._of(cos, sin, recorder.inputs[n:], trunk)

    @classmethod
    def _of(cls, cos: Sequence[Array], sin: Sequence[Array], others: Sequence[Array], trunk: TrunkMotion) -> _Signals:
        n = len(cos)
        varying = iter(others[2 * n :])
        omega, alpha, a = (
            vector(x) if x.ndim == 1 else (next(varying), next(varying), next(varying)) for x in _of_trunk(trunk)
        )
        return cls(cos, sin, others[:n], others[n : 2 * n], omega, alpha, a)


def _of_trunk(trunk: TrunkMotion) -> tuple[Array, Array, Array]:
    return trunk.angular_velocity, trunk.angular_acceleration, trunk.specific_force


def _joints(inputs: int, trunk: TrunkMotion) -> int:
    return (inputs - 3 * sum(x.ndim > 1 for x in _of_trunk(trunk))) // 3


def _inputs(joints: JointMotion, trunk: TrunkMotion) -> Array:
    """Components of the motion that are not constant, (inputs, samples): position, velocity and acceleration of all
    joints, and the trunk's.
    """
    given = [joints.position, joints.velocity, joints.acceleration, *(x for x in _of_trunk(trunk) if x.ndim > 1)]
    return np.concatenate([x.T for x in given], out=np.empty((sum(x.shape[1] for x in given), len(joints))))


def _picked(links: Sequence[_LinkMotion], output: int, pattern: _Pattern) -> Iterator[Component]:
    """Yields the computed columns of an output."""
    for link, wanted in pattern.picks:
        yield from links[link].coefficients(output, wanted)


def _walk(tree: Tree, signals: _Signals, trunk_rows: bool) -> Iterator[_LinkMotion]:
    """Yields the links' motions in tree order; the trunk's only with `trunk_rows`. See `stadera.legs.motion`."""
    unit: dict[int, tuple[Vector, Vector]] = {}
    if trunk_rows:
        unit = {k: (ZERO, e) for k, e in enumerate(_UNIT)} | {3 + k: (e, ZERO) for k, e in enumerate(_UNIT)}
    base = _LinkMotion(tree.links[0], signals.omega, signals.alpha, signals.a, unit)
    if trunk_rows:
        yield base
    done = [base]
    for i in range(len(tree.joints)):
        link = _next(tree, i, done[tree.parents[i]], signals, i + len(unit))
        done.append(link)
        yield link


def _next(tree: Tree, i: int, parent: _LinkMotion, signals: _Signals, output: int) -> _LinkMotion:
    """Motion of the link moved by joint i, whose row has the number `output`."""
    turn = JointRotation.of(tree, i, signals.cos[i], signals.sin[i])
    t, axis = vector(tree.translations[i]), vector(tree.axes[i])
    spin = scale(signals.velocity[i], axis)
    carried = turn(parent.omega)
    at_joint = add(parent.a, cross(parent.alpha, t), cross(parent.omega, cross(parent.omega, t)))
    moved = {k: (turn(s), turn(add(v, cross(s, t)))) for k, (s, v) in parent.unit_motions.items()}
    moved[output] = (axis, ZERO)
    return _LinkMotion(
        tree.links[i + 1],
        omega=add(carried, spin),
        alpha=add(turn(parent.alpha), cross(carried, spin), scale(signals.acceleration[i], axis)),
        a=turn(at_joint),
        unit_motions=moved,
    )
