"""Approach (a): the centre of mass by least squares over static poses (the paper's section III.A, eq. 8-11).

The equations at rest (`stadera.lab.laws.equilibrium`) contain only the centre of mass normal to the vertical; poses
that tilt the trunk about two axes determine all of it. With `COMBINED` the errors are estimated as well: they stay the
same while the poses change, and two unknown torques cannot mimic a shifted load at every tilt, height and position of
the trunk. Then

    Σ_poses ‖whitened equations(θ, n)‖² + nᵀ C⁻¹ n + the weak prior

is minimised over trunk θ and errors n by Gauss-Newton: the equations are linear in everything except the feet, and
nearly so in these. Each leg in the air adds three equations.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stadera.constants import GRAVITY
from stadera.information import Information, Unknowns
from stadera.lab.laws.equilibrium import ForceNoise, NoisyForces, constant_errors_of, equilibrium_rows
from stadera.lab.laws.static import StaticEstimator, stated_errors
from stadera.robot.model import Robot
from stadera.trunk.load import centre_slope
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkBounds, TrunkModel
from stadera.trunk.protocol import TrunkEstimate, unobserved
from stadera.trunk.standing.detection import StaticLimits
from stadera.trunk.standing.forces import ContactForces
from stadera.types import Array

SETTLED = StaticLimits(joint_velocity=0.02, quiet=0.5)
"""Limits for a robot at rest for so long that the trunk's residual sway is negligible."""


class PoseMean:
    """Running mean of similar samples, of which there are `count`: none is farther from it than `joint` [rad] in any
    joint and `tilt` [rad] in the vertical, unless that comes from the feet's forces, whose noise exceeds the tilt
    between poses.
    """

    joint, tilt = 0.02, 0.01

    def __init__(self, first: Measurement) -> None:
        self._first, self._mean = first, {name: value.copy() for name, value in _averaged(first).items()}
        self._foot_squares, self._effort_squares = 0.0, np.zeros((len(first.effort), len(first.effort)))
        self.count = 1

    def takes(self, m: Measurement) -> bool:
        """Adds a sample if it is similar and the same legs are in stance; returns whether it was added."""
        values, k = _averaged(m), len(m.extra) // 3
        if _meant(m) != _meant(self._first) or values.keys() != self._mean.keys():
            return False
        away = {name: value - self._mean[name] for name, value in values.items()}
        joints = np.append(away["joint_position"], away["extra"][:k])
        if float(np.abs(joints).max()) > self.joint:
            return False
        if not m.vertical_by_forces and float(np.abs(away["up"]).max()) > self.tilt:
            return False
        self.count += 1
        share = 1.0 / self.count
        for name, value in away.items():
            self._mean[name] += share * value
        self._effort_squares += (1.0 - share) * np.outer(away["effort"], away["effort"])
        if "foot_position" in away:
            self._foot_squares += (1.0 - share) * float((away["foot_position"] ** 2).sum())
        return True

    @property
    def effort_covariance(self) -> Array:
        """Covariance (n, n) of the mean efforts [N²·m²] from their scatter; 0 for a single sample."""
        return np.asarray(self._effort_squares / (max(self.count - 1, 1) * self.count))

    @property
    def foot_variance(self) -> float:
        """Variance of each component of the feet's mean positions [m²] from their scatter; 0 if not measured."""
        values = self._mean["foot_position"].size if "foot_position" in self._mean else 1
        return self._foot_squares / (values * max(self.count - 1, 1) * self.count)

    @property
    def measurement(self) -> Measurement:
        """The mean, as a measurement at rest."""
        mean: dict[str, Any] = {name: value.copy() for name, value in self._mean.items()}
        up, still = mean.pop("up"), np.zeros_like(mean["effort"])
        force = GRAVITY * up / np.linalg.norm(up)
        at_rest: dict[str, Any] = {"joint_velocity": still, "angular_velocity": np.zeros(3), "rotation": None}
        return replace(self._first, specific_force=force, **mean, **at_rest)


def _averaged(m: Measurement) -> dict[str, Array]:
    """What is averaged over a pose."""
    values = {"joint_position": m.joint_position, "effort": m.effort, "up": m.up, "extra": m.extra}
    return values if m.foot_position is None else values | {"foot_position": m.foot_position}


def _meant(m: Measurement) -> list[bool]:
    """Legs meant to be in stance; none are known, none are named."""
    return [] if m.stance is None else m.stance.tolist()


@dataclass(frozen=True)
class PosesSettings:
    """Settings of the estimate from poses."""

    seek_errors: bool = False  # treat constant errors as unknowns; else they are considered
    kept: int = 0  # closed poses that are linearised again in every solution; older ones are summed up permanently
    iterations: int = 6  # largest number of Gauss-Newton iterations, if errors are sought
    settled: float = 1e-6  # change of the centre of mass at which they stop [m]
    observed: float = 0.2  # share of the plausible range's standard deviation below which a component is observed
    # sizes of torque offsets, as a share of the effort limits, and of errors of the feet's positions [m] (1 σ); None
    # for those of the forces' noise. The vertical's error is 0.2°.
    torque_constant: float | None = None
    foot_position: float | None = None
    still: StaticLimits = SETTLED  # limits for a robot at rest


WIDE_TORQUE, WIDE_FOOT = 0.15, 0.03
"""Sizes of the errors in the combined method: share of the effort limits, and [m] (1 σ)."""

COMBINED = PosesSettings(seek_errors=True, kept=64, torque_constant=WIDE_TORQUE, foot_position=WIDE_FOOT)
"""The combined method, with torque offsets and feet as unknowns too. The paper's errors are up to 20 N·m and 3 cm."""


