"""Weighing while walking: the trunk's ten parameters from every block of 20 ms, whatever the robot does.

Rows of a block (`stadera.estimate.walking_rows`) are whitened by their noise at the trunk as believed and taken into a
square-root information of 28 unknowns: the trunk's ten parameters, which may drift a little, and what is constant
over a run (torque offsets, accelerometer bias, lags, depth of the soles), each about zero to its stated size. So
the absolute error bars contain the constants, and as a reference (the tare) is kept as ten more unknowns beside them,
what constants do alike to both cancels in the payload and in its covariance. What the model itself is off by is not
sought, but carried through into the error bars (`stadera.estimate.square_root`).

When the load changes (`stadera.estimate.changes`), the ten parameters start anew from what was known before the change,
widened by what a payload can do; offsets, bias, lag and the tare stay as known.

Nothing is asked of the motion. What it does not show, height and inertia of a robot that stands still, stays as wide as
it was started, and counts as not observed.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from stadera.errors import StaderaError
from stadera.estimate.changes import ChangeDetector, ChangeLimits, Jump, Step
from stadera.estimate.measurement import Measurement
from stadera.estimate.protocol import Status, TrunkEstimate, unobserved
from stadera.estimate.square_root import SquareRoot
from stadera.estimate.trunk import ImplausibleError, TrunkBounds, TrunkModel
from stadera.estimate.walking_ground import GroundNormal
from stadera.estimate.walking_noise import WalkingNoise
from stadera.estimate.walking_result import Centre, ChangeBegun, LoadChange, Payload, TrunkParameters, known_to
from stadera.estimate.walking_rows import BlockRows, RowMaker
from stadera.estimate.walking_samples import SampleBuffer, Samples
from stadera.estimate.walking_unknowns import (
    ALWAYS,
    CONSTANTS,
    LAG,
    MODEL,
    OFFSETS,
    THETA,
    UNKNOWNS,
    constants_of,
    unknowns,
    widest,
)
from stadera.inertia import InertialParameters
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot

Array = NDArray[np.float64]

_GRAVITY = 9.81  # m/s²
_ROWS = np.eye(6)
_RESHAPED = 10  # blocks after which the trunk that noise is reckoned with is read anew
_LOST_GROUND = 0.2  # s
_SLIDES = 0.8  # of 1: a joint that surely slides
_HELD = 0.2  # s without sliding, after which what holds a joint was taken for its offset
_HOLDS = 0.6  # of its Coulomb friction, 1 σ: what holds a joint that sticks, anything up to that
_WANDERED = 0.5  # s
_TARE = slice(UNKNOWNS, UNKNOWNS + 10)
_SETTLED = 0.5  # s of learning after which an estimate that is known well enough counts as converged
_LOUD = 9.0  # normalised innovation squared, per row, from which a block counts for less
_JUMP = 0.3  # of the widest: the size of what a payload does to the ten parameters
_SHIFTED = 0.005  # of the robot's mass: what changes by less was only moved
_PAYLOAD_LIMIT = 0.1  # of the leg's length: a payload's centre of mass known less well is not observed
_PATIENCE = 25  # blocks after a jump, until one that is still too small for a name is taken over without
_FIRST_CAUTION = 9.0  # times the stated variances, that a change must beat before the noise has been heard
_QUIETEST = 0.5  # times the stated variances: quieter noise is not believed in
_SCALE_MEMORY = 50  # blocks over which noise louder than stated is found out


@dataclass(frozen=True)
class WalkingSettings:
    """How it weighs.

    Attributes:
        block: length of a block [s], 10 to 200 ms. Error bars were found right at 20 ms; at either end they may come
            out half as wide as they should be.
        drift: how much the parameters may wander in a second, as a share of the widest that they can be.
        wander: how much offsets, bias, lag and soles may wander in a second, as a share of their stated sizes.
        least_change: of the load, that counts as one: share of the robot's mass, or that mass times leg length, by
            which the trunk's mass or first moment jumps.
        changes: when a change of the load counts.
    """

    block: float = 0.02
    drift: float = 2e-4
    wander: float = 0.02
    least_change: float = 0.015
    changes: ChangeLimits = field(default_factory=ChangeLimits)

    def __post_init__(self) -> None:
        if not (0.01 <= self.block <= 0.2 and min(self.drift, self.wander, self.least_change) >= 0.0):
            raise StaderaError(f"walking needs a block of 10 to 200 ms and drifts ≥ 0, got {self}")


class WalkingEstimator:
    """Weighs a robot that stands, walks, trots or sways; an `Estimator`, and more besides.

    Args:
        robot: whose legs are believed in; rotors and friction of its joints among them.
        noise: of the sensors; None for `WalkingNoise.of(robot)`.
        start: what is believed first, and of what is never observed; None for the robot's own trunk.
        settings: None for the defaults.
        mount: of the IMU; None for the model's.

    Raises:
        ImplausibleError: an implausible start.
    """

    def __init__(
        self,
        robot: Robot,
        noise: WalkingNoise | None = None,
        start: TrunkModel | None = None,
        settings: WalkingSettings | None = None,
        mount: ImuMount | None = None,
    ) -> None:
        self.robot, self.noise = robot, noise or WalkingNoise.of(robot)
        self.settings, self.bounds = settings or WalkingSettings(), TrunkBounds.of(robot)
        first = self.bounds.check(start or TrunkModel.prior(robot))
        inertia = first.inertia_com if first.inertia_com is not None else robot.inertias[robot.trunk].inertia_com
        self._start = InertialParameters.from_com(first.mass, first.com_trunk, inertia)
        self._maker = RowMaker(robot, self.noise, mount or ImuMount.of(robot))
        self._length = self._maker.regressor.length
        self._limit = known_to(robot.mass, self._length)
        self._buffer = SampleBuffer(robot.tree.joints, self.settings.block)
        self._gaps: deque[tuple[float, float]] = deque(maxlen=100)
        self._told: TrunkEstimate | None = None
        self._ground = GroundNormal(robot.mass * _GRAVITY)
        self._wide = widest(robot.mass, self._length)
        self._constants = constants_of(self.noise)
        self._known = unknowns(self._start, self._wide, self._constants, ALWAYS + MODEL * self.noise.doubts_model)
        self._constant_for = 0.0
        self._dry, self._stuck_for = self._maker.regressor.coulomb.ravel(), np.zeros(12)
        self._good, self._shape, self._adopted = self._known, self._start, 0
        self._found: TrunkParameters | None = None
        self._detector = ChangeDetector(THETA, _JUMP * self._wide, self.settings.changes, OFFSETS)
        self._changes: list[LoadChange] = []
        self._changing: ChangeBegun | None = None
        self._learnt, self._since = np.nan, np.nan
        self._scale, self._caution = 1.0, _FIRST_CAUTION
        self._status, self._reason = Status.WAITING, ""

    # -- feeding ----------------------------------------------------------------------------------------------
    def update(self, measurement: Measurement) -> None:
        """Takes in one measurement; the trunk is looked at anew with every block."""
        samples = self._buffer.gather(measurement)
        if samples is not None:
            self.add(samples)

    def add(self, samples: Samples) -> None:
        """Takes in any number of samples, as so many calls of `update` would.

        What is not finite or runs back in time is left out and named; over a gap in time nothing is differentiated.
        """
        for stretch in self._buffer.take(samples):
            if stretch.reason:
                self._refuse(stretch.reason)
            if stretch.gap:
                self._interrupted(stretch.begin, stretch.gap)
            for block in stretch.blocks:
                self._block(block)

    # -- asking -----------------------------------------------------------------------------------------------
    def estimate(self) -> TrunkEstimate:
        """Mass and centre of mass of the trunk; after a refusal the last good ones, and why."""
        if self._told is None:
            found = self.parameters()
            covariance = found.covariance if self._adopted else unobserved()
            trunk = TrunkModel.of(found.inertial)
            self._told = TrunkEstimate(self._learnt, trunk, covariance, self._status, self._reason)
        return self._told

    def parameters(self) -> TrunkParameters:
        """All ten parameters of the trunk, payload included, and how well they are known."""
        if self._found is None:
            self._found = TrunkParameters.of(self._good, self._start, self._limit, self._length)
        return self._found

    def tare(self) -> None:
        """Takes the trunk as it is now for the reference that `payload` is the difference to."""
        self._known = self._good = self._good.first(UNKNOWNS).repeat(THETA)
        self._detector.restart()

    def payload(self) -> Payload | None:
        """What was put on since the tare; None without one."""
        known = self._good
        if len(known) == UNKNOWNS:
            return None
        root, difference = known.root[THETA] - known.root[_TARE], known.mean[THETA] - known.mean[_TARE]
        return Payload.of(difference, root @ root.T, _PAYLOAD_LIMIT * self._length)

    @property
    def torque_lag(self) -> tuple[float, float]:
        """By how much torques are found to arrive late, and its standard deviation [s]."""
        return float(self._known.mean[LAG]), float(np.linalg.norm(self._known.root[LAG]))

    @property
    def changes(self) -> tuple[LoadChange, ...]:
        """Every change of the load so far, the last by what is known now."""
        if self._changing is None:
            return tuple(self._changes)
        return (*self._changes, self._changing.weighed(self._known))

    @property
    def gaps(self) -> tuple[tuple[float, float], ...]:
        """The last hundred gaps between samples: when each ended and how long it was [s]."""
        return tuple(self._gaps)

    # -- inside -----------------------------------------------------------------------------------------------
    def _interrupted(self, time: float, gap: float) -> None:
        """Nothing is differentiated over a gap; after a long one ground and gravity are looked for anew, and joints
        that stuck before it may have slid.
        """
        self._maker.restart()
        self._gaps.append((time, gap))
        if gap > _LOST_GROUND:
            self._maker.forget()
            self._known = self._freed(self._wandered(gap), self._stuck_for > _HELD)
            self._stuck_for = np.zeros(12)
            self._ground = GroundNormal(self.robot.mass * _GRAVITY)

    def _block(self, samples: Samples) -> None:
        inside = slice(1, -1)
        duration = float(samples.time[-1] - samples.time[1])
        force, omega = samples.specific_force[inside].mean(axis=0), samples.angular_velocity[inside].mean(axis=0)
        if not force.any():
            self._maker.restart()
            self._refuse("the accelerometer reads zero")
            return
        made = self._maker.block(samples, self._ground.ahead(force, omega, duration))
        if made.singular is not None:
            leg = self.robot.legs[made.singular].name
            self._refuse(f"leg {leg} is so stretched that its foot's force is not felt")
            return
        self._ground.learn(made.feet, made.force, duration)
        if made.rows is not None:
            self._learn(made.rows)

    def _learn(self, rows: BlockRows) -> None:
        matrix, covariance, considered = rows.about(self._shape, self.noise)
        full = np.column_stack((matrix, rows.target, considered))
        white = lapack.dtrtrs(np.linalg.cholesky(covariance), full, lower=1)[0]
        H, y, B = np.zeros((6, len(self._known))), white[:, UNKNOWNS], white[:, UNKNOWNS + 1 :]
        H[:, :UNKNOWNS] = white[:, :UNKNOWNS]
        before = self._released(self._wandered(rows.elapsed), rows)
        innovation, spread = y - H @ before.mean, H @ before.root
        spread[:, len(before) :] += B
        squared = float(innovation @ np.linalg.solve(_ROWS + spread @ spread.T, innovation))
        scale = max(self._scale, 1.0)
        self._caution *= 1.0 - 1.0 / _SCALE_MEMORY
        step = Step(rows.time, before, H, y, B, squared)
        jump = self._detector.look(step, max(self._scale, self._caution, _QUIETEST))
        if jump is not None:
            known = self._jumped(jump, scale)
            named = self._matters(jump.before, known)
            if named:
                self._begin_change(jump, rows.time)
            if named or len(jump.after) >= _PATIENCE:
                self._detector.restart()
                self._adopt(known, rows.time)
                return
        squared /= 6.0
        self._scale += (min(squared, _LOUD * self._scale) - self._scale) / _SCALE_MEMORY
        weight = 1.0 / sqrt(max(scale, squared / _LOUD))
        self._adopt(before.measure(weight * H, weight * y, weight * B), rows.time)

    def _wandered(self, elapsed: float) -> SquareRoot:
        """What is known after so long [s]: the trunk drifts; the constants wander, which is reckoned now and then."""
        known = self._known.diffuse(THETA, self.settings.drift * sqrt(elapsed) * self._wide)
        self._constant_for += elapsed
        if self._constant_for > _WANDERED:
            known = known.diffuse(CONSTANTS, self.settings.wander * sqrt(self._constant_for) * self._constants)
            self._constant_for = 0.0
        return known

    def _released(self, known: SquareRoot, rows: BlockRows) -> SquareRoot:
        """What is known where joints that stuck for a while slide again: friction that held them is gone, and was
        taken for a constant offset until now.
        """
        if not self._dry.any():
            return known
        share = np.abs(rows.sliding)
        slipped = (self._stuck_for > _HELD) & (share > _SLIDES)
        self._stuck_for = np.where(share > _SLIDES, 0.0, self._stuck_for + rows.elapsed)
        return self._freed(known, slipped)

    def _freed(self, known: SquareRoot, joints: NDArray[np.bool_]) -> SquareRoot:
        """What is known once these joints (12,) have let go of what held them."""
        std = _HOLDS * np.where(joints, self._dry, 0.0)
        if not std.any():
            return known
        self._detector.loosen(std)
        return known.diffuse(OFFSETS, std)

    def _jumped(self, jump: Jump, scale: float) -> SquareRoot:
        """What is known if a jump is believed: all from before it but the trunk, and what came after it."""
        known = jump.before.diffuse(THETA, _JUMP * self._wide)
        weight = 1.0 / sqrt(scale)
        for step in jump.after:
            known = known.measure(weight * step.matrix, weight * step.target, weight * step.considered)
        return known

    def _matters(self, before: SquareRoot, after: SquareRoot) -> bool:
        """Whether a jump of mass or first moment is worth a name; smaller ones are taken over without."""
        change = np.abs(after.mean[:4] - before.mean[:4]) / self.robot.mass
        return bool(
            change[0] > self.settings.least_change or change[1:].max() > self.settings.least_change * self._length
        )

    def _begin_change(self, jump: Jump, now: float) -> None:
        if self._changing is not None:
            self._changes.append(self._changing.weighed(jump.before))
        self._changing = ChangeBegun(jump.time, now, jump.before, _SHIFTED * self.robot.mass)
        self._since, self._adopted = now, 1

    def _adopt(self, known: SquareRoot, time: float) -> None:
        """Makes it what is known; the trunk read from it becomes the estimate, unless it cannot be."""
        self._known = known
        if np.isnan(self._since):
            self._since = time
        centre = Centre.of(known, self._start, self._limit)
        try:
            complaint = self.bounds.complaint(TrunkModel(float(centre.value[0]), centre.value[1:]))
        except ImplausibleError as error:
            complaint = str(error)
        if complaint:
            self._refuse(f"the estimate runs away: {complaint}")
            return
        self._good, self._found, self._learnt, self._reason = known, None, time, ""
        settled = time - self._since >= _SETTLED and bool(centre.observed[:3].all())
        self._status, self._told = Status.CONVERGED if settled else Status.MOVING, None
        self._adopted += 1
        if self._adopted < _RESHAPED or self._adopted % _RESHAPED == 0:
            self._shape = self.parameters().inertial

    def _refuse(self, reason: str) -> None:
        self._status, self._reason, self._told = Status.REFUSED, reason, None
