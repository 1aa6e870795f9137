"""Mean p̂ and covariance Σ of the model errors, estimated together with the trunk.

All rows of loaded legs, with θ eliminated, leave M (p - p̂) = v (`Segment.remainder`), and legs in the air tell the
joints (`SwingJoints`), so p is estimated by least squares around its prior, of variance σ² for the rows:

    p̂ = p_s + S (v - M p_s) / σ²,      S = (P⁻¹ + M/σ²)⁻¹

with p_s and P of the legs in the air and, for all other errors, zero and their prior size. With P = L Lᵀ,
S = L (1 + Lᵀ M L/σ²)⁻¹ Lᵀ. σ² is the variance of the residual that p̂ leaves, times the number of rows that share one
error: `repeated`, as long as a swing or stance lasts, and more in proportion once there are more than `returning`, or
`strides` in a walk, since the errors of friction laws and impacts return with every step. Rows of limbs have a σ² of
their own. Were σ² constant, p̂ would follow these errors, and the noise in its own columns, the more the longer a log
is: trunks of real walks would become lighter by a quarter from 10 to 37 s, and noise alone would make a trot's lighter
by 4 % in a minute.

Not estimated, but considered (Schmidt), are errors c that may change with the load, that no residual shows or that are
noise: static friction, the common scale of all torques, noise of the matrix. They add

    Σ = S + (S M_c/σ²) C (S M_c/σ²)ᵀ,      Σ_pc = -(S M_c/σ²) C

Blocks in which most joints are at rest are left out: their columns are noise.

**The gains of single joints have a mean of zero.** A free mean of all gains takes up whatever is wrong: torques are in
the target b and, with the same noise, in the gains' columns, so a common gain of minus one explains all residuals, and
every error of a friction law or of an impact makes the robot lighter. Trunks were 3 to 12 % too light with it, on logs
where they are 1 % off without. What all gains have in common is `common_gain`, which weight cannot tell.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import lapack

from stadera.trunk.error_model import QUIETEST, ErrorModel
from stadera.trunk.placed import Solved
from stadera.trunk.segment import RowSums, Segment
from stadera.trunk.swing import SwingJoints, root_of
from stadera.types import Array

_PRIOR = 0.25
"""Parts of a log, as many as the scatter of its rows counts for [1]: two parts alone may agree by chance. With 1 and 4
bars of masses are a tenth wider, and those of places a fifth and more.
"""


class Errors:
    """Mean p̂ and covariance Σ of the model errors, and what they do to the trunk.

    Args:
        model: sizes of the errors.
        swing: sums of the legs in the air.
        scale: (errors,), of the standard deviations in `model`; None for one.
        rows: sums of the loaded legs; None before any.
        learnt: errors that are estimated from `rows`, from the first one on; the rest is considered. None for those
            of the model's layout.
        gravity: what a robot at rest tells, see `AtRest.known`.
        strides_alike: see `SwingJoints.posterior`.

    Attributes:
        layout: places of the errors.
        mean: (errors,). covariance: Σ (errors, errors). std: (errors,).
        scatter: variance of the rows' residual, in their unit, times the number of successive rows with the same error
            [1]; one before any.
        prior: (errors, errors), the covariance before loaded rows.
    """

    def __init__(
        self,
        model: ErrorModel,
        swing: SwingJoints,
        scale: Array | None = None,
        rows: RowSums | None = None,
        learnt: slice | None = None,
        gravity: Array | None = None,
        *,
        strides_alike: bool = False,
    ) -> None:
        self.layout = model.layout
        self._offsets, self._drift, self._alike = model.layout.places["offset"], model.drift, model.renewed
        self._friction, self._law = model.layout.at("coulomb", "load_friction"), model.friction_law
        learnt, count, by_swing = learnt or self.layout.learnt, self.layout.count, self.layout.by_swing
        gain, stuck = self.layout.places["gain"], self.layout.sticking
        joints, covariance = swing.posterior(None if scale is None else scale[by_swing], strides_alike=strides_alike)
        scale = np.ones(count) if scale is None else scale
        sticking, variance = model.scaled(scale)
        self.scatter = 1.0
        self.mean, self.covariance = np.zeros(count), np.diag(variance)
        self.mean[by_swing], self.covariance[by_swing, by_swing] = joints, covariance
        self.covariance[gain, gain] -= variance[gain].mean() / self.layout.joints
        before, rest, by_rest = self.covariance.copy(), slice(learnt.stop, count), None
        if rows is not None and rows.moved:
            by_rest = self._learn(_Root(root_of(covariance), np.sqrt(variance[learnt]), gain), rows, learnt, gravity)
        elif gravity is not None:
            y, h = gravity[0], gravity[1:]
            along = self.covariance @ h
            self.mean += along * (y - h @ self.mean) / (1.0 + h @ along)
            self.covariance -= np.outer(along, along) / (1.0 + h @ along)
        self._model, self._scale = model, scale
        before[stuck, stuck] = self.covariance[stuck, stuck] = self._held(model, swing, sticking)
        self.prior = before
        if by_rest is not None:
            across = -by_rest @ self.covariance[rest, rest]
            self.covariance[learnt, learnt] -= across @ by_rest.T
            self.covariance[learnt, rest], self.covariance[rest, learnt] = across, across.T
        self.std: Array = np.sqrt(np.diagonal(self.covariance))

    @property
    def start(self) -> Array:
        """(errors, errors), the covariance before any row, of errors that residuals show."""
        return np.asarray(self._model.covariance * np.outer(self._scale, self._scale))

    def _learn(self, root: _Root, rows: RowSums, learnt: slice, gravity: Array | None) -> Array:
        """Updates mean and covariance of the errors that are estimated. Returns S M_c/σ², by these and the rest."""
        p = self.mean[learnt]
        sums = [(rows.in_motion, 6.0 * rows.moved)]
        if rows.limb_count:
            sums.append((rows.of_limbs, rows.limb_count))
        parts = [_Quadratic.of(each, p, root) for each, _ in sums]
        known = [] if gravity is None else [(_Quadratic.of(np.outer(gravity, gravity), p, root), 1.0)]
        louds, found = [rows.repeats] * len(sums), np.zeros(len(p))
        for _ in range(2):  # the second pass uses the first one's residual
            each = [max(part.at(found) / count, QUIETEST) for part, (_, count) in zip(parts, sums, strict=True)]
            louds = [rows.repeats * variance for variance in each]
            every = [*zip(parts, louds, strict=True), *known]
            system = np.asarray(sum(part.normal / loud for part, loud in every))
            system.flat[:: len(system) + 1] += 1.0
            factor = lapack.dpotrf(system)[0]
            along = sum(part.along / loud for part, loud in every)
            found = lapack.dpotrs(factor, along)[0]
        self.scatter, inverse = rows.repeated * each[0], root.before(lapack.dtrtri(factor)[0])
        self._weighed = np.asarray(sum(total / loud for (total, _), loud in zip(sums, louds, strict=True)))
        self.mean[learnt] += root.before(found[:, None])[:, 0]
        self.covariance[learnt, learnt] = S = inverse @ inverse.T
        return np.asarray(S @ self._weighed[1:, 1:][learnt, learnt.stop :])

    def evidence(self, swing: SwingJoints) -> tuple[Array, Array]:
        """What loaded legs and legs in the air tell the errors before any row: A (learnt, learnt) and c (learnt,) of
        `stadera.trunk.sizes`.
        """
        learnt, by_swing = self.layout.learnt, self.layout.by_swing
        normal, right = self._weighed[1:, 1:][learnt, learnt].copy(), self._weighed[1:, 0][learnt].copy()
        in_air = swing.information
        normal[by_swing, by_swing] += in_air[0]
        right[by_swing] += in_air[1]
        root = _Root(swing.root, np.sqrt(self._model.variance[learnt]), self.layout.places["gain"])
        return root.after(root.after(normal).T), root.after(right[None])[0]

    def _held(self, model: ErrorModel, swing: SwingJoints, sticking: Array) -> Array:
        """Covariance (joints, joints) of static friction, of the size that the present Coulomb friction allows.

        Rows under load tell friction as far as the direction of sliding is known, and noise at rest mimics that, so
        without legs in the air its size is that before any row.
        """
        coulomb = self.layout.places["coulomb"]
        square = model.resting**2
        if swing.rows:
            square = (model.dry + self.mean[coulomb]) ** 2 + np.diagonal(self.covariance)[coulomb]
        ratio = model.held * np.sqrt(square) / np.maximum(np.sqrt(np.diagonal(sticking)), 1e-300)
        return np.asarray(sticking * ratio * ratio[:, None])

    @cached_property
    def lasting(self) -> Array:
        """Σ without the covariance of errors that may change with the load, (errors, errors)."""
        out = self.covariance.copy()
        at = self.layout.changing_at
        out[at] = out[:, at] = 0.0  # with what others have in common with them: else it is no covariance
        return out

    def shared(self, alike: float) -> Array:
        """Covariance (errors, errors) of errors under one load with those under another, see `alike`."""
        out = self.lasting.copy()
        out[np.ix_(*2 * [self.layout.changing_at])] = alike * self.of_changing
        return out

    def by_scale(self, sensitivity: Array) -> Array:
        """What a standard deviation of the torques' common scale does to trunk parameters, (10,); `sensitivity`
        (10, errors), theirs to all errors.
        """
        at = self.layout.places["common_gain"].start
        own = float(np.sqrt(max(self.covariance[at, at], 1e-300)))
        return np.asarray(sensitivity @ self.covariance[:, at] / own)

    def by_law(self, sensitivity: Array) -> Array:
        """What a standard deviation of sliding friction beyond its law, in all joints alike, does to trunk parameters,
        (10,): a share of what friction corrects (`ModelErrors.friction_law`); `sensitivity` as of `by_scale`.

        It is in the bars of loads. Their detection leaves it out: the motion just before and just after one comes is
        the same.
        """
        return np.asarray(self._law * (sensitivity[:, self._friction] @ self.mean[self._friction]))

    @cached_property
    def of_changing(self) -> Array:
        """Covariance (changing, changing) of errors that may change with the load, those of each name apart."""
        at, sizes = self.layout.changing_at, [place.stop - place.start for place in self.layout.changing]
        name = np.repeat(np.arange(len(sizes)), sizes)
        return np.where(name[:, None] == name, self.covariance[np.ix_(at, at)], 0.0)

    def trunk_covariance(self, segment: Segment) -> Array:
        """Covariance of a segment's trunk parameters, (10, 10)."""
        K, changing = segment.sensitivity, segment.sensitivity[:, self.layout.changing_at]
        lasting = self.of_rows(segment, self.scatter) + K @ self.lasting @ K.T
        return np.asarray(lasting + changing @ self.of_changing @ changing.T)

    def load_covariance(self, load: Solved) -> Array:
        """Covariance of a load elsewhere than on the trunk, (n, n). Errors that may change with it do not cancel."""
        K, changing = load.sensitivity, load.sensitivity[:, self.layout.changing_at]
        total = self.of_rows(load, self.scatter) + K @ self.lasting @ K.T
        for part in (load.before, changing - load.before):
            total += part @ self.of_changing @ part.T
        return np.asarray(0.5 * (total + total.T))

    def alike(self, *loads: Segment) -> float:
        """Correlation of the friction of joints at rest under these loads and under another [1]."""
        return self._alike if all(load.steps for load in loads) else 0.0

    def difference_covariance(
        self, first: Segment | Solved, second: Segment | Solved, alike: float | Array = 0.0
    ) -> Array:
        """Covariance of the second segment's trunk parameters minus the first's, (10, 10); of several of each at once,
        `Solved.stack`, (..., n, n).

        Errors that act on both alike cancel. Static friction of joints at rest may change with the load, and may even
        hide the load.

        Args:
            alike: correlation of static friction in both, one number or (..., 1, 1) [1].
        """
        own = self.of_rows(first) + self.of_rows(second)
        difference = second.sensitivity - first.sensitivity
        at_once = difference.reshape(-1, difference.shape[-1]) @ self.lasting
        total = own + at_once.reshape(difference.shape) @ difference.mT
        parts = (difference, alike), (first.sensitivity, 1.0 - alike), (second.sensitivity, 1.0 - alike)
        for K, share in parts:
            changing = K[..., self.layout.changing_at]
            total += share * changing @ self.of_changing @ changing.mT
        return np.asarray(0.5 * (total + total.mT))

    def of_rows(self, segment: Segment | Solved, scatter: float = 0.0) -> Array:
        """Covariance (10, 10) of a segment's own errors: what parts of the log show (`stadera.trunk.batches`), and
        offsets that are others under another load.

        Args:
            scatter: variance of the rows, in their unit [1], which counts besides. Of a trunk and of a load in a hand
                it is `scatter`. In the difference of two loads on the trunk it cancels: steps are as wrong after a
                change as before it.
        """
        drifted = segment.sensitivity[..., self._offsets] * self._drift
        own = segment.inverse @ segment.inverse.mT
        if isinstance(segment, Segment) and segment.held is None and len(segment.batches.weights):
            pulls, count = segment.batches.pulls(own, segment.combination(self.mean))
            of_parts = (_PRIOR * self.scatter * own + count * pulls @ pulls.T) / (_PRIOR + count - 1.0)
            own = scatter * own + of_parts
        else:
            own = max(scatter, 1.0) * own
        return np.asarray(own + drifted @ drifted.mT)

    def energies(self, products: Array) -> tuple[float, float]:
        """How the expected energy of the residual splits: that of the sampling error e, and of all others tr D Σ'. With
        own variance e² and f the column of Σ over it, Σ' = Σ - e² f fᵀ, and e² fᵀ D f is the first.

        Args:
            products: (1 + errors, 1 + errors) of target and errors; D is all but the first row and column.
        """
        at = self.layout.places["sampling"].start
        D, column, own = products[1:, 1:], self.covariance[:, at], self.covariance[at, at]
        sampling = float(column @ D @ column / own)
        return sampling, float(np.einsum("ij,ji->", D, self.covariance)) - sampling


