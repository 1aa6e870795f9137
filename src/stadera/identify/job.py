"""What is decided before the passes over the logs: cut-off, vertical, torque lag, what is fixed and what believed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from stadera.errors import RecordingError
from stadera.identify.lag import EARLIEST, LATEST, STEP, TorqueLag, estimate_lag
from stadera.identify.log import Log, Part, Stretch, head, joints_with_effort, name_of, time_span
from stadera.identify.prior import Prior, robot_prior
from stadera.identify.settings import IdentifySettings
from stadera.identify.vertical import Vertical, vertical_of
from stadera.recording.cutoff import highest_cutoff, suggest_cutoff
from stadera.recording.join import take
from stadera.recording.preprocess import preprocess_stream
from stadera.recording.recording import Recording
from stadera.recording.settings import Preprocessing
from stadera.regressors import FrictionModel, JointTorqueRegressor, TrunkMotion
from stadera.robot.model import Leg, Robot

Progress = Callable[[str, int, int], None]
"""Told a step's name, how much of it is done, and how much there is (0: not known)."""

LOWEST_CUTOFF = 15.0
"""Hz; no lower one is chosen for signals: Coulomb friction's steps, smeared out, would pass for something else."""
DROP_BELOW = 0.01
"""rad/s, the paper's: slower than this a joint's friction is not determined by its velocity."""
LAG_CUTOFF = 25.0
"""Hz; for the torque lag, which shows best in fast changes."""


@dataclass(frozen=True, eq=False)
class LegTask:
    """One leg to identify.

    Attributes:
        leg: its names.
        regressor: rows of its torques, with all joint terms.
        believed: the model's value of every parameter.
        fixed: those that are not to be identified, at the model's values.
        prior: the belief in those that are.
    """

    leg: Leg
    regressor: JointTorqueRegressor
    believed: Mapping[str, float]
    fixed: Mapping[str, float]
    prior: Prior

    @classmethod
    def of(cls, robot: Robot, leg: Leg, settings: IdentifySettings) -> LegTask:
        """A leg of a robot, with what the settings leave to be identified."""
        regressor = JointTorqueRegressor(
            robot.leg_tree(leg.name), FrictionModel.full(settings.friction.stiction_velocity)
        )
        everything = robot_prior(robot, regressor.columns, settings.width)
        believed = dict(zip(regressor.columns, everything.values.tolist(), strict=True))
        chosen = {f"{joint}.{term}" for joint in leg.joints for term in settings.friction.terms}
        terms = {c for c in regressor.columns if c.rsplit(".", 1)[0] in leg.joints}
        fixed = {c: believed[c] for c in regressor.columns if c in terms - chosen}
        identified = tuple(c for c in regressor.columns if c not in fixed)
        return cls(leg, regressor, believed, fixed, robot_prior(robot, identified, settings.width))

    @cached_property
    def rigid(self) -> dict[str, float]:
        """The links' parameters at the model's values."""
        return {c: v for c, v in self.believed.items() if c.rsplit(".", 1)[0] in self.leg.links}


