"""Online estimator of the trunk's ten parameters for a robot that stands, walks, trots or sways.

1. Each block of 20 ms gives six equations A θ + C p = b of the trunk (`trunk.rows`) and, for legs in the air, equations
   of their joints alone (`trunk.swing`). θ are the trunk's ten parameters, p the errors of the robot's model.
2. Joints' errors are estimated from legs in the air, whose equations contain no weight, and p together with θ from all
   rows (`trunk.joint_errors`), with less weight for blocks that fit badly (`trunk.history`). What is uncertain of p
   enters the error bars, by sizes of its kinds that the rows show (`trunk.sizes`).
3. Averages over the last 0.2 and 1 s are compared with the earlier estimate (`trunk.changes`). After a change of the
   load θ is estimated anew; that of p is kept.
4. A tare stores the present trunk; the payload is the difference from it, in which constant errors cancel.

The motion is arbitrary. Quantities that it does not excite, such as height and inertia of a robot at rest, keep their
prior uncertainty and count as not observed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import hypot, inf, isnan, sqrt
from zlib import crc32

import numpy as np
from numpy.typing import ArrayLike

from stadera.errors import IdentificationError, RecordingError, number
from stadera.inertia import InertialParameters
from stadera.robot.imu import ImuMount
from stadera.robot.load import load_robot
from stadera.robot.model import Robot
from stadera.trunk.drives import Drives
from stadera.trunk.fit import ModelFit
from stadera.trunk.front import Front, Made
from stadera.trunk.history import History
from stadera.trunk.joint_errors import Errors
from stadera.trunk.load import LoadChange, Payload
from stadera.trunk.loads import Found, LoadChanges
from stadera.trunk.measurement import Measurement
from stadera.trunk.memory import Memory, MemorySettings, evidence_of
from stadera.trunk.model import TrunkBounds, TrunkModel
from stadera.trunk.outside import Correction, Knowledge, Reading, on_scale, with_test_weight
from stadera.trunk.protocol import RUNS_AWAY, Status, TrunkEstimate
from stadera.trunk.result import ObservedLimits, TrunkParameters, unobserved
from stadera.trunk.samples import Samples
from stadera.trunk.segment import Segment
from stadera.trunk.settings import TrunkSettings
from stadera.trunk.where import Whereabouts
from stadera.trust import Trust
from stadera.types import Array


@dataclass(frozen=True)
class _State:
    """Status and reason; time of the last samples used, and of the first ones under the present load [s]."""

    status: Status = Status.WAITING
    reason: str = ""
    learnt: float = np.nan
    since: float = np.nan
    settled: bool = False
    complaint: str = ""  # why the latest estimate is none that a trunk can have


class TrunkEstimator:
    """Estimates mass, centre of mass and inertia of the trunk online, in any motion.

    Args:
        robot: a `Robot`, the name of one, or the path of its model file.
        joints: names of the joints in the order of the arrays given to `update`; None for the robot's own order. Joints
            outside the legs (an arm) that are among them move as given, and their torques tell what they carry (zero
            where not known); the trunk's values are those with them at the robot's reference, the model's zero unless
            `Robot.posed` set another.
        imu_frame: frame of the IMU's values; None for the model's.
        start: prior of the trunk, which also supplies components that are never observed; None for the model's trunk.
        settings: None for the defaults.
        mount: of the IMU, instead of `imu_frame`.
        at: link or frame on which the load is, such as a hand's; None to find where it is. A load that is not on the
            trunk is no part of it.

    Raises:
        ImplausibleError: the prior is not plausible.
        UnknownNameError: no such link or frame.
        RecordingError: a joint of the legs is not among the given ones, or one is there twice.
    """

    def __init__(
        self,
        robot: Robot | str,
        joints: Sequence[str] | None = None,
        imu_frame: str | None = None,
        start: TrunkModel | None = None,
        settings: TrunkSettings | None = None,
        mount: ImuMount | None = None,
        at: str | None = None,
    ) -> None:
        self.robot = robot if isinstance(robot, Robot) else load_robot(robot)
        self.settings, self.bounds = settings or TrunkSettings(), TrunkBounds.of(self.robot)
        first = self.bounds.check(start or TrunkModel.prior(self.robot))
        inertia = first.inertia_com
        if inertia is None:
            inertia = self.robot.inertias[self.robot.trunk].inertia_com
        self._start = InertialParameters.from_com(first.mass, first.com_trunk, inertia)
        self._where = Whereabouts(self.robot, at)
        places, mount = self._where.places, mount or ImuMount.of(self.robot, imu_frame)
        self._front = Front(self.robot, mount, self.settings, joints, places)
        self._front.shape = self._start
        self._fit = ModelFit(self.robot, self.settings)
        layout = self._fit.model.layout
        static = np.sqrt(self._fit.model.variance[layout.sticking])
        known = (self._start.vector, layout, self.settings, len(places), self._fit.friction)
        self._history = History(self.robot, *known, static)
        self._history.at = self._where.candidates[0]
        self._changes = LoadChanges(self.robot, self.settings, self._where)
        self._known: tuple[Knowledge, ...] = ()
        self._good: Reading | None = None
        self._state, self._print = _State(), 0

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
            RecordingError: missing values, wrong shapes, or what is no number.
        """
        self._take(t if isinstance(t, Measurement) else self._front.measured(t, q, dq, tau, gyro, accel))

    def _take(self, measurement: Measurement) -> None:
        table = self._front.gather(measurement)
        if table is not None:
            for _ in self._steps(table):
                pass

    def add(self, samples: Samples | Sequence[Measurement]) -> None:
        """Processes any number of samples, equivalent to as many calls of `update`.

        Samples that are not finite or go back in time are skipped and reported. No signal is differentiated over a gap.

        Raises:
            RecordingError: anything but `Samples`, or measurements.
        """
        if isinstance(samples, list | tuple) and samples and isinstance(samples[0], Measurement):
            samples = Samples.of(samples)
        if not isinstance(samples, Samples):
            raise RecordingError(f"add takes stadera.trunk.Samples, got {type(samples).__name__}; one sample: update")
        for _ in self._steps(samples.table):
            pass

    def learning(self, table: Array) -> Iterator[float]:
        """The same of samples given by their `Samples.table`, step by step: yields the time of the last sample that a
        step takes in [s], before it does.
        """
        return self._steps(table)

    def _steps(self, table: Array) -> Iterator[float]:
        self._print = crc32(table.tobytes(), self._print)
        self._front.take(table)

        def steps() -> Iterator[float]:
            for made in self._front.made():
                yield made.due
                self._learn(made)
                self._front.ahead = max(self._fit.due - self._history.blocks, 1)

        return steps()

    def tare(self) -> None:
        """Makes the present estimate of the trunk the reference for `payload`.

        Later rows are summed separately: a load that comes with the tare counts whether or not it is detected as a
        change.
        """
        self._history.set_tare(self._fit.errors.mean)
        self._changes.keep()
        self._end_load(self._history.current)

    def know_weight(self, mass: float, std: float) -> None:
        """Takes the mass of the whole robot as it is now, or as it was at the tare if there was one, from a scale. It
        tells the scale of the torques, which no motion shows.

        Args:
            mass, std: [kg], what the scale says and its standard deviation.

        Raises:
            IdentificationError: not a mass that the robot can have.
        """
        for value in (mass, std):
            number("a weight on a scale", value, "kg", IdentificationError)
        legs = self.robot.mass - self.robot.inertias[self.robot.trunk].mass
        if not (legs < mass < self.settings.overweight * self.robot.mass and 0.0 <= std < mass):
            raise IdentificationError(
                f"a weight of {mass:g} ± {std:g} kg: the legs of {self.robot.name} alone have {legs:.3g} kg, the model "
                f"has {self.robot.mass:.4g} kg, and a standard deviation is below the mass; kg are needed"
            )
        self._know(on_scale(self.robot, mass, std, self._history.tare))

    def know_payload(self, mass: float, com: ArrayLike, mass_std: float = 0.005, com_std: float = 0.005) -> None:
        """Takes the payload since the tare as known: a test weight, by which gains and offsets are calibrated.

        Args:
            mass: [kg].
            com: (3,) [m], of its centre of mass, trunk frame.
            mass_std: standard deviation [kg].
            com_std: standard deviation [m].

        Raises:
            IdentificationError: no tare, or not a payload.
        """
        self._know(with_test_weight(self.robot, mass, com, mass_std, com_std, self._history.tare))

    def recall(self, memory: Memory, days: float = np.nan, settings: MemorySettings | None = None) -> None:
        """Uses what earlier logs of this robot showed.

        Args:
            memory: see `stadera.trunk.memory`.
            days: time of this log, days since 1970; NaN if unknown.

        Raises:
            IdentificationError: it is of another robot or another model.
        """
        settings, model = settings or MemorySettings(), self._fit.model
        memory = memory.check(self.robot).faded(days, settings)
        if (known := memory.knowledge(model.layout, model.variance, settings)) is not None:
            self._know(known)

    def remember(self, memory: Memory, days: float = np.nan, settings: MemorySettings | None = None) -> Memory:
        """The memory with what this log adds to it.

        Raises:
            IdentificationError: another robot or model, a bad fit, a log that the memory has already, or contradicts.
        """
        settings, model, errors = settings or MemorySettings(), self._fit.model, self._fit.errors
        if self.trust.verdict == "bad" or self._state.status is Status.REFUSED:
            raise IdentificationError("a log whose fit is bad, or whose end is refused, is not remembered")
        memory.check(self.robot)
        own = tuple(known for known in self._known if known.trunks)
        if self._contradicted(own):
            raise IdentificationError("a log that contradicts its scale or test weight is not remembered")
        outside = self._correction(own)
        found = (errors.mean, errors.covariance) if outside is None else outside.of_errors()
        return memory.with_log(evidence_of(self.robot, model, errors.start, *found), days, settings, self._print)

    def remembered(self, memory: Memory, days: float = np.nan) -> tuple[Memory | None, str]:
        """As `remember`, None where that raises an error, and what to say of it. A log that is in the memory already is
        weighed without it.
        """
        if self._print in memory.seen:
            self._known = tuple(known for known in self._known if not known.of_logs)
            if self._good is not None and self._state.status is not Status.REFUSED:
                self._adopt(self._state.learnt)
        return memory.after(lambda: self.remember(memory, days))

    def restart(self) -> None:
        """Announces that the next samples do not continue the previous ones; their rate may differ. Estimates are
        kept.
        """
        self._front.restart()

    def __repr__(self) -> str:
        lines = [f"TrunkEstimator of {self.robot.name}, {self._state.status}", f"  trunk: {self.trunk!r}"]
        if (payload := self.payload) is not None:
            lines.append(f"  payload: {payload!r}")
        lines.append(f"  changes of load: {len(self.changes)}; trust: {self.trust.verdict}")
        return "\n".join(lines)

    # -- asking -----------------------------------------------------------------------------------------------------
    @property
    def trunk(self) -> TrunkParameters:
        """The trunk's ten parameters, payload included, with their uncertainty."""
        return self._good.parameters if self._good is not None else TrunkParameters.unobserved(self._start)

    def estimate(self) -> TrunkEstimate:
        """Mass and centre of mass of the trunk; after a refusal the last good ones, with the reason."""
        found, state = self.trunk, self._state
        covariance = found.covariance if self._good is not None else unobserved()
        status = state.status
        if status is Status.MOVING and state.settled and found.observed[:3].all():
            status = Status.CONVERGED
        return TrunkEstimate(state.learnt, TrunkModel.of(found.inertial), covariance, status, state.reason)

    @property
    def learnt(self) -> float:
        """Time of the last samples that the estimate is based on [s]; NaN before any."""
        return self._state.learnt

    @property
    def refusal(self) -> str:
        """Why the latest samples are refused; empty if they are not."""
        return self._state.reason if self._state.status is Status.REFUSED else ""

    @property
    def payload(self) -> Payload | None:
        """Mass added since the tare; None without a tare."""
        if (tare := self._history.tare) is None:
            return None
        now, errors = self._history.carried, self._fit.errors
        limit = ObservedLimits().com * self.robot.leg_length
        if now.load is not None and now.held is not None:
            return self._where.payload(now.load, now.held.at, errors, limit)
        difference, covariance, by_scale = self._difference(tare, self._outside)
        found = Payload.of_parameters(difference, covariance, limit, by_scale)
        return found if len(self._where.candidates) == 1 else self._where.said(found, (0,))

    def _difference(self, tare: Segment, outside: Correction | None) -> tuple[Array, Array, Array]:
        """The payload's ten parameters, their covariance, and `Errors.by_scale`."""
        errors, p = self._fit.errors, self._fit.errors.mean
        now = self._history.carried
        moved = now.sensitivity - tare.sensitivity
        by_law, by_scale = errors.by_law(moved), errors.by_scale(moved)
        covariance = errors.difference_covariance(tare, now, errors.alike(tare, now)) + np.outer(by_law, by_law)
        found = now.mean(p) - tare.mean(p), covariance
        if outside is None:
            return *found, by_scale
        return outside.of_trunks({now: np.eye(10), tare: -np.eye(10)}, *found, by_scale)

    def bars_on_scale(self, std: float) -> tuple[float, float]:
        """Standard deviations of payload (infinite without one on the trunk) and trunk [kg] to expect if the robot's
        mass, at the tare if there is one, were known to `std` [kg].
        """
        return self._bars_with(on_scale(self.robot, 0.0, std, self._history.tare))

    def bars_calibrated(self, mass: float) -> tuple[float, float]:
        """The same if a test weight [kg] had been on it as long, moved alike. Raises IdentificationError: no tare."""
        place, again = (0.0, 0.0, 0.3 * self.robot.leg_length), replace(self._history.carried)
        return self._bars_with(with_test_weight(self.robot, mass, place, 0.005, 0.005, self._history.tare, again))

    def bars_remembered(self, logs: int) -> tuple[float, float]:
        """The same if so many earlier logs had shown as much as this one."""
        settings, model, errors = MemorySettings(), self._fit.model, self._fit.errors
        evidence = evidence_of(self.robot, model, errors.start, 0.0 * errors.mean, errors.covariance)
        memory = Memory.none(self.robot)
        for log in range(logs):
            memory = memory.with_log(evidence, np.nan, settings, log)
        known = memory.faded(np.nan, settings).knowledge(model.layout, model.variance, settings)
        return (inf, inf) if known is None else self._bars_with(known)

    def _bars_with(self, more: Knowledge) -> tuple[float, float]:
        known = (*(other for other in self._used if other.what != more.what), more)
        tare, trunk = self._history.tare, sqrt(float(self._read(known).covariance[0, 0]))
        now = self._history.carried
        if tare is None or now.load is not None:
            return inf, trunk
        return sqrt(float(self._difference(tare, self._correction(known))[1][0, 0])), trunk

    @property
    def changes(self) -> tuple[LoadChange, ...]:
        """All changes of the load so far; the last is updated as the estimate improves."""
        return self._changes.all(self._history, self._fit.errors)

    @property
    def trust(self) -> Trust:
        """How well the model explains the log so far; bad while the estimate is none that a trunk can have."""
        trust = self._fit.trust
        if self._state.complaint:
            trust = trust.at_most("bad", self._state.complaint)
        why = "another load than was said, a part that was changed, or torques of another scale"
        for what, far in self._contradicted(self._known).items():
            left_out = f"{what}, which is left out, and the log are {far:.1f} standard deviations apart"
            trust = trust.at_most("doubtful", f"{left_out}: {why}")
        return trust

    @property
    def torque_lag(self) -> tuple[float, float]:
        """Estimated delay of the torques and its standard deviation [s]: positive if the log has them late, as of
        sensors; negative if they act after their stamps, as of commands. `identify` counts the other way.
        """
        at, errors, settings = self._fit.model.layout.places["torque_lag"].start, self._fit.errors, self.settings
        lag, left = float(errors.mean[at]), sqrt(min(self._fit.misfit, 1.0))
        return lag, hypot(float(errors.std[at]), left * settings.lag_share * lag, left * settings.lag_least)

    @property
    def errors(self) -> Errors:
        """Differences between the robot and its model, as estimated."""
        return self._fit.errors

    @property
    def drives(self) -> Drives:
        """Rotor inertia, friction and torque offsets of the legs' joints."""
        return Drives.of(self.robot, self._fit.model, self._fit.of_drives(self._history))

    @property
    def mount(self) -> ImuMount:
        """The IMU's mount."""
        return self._front.mount

    @property
    def impacts(self) -> float:
        """Time left out for impacts [s], see `TrunkSettings.impact`."""
        return self._front.impacts

    @property
    def spikes(self) -> int:
        """Number of samples of which single wild values were replaced, see `stadera.trunk.spikes`."""
        return self._front.spikes

    # -- inside -----------------------------------------------------------------------------------------------------
    def _learn(self, made: Made) -> None:
        """Takes in one block."""
        if made.refusal:
            self._refuse(made.refusal)
        if made.rows is None:
            return
        history, fit, now = self._history, self._fit, made.rows.time
        fit.add_swing(made.rows.swing)
        if made.struck:
            return
        rows = history.add(made.rows, fit.errors.mean, fit.errors.covariance)
        updated = fit.update(history, self._front)
        if fit.due - history.blocks == self.settings.updated // 2:  # not in the block that also evaluates the fit
            self._changes.place(history, fit.errors, self.settings.compared)
        misfit = 1.0 if fit.fit is None else fit.fit.misfit
        found = self._changes.look(rows, history, fit.errors, misfit if misfit <= self.settings.bad else inf)
        if found is Found.OTHER:
            self._end_load(self._changes.ended[0])
            self._state = replace(self._state, since=now)
        elif found is Found.BACK:
            for load in (each for each in self._changes.ended if each is not history.tare):
                self._known = tuple(known.of_load(load, None) for known in self._known)
        self._adopt(now, updated)

    def _know(self, known: Knowledge) -> None:
        """Takes in what is known from outside, in place of what the same source said before."""
        self._known = (*(other for other in self._known if other.what != known.what), known)
        if self._good is not None and self._state.status is not Status.REFUSED:
            self._adopt(self._state.learnt)

    def _end_load(self, load: Segment) -> None:
        """What was known of the present load is of one that ends now."""
        self._known = tuple(known.of_load(None, load) for known in self._known)

    @property
    def _outside(self) -> Correction | None:
        """What is known from outside, in place of the estimates."""
        return self._correction(self._used)

    @property
    def _used(self) -> tuple[Knowledge, ...]:
        """What is known from outside, without what contradicts the log."""
        left_out = self._contradicted(self._known)
        return tuple(known for known in self._known if known.what not in left_out)

    def _contradicted(self, known: Sequence[Knowledge]) -> dict[str, float]:
        """Who contradicts the log, and by how many standard deviations."""
        outside = self._correction(known)
        return {} if outside is None else outside.beyond(self.settings.apart)

    def _correction(self, known: Sequence[Knowledge]) -> Correction | None:
        """By what is known, of the payload since the tare."""
        errors, now, tare = self._fit.errors, self._history.carried, self._history.tare
        return Correction.by(known, errors, now, alike=0.0 if tare is None else errors.alike(tare, now))

    def _read(self, known: tuple[Knowledge, ...]) -> Reading:
        return Reading(self.robot, self._start, self._present, self._fit.errors, known)

    @property
    def _present(self) -> Segment:
        """The rows that tell what the robot carries now. A load that came since the tare may not have been noticed yet:
        the rows since then have it alone if they are half of all, or if by them the mass is another.
        """
        loaded, current, tare = self._history.loaded, self._history.current, self._history.tare
        if loaded is None or tare is None or not loaded.blocks:
            return current
        if 2.0 * loaded.weight > current.weight:
            return loaded
        load, covariance, _ = self._difference(tare, None)
        return loaded if load[0] ** 2 > covariance[0, 0] else current

    def _adopt(self, time: float, updated: bool = False) -> None:
        """Adopts the present estimate of the trunk, unless it is implausible; `updated`: with other model errors."""
        since, read = time if isnan(self._state.since) else self._state.since, self._read(self._used)
        if complaint := read.complaint(self.bounds, self.settings.apart):
            self._state = replace(self._state, since=since, complaint=f"{RUNS_AWAY}: {complaint}")
            self._refuse(self._state.complaint)
            return
        self._good = read
        misfit = self._fit.misfit
        if misfit > self.settings.bad:
            self._state = replace(self._state, learnt=time, since=since, complaint="")
            self._refuse(f"the model does not explain what the sensors say: {self.trust.reasons[0]}")
            return
        settled = time - since >= self.settings.settled and misfit <= self.settings.doubtful
        self._state = _State(Status.MOVING, "", time, since, settled)
        if updated:
            self._front.shape = read.parameters.inertial

    def _refuse(self, reason: str) -> None:
        self._state = replace(self._state, status=Status.REFUSED, reason=reason)
