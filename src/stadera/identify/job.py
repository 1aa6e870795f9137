"""Determines cut-off, vertical, torque lag, fixed parameters and priors before the passes over the logs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from stadera.body import Body, FrictionModel, JointMotion, JointTorqueRegressor, Motion, Rows, State, TrunkMotion
from stadera.checks import CheckLimits
from stadera.checks.statics import motors_off
from stadera.constants import GRAVITY, SINGULAR
from stadera.errors import RecordingError, UntrustedError
from stadera.identify.lag import estimate_lag
from stadera.identify.log import Log, Part, Section, has_effort, head, time_span
from stadera.identify.prior import Prior, PriorWidth, robot_prior
from stadera.identify.settings import IdentifySettings
from stadera.identify.varying import VaryingFriction, columns_of, with_varying
from stadera.information import Information
from stadera.logs.filters import highest_cutoff, suggest_cutoff
from stadera.logs.processing import Preprocessing, preprocess_stream
from stadera.logs.recording import Recording, take
from stadera.robot.imu import ImuMount
from stadera.robot.model import Leg, Robot
from stadera.types import Array, Progress


@dataclass(frozen=True, eq=False)
class TrunkUp:
    """The vertical in trunk axes (3,), a sentence on its source, and how fast the trunk turns (rms) [rad/s]."""

    up: Array
    note: str
    turning: float = 0.0


def vertical_of(recording: Recording, robot: Robot, up: tuple[float, float, float] | None) -> TrunkUp:
    """The given vertical, else the mean specific force in a log's IMU, else the trunk's z axis. UnknownNameError for an
    IMU frame that the robot lacks, ModelError for one that is fixed to a leg.
    """
    if up is not None:
        return TrunkUp(np.asarray(up, dtype=float), f"vertical given: ({up[0]:g}, {up[1]:g}, {up[2]:g}) in trunk axes")
    imu = recording.imu
    if imu is None:
        return TrunkUp(np.array([0.0, 0.0, 1.0]), "no IMU in the log and no vertical given: trunk taken as level")
    mean = ImuMount.of(robot, None, imu.frame).rotation @ imu.linear_acceleration.mean(axis=0)
    turning = float(np.sqrt(np.mean(np.sum(imu.angular_velocity**2, axis=1))))
    tilt = np.degrees(np.arccos(np.clip(mean[2] / np.linalg.norm(mean), -1.0, 1.0)))
    return TrunkUp(mean, f"vertical from the IMU: trunk tilted by {tilt:.1f}°", turning)


def carried_shares(
    recording: Recording, robot: Robot, up: tuple[float, float, float] | None, samples: int = 4000
) -> dict[str, float]:
    """Mean upward force on each foot of a recorded leg as a share of the robot's weight, of postures in which the leg
    is not near-singular; the vertical as of `vertical_of`. A log of more than `samples` is thinned out.
    """
    body, state, effort, vertical = _at_rest(recording, robot, up, samples)
    with np.errstate(invalid="ignore"):  # of legs so stretched that they feel nothing, left out below
        contacts = body.contacts(state, (state.torque - effort)[:, body.in_legs])
        force = contacts[..., :3] @ vertical / (robot.mass * GRAVITY)
    felt = np.abs(state.volume) > SINGULAR * robot.leg_length**3
    loads = np.where(felt, force, 0.0).sum(axis=0) / np.maximum(felt.sum(axis=0), 1)
    return {leg.name: float(loads[k]) for k, leg in enumerate(robot.legs) if set(leg.joints) <= set(recording.joints)}


def _at_rest(
    recording: Recording, robot: Robot, up: tuple[float, float, float] | None, samples: int = 4000
) -> tuple[Body, State, Array, Array]:
    """The robot, its state if it were at rest in each posture, efforts (samples, joints), and the vertical; legs that
    are not recorded are at zero.
    """
    body, joints = Body.of(robot, others=False), robot.tree.joints
    thin = slice(None, None, -(-len(recording) // samples))
    position, effort = np.zeros((2, len(recording.time[thin]), len(joints)))
    for leg in robot.legs:
        if not set(leg.joints) <= set(recording.joints):
            continue
        columns = [joints.index(joint) for joint in leg.joints]
        position[:, columns], effort[:, columns] = (
            recording.channel(name, leg.joints)[thin] for name in ("position", "effort")
        )
    vertical = vertical_of(recording, robot, up).up
    vertical = vertical / np.linalg.norm(vertical)
    still, rest = np.zeros_like(position), np.zeros((len(position), 3))
    state = body.at(Motion(position, still, still, rest, rest, rest + GRAVITY * vertical, vertical))
    return body, state, effort, vertical


@dataclass(frozen=True, eq=False)
class LegTask:
    """One leg to identify."""

    leg: Leg  # names of the leg, its links and joints
    regressor: JointTorqueRegressor  # of its torques, with all joint terms
    nominal: Mapping[str, float]  # the model's values of all parameters
    fixed: Mapping[str, float]  # parameters that are not identified, at the model's values
    prior: Prior  # of the parameters that are identified
    varying: Mapping[str, VaryingFriction] = field(default_factory=dict)  # by joint with Coulomb friction
    still: frozenset[str] = frozenset()  # joints that do not move: what is measured of their velocities is noise

    @classmethod
    def of(cls, robot: Robot, leg: Leg, settings: IdentifySettings) -> LegTask:
        """The task for one leg, given the terms that the settings select."""
        regressor = JointTorqueRegressor(robot.leg_tree(leg.name), FrictionModel.full())
        everything = robot_prior(robot, regressor.columns, settings.width)
        nominal = dict(zip(regressor.columns, everything.values.tolist(), strict=True))
        chosen = {f"{joint}.{term}" for joint in leg.joints for term in settings.friction.terms}
        terms = {c for c in regressor.columns if c.rsplit(".", 1)[0] in leg.joints}
        fixed = {c: nominal[c] for c in regressor.columns if c in terms - chosen}
        identified = tuple(c for c in regressor.columns if c not in fixed)
        return cls(leg, regressor, nominal, fixed, robot_prior(robot, identified, settings.width))

    def with_varying(self, robot: Robot, varying: Mapping[str, VaryingFriction], width: PriorWidth) -> LegTask:
        """The task with friction of these joints that varies."""
        more = columns_of(varying)
        prior = robot_prior(robot, (*self.prior.columns, *more), width)
        return replace(self, varying=varying, prior=prior, nominal=dict(self.nominal) | dict.fromkeys(more, 0.0))

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all parameters."""
        return self.regressor.columns + columns_of(self.varying)

    def rows(self, motion: JointMotion, torque: Array, trunk: TrunkMotion, std: float = 1.0) -> Iterator[Rows]:
        """One set of rows for each joint [N·m], from torques (samples, joints)."""
        if self.still:
            moves = np.array([joint not in self.still for joint in self.leg.joints], dtype=float)
            motion = JointMotion(motion.position, moves * motion.velocity, moves * motion.acceleration)
        for k, (joint, rows) in enumerate(
            zip(self.leg.joints, self.regressor.rows(motion, torque, trunk, std), strict=True)
        ):
            varying = self.varying.get(joint)
            q, rate = motion.position[:, k], motion.velocity[:, k]
            yield rows if varying is None else with_varying(rows, joint, varying, q, rate, self.rigid)

    @property
    def constant(self) -> LegTask:
        """The task with constant friction, acting in the direction of sliding."""
        kept = len(self.prior.columns) - len(columns_of(self.varying))
        return replace(self, varying={}, prior=self.prior.first(kept))

    def lasting(self, information: Information) -> Information:
        """Information on links and drives alone, in units of its noise: how friction varies is left to its prior."""
        names = columns_of(self.varying)
        width = [self.prior.scales[self.prior.columns.index(name)] for name in names]
        before = Rows(names, np.diag(1.0 / np.array(width)), np.zeros(len(names)))
        return information.merge(Information.of([before], names)).marginal(self.constant.prior.columns)

    @cached_property
    def rigid(self) -> dict[str, float]:
        """The links' parameters at the model's values."""
        return {c: v for c, v in self.nominal.items() if c.rsplit(".", 1)[0] in self.leg.links}