@dataclass(frozen=True, eq=False)
class Job:
    """Everything that is fixed before the passes over the logs begin.

    Attributes:
        robot: the prior model.
        tasks: one for each leg, those asked for first; the others are there for what they say of the drives.
        wanted: how many were asked for.
        settings: as asked for.
        preprocessing: of the signals; keeps samples at rest.
        rows_cutoff: of the rows made of them [Hz]; None where nothing is filtered.
        drop_below: rows with all joints of a leg slower than this are left out [rad/s].
        vertical: of the held trunk.
        notes: what was found out, one sentence each.
        progress: see `Progress`.
    """

    robot: Robot
    tasks: tuple[LegTask, ...]
    wanted: int
    settings: IdentifySettings
    preprocessing: Preprocessing
    rows_cutoff: float | None
    drop_below: float
    vertical: Vertical
    notes: tuple[str, ...]
    progress: Progress

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints of all legs, in the order of the processed signals."""
        return tuple(joint for task in self.tasks for joint in task.leg.joints)

    @property
    def trunk(self) -> TrunkMotion:
        """The held trunk."""
        return TrunkMotion.held(self.vertical.up)

    def with_samples_at_rest(self) -> Job:
        """The same, keeping rows at which nothing moves: all there is in a log without motion."""
        return replace(self, drop_below=0.0)

    def step(self, name: str) -> Callable[[int, int], None]:
        """The progress of one step."""
        return partial(self.progress, name)


def prepare(robot: Robot, logs: Sequence[Log], settings: IdentifySettings, progress: Progress) -> Job:
    """Decides cut-off, vertical and torque lag from the beginning of each log.

    Raises:
        RecordingError: logs that lack a joint or its torque, or are too short; torques of a leg that are all zero.
        UnknownNameError: no such leg or joint.
    """
    wanted = tuple(dict.fromkeys(robot.leg(name).name for name in settings.legs or (leg.name for leg in robot.legs)))
    beginnings = [head(log, [joint for name in wanted for joint in robot.leg(name).joints]) for log in logs]
    for beginning in beginnings:
        _check_torques(beginning, robot, wanted)
    supporting = () if settings.spread is None else _also_recorded(robot, logs, wanted)
    tasks = tuple(LegTask.of(robot, robot.leg(name), settings) for name in (*wanted, *supporting))
    joints = tuple(joint for task in tasks for joint in task.leg.joints)
    if supporting:
        beginnings = [head(log, joints) for log in logs]
    cutoff, rows_cutoff = _cutoffs(beginnings, joints, settings)
    vertical = vertical_of(beginnings[0], robot, settings.up)
    notes: tuple[str, ...] = ()
    lag = settings.torque_lag
    if lag is None:
        progress("estimating the torque lag", 0, 1)
        training = [take(r, slice(0, max(2, round(settings.split * len(r))))) for r in beginnings]
        estimate = _lag(training, tasks, vertical, filtered=cutoff is not None)
        progress("estimating the torque lag", 1, 1)
        lag = estimate.value
        if min(abs(lag - EARLIEST), abs(lag - LATEST)) < STEP / 2:
            notes = (f"torque lag at the end of the search, {1e3 * lag:.1f} ms: look at the stamps of the log",)
        elif lag:
            notes = (
                f"torque lag estimated at {1e3 * lag:.1f} ms; it lowers the residuals' variance by "
                f"{100 * (1 - estimate.variance_ratio):.0f} %",
            )
    if rows_cutoff is not None:
        notes += (f"equations filtered at {rows_cutoff:g} Hz, thinned to twice that",)
    preprocessing = Preprocessing(cutoff, drop_below=0.0, effort_delay=lag)
    return Job(robot, tasks, len(wanted), settings, preprocessing, rows_cutoff, DROP_BELOW, vertical, notes, progress)


def _check_torques(beginning: Recording, robot: Robot, legs: Sequence[str]) -> None:
    """Torques that are zero for a whole leg that moves were not recorded, though all would follow from them surely."""
    for name in legs:
        joints = robot.leg(name).joints
        moves = bool(np.ptp(beginning.channel("position", joints), axis=0).any())
        if moves and not beginning.channel("effort", joints).any():
            listed = ", ".join(joints)
            raise RecordingError(
                f"{beginning.source}: the efforts of leg {name} ({listed}) are all zero: no torque was recorded"
            )


def _also_recorded(robot: Robot, logs: Sequence[Log], wanted: Sequence[str]) -> tuple[str, ...]:
    """The legs beside those wanted whose joints are in all logs, torques included."""
    recorded = set.intersection(*(joints_with_effort(log) for log in logs))
    return tuple(leg.name for leg in robot.legs if leg.name not in wanted and recorded.issuperset(leg.joints))


def _cutoffs(
    beginnings: Sequence[Recording], joints: Sequence[str], settings: IdentifySettings
) -> tuple[float | None, float | None]:
    """The cut-offs of signals and of rows [Hz]."""
    if settings.cutoff_hz is None:
        return None, None
    suggested = [c for c in (suggest_cutoff(r, joints) for r in beginnings) if c is not None]
    if settings.cutoff_hz != "auto":
        return settings.cutoff_hz, min((settings.cutoff_hz, *suggested))
    if not suggested:
        return None, None  # accelerations are recorded: there is nothing to filter
    return min(max(*suggested, LOWEST_CUTOFF), *(highest_cutoff(r) for r in beginnings)), max(suggested)


def _lag(recordings: Sequence[Recording], tasks: Sequence[LegTask], vertical: Vertical, *, filtered: bool) -> TorqueLag:
    cutoff = min(LAG_CUTOFF, *(highest_cutoff(r) for r in recordings)) if filtered else None
    joints = tuple(joint for task in tasks for joint in task.leg.joints)
    settings = Preprocessing(cutoff, drop_below=0.0)
    stretches = [p for r in recordings for p in preprocess_stream([r], settings, joints) if len(p)]
    return estimate_lag(stretches, [task.regressor for task in tasks], vertical.up)


def parts_of(job: Job, logs: Sequence[Log], validation: Sequence[Log] | None) -> tuple[Part, Part | None, str | None]:
    """The training part, the validation part, and in words what the latter is."""
    make = partial(Part, joints=job.joints, settings=job.preprocessing)
    if validation is not None:
        names = ", ".join(dict.fromkeys(name_of(log) for log in validation))
        return make([Stretch(log) for log in logs]), make([Stretch(log) for log in validation]), names
    if job.settings.split == 1.0:
        return make([Stretch(log) for log in logs]), None, None
    first, rest = [], []
    for log in logs:
        start, stop = time_span(log, job.joints)
        middle = start + job.settings.split * (stop - start)
        first.append(Stretch(log, stop=middle))
        rest.append(Stretch(log, start=middle))
    whole = "the log" if len(logs) == 1 else "each log"
    return make(first), make(rest), f"the last {100 * (1 - job.settings.split):.0f} % of {whole}"
