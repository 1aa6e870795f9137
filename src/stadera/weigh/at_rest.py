"""Weighs a robot from its times at rest, in one pass, with memory independent of the log's length but for its blocks.

In static equilibrium the ground carries the weight along the vertical u (trunk axes),

    m_tr = u · Σ f_i / g - m_l                                                    (eq. 7)

which gives the mass of each block, a short time at rest. Constant errors n of torques, feet and the legs' masses change
it by s n with s = uᵀ (∂F/∂n) / g. Two blocks in one pose have nearly the same s, so the variance of their difference,
(s_2 - s_1) C (s_2 - s_1)ᵀ, is small: a change is known much better than a mass.

A block deviates from the mean of its load if it differs by more than a share of the robot's mass and by more than a
number of standard deviations of the difference. If two successive blocks deviate to the same side, the load changed at
the first of them; a single one is a disturbance. The centre of mass is that of the method, made anew for each load from
its first block on: from a block that deviates the next estimator runs beside the present one, until it is confirmed.
The payload is the difference between the poses held since the tare and those before it.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import degrees, hypot, isnan, sqrt

import numpy as np
from scipy.linalg import block_diag

from stadera.constants import GRAVITY
from stadera.errors import IdentificationError
from stadera.inertia import InertialParameters, skew
from stadera.robot.model import Robot
from stadera.trunk.load import LoadChange, Payload
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.trunk.protocol import Status, StepEstimator, TrunkEstimate, Weigher, unobserved
from stadera.trunk.result import TrunkParameters
from stadera.trunk.standing.detection import StaticDetector, stretched
from stadera.trunk.standing.equilibrium import ConstantErrors, felt_by_mass, weight_felt
from stadera.trunk.standing.forces import ContactForceEstimator, ContactForces, ForceNoise
from stadera.trunk.standing.poses import Alike, PoseMean, gather, payload_between, sized_by_poses
from stadera.trust import Trust
from stadera.types import Array
from stadera.weigh.result import Balance, Refusal, Timeline, Vertical, level_axes
from stadera.weigh.settings import WeighSettings

Locate = Callable[[Measurement, ContactForceEstimator], Weigher]
"""Makes the estimator of the centre of mass; given the log's first measurement."""


@dataclass(frozen=True, eq=False)
class RestBlock:
    """A short period at rest, or several of one load, from the first to the last sample [s]."""

    begin: float
    end: float
    count: int
    mass: float  # mean over `count` samples [kg]
    # of the mean due to white noise [kg²]: the larger of the stated one and that of the samples' scatter
    variance: float
    sensitivity: Array  # (k,), s: of the mass to constant errors
    load: Array  # (L,) [N], mean vertical forces
    noticed: float = np.nan  # end of the block that confirmed the change to this load [s]; NaN for the first load

    def joined(self, later: RestBlock) -> RestBlock:
        """This block and a later one of the same load."""
        count = self.count + later.count
        old, new = self.count / count, later.count / count
        return replace(
            self,
            end=later.end,
            count=count,
            mass=old * self.mass + new * later.mass,
            variance=old**2 * self.variance + new**2 * later.variance,
            sensitivity=old * self.sensitivity + new * later.sensitivity,
            load=old * self.load + new * later.load,
        )

    def std(self, errors: ConstantErrors) -> float:
        """Standard deviation of the mass, constant errors included [kg]."""
        return sqrt(self.variance + self.sensitivity @ errors.covariance @ self.sensitivity)

    def variance_from(self, other: RestBlock, covariance: Array) -> float:
        """Variance of the difference of two masses [kg²]: white noise of both, and the part of constant errors of this
        covariance (k, k) that does not cancel.
        """
        apart = self.sensitivity - other.sensitivity
        return float(self.variance + other.variance + apart @ covariance @ apart)