class PosesCom(StaticEstimator):
    """Estimates all three components by least squares over the poses held so far, with bounded memory: by default the
    paper's approach (a), by `COMBINED` with errors as unknowns. `start` is the value of components that no pose
    determines.
    """

    _WITHOUT_IMU, kind = True, PosesSettings
    settings: PosesSettings

    def _begin(self) -> None:
        robot, torque, foot = self.robot, self.settings.torque_constant, self.settings.foot_position
        if torque is not None and foot is not None:
            self._error_std = stated_errors(robot, ForceNoise.of(robot, constant=torque, foot_position=foot))
        self._folded = plausible(robot, self._start, self.bounds)
        self._open: PoseMean | None = None
        self._closed: list[PoseMean] = []
        self._linear_at = self._anchor = np.zeros(len(self._error_std))
        self._known = unobserved()
        self._solved, self._latest = -np.inf, np.nan

    def tare(self) -> None:
        """Makes the present estimate the reference for `payload`, and begins anew: later poses may be of another
        load.
        """
        super().tare()
        self._folded, self._open, self._closed = plausible(self.robot, self._start, self.bounds), None, []

    def estimate(self) -> TrunkEstimate:
        """The estimate from all poses so far, computed on demand."""
        refusal = "" if self._ran_away else self._reason
        self._solve()
        if refusal:
            self._refuse(refusal)
        return super().estimate()

    def _learn(self, measurement: Measurement, forces: ContactForces) -> None:
        self._latest = measurement.time
        if self._open is None or not self._open.takes(measurement):
            self._close()
            self._open = PoseMean(measurement)

    def _close(self) -> None:
        kept = self.settings.kept
        if kept and len(self._closed) >= kept:  # the oldest pose is about to be linearised permanently
            self._solve()
            self._anchor = self._linear_at
        if self._open is not None:
            self._closed.append(self._open)
            self._open = None
        while len(self._closed) > kept:
            self._folded = with_poses(self._folded, self.forces, [self._closed.pop(0)], self._linear_at)

    def _solution(self) -> Information:
        """Gauss-Newton from the errors at which older poses were linearised; one step if errors are only considered,
        which removes them from the unknowns.
        """
        settings, before, std = self.settings, np.full(3, np.inf), self._error_std
        self._linear_at = self._anchor
        poses = [*self._closed, self._open] if self._open is not None else self._closed
        for _ in range(settings.iterations):
            known = with_poses(self._folded, self.forces, poses, self._linear_at)
            if not settings.seek_errors:
                return known.consider(np.diag(std), ("errors",))
            prior = np.zeros((len(std), len(known)))
            prior[:, known["errors"]] = np.diag(1.0 / std)
            known = known.add(prior, np.zeros(len(std)))
            self._linear_at, com = known.mean[known["errors"]], centre_of(known)[0][1:]
            if float(np.abs(com - before).max()) < settings.settled:
                break
            before = com
        return known

    def _solve(self) -> None:
        if np.isnan(self._latest) or self._latest == self._solved:
            return
        value, covariance = centre_of(self._solution())
        self._solved = self._latest
        hidden = np.flatnonzero(~(np.sqrt(np.diag(covariance)) < self.settings.observed * self.bounds.spread))
        start = np.array([self._start.mass, *self._start.com_trunk])
        value = _conditioned(value, covariance, hidden, start)
        if self._adopt(self._latest, float(value[0]), value[1:], not len(hidden)):
            self._known = covariance
            self._known[hidden, :] = self._known[:, hidden] = np.nan

    def _covariance(self) -> Array:
        return self._known


def _conditioned(value: Array, covariance: Array, fixed: NDArray[np.intp], at: Array) -> Array:
    """Conditional mean of the other components when some are known to be `at`."""
    if not len(fixed):
        return value
    gain = covariance[:, fixed] @ np.linalg.inv(covariance[np.ix_(fixed, fixed)])
    result = value + gain @ (at[fixed] - value[fixed])
    result[fixed] = at[fixed]
    return np.asarray(result)


def with_poses(
    known: Information, forces: NoisyForces, poses: Iterable[PoseMean], errors: Array | None = None
) -> Information:
    """Information on trunk and errors with the equations of some poses, linearised at errors (k,); None for zero."""
    at = np.zeros(len(constant_errors_of(forces.robot))) if errors is None else errors
    for pose in poses:
        rows, target = equilibrium_rows(
            forces, pose.measurement, pose.count, at, pose.foot_variance, pose.effort_covariance
        )
        matrix = np.zeros((len(rows), len(known)))
        matrix[:, known["trunk"]], matrix[:, known["errors"]] = rows[:, :4], rows[:, 4:]
        known = known.add(matrix, target)
    return known


def plausible(robot: Robot, start: TrunkModel, bounds: TrunkBounds) -> Information:
    """The weak prior: mass and first moment around the start's, as wide as uniform distributions of mass and centre of
    mass over the plausible box.
    """
    known = Information.empty(Unknowns.of(trunk=4, errors=len(constant_errors_of(robot))))
    place, scale = known["trunk"], 1.0 / (start.mass * bounds.spread[1:])
    matrix = np.zeros((4, len(known)))
    matrix[:3, place.start] = -start.com_trunk * scale
    matrix[:3, place.start + 1 : place.stop] = np.diag(scale)
    matrix[3, place.start] = 1.0 / bounds.spread[0]
    return known.add(matrix, np.array([0.0, 0.0, 0.0, start.mass / bounds.spread[0]]))


def centre_of(known: Information) -> tuple[Array, Array]:
    """Mass [kg] and centre of mass [m] of the trunk (4,), and their covariance (4, 4)."""
    moments = known.mean[known["trunk"]]
    slope = centre_slope(moments)
    return np.array([moments[0], *moments[1:] / moments[0]]), slope @ known.covariance("trunk") @ slope.T
