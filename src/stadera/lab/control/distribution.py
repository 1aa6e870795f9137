"""Distributes a wrench over the feet: a quadratic programme with friction pyramids and unilateral contact.

    min_f  ‖Σ f_i - F‖² + ‖Σ r_i x f_i - Γ‖² / L² + ε ‖f‖² + β ‖f - f_before‖²
    s.t.   least ≤ n·f_i ≤ most_i,     |t1·f_i| ≤ μ/√2 n·f_i,     |t2·f_i| ≤ μ/√2 n·f_i

r_i: contacts relative to the reference point of Γ; n, t1, t2: the ground's normal and two tangents; L: a length that
makes moments comparable with forces; all vectors in the axes of one frame. ε and β are small: they choose among the
forces with the required wrench, which deviates by about their relative size unless constraints are active.

With W f the wrench, β' = β / (ε + β) and t the required wrench, the minimiser x_0 of the objective alone is

    x_0 = β' f_before + Wᵀ (W Wᵀ + (ε + β) 1)⁻¹ (t - β' W f_before)

The programme is strictly convex: if x_0 satisfies the constraints G x ≤ b, it is the solution. Otherwise, with the
Hessian UᵀU and y = U (x - x_0), the solution is the least y with G U⁻¹ y ≤ b - G x_0, and such a least-distance problem
is a non-negative least-squares problem (Lawson and Hanson, Solving Least Squares Problems, ch. 23)::

    u = argmin_{u ≥ 0} ‖E u - e_last‖,     E = [-G U⁻¹ | G x_0 - b]ᵀ,     r = E u - e_last,     y = -r / r_last

which ends exactly after a few exchanges. Feet without load are excluded from both.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.lapack import dposv, dpotrf, dtrtrs
from scipy.optimize import nnls

from stadera.constants import ROUNDING
from stadera.inertia import skews
from stadera.types import Array

_ROWS = 6  # constraints for each foot: upper and lower limit, four sides of the pyramid


class ForceDistribution:
    """The quadratic programme of feet, or of points on them, with the least normal force [N] of every foot in stance,
    length L [m], `small` ε and `smooth` β. `forces` (feet, 3) [N] is the latest solution, an older one if the solver
    failed.
    """

    friction = 0.6  # coefficient assumed by the controller

    def __init__(self, least: float, length: float, small: float = 1e-5, smooth: float = 1e-4, feet: int = 4) -> None:
        self.least, self.length, self._feet = least, length, feet
        self._keeping, self._six = smooth / (small + smooth), (small + smooth) * np.eye(6)
        self.forces = np.zeros((feet, 3))
        self._skew = -skews(np.eye(3)).reshape(3, 9) / length  # negative, as the rows of [r]x are used as columns
        self._wrench = np.zeros((6, 3 * feet))  # the map from forces to the weighted wrench
        self._wrench[:3] = np.tile(np.eye(3), feet)
        self._diagonal = np.diag(np.full(3 * feet, small + smooth))
        self._bounds = np.zeros(feet * _ROWS)
        self._before, self._target = np.zeros(3 * feet), np.zeros(6)
        self._carrying = np.ones(3 * feet)
        self.set_ground(np.array([0.0, 0.0, 1.0]))
        self.set_most(np.full(feet, np.inf))

    def set_ground(self, normal: Array) -> None:
        """Sets the ground's unit normal (3,)."""
        slope = self.friction / np.sqrt(2.0)
        helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
        first = np.cross(normal, helper)
        first /= np.linalg.norm(first)
        second = np.cross(normal, first)
        sides = [sign * t - slope * normal for t in (first, second) for sign in (1.0, -1.0)]
        self._sides = np.kron(np.eye(self._feet), np.array([normal, -normal, *sides]))

    def set_most(self, most: ArrayLike) -> None:
        """Sets the largest normal force of each foot, (feet,) [N]; zero for a foot in the air."""
        cap: Array = np.maximum(np.asarray(most, dtype=float), 0.0)
        carrying = np.repeat(np.where(cap > 0.0, 1.0, 0.0), 3)
        if (carrying != self._carrying).any():
            self._carrying = carrying
            self._wrench[:3] = np.tile(np.eye(3), self._feet) * carrying
            self._before = self._before * carrying
        bounds = self._bounds.reshape(-1, _ROWS)
        bounds[:, 0], bounds[:, 1] = cap, -np.minimum(self.least, cap)

    def normal_force(self) -> float:
        """Total normal force of all feet in the latest solution [N]."""
        return float(self.forces.sum(axis=0) @ self._sides[0, :3])

    def solve(self, levers: Array, force: Array, moment: Array) -> Array:
        """Forces (feet, 3) [N] on the feet at levers (feet, 3) [m] for a wrench of force and moment, (3,) each."""
        wrench = self._wrench
        wrench[3:] = levers.dot(self._skew).reshape(-1, 3).T * self._carrying
        target = self._target
        target[:3], target[3:] = force, moment / self.length
        near = self._keeping * self._before
        square = wrench.dot(wrench.T)
        square += self._six
        _, pull, failed = dposv(square, target - wrench.dot(near), overwrite_a=1, overwrite_b=1)
        if failed:
            return self.forces
        best = near + pull.dot(wrench)
        slack = self._bounds - self._sides.dot(best)
        if slack.min() >= -ROUNDING:
            return self._found(best)
        return self._constrained(best, slack)

    def _constrained(self, best: Array, slack: Array) -> Array:
        """The forces nearest to the best ones for which no slack is negative."""
        upper, _ = dpotrf(self._wrench.T @ self._wrench + self._diagonal)
        counted = np.isfinite(slack) & np.repeat(self._carrying[::3] > 0.0, _ROWS)
        across, _ = dtrtrs(upper, self._sides[counted].T, trans=1)  # U⁻ᵀ Gᵀ, its columns the constraints
        sizes = np.sqrt((across * across).sum(axis=0))
        far = -slack[counted] / sizes  # of the constraints from y = 0
        scale = float(far.max())
        E = np.empty((len(across) + 1, len(far)))
        E[:-1], E[-1] = -across / sizes, far / scale
        goal = np.zeros(len(E))
        goal[-1] = 1.0
        try:
            u, _ = nnls(E, goal)
        except RuntimeError:  # no convergence
            return self.forces
        left = E @ u - goal
        step, _ = dtrtrs(upper, left[:-1] * (-scale / left[-1]))
        return self._found(best + step)

    def _found(self, forces: Array) -> Array:
        self._before, self.forces = forces, forces.reshape(-1, 3)
        return self.forces


@dataclass(frozen=True)
class LoadRamp:
    """A limit of a foot's normal force that changes linearly."""

    begin: float  # [s]
    duration: float  # [s], positive
    start: float  # [N]
    goal: float  # [N]
    remains: bool  # whether the limit persists after the end; else it is removed

    def at(self, time: float) -> float:
        """The limit [N]; infinite after the end, unless it remains."""
        x = (time - self.begin) / self.duration
        if x >= 1.0 and not self.remains:
            return np.inf
        return self.start + min(max(x, 0.0), 1.0) * (self.goal - self.start)