@dataclass
class _OpenBlock:
    """A block that is still being filled, and its measurements as far as they are of a load's poses."""

    begin: float
    held: list[Measurement] = field(default_factory=list)
    loads: list[Array] = field(default_factory=list)  # (L,) [N] each, vertical forces of the feet
    in_pose: bool = True  # False once a tare was taken within it

    def add(self, m: Measurement, forces: ContactForces) -> None:
        self.held.append(m)
        self.loads.append(forces.vertical(m.up))

    def closed(self, forces_of: ContactForceEstimator, fewest: int = 3) -> RestBlock | None:
        """The block; None if it has too few samples."""
        m, n = self.held[-1], len(self.held)
        if n < fewest:
            return None
        load, forces = np.array(self.loads), forces_of.at(m)
        masses = load.sum(axis=1) / GRAVITY - forces_of.leg_mass
        sensitivity = felt_by_mass(forces, m, forces_of.robot)
        white = float(sensitivity[: len(forces.left)] ** 2 @ forces.noise.torque_white**2)
        variance = max(white, float(masses.var(ddof=1))) / n
        return RestBlock(self.begin, m.time, n, float(masses.mean()), variance, sensitivity, load.mean(axis=0))


@dataclass
class _Load:
    """What is learnt while one load lasts: the method's estimator, its estimates at the ends of blocks, and poses."""

    estimator: Weigher
    estimates: list[TrunkEstimate] = field(default_factory=list)
    poses: list[PoseMean] = field(default_factory=list)


class _Movement:
    """A period without rest, and the reason that applied for most of its samples; figures in it do not count."""

    def __init__(self, begin: float) -> None:
        self.begin = begin
        self._reasons: Counter[str] = Counter()
        self._first: dict[str, str] = {}  # of each kind

    def add(self, reason: str) -> None:
        kind = re.sub(r"[-+]?\d[\d.]*|'[^']*'", "#", reason)
        self._reasons[kind] += 1
        self._first.setdefault(kind, reason)

    def until(self, end: float) -> Refusal:
        return Refusal(self.begin, end, self._first[self._reasons.most_common(1)[0][0]])