@dataclass(frozen=True, eq=False)
class _Quadratic:
    """The energy of residuals that errors p + L x leave: least (1,), less 2 along x, more xᵀ normal x."""

    least: float
    along: Array
    normal: Array

    @classmethod
    def of(cls, products: Array, p: Array, root: _Root) -> _Quadratic:
        """Of products of target and errors, of which the first are estimated, p."""
        n, joints = len(p), len(root.joints)
        M, right = products[1 : 1 + n, 1 : 1 + n], products[1 : 1 + n, 0]
        v = right - M[:, :joints] @ p[:joints]
        normal = root.after(root.after(M).T)
        return cls(float(products[0, 0] - (right + v) @ p), root.after(v[None])[0], normal)

    def at(self, x: Array) -> float:
        """The energy."""
        return self.least - float(x @ (2.0 * self.along - self.normal @ x))


@dataclass(frozen=True, eq=False)
class _Root:
    """L of the prior covariance L Lᵀ of the errors that are estimated.

    Attributes:
        joints: its block of the errors that legs in the air determine.
        std: its diagonal elsewhere. The gains' block is their standard deviation times the projection on a mean of
            zero; `gain` is its place.
    """

    joints: Array
    std: Array
    gain: slice

    def after(self, rows: Array) -> Array:
        """rows L."""
        out: Array = rows * self.std
        swing, gain = slice(0, len(self.joints)), self.gain
        out[:, swing] = rows[:, swing] @ self.joints
        if len(self.std) >= gain.stop:
            out[:, gain] -= out[:, gain].mean(axis=1, keepdims=True)
        return out

    def before(self, columns: Array) -> Array:
        """L columns."""
        out: Array = columns * self.std[:, None]
        swing, gain = slice(0, len(self.joints)), self.gain
        out[swing] = self.joints @ columns[swing]
        if len(self.std) >= gain.stop:
            out[gain] -= out[gain].mean(axis=0)
        return out