@dataclass(frozen=True, eq=False)
class Job:
    """Settings and data determined before the passes over the logs."""

    robot: Robot  # the prior model
    tasks: tuple[LegTask, ...]  # one for each leg: the requested ones first, then others that inform on the drives
    wanted: int  # number of requested legs
    settings: IdentifySettings  # as requested
    preprocessing: Preprocessing  # of the signals; keeps samples at rest
    rows_cutoff: float | None  # cut-off of the filter over the rows [Hz]; None for no filter
    drop_below: float  # rows in which all joints of a leg are slower than this are skipped [rad/s]
    vertical: TrunkUp  # of the held trunk
    torque_noise: Mapping[str, float]  # by joint, white noise of the torque in the band of the rows [N·m]
    torque_rms: Mapping[str, float]  # by joint, root mean square of the torque [N·m]
    notes: tuple[str, ...]  # remarks, one sentence each
    doubts: tuple[str, ...]  # reasons found in the logs why the result is doubtful at best
    progress: Progress  # see `Progress`
    lag_std: float = 0.0  # standard deviation of what remains of the torques' lag [s]

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints of all legs, in the order of the processed signals."""
        return joints_of(self.robot, [task.leg.name for task in self.tasks])

    @property
    def trunk(self) -> TrunkMotion:
        """The held trunk."""
        return TrunkMotion.held(self.vertical.up)


def prepare(robot: Robot, logs: Sequence[Log], settings: IdentifySettings, progress: Progress) -> Job:
    """Determines cut-off, vertical and torque lag from the beginning of each log.

    Raises:
        RecordingError: a joint or its torque is missing, all torques of a leg are zero, a foot carries load, or too few
            samples.
        UnknownNameError: no such leg or joint.
    """
    wanted = wanted_legs(robot, settings)
    beginnings = [head(log, joints_of(robot, wanted)) for log in logs]
    for beginning in beginnings:
        _check_torques(beginning, robot, wanted)
        check_feet(beginning, robot, wanted, settings)
    legs = (*wanted, *_supporting(robot, logs, wanted, settings))
    if len(legs) > len(wanted):
        beginnings = [head(log, joints_of(robot, legs)) for log in logs]
    tasks = tuple(LegTask.of(robot, robot.leg(name), settings) for name in legs)
    joints = joints_of(robot, legs)
    cutoff, rows_cutoff = _cutoffs(beginnings, joints, settings)
    vertical = vertical_of(beginnings[0], robot, settings.up)
    lag, lag_std = settings.torque_lag, 0.0
    notes: tuple[str, ...] = ()
    if lag is None:
        progress("estimating the torque lag", 0, 1)
        lag, lag_std, notes = _estimated_lag(robot, beginnings, tasks, vertical, cutoff, settings)
        progress("estimating the torque lag", 1, 1)
    if rows_cutoff is not None:
        notes += (f"equations filtered at {rows_cutoff:g} Hz, thinned to twice that",)
    noise, size = torque_sizes(beginnings, joints, rows_cutoff)
    return Job(
        robot=robot,
        tasks=tasks,
        wanted=len(wanted),
        settings=settings,
        preprocessing=Preprocessing(cutoff, effort_delay=lag),
        rows_cutoff=rows_cutoff,
        drop_below=settings.signals.drop_below,
        vertical=vertical,
        torque_noise=noise,
        torque_rms=size,
        notes=notes,
        doubts=tuple(dict.fromkeys(doubt for beginning in beginnings for doubt in beginning.doubts)),
        progress=progress,
        lag_std=lag_std,
    )


def torque_sizes(
    recordings: Sequence[Recording], joints: tuple[str, ...], cutoff_hz: float | None
) -> tuple[dict[str, float], dict[str, float]]:
    """White noise of each joint's recorded torque, and the torque's root mean square [N·m].

    The noise is estimated from third differences, to which motion far below the sampling rate contributes nothing:
    white noise of variance σ² gives 20 σ². A low-pass at `cutoff_hz` (None for none) passes 2 f_c / f_s of that.
    """
    noise, size = np.zeros(len(joints)), np.zeros(len(joints))
    for recording in recordings:
        effort = recording.channel("effort", joints)
        passed = 1.0 if cutoff_hz is None else min(2.0 * cutoff_hz * float(np.median(np.diff(recording.time))), 1.0)
        noise += passed * (np.diff(effort, 3, axis=0) ** 2).mean(axis=0) / 20.0
        size += (effort**2).mean(axis=0)
    noise, size = np.sqrt(noise / len(recordings)), np.sqrt(size / len(recordings))
    return dict(zip(joints, noise.tolist(), strict=True)), dict(zip(joints, size.tolist(), strict=True))


def wanted_legs(robot: Robot, settings: IdentifySettings) -> tuple[str, ...]:
    """Names of the requested legs. Raises UnknownNameError: no such leg."""
    return tuple(dict.fromkeys(robot.leg(name).name for name in settings.legs or [leg.name for leg in robot.legs]))


def joints_of(robot: Robot, legs: Sequence[str]) -> tuple[str, ...]:
    """Joints of the named legs, leg by leg."""
    return tuple(joint for name in legs for joint in robot.leg(name).joints)


def _check_torques(beginning: Recording, robot: Robot, legs: Sequence[str]) -> None:
    """Raises if all torques of a leg are zero: then they were not recorded, but the fit would accept them as exact."""
    for name in legs:
        joints = robot.leg(name).joints
        moves = bool(np.ptp(beginning.channel("position", joints), axis=0).any())
        if moves and not beginning.channel("effort", joints).any():
            what = f"the efforts of leg {name} ({', '.join(joints)}) are all zero"
            raise RecordingError(f"{beginning.source}: {what}: no torque was recorded")


def check_motors(beginning: Recording, robot: Robot, legs: Sequence[str], settings: IdentifySettings) -> None:
    """Raises UntrustedError if no joint moves and the torques do not even carry the legs."""
    joints = joints_of(robot, legs)
    if np.ptp(beginning.channel("position", joints), axis=0).max() >= settings.signals.travel:
        return
    _, state, effort, _ = _at_rest(beginning, robot, settings.up)
    at = [robot.tree.joints.index(joint) for joint in joints]
    if off := motors_off(effort[:, at], state.torque[:, at], CheckLimits()):
        raise UntrustedError(f"{beginning.source}: no joint moves, and {off}")


def check_feet(
    beginning: Recording,
    robot: Robot,
    legs: Sequence[str],
    settings: IdentifySettings,
    what: str = "without an IMU, legs are identified",
) -> None:
    """Raises if a foot carries load, or if no leg of this robot in the air would have such torques."""
    shares = carried_shares(beginning, robot, settings.up)
    carrying = {name: shares[name] for name in legs if shares[name] > settings.most_carried}
    if carrying:
        feet = ", ".join(f"{name} {100 * share:.0f} %" for name, share in carrying.items())
        free = [name for name, share in shares.items() if share <= settings.most_carried]
        others = f"; those in the air are identified by --legs {','.join(free)}" if free else ""
        raise RecordingError(
            f"{beginning.source}: feet carry a share of the robot's weight ({feet}): {what} while they "
            f"swing freely and the trunk is held{others}"
        )


def stands(log: Log, robot: Robot, wanted: Sequence[str], settings: IdentifySettings) -> bool:
    """True for a log with an IMU of a robot that is on its feet, on any of the wanted legs."""
    beginning = head(log, joints_of(robot, wanted))
    if beginning.imu is None:
        return False
    shares = carried_shares(beginning, robot, settings.up)
    return any(shares[name] > settings.most_carried for name in wanted)


def _supporting(robot: Robot, logs: Sequence[Log], wanted: Sequence[str], settings: IdentifySettings) -> list[str]:
    """Legs, besides those requested, that inform on the drives: recorded with torques in all logs, and in the air."""
    if settings.spread is None:
        return []
    others = [leg for leg in robot.legs if leg.name not in wanted]
    found = [leg.name for leg in others if all(has_effort(log, leg.joints) for log in logs)]
    for log in logs if found else ():
        beginning = head(log, joints_of(robot, found))
        shares = carried_shares(beginning, robot, settings.up)
        found = [name for name in found if shares[name] <= settings.most_carried]
    return found


def _cutoffs(
    beginnings: Sequence[Recording], joints: Sequence[str], settings: IdentifySettings
) -> tuple[float | None, float | None]:
    if settings.cutoff_hz is None:
        return None, None
    suggested = [c for c in (suggest_cutoff(r, joints) for r in beginnings) if c is not None]
    if settings.cutoff_hz != "auto":
        return settings.cutoff_hz, min((settings.cutoff_hz, *suggested))
    if not suggested:
        return None, None  # accelerations are recorded, so nothing needs filtering
    highest = settings.signals.any_part * min(highest_cutoff(r) for r in beginnings)
    return min(max(*suggested, settings.signals.lowest_cutoff), highest), min(max(suggested), highest)


def _estimated_lag(
    robot: Robot,
    beginnings: Sequence[Recording],
    tasks: Sequence[LegTask],
    vertical: TrunkUp,
    cutoff: float | None,
    asked: IdentifySettings,
) -> tuple[float, float, tuple[str, ...]]:
    """The lag [s], its standard deviation and a note on it, from signals with the job's cut-off, or none."""
    recordings = [take(r, slice(0, max(2, round(asked.split * len(r))))) for r in beginnings]
    if cutoff is not None:
        cutoff = min(cutoff, asked.signals.lag_cutoff, *(highest_cutoff(r) for r in recordings))
    joints = tuple(joint for task in tasks for joint in task.leg.joints)
    stretches = [p for r in recordings for p in preprocess_stream([r], Preprocessing(cutoff), joints) if len(p)]
    search = asked.signals.lag
    legs = [(task.regressor, robot_prior(robot, task.regressor.columns, asked.width)) for task in tasks]
    lag, std, ratio = estimate_lag(stretches, legs, vertical.up, search)
    std = float(np.hypot(std, search.remains))
    if min(abs(lag - search.earliest), abs(lag - search.latest)) < search.step / 2:
        return lag, std, (f"torque lag at the end of the search, {1e3 * lag:.1f} ms: look at the stamps of the log",)
    fall = f"it lowers the residuals' variance by {100 * (1 - ratio):.0f} %"
    return lag, std, (f"torque lag estimated at {1e3 * lag:.1f} ms ± {1e3 * std:.1f}; {fall}",) if lag else ()


def parts_of(job: Job, logs: Sequence[Log], validation: Sequence[Log] | None) -> tuple[Part, Part | None, str | None]:
    """The training part, the validation part, and a description of the latter."""
    make = partial(Part, joints=job.joints, settings=job.preprocessing)
    if validation is not None:
        names = ", ".join(dict.fromkeys(log.source for log in validation))
        return make([Section(log) for log in logs]), make([Section(log) for log in validation]), names
    if job.settings.split == 1.0:
        return make([Section(log) for log in logs]), None, None
    first, rest = [], []
    for log in logs:
        start, stop = time_span(log, job.joints)
        middle = start + job.settings.split * (stop - start)
        first.append(Section(log, stop=middle))
        rest.append(Section(log, start=middle))
    whole = "the log" if len(logs) == 1 else "each log"
    return make(first), make(rest), f"the last {100 * (1 - job.settings.split):.0f} % of {whole}"