class AtRest(StepEstimator):
    """Estimates mass, centre of mass and payload of a robot while it stands still.

    Args:
        locate: makes the method's estimator of the centre of mass.
        no_imu: what to add to errors if the log has none.

    Attributes:
        blocks: at rest so far.
    """

    def __init__(self, robot: Robot, locate: Locate, settings: WeighSettings, no_imu: str = "") -> None:
        self.robot, self._settings, self._locate, self._no_imu = robot, settings, locate, no_imu
        self._prior = ConstantErrors.of_robot(robot, settings.trunk.model)
        torques = np.sqrt(np.diag(self._prior.covariance)[self._prior.places["torque"]])
        self._forces = ContactForceEstimator(robot, replace(ForceNoise.of(robot), torque_constant=torques))
        self._alike = Alike()
        self._first: Measurement | None = None
        self._gate = StaticDetector(robot)
        self.blocks: list[RestBlock] = []
        self._means: list[RestBlock] = []
        self._load: _Load | None = None
        self._next: _Load | None = None  # from the block that waits for confirmation on
        self._waiting: RestBlock | None = None
        self._open: _OpenBlock | None = None
        self._earlier: list[TrunkEstimate] = []  # of former loads, at the ends of their blocks
        self._reference: list[PoseMean] | None = None
        self._tared_at = np.nan
        self._refused: list[Refusal] = []
        self._moves: _Movement | None = None
        self._restarted = self._anew = False
        self._time, self._begin = np.nan, np.nan
        self._sized: ConstantErrors | None = None

    # -- feeding ------------------------------------------------------------------------------------------------------
    def update(self, m: Measurement) -> None:
        """Processes one measurement."""
        if self._load is None or self._restarted:
            self._earlier += self._load.estimates if self._load else []
            self._first, self._begin, self._restarted, self._anew = m, m.time, False, True
            self._load, self._next, self._waiting = _Load(self._locate(m, self._forces)), None, None
        forces, self._time = self._forces.at(m), m.time
        reason = self._gate.complaint(m, forces) or stretched(forces, self.robot, m.stance)
        if reason or (self._open is not None and m.time - self._open.begin >= self._settings.block):
            self._close()
        if reason:
            self._moves = self._moves or _Movement(m.time)
            self._moves.add(reason)
        else:
            if self._moves is not None:
                self._refused.append(self._moves.until(m.time))
                self._moves = None
            self._open = self._open or _OpenBlock(m.time)
            self._open.add(m, forces)
        for load in (self._load, self._next):
            if load is not None:
                load.estimator.update(m)

    def tare(self) -> None:
        """Makes the poses held so far under this load the reference for `payload`."""
        if self._load is None:
            return
        self._reference, self._load.poses, self._tared_at = self._load.poses, [], self._time
        if self._open is not None:
            self._open.in_pose = False
        self._sized = None

    def restart(self) -> None:
        """Announces that the next measurements do not continue the previous ones, and may be of another load."""
        self._close()
        if self._moves is not None:
            self._refused.append(self._moves.until(self._time))
            self._moves = None
        self._gate, self._restarted, self._sized = StaticDetector(self.robot), True, None

    def _close(self) -> None:
        """Ends the open block; decides whether the load changed."""
        opened, self._open = self._open, None
        block = None if opened is None else opened.closed(self._forces)
        if opened is None or block is None or self._load is None:
            return
        self.blocks.append(block)
        self._sized, held = None, opened.held if opened.in_pose else []
        for load in (self._load, self._next):
            if load is not None:
                load.estimates.append(load.estimator.estimate())
                self._hold(load, held)
        if self._anew:
            self._means.append(block)
            self._anew = False
        elif not self._departs(self._means[-1], block):
            self._means[-1], self._waiting, self._next = self._means[-1].joined(block), None, None
        elif (
            self._waiting is not None
            and self._next is not None
            and (self._waiting.mass > self._means[-1].mass) == (block.mass > self._means[-1].mass)
        ):
            self._means.append(replace(self._waiting, noticed=block.end).joined(block))
            self._earlier += self._load.estimates[: -len(self._next.estimates)]
            self._load, self._next, self._waiting = self._next, None, None
        else:
            assert self._first is not None
            self._waiting, self._next = block, _Load(self._locate(self._first, self._forces))
            self._next.estimator.add(opened.held)
            self._next.estimates.append(self._next.estimator.estimate())
            self._hold(self._next, held)

    def _hold(self, load: _Load, held: Sequence[Measurement]) -> None:
        for m in held:
            gather(load.poses, m, self._alike, self._settings.poses)

    def _departs(self, mean: RestBlock, block: RestBlock) -> bool:
        """True if a block deviates from the mean of its load."""
        settings, std = self._settings, sqrt(block.variance_from(mean, self._prior.covariance))
        least = max(settings.least_change * self.robot.mass, settings.change_deviations * std)
        return abs(block.mass - mean.mass) > least

    # -- asking -------------------------------------------------------------------------------------------------------
    def estimate(self) -> TrunkEstimate:
        """The method's estimate at the end of the last block, and the mass of the load."""
        if not self.blocks:
            reason = f"the robot never stands still, nothing to weigh by: {self._usual_reason}{self._no_imu}"
            return TrunkEstimate(np.nan, TrunkModel.prior(self.robot), unobserved(), Status.REFUSED, reason)
        trunk, last = self.trunk, self._last
        return TrunkEstimate(self.learnt, TrunkModel.of(trunk.inertial), trunk.covariance, last.status, last.reason)

    @property
    def learnt(self) -> float:
        """End of the last block [s]; NaN before any."""
        return self.blocks[-1].end if self.blocks else np.nan

    @property
    def refusals(self) -> tuple[Refusal, ...]:
        """Periods without rest, and why, in order."""
        return tuple(self._refused)

    @property
    def trunk(self) -> TrunkParameters:
        """The mass by eq. 7 over the whole load, the centre of mass from the method, the inertia of the prior."""
        prior = self.robot.inertias[self.robot.trunk]
        if not self._means:
            return TrunkParameters.unobserved(prior)
        found, mass, alone = self._last, self._means[-1].mass, self._wide * self._means[-1].std(self._errors)
        hidden = np.isnan(found.std[1:])
        own = self._with_gain(alone, mass + self.robot.mass - prior.mass) ** 2
        # mass and centre of mass are estimated separately
        covariance = block_diag(np.array(own), self._wide**2 * found.covariance[1:, 1:])
        com = np.where(hidden, prior.com, found.trunk.com_trunk)
        inertial = InertialParameters.from_com(mass, com, prior.inertia_com)
        observed = np.array([True, *~hidden, *[False] * 6])
        return TrunkParameters(inertial, covariance, np.full(6, np.nan), observed, alone)

    @property
    def payload(self) -> Payload | None:
        """By the difference between poses. Raises IdentificationError: there was no rest on one side."""
        if self._reference is None or self._load is None:
            return None
        if not self._load.poses:
            raise IdentificationError(
                f"the robot does not stand still after the tare's time, {self._tared_at - self._begin:.3g} s"
                f"{self._no_imu}"
            )
        found = payload_between(self._reference, self._load.poses, self._forces, self._errors)
        return replace(
            found,
            mass_std=self._with_gain(self._wide * found.mass_std, found.mass),
            mass_std_without_scale=self._wide * found.mass_std,
            com_covariance=self._wide**2 * found.com_covariance,
        )

    @property
    def changes(self) -> tuple[LoadChange, ...]:
        """From each load to the next of the same log; static friction of each is its own."""
        found = []
        for before, after in ((b, a) for b, a in pairwise(self._means) if not isnan(a.noticed)):
            alone = self._wide * sqrt(change_variance(before, after, self._errors))
            mass = after.mass - before.mass
            kind, std = "on" if mass > 0 else "off", self._with_gain(alone, mass)
            found.append(LoadChange(after.begin, after.noticed, mass, std, kind, alone))  # type: ignore[arg-type]
        return tuple(found)

    @property
    def trust(self) -> Trust:
        """By the scatter of the masses of blocks, and the time since the last of them."""
        misfit, since = self._misfit, self._time - self.learnt
        trust = Trust("good", misfit)
        if self._wide > 1.0:
            reason = f"the masses of blocks at rest scatter {misfit:.3g} times as much as stated (variance)"
            trust = trust.at_most("doubtful", f"{reason}; the error bars are widened by it")
        if since > self._settings.stale:
            trust = trust.at_most(
                "doubtful",
                f"the robot stands still until {self.learnt - self._begin:.2f} s and not in the {since:.1f} s after "
                "it; a change of the load from then on would not be seen",
            )
        return trust

    @property
    def timeline(self) -> Timeline:
        """Mass and feet's forces of each block alone, and the centre of mass at its end."""
        blocks, estimates = self.blocks, [*self._earlier, *(self._load.estimates if self._load else ())]
        std = np.array([estimate.std[1:] for estimate in estimates])
        com = np.array([estimate.trunk.com_trunk for estimate in estimates])
        return Timeline(
            time=np.array([0.5 * (b.begin + b.end) for b in blocks]),
            mass=np.array([b.mass for b in blocks]),
            mass_std=np.array([b.std(self._errors) for b in blocks]),
            com=np.where(np.isnan(std), np.nan, com),
            com_std=std,
            load=np.array([b.load for b in blocks]),
        )

    @property
    def vertical(self) -> Vertical:
        """In the last pose, with the error due to constant errors and white noise."""
        pose, errors = self._pose, self._errors
        m = pose.measurement
        if not m.vertical_by_forces:
            turned = skew(m.up)
            tilt = errors.covariance[errors.places["vertical"], errors.places["vertical"]]
            return Vertical("imu", m.up, np.sqrt(np.diag(turned @ tilt @ turned.T)))
        forces, torque = self._forces.at(m), errors.places["torque"]
        felt = weight_felt(forces, self.robot, m.up)[1:]
        white = felt[:, torque] * (forces.noise.torque_white**2 / pose.count) @ felt[:, torque].T
        return Vertical("forces", m.up, np.sqrt(np.diag(felt @ errors.covariance @ felt.T + white)))

    @property
    def balance(self) -> Balance:
        """In the last pose."""
        m, found, mass, legs = self._pose.measurement, self._last, self._means[-1].mass, self._forces.leg_mass
        forces, up = self._forces.at(m), m.up
        to_level = level_axes(up)
        com = (mass * found.trunk.com_trunk + forces.weights.moment) / (mass + legs)
        return Balance(
            to_level=to_level,
            position=m.joint_position,
            feet=forces.contact,
            stance=forces.stance,
            force=forces.vertical(up),
            pressure=(to_level @ forces.pressure(up))[:2],
            robot_com=np.full(2, np.nan) if isnan(found.time) else (to_level @ com)[:2],
        )

    def remarks(self, method: str) -> list[str]:
        """On the vertical without an IMU, and on the method's estimate, one sentence each."""
        found, vertical, said = self._last, self.vertical, []
        if vertical.source == "forces":
            said.append(
                "no IMU: weighed while the joints stand still, with the direction of the feet's forces as the "
                f"vertical, known to ±{degrees(vertical.tilt_std):.2g}°, which is in the error bars; a steady push or "
                "pull and a floor that accelerates would be taken for weight, and neither inertia nor anything in "
                "motion is known"
            )
        if isnan(found.time):
            said.append(f"the method {method!r} found no centre of mass: {found.reason or 'no rest'}")
        elif found.status is Status.REFUSED:
            said.append(f"the centre of mass is the last good one: {found.reason}")
        elif found.status is not Status.CONVERGED:
            said.append(
                f"the method {method!r} had not settled by its own rule at the end of the log; a longer rest, or poses "
                "with the trunk tilted for methods that use poses, would tell more"
            )
        return said

    # -- inside -------------------------------------------------------------------------------------------------------
    @property
    def _last(self) -> TrunkEstimate:
        """The method's estimate at the end of the last block."""
        assert self._load is not None
        return self._load.estimates[-1]

    @property
    def _pose(self) -> PoseMean:
        """The last pose; that of the tare right after it."""
        assert self._load is not None
        return (self._load.poses or self._reference or [])[-1]

    @property
    def _errors(self) -> ConstantErrors:
        """The constant errors, with the sizes that the poses show."""
        if self._sized is None:
            poses = [] if self._load is None else self._load.poses
            self._sized = sized_by_poses(self._reference or [], poses, self._forces, self._prior)
        return self._sized

    @property
    def _misfit(self) -> float:
        """Variance of the blocks' masses about the mean of their load, divided by the stated one; NaN for too few
        blocks. Disturbances are excluded. Each mean takes one degree of freedom.
        """
        squares, freedom, starts = 0.0, -len(self._means), [mean.begin for mean in self._means[1:]]
        for block in self.blocks:
            mean = self._means[bisect_right(starts, block.begin)]
            if not self._departs(mean, block):
                variance = block.variance_from(replace(mean, variance=0.0), self._prior.covariance)
                squares, freedom = squares + (block.mass - mean.mass) ** 2 / variance, freedom + 1
        return squares / freedom if freedom > 0 else np.nan

    @property
    def _wide(self) -> float:
        """Factor on all error bars that accounts for the scatter of the blocks' masses."""
        misfit = self._misfit
        return sqrt(misfit) if misfit > self._settings.doubtful_misfit else 1.0

    def _with_gain(self, std: float, mass: float) -> float:
        """A mass's standard deviation with that of the scale of all torques in common, which no pose shows."""
        return hypot(std, self._settings.trunk.model.common_gain * mass)

    @property
    def _usual_reason(self) -> str:
        """The reason against rest that applied for the longest time."""
        moved = [*self._refused, *([] if self._moves is None else [self._moves.until(self._time)])]
        longest = max(moved, key=lambda r: r.end - r.begin, default=None)
        return "" if longest is None else longest.reason


def change_variance(before: RestBlock, after: RestBlock, errors: ConstantErrors) -> float:
    """Variance of the difference of two loads [kg²]: static friction of each is its own."""
    torques = [block.sensitivity[errors.places["torque"]] for block in (before, after)]
    own = sum(float(s @ errors.sticking @ s) for s in torques)
    return after.variance_from(before, errors.lasting) + own
