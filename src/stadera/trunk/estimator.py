"""Online estimator of the trunk's ten parameters for a robot that stands, walks, trots or sways.

1. Each block of 20 ms gives six equations A θ + C p = b of the trunk (`trunk.rows`) and, for legs in the air, equations
   of their joints alone (`trunk.swing`). θ are the trunk's ten parameters, p the errors of the robot's model.
2. Joints' errors are estimated from legs in the air, whose equations contain no weight, and p together with θ from all
   rows (`trunk.joint_errors`), with less weight for blocks that fit badly (`trunk.scatter`). What is uncertain of p
   enters the error bars, by a scale of its prior sizes that comes from the residuals (`trunk.fit`).
3. Averages over the last 0.1 to 2 s are compared with the earlier estimate (`trunk.changes`). After a change of the
   load θ is estimated anew; that of p is kept.
4. A tare stores the present trunk; the payload is the difference from it, in which constant errors cancel.

The motion is arbitrary. Quantities that it does not excite, such as height and inertia of a robot at rest, keep their
prior uncertainty and count as not observed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import exp, inf, isnan

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stadera.errors import IdentificationError, RecordingError, UnknownNameError
from stadera.inertia import InertialParameters
from stadera.robot.imu import ImuMount
from stadera.robot.load import load_robot
from stadera.robot.model import Robot
from stadera.trunk.changes import ChangeDetector, Jump
from stadera.trunk.drives import Drives
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.fit import Fit
from stadera.trunk.front import BLIND, Front
from stadera.trunk.joint_errors import Errors
from stadera.trunk.load import SIGNIFICANT, ChangeKind, LoadChange, Payload
from stadera.trunk.measurement import Measurement
from stadera.trunk.merge import TrunkEvidence
from stadera.trunk.model import ImplausibleError, TrunkBounds, TrunkModel
from stadera.trunk.on_scale import OnScale, Told
from stadera.trunk.protocol import Status, TrunkEstimate, unobserved
from stadera.trunk.result import ObservedLimits, TrunkParameters
from stadera.trunk.row_sums import RowSums, robot_weight
from stadera.trunk.rows import BlockRows
from stadera.trunk.samples import SampleBuffer, Samples
from stadera.trunk.scatter import RobustWeights, Scatter
from stadera.trunk.segment import Segment, WeightedRows
from stadera.trunk.settings import TrunkSettings
from stadera.trunk.summing import Summing
from stadera.trunk.swing import SwingJoints
from stadera.trust import Trust, Verdict
from stadera.types import Array

_APART = 4.0  # standard deviations between a scale and the log, beyond which they contradict each other


@dataclass(frozen=True, eq=False)
class _Change:
    """A change whose new load is still being estimated, with the estimate before it; `shown` as in `Jump`."""

    time: float
    noticed: float
    before: Segment
    shown: Array


@dataclass(frozen=True, eq=False)
class _Rival:
    """What was known before the last change, to return to if the change was a push: `before` and `since` are the
    estimates before it and right after it, all others the estimator's own attributes.
    """

    time: float
    before: Segment
    since: Segment
    finished: tuple[Segment, ...]
    loaded: Segment | None
    changes: int
    changing: _Change | None


class _Reading:
    """The trunk as estimated at one time, computed on first use."""

    def __init__(self, of: TrunkEstimator) -> None:
        self._of, self._segment, self._errors = of, of._current, of._errors
        self._scatter, self._suspected = of._scatter.value, of._detector.suspected
        self._told = of._told(self._segment)

    @cached_property
    def parameters(self) -> TrunkParameters:
        """All ten parameters and their uncertainty."""
        of, covariance = self._of, self._errors.trunk_covariance(self._segment, self._scatter)
        covariance[:4, :4] += np.outer(self._suspected, self._suspected)
        vector = self._segment.mean(self._errors.mean)
        by_scale = self._errors.by_scale(self._segment.sensitivity)
        if self._told is not None:
            shared = self._told.shared(self._segment)
            vector, covariance, by_scale = self._told.corrected(vector, covariance, by_scale, shared)
        found = TrunkParameters.of(vector, covariance, of._start, of.robot.mass, of._length)
        return replace(found, mass_std_without_scale=_without(covariance[0, 0], by_scale[0]))


class TrunkEstimator:
    """Estimates mass, centre of mass and inertia of the trunk online, in any motion.

    Args:
        robot: a `Robot`, the name of one, or the path of its model file.
        joints: names of the joints in the order of the arrays given to `update`; None for the robot's own order. Joints
            outside the legs (an arm) that are among them move as given; the trunk's values are those with them at the
            robot's reference, the model's zero unless `Robot.posed` set another.
        imu_frame: frame of the IMU's values; None for the model's.
        start: prior of the trunk, which also supplies components that are never observed; None for the model's trunk.
        settings: None for the defaults.
        mount: of the IMU, instead of `imu_frame`.

    Attributes:
        impacts: time left out for impacts [s], see `TrunkSettings.impact`.

    Raises:
        ImplausibleError: the prior is not plausible.
        UnknownNameError: no such joint or frame.
    """

    def __init__(
        self,
        robot: Robot | str,
        joints: Sequence[str] | None = None,
        imu_frame: str | None = None,
        start: TrunkModel | None = None,
        settings: TrunkSettings | None = None,
        mount: ImuMount | None = None,
    ) -> None:
        self.robot = robot if isinstance(robot, Robot) else load_robot(robot)
        self.settings, self.bounds = settings or TrunkSettings(), TrunkBounds.of(self.robot)
        self.mount = mount or ImuMount.of(self.robot, imu_frame)
        self._box = tuple(zip(self.bounds.low.tolist(), self.bounds.high.tolist(), strict=True))
        self._order, self._extra_order = _order(self.robot, joints), _extra_order(self.robot, joints)
        self._joints = len(joints) if joints is not None else len(self._order)
        first = self.bounds.check(start or TrunkModel.prior(self.robot))
        inertia = first.inertia_com
        if inertia is None:
            inertia = self.robot.inertias[self.robot.trunk].inertia_com
        self._start = InertialParameters.from_com(first.mass, first.com_trunk, inertia)
        self._front = Front(self.robot, self.mount, self.settings.swing)
        self._stops = _stops(self.robot)
        self._length = self.robot.leg_length
        self._model = ErrorModel(self.robot, self.settings.model, self._length)
        self._swing = SwingJoints(self._model, self.settings.swing)
        self._errors = Errors(self._model, self._swing, 1.0)
        self._scale: OnScale | None = None
        self._buffer = SampleBuffer(self.robot.tree.joints, self.settings)
        mass, le = self.robot.mass, self._length
        self._wide = mass * np.array([1.0, *[0.5 * le] * 3, *[0.5 * le**2] * 6])
        self._recent: deque[WeightedRows] = deque()
        # estimates before each of them, and with all of them
        self._known = deque([Segment.prior(self._start.vector, self._wide, self._model.layout)])
        scale = mass * np.array([1.0, le, le, le])
        self._detector = ChangeDetector(self.settings.changes, scale, self.settings.block, self._model.layout)
        self._finished: tuple[Segment, ...] = ()
        self._earlier: RowSums | None = None  # their sum
        self._changes: list[LoadChange] = []
        self._changing: _Change | None = None
        self._candidate: _Change | None = None
        self._rival: _Rival | None = None
        self._tare: Segment | None = None
        self._loaded: Segment | None = None  # rows since the tare, until a change is detected
        self._since_tare = RobustWeights(self.settings.outliers)
        self._unused = 0  # next rows that still contain samples before the tare
        self._fit: Fit | None = None
        self._swing_misfit: float | None = None  # of the last fit; None before it is evaluated
        self._scatter = Scatter(self._wide[:4], self.settings.memory / self.settings.block, self.settings.outliers)
        self._summing = Summing(robot_weight(self.robot), self._length, self._scatter)
        self._gaps: deque[tuple[float, float]] = deque(maxlen=100)
        self._impact = self.settings.impact * robot_weight(self.robot)
        self._blocks, self._refresh_at, self.impacts = 0, 0, 0.0
        self._learnt, self._since, self._seen_for = np.nan, np.nan, 0.0
        self._status, self._reason = Status.WAITING, ""
        self._good: _Reading | None = None
        self._settled = False
        self._shape = self._start
        self._trust: Trust | None = None

    # -- feeding ----------------------------------------------------------------------------------------------------
    def update(
        self,
        t: float | Measurement,
        q: ArrayLike | None = None,
        dq: ArrayLike | None = None,
        tau: ArrayLike | None = None,
        gyro: ArrayLike | None = None,
        accel: ArrayLike | None = None,
    ) -> None:
        """Processes one sample. The estimate changes with every complete block.

        Args:
            t: time [s]; or a `Measurement`, without other arguments.
            q, dq, tau: (n,) joint positions [rad], velocities [rad/s] and torques [N·m] in the order of `joints`.
            gyro, accel: (3,) [rad/s, m/s²], in the IMU's frame.

        Raises:
            RecordingError: missing values or wrong shapes.
        """
        if not isinstance(t, Measurement):
            t = self._measured(float(t), q, dq, tau, gyro, accel)
        table = self._buffer.gather(t)
        if table is not None:
            self.add_table(table)

    def add(self, samples: Samples) -> None:
        """Processes any number of samples, equivalent to as many calls of `update`.

        Samples that are not finite or go back in time are skipped and reported. Signals are not differentiated across a
        gap.

        Raises:
            RecordingError: anything but `Samples`.
        """
        if not isinstance(samples, Samples):
            raise RecordingError(f"add takes stadera.trunk.Samples, got {type(samples).__name__}; one sample: update")
        self.add_table(samples.table)

    def add_table(self, table: Array) -> None:
        """The same, of samples given by their `Samples.table`."""
        for stretch in self._buffer.take(table):
            if stretch.reason:
                self._refuse(stretch.reason)
            if stretch.gap:
                self._interrupted(stretch.begin, stretch.gap)
            for block in stretch.blocks:
                self._block(block)

    def tare(self) -> None:
        """Makes the present estimate of the trunk the reference for `payload`.

        Later rows are summed separately: a load that comes with the tare counts whether or not it is detected as a
        change.
        """
        self._tare, self._unused = self._current, self.settings.changes.spoilt
        self._freeze_scale(self._tare)
        self._rival = None
        self._since_tare = RobustWeights(self.settings.outliers)
        self._loaded = self._widened(self._current)

    def know_weight(self, mass: float, std: float) -> None:
        """Takes the mass of the whole robot as it is now, or as it was at the tare if there was one, from a scale. It
        tells the scale of the torques, which no motion shows.

        Args:
            mass, std: [kg], what the scale says and its standard deviation.

        Raises:
            IdentificationError: not a mass that the robot can have.
        """
        legs = self.robot.mass - self.robot.inertias[self.robot.trunk].mass
        if not (legs < mass < inf and 0.0 <= std < mass):
            raise IdentificationError(
                f"a weight of {mass:g} ± {std:g} kg: the legs of {self.robot.name} alone have {legs:.3g} kg, and a "
                "standard deviation is below the mass"
            )
        links = np.zeros(self._model.layout.count)
        moved = self.robot.tree.links[1:]
        links[self._model.layout.places["link_mass"]] = [self.robot.inertias[link].mass for link in moved]
        self._scale, self._trust = OnScale(mass - legs, std, links, self._tare), None
        if self._good is not None:
            self._good = _Reading(self)

    def restart(self) -> None:
        """Announces that the next samples do not continue the previous ones; their rate may differ. Estimates are
        kept.
        """
        self._buffer = SampleBuffer(self.robot.tree.joints, self.settings)
        self._front.forget()

    def __repr__(self) -> str:
        lines = [f"TrunkEstimator of {self.robot.name}, {self._status}", f"  trunk: {self.trunk!r}"]
        if (payload := self.payload) is not None:
            lines.append(f"  payload: {payload!r}")
        lines.append(f"  changes of load: {len(self.changes)}; trust: {self.trust.verdict}")
        return "\n".join(lines)

    # -- asking -----------------------------------------------------------------------------------------------------
    @property
    def trunk(self) -> TrunkParameters:
        """The trunk's ten parameters, payload included, with their uncertainty."""
        return self._good.parameters if self._good is not None else TrunkParameters.unobserved(self._start)

    def parameters(self) -> TrunkParameters:
        """The same as `trunk`."""
        return self.trunk

    def estimate(self) -> TrunkEstimate:
        """Mass and centre of mass of the trunk; after a refusal the last good ones, with the reason."""
        found = self.trunk
        covariance = found.covariance if self._good is not None else unobserved()
        status = self._status
        if status is Status.MOVING and self._settled and found.observed[:3].all():
            status = Status.CONVERGED
        return TrunkEstimate(self._learnt, TrunkModel.of(found.inertial), covariance, status, self._reason)

    @property
    def learnt(self) -> float:
        """Time of the last samples that the estimate is based on [s]; NaN before any."""
        return self._learnt

    @property
    def refusal(self) -> str:
        """Why the latest samples are refused; empty if they are not."""
        return self._reason if self._status is Status.REFUSED else ""

    @property
    def payload(self) -> Payload | None:
        """Mass added since the tare; None without a tare."""
        if self._tare is None:
            return None
        p, missed = self._errors.mean, self._detector.suspected
        now = self._current if self._loaded is None else self._loaded
        difference = now.mean(p) - self._tare.mean(p)
        covariance = self._errors.difference_covariance(self._tare, now, self._scatter.value)
        if self._loaded is not None and missed.any():  # the rows since the tare already contain part of it
            missed = missed - (now.mean(p) - self._aged.mean(p))[:4]
        covariance[:4, :4] += np.outer(missed, missed)
        by_scale = self._errors.by_scale(now.sensitivity - self._tare.sensitivity)
        if (told := self._told(self._current)) is not None:
            shared = told.shared(now) - told.shared(self._tare)
            difference, covariance, by_scale = told.corrected(difference, covariance, by_scale, shared)
        found = Payload.of_parameters(difference, covariance, ObservedLimits().com * self._length)
        return replace(found, mass_std_without_scale=_without(covariance[0, 0], by_scale[0]))

    @property
    def changes(self) -> tuple[LoadChange, ...]:
        """All changes of the load so far; the last is updated as the estimate improves."""
        if self._changing is None:
            return tuple(self._changes)
        return (*self._changes, self._weighed(self._changing, self._current))

    @property
    def trust(self) -> Trust:
        """How well the model explains the log so far."""
        if self._trust is None:
            if self._fit is None or self._swing_misfit is None:
                self._trust = Trust("doubtful", 1.0, {}, ("too few rows yet to evaluate the fit",))
            else:
                self._trust = self._fit.trust(
                    self.robot, self._model, self.settings, self._swing_misfit, self._swing.stepped
                )
            told = self._told(self._current)
            if told is not None and abs(told.apart) > _APART:
                self._trust = self._trust.at_most(
                    "doubtful",
                    f"the scale and the log are {abs(told.apart):.1f} standard deviations apart: another load "
                    "than on the scale, or torques of another scale than usual",
                )
        return self._trust

    @property
    def torque_lag(self) -> tuple[float, float]:
        """Estimated delay of the torques and its standard deviation [s]."""
        at = self._model.layout.places["torque_lag"].start
        return float(self._errors.mean[at]), float(self._errors.std[at])

    @property
    def drives(self) -> Drives:
        """Rotor inertia, friction and torque offsets of the legs' joints."""
        return Drives.of(self.robot, self._model, self._errors)

    @property
    def evidence(self) -> TrunkEvidence:
        """Information on the trunk from the rows since the last change of the load, for merging with other logs."""
        known = self._current.known.scaled_noise(float(np.sqrt(self._scatter.value)))
        errors = self._errors
        return TrunkEvidence(
            known, errors.mean, errors.covariance, errors.prior, errors.remaining, self._length, errors.layout
        )

    @property
    def gaps(self) -> tuple[tuple[float, float], ...]:
        """The last hundred gaps between samples: end time and duration of each [s]."""
        return tuple(self._gaps)

    @property
    def spikes(self) -> int:
        """Number of samples of which single wild values were replaced, see `stadera.trunk.spikes`."""
        return self._front.spikes

    # -- inside -----------------------------------------------------------------------------------------------------
    @property
    def _current(self) -> Segment:
        """The present estimate."""
        return self._known[-1]

    @property
    def _aged(self) -> Segment:
        """The estimate without the latest blocks, in which a change may still be detected."""
        return self._known[max(len(self._recent) - self.settings.changes.pending, 0)]

    def _measured(
        self,
        t: float,
        q: ArrayLike | None,
        dq: ArrayLike | None,
        tau: ArrayLike | None,
        gyro: ArrayLike | None,
        accel: ArrayLike | None,
    ) -> Measurement:
        joints = self._joints
        values = []
        for name, value, size in (
            ("q", q, joints),
            ("dq", dq, joints),
            ("tau", tau, joints),
            ("gyro", gyro, 3),
            ("accel", accel, 3),
        ):
            array = np.asarray(value, dtype=float) if value is not None else np.empty(0)
            if array.shape != (size,):
                raise RecordingError(f"update needs {name} of shape ({size},), got {array.shape}")
            values.append(array)
        turn = self.mount.in_trunk_axes
        order = self._order
        return Measurement(
            t,
            values[0][order],
            values[1][order],
            values[2][order],
            turn(values[3]),
            turn(values[4]),
            lever=self.mount.translation,
            extra=self._extra(values[0], values[1]),
        )

    def _extra(self, q: Array, dq: Array) -> Array:
        """Positions, then velocities, of the joints outside the legs; empty if none was announced."""
        extra, order = self.robot.extra, self._extra_order
        if extra is None or not order:
            return np.empty(0)
        out = np.append(extra.reference, np.zeros(len(extra.joints)))
        for at, k in order.items():
            out[[at, len(extra.joints) + at]] = q[k], dq[k]
        return out

    def _interrupted(self, time: float, gap: float) -> None:
        """Stops differentiation across a gap; after a long one ground normal and gravity are estimated anew."""
        self._front.interrupt()
        self._gaps.append((time, gap))
        if gap > self.settings.lost_ground:
            self._front.forget()

    def _block(self, table: Array) -> None:
        made = self._front.block(table, self._shape)
        if made.refused == BLIND:
            self._refuse("the accelerometer reads zero")
        elif made.refused is not None:
            leg = self.robot.legs[made.refused].name
            self._refuse(f"leg {leg} is so stretched that its foot's force is not felt")
        elif made.rows is not None and not self._at_a_stop(table):
            self._learn(made.rows)

    def _at_a_stop(self, table: Array) -> bool:
        """Refuses a block in which a joint is at its mechanical stop, whose torque no sensor shows."""
        away = np.abs(table[:, 1 : 1 + self._stops.shape[1], None] - self._stops.T).min(axis=(0, 2))
        at = int(np.argmin(away))
        if away[at] >= self.settings.stop:
            return False
        self._refuse(f"joint {self.robot.tree.joints[at]!r} is at its mechanical stop, which carries a torque unseen")
        return True

    def _learn(self, made: BlockRows) -> None:
        swing = made.swing
        if np.count_nonzero(swing.air):
            white = self._front.torque_noise
            self._swing.add(swing.air, swing.terms, swing.rate, swing.residual, white, swing.late)
        if self._struck(made):
            return
        self._blocks += 1
        self._seen_for += made.elapsed
        p = self._errors.mean
        keep = exp(-made.elapsed / self.settings.memory)
        rows, known = self._summing.add(made, self._current, self._aged, p, keep)
        self._recent.append(rows)
        self._known.append(known)
        if self._loaded is not None:
            self._unused -= 1
            if self._unused < 0:  # weighted by residuals from the present load: the estimate may be of the one before
                weight = self._since_tare.weight(rows, self._loaded, p)
                self._loaded = self._loaded.add(replace(rows, weight=weight), keep, remainder=False)
        if len(self._recent) > 2 * self.settings.changes.pending:
            self._recent.popleft()
            self._known.popleft()
        if self._blocks >= self._refresh_at:
            self._refresh()
            self._refresh_at = self._blocks + self.settings.wait(self._blocks)
        held = self._fit is not None and self._fit.misfit > self.settings.bad
        between = self.settings.updated // 2  # not in the block that also evaluates the fit
        if self._refresh_at - self._blocks == between:
            self._detector.learn(self._aged, self._errors)
        if self._rival is not None and self._settled_rival(self._rival, made.time):
            return
        jump = self._detector.look(rows, self._aged, self._known[0], self._errors, self._scatter.value, held)
        if jump is not None:
            self._jumped(jump, made.time)
        elif self._blocks % self.settings.checked == 0:
            self._report(made.time)
        self._adopt(made.time)

    def _struck(self, made: BlockRows) -> bool:
        """True if the block is left out for its impacts; if most of the time is, that is a reason to refuse."""
        if np.abs(made.columns[:3, 11 + self._model.layout.places["sampling"].start]).max() <= self._impact:
            return False
        self.impacts += made.elapsed
        if self.impacts > self._seen_for:
            self._refuse("the log's rate does not resolve the impacts that its accelerometer shows")
        return True

    def _refresh(self) -> None:
        """Updates p̂ and Σ from legs in the air and residuals."""
        # rows in which a change may still be detected do not count against the model
        last = self._aged if self._aged.blocks >= self.settings.outliers.cluster or self._finished else self._current
        rows = self._summed((last,)) if self._earlier is None else self._earlier.plus(last)
        usual = Errors(self._model, self._swing, 1.0, rows, self._model.layout.by_swing)
        self._fit = Fit.of(rows, usual, self.settings, self._summing.tails)
        self._errors = Errors(self._model, self._swing, self._fit.shared_scale(self.settings), rows)
        laws = [self._model.layout.places[name] for name in ("rotor", "viscous", "coulomb")]
        self._front.know_joints(*(np.array([x[law] for law in laws]) for x in (self._errors.mean, self._errors.std)))
        self._swing_misfit = self._swing.misfit if self._seen_for >= self.settings.evaluated else None
        self._trust = None

    def _freeze_scale(self, segment: Segment) -> None:
        """The robot was on the scale with the load that ends now."""
        if self._scale is not None and self._scale.segment is None:
            self._scale = replace(self._scale, segment=segment)

    def _told(self, current: Segment) -> Told | None:
        """What a scale tells, if it was asked and the trunk then is known."""
        scale = self._scale
        segment = current if scale is None or scale.segment is None else scale.segment
        if scale is None or not segment.blocks:
            return None
        return Told(scale, self._errors, segment, self._scatter.value)

    def _widened(self, known: Segment) -> Segment:
        """A prior for the trunk under another load."""
        wide = self.settings.after_change * self._wide
        return Segment.prior(known.mean(self._errors.mean), wide, self._model.layout)

    def _summed(self, segments: Sequence[Segment]) -> RowSums:
        swing = self.settings.swing
        return RowSums.of(segments, swing.repeated, swing.returning)

    def _jumped(self, jump: Jump, now: float) -> None:
        """Restarts the trunk with the rows since the change, and keeps the earlier estimate."""
        recent, spoilt = list(self._recent), self.settings.changes.spoilt
        blocks = min(jump.blocks, len(recent))
        before = self._known[max(len(recent) - blocks - spoilt, 0)]
        self._freeze_scale(before)
        begun = recent[-blocks].time - self.settings.block
        rival = self._rival or _Rival(
            now, before, before, self._finished, self._loaded, len(self._changes), self._changing
        )
        self._finished = (*self._finished[-3:], before)
        self._earlier = self._summed(self._finished)
        self._known = deque([self._widened(before)])
        self._loaded = None
        self._recent = deque(recent[len(recent) - blocks + spoilt :])
        for rows in self._recent:  # weights were those of residuals from the earlier load
            self._known.append(self._current.add(replace(rows, weight=1.0)))
        self._rival = replace(rival, since=self._current)
        self._candidate = _Change(begun, now, before, jump.shown) if jump.reported else None
        self._report(now)
        self._detector.restart(len(self._recent))
        self._scatter.restart()
        self._since = now

    def _settled_rival(self, rival: _Rival, now: float) -> bool:
        """Drops the rival once it is old; returns to it, and then returns True, if the load is again what it was."""
        if now - rival.time > self.settings.changes.transient:
            self._rival = None
        elif self._detector.returned(rival.before, rival.since, self._errors):
            back = list(self._recent)[-self.settings.changes.back :]
            self._rival, self._candidate, self._changing = None, None, rival.changing
            if self._scale is not None and self._scale.segment is rival.before:
                self._scale = replace(self._scale, segment=None)
            self._changes = self._changes[: rival.changes]
            self._finished, self._loaded = rival.finished, rival.loaded
            self._earlier = self._summed(rival.finished) if rival.finished else None
            self._known, self._recent = deque([rival.before]), deque(back)
            for rows in back:
                self._known.append(self._current.add(rows))
            self._detector.restart(len(back))
            self._scatter.restart()
            self._adopt(now)
            return True
        return False

    def _report(self, now: float) -> None:
        """Reports the detected change once it exceeds its error bars; a change that never does is not reported."""
        candidate = self._candidate
        if candidate is None:
            return
        if self._exceeds_errors(candidate):
            if self._changing is not None:
                self._changes.append(self._weighed(self._changing, candidate.before))
            self._changing, self._candidate = replace(candidate, noticed=now), None
        elif now - candidate.noticed > self.settings.reported_within:
            self._candidate = None

    def _exceeds_errors(self, change: _Change) -> bool:
        """True if mass or first moment differ from the earlier ones by more than their errors, while no joint sticks.

        Model errors count as far as averages under a constant load show them.
        """
        p, now, scatter = self._errors.mean, self._current, self._scatter.value
        difference = (now.mean(p) - change.before.mean(p))[:4]
        rows = self._errors.rows_covariance(change.before, now, scatter, stiction=False)
        total = self._errors.difference_covariance(change.before, now, scatter, stiction=False)
        own, both = np.diag(rows)[:4], np.diag(total)[:4]
        return bool((np.abs(difference) > SIGNIFICANT * np.sqrt(own + change.shown * (both - own))).any())

    def _weighed(self, change: _Change, now: Segment) -> LoadChange:
        p = self._errors.mean
        mass = float(now.mean(p)[0] - change.before.mean(p)[0])
        covariance = self._errors.difference_covariance(change.before, now, self._scatter.value)
        std = float(np.sqrt(covariance[0, 0]))
        kind: ChangeKind = "on" if mass > 0 else "off"
        if abs(mass) < max(3.0 * std, self.settings.changes.shifted * self.robot.mass):
            kind = "shifted"
        by_scale = self._errors.by_scale(now.sensitivity - change.before.sensitivity)
        return LoadChange(change.time, change.noticed, mass, std, kind, _without(std**2, by_scale[0]))

    def _adopt(self, time: float) -> None:
        """Adopts the present estimate of the trunk, unless it is implausible."""
        if isnan(self._since):
            self._since = time
        vector, read = self._current.mean(self._errors.mean), _Reading(self)
        if complaint := self._complaint(vector, read):
            self._refuse(f"the estimate runs away: {complaint}")
            return
        self._good, self._learnt, self._reason = read, time, ""
        verdict, misfit = self._verdict()
        if verdict == "bad":
            self._refuse(f"the model does not explain what the sensors say: {self.trust.reasons[0]}")
            return
        self._settled = time - self._since >= self.settings.settled and misfit <= self.settings.doubtful
        self._status = Status.MOVING
        if self._blocks < self.settings.updated or self._blocks % self.settings.updated == 0:
            self._shape = read.parameters.inertial

    def _verdict(self) -> tuple[Verdict, float]:
        """Verdict and misfit of `trust`, without its reasons."""
        if self._fit is None or self._swing_misfit is None:
            return "doubtful", 1.0
        return self._fit.verdict(self.settings, self._swing_misfit, self._swing.stepped), self._fit.misfit

    def _complaint(self, vector: Array, read: _Reading) -> str | None:
        """Why the trunk (10,), with the prior for unobserved parameters, is implausible; None if plausible."""
        mass, *moment = vector[:4].tolist()
        if not mass > 0.0:
            return f"a mass of {mass:.3g} kg"
        bounds, box = self.bounds, self._box
        inside = True
        for h, (low, high) in zip(moment, box, strict=True):
            inside &= low * mass <= h <= high * mass
        if bounds.mass[0] <= mass <= bounds.mass[1] and inside:
            return None  # the prior is inside too, so any mixture of the two is
        try:
            return bounds.complaint(TrunkModel.of(read.parameters.inertial))
        except ImplausibleError as error:
            return str(error)

    def _refuse(self, reason: str) -> None:
        self._status, self._reason = Status.REFUSED, reason


def _without(variance: float, by_scale: float) -> float:
    """A mass's standard deviation without the part that the torques' common scale brings."""
    return float(np.sqrt(max(variance - by_scale**2, 0.0)))


def _stops(robot: Robot) -> Array:
    """The joints' least and largest positions, (2, joints) [rad], in the tree's order."""
    limits = [robot.limits[joint] for joint in robot.tree.joints]
    return np.array([[limit.lower for limit in limits], [limit.upper for limit in limits]])


def _order(robot: Robot, joints: Sequence[str] | None) -> NDArray[np.int_]:
    """Position of each joint of the tree among the given names."""
    if joints is None:
        return np.arange(len(robot.tree.joints))
    given = list(joints)
    for joint in robot.tree.joints:
        if joint not in given:
            raise UnknownNameError("joint", joint, given, "the arrays given to update")
    return np.array([given.index(joint) for joint in robot.tree.joints])


def _extra_order(robot: Robot, joints: Sequence[str] | None) -> dict[int, int]:
    """By index of a joint outside the legs, its position among the given names."""
    names = () if robot.extra is None or joints is None else robot.extra.joints
    given = list(joints or ())
    return {at: given.index(joint) for at, joint in enumerate(names) if joint in given}
