"""Shares a wrench out over the feet: a quadratic programme with friction pyramids and unilateral contact.

    min_f  ‖Σ f_i - F‖² + ‖Σ r_i x f_i - Γ‖² / L² + ε ‖f‖² + β ‖f - f_before‖²
    s.t.   least ≤ n·f_i ≤ most_i,     |t1·f_i| ≤ μ/√2 n·f_i,     |t2·f_i| ≤ μ/√2 n·f_i

r_i: contacts from the point that Γ is about; n, t1, t2: the ground's normal and two tangents; L: a length that makes
moments count like forces. ε and β are small: they choose among the forces that make the wrench, towards little and
towards what was before; the wrench gives way by no more than about their size, relative, unless the constraints demand
it.
The pyramid lies inside the friction cone. Everything is in one frame's axes, any one.

The programme is strictly convex: where the minimiser of the objective alone keeps the constraints, it is the solution,
and the solver is not asked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import proxsuite
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.lapack import dposv

from stadera.errors import ModelError
from stadera.inertia import skew

Array = NDArray[np.float64]

_SKEW = np.stack([skew(axis) for axis in np.eye(3)]).reshape(3, 9)
_INFINITE = 1e20
_MOST_ITERATIONS = 200  # of which a warm start needs a few
_ROWS = 5  # of constraints a foot


@dataclass(frozen=True)
class ContactLimits:
    """What the feet may do.

    Attributes:
        friction: coefficient that the controller counts on.
        least_normal: [N], of every foot in stance.
        most_normal: [N].
    """

    friction: float = 0.6
    least_normal: float = 0.0
    most_normal: float = np.inf

    def __post_init__(self) -> None:
        if not (np.isfinite(self.friction) and self.friction > 0):
            raise ModelError(f"the friction coefficient must be positive, got {self.friction}")
        if not 0 <= self.least_normal < self.most_normal:
            raise ModelError(f"normal forces need 0 ≤ least < most, got {self.least_normal} N and {self.most_normal} N")


class ForceDistribution:
    """The quadratic programme of four feet, warm-started from its last solution.

    Args:
        limits: of the contacts.
        length: L [m].
        small: ε, and
        smooth: β, both relative to the weight of a force error.

    Attributes:
        forces: (4, 3) [N], the last solution.
        solved: whether the solver says so; if not, `forces` are those before.
    """

    def __init__(self, limits: ContactLimits, length: float, small: float = 1e-5, smooth: float = 1e-4) -> None:
        self.limits, self.length = limits, length
        self._small, self._smooth = small, smooth
        self.forces = np.zeros((4, 3))
        self.solved = True
        self._skew = -_SKEW / length  # minus, as the rows of [r]x are taken for columns
        self._wrench = np.zeros((6, 12))  # the map from forces to the weighted wrench
        self._wrench[:3] = np.tile(np.eye(3), 4)
        self._diagonal = np.diag(np.full(12, small + smooth))
        self._upper, self._lower = np.full(4 * _ROWS, 0.0), np.full(4 * _ROWS, -_INFINITE)
        self._before, self._target = np.zeros(12), np.zeros(6)
        self._carrying = np.ones(12)
        self._qp = proxsuite.proxqp.dense.QP(12, 0, 4 * _ROWS)
        self._qp.settings.eps_abs = 1e-7
        self._qp.settings.eps_rel = 0.0
        self._qp.settings.max_iter = _MOST_ITERATIONS
        self._qp.settings.initial_guess = proxsuite.proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        self._started = False
        self._sides, self._bounds = np.zeros((0, 12)), np.zeros(0)
        self.set_ground(np.array([0.0, 0.0, 1.0]))
        self.set_load(np.ones(4))

    def set_ground(self, normal: Array) -> None:
        """The ground's unit normal (3,)."""
        slope = self.limits.friction / np.sqrt(2.0)
        helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
        first = np.cross(normal, helper)
        first /= np.linalg.norm(first)
        second = np.cross(normal, first)
        rows = np.array([normal] + [sign * t - slope * normal for t in (first, second) for sign in (1.0, -1.0)])
        self._constraints = np.kron(np.eye(4), rows)
        self._new_bounds = self._new_sides = True

    def set_load(self, share: ArrayLike) -> None:
        """How much of its normal force each foot may carry, (4,) from 1 down to 0 for a foot in the air.

        Less than one caps the force at that share of `most_normal`, or of four times the last solution's mean.
        """
        load = np.clip(np.asarray(share, dtype=float), 0.0, 1.0)
        cap = self.limits.most_normal
        if not np.isfinite(cap):
            cap = max(4.0 * self.normal_force(), 1.0)
        self.set_most(np.where(load < 1.0, load * cap, np.inf))

    def set_most(self, most: ArrayLike) -> None:
        """How much normal force each foot may carry at most, (4,) [N]; zero for a foot in the air."""
        cap: Array = np.clip(np.asarray(most, dtype=float), 0.0, self.limits.most_normal)
        carrying = np.repeat(np.where(cap > 0.0, 1.0, 0.0), 3)
        if (carrying != self._carrying).any():
            self._carrying = carrying
            self._wrench[:3] = np.tile(np.eye(3), 4) * carrying
            self._before = self._before * carrying
        self._upper[::_ROWS] = np.minimum(cap, _INFINITE)
        self._lower[::_ROWS] = np.minimum(self.limits.least_normal, cap)
        self._new_bounds = self._new_sides = True

    def normal_force(self) -> float:
        """Of all feet together, at the last solution [N]."""
        return float(self.forces.sum(axis=0) @ self._constraints[0, :3])

    def solve(self, levers: Array, force: Array, moment: Array) -> Array:
        """Forces (4, 3) [N] on the feet at levers (4, 3) [m] that make a wrench of force and moment, (3,) each."""
        wrench = self._wrench
        wrench[3:] = (levers @ self._skew).reshape(12, 3).T * self._carrying
        target = self._target
        target[:3], target[3:] = force, moment / self.length
        hessian = wrench.T @ wrench
        hessian += self._diagonal
        wanted = target @ wrench + self._smooth * self._before  # minus the gradient at zero
        _, best, failed = dposv(hessian, wanted)
        if failed or not self._keeps(best):
            return self._constrained(hessian, -wanted)
        return self._found(best)

    def _keeps(self, forces: Array) -> bool:
        """Whether forces (12,) keep the constraints."""
        if self._new_sides:
            lower, upper = self._lower > -_INFINITE, self._upper < _INFINITE
            self._sides = np.concatenate([self._constraints[upper], -self._constraints[lower]])
            self._bounds = np.concatenate([self._upper[upper], -self._lower[lower]])
            self._new_sides = False
        return bool((self._sides @ forces - self._bounds).max() <= 0.0)

    def _constrained(self, hessian: Array, gradient: Array) -> Array:
        qp = self._qp
        if not self._started:
            qp.init(hessian, gradient, None, None, self._constraints, self._lower, self._upper)
            self._started = True
        elif self._new_bounds:
            qp.update(H=hessian, g=gradient, C=self._constraints, l=self._lower, u=self._upper)
        else:
            qp.update(H=hessian, g=gradient)
        self._new_bounds = False
        qp.solve()
        if qp.results.info.status != proxsuite.proxqp.PROXQP_SOLVED:
            self.solved = False
            return self.forces
        return self._found(np.array(qp.results.x))

    def _found(self, forces: Array) -> Array:
        self.solved, self._before, self.forces = True, forces, forces.reshape(4, 3)
        return self.forces
