"""Weighs a robot from its times at rest, in two passes over the log, with memory independent of its length.

The first pass finds the times at rest, the mass in each by eq. 7, and the changes of the load. The second runs the
method for the centre of mass as if online, restarted after each change, and collects the poses of tare and load.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import degrees, isnan, sqrt

import numpy as np

from stadera.errors import IdentificationError
from stadera.inertia import InertialParameters, skew
from stadera.trunk.load import LoadChange, Payload, since_tare
from stadera.trunk.measurement import Measurement, measurements_of
from stadera.trunk.posture import PostureLaw
from stadera.trunk.protocol import Estimator, Status, TrunkEstimate
from stadera.trunk.registry import Setup, make_estimator
from stadera.trunk.result import TrunkParameters
from stadera.trunk.standing.equilibrium import ConstantErrors, weight_felt
from stadera.trunk.standing.forces import ContactForceEstimator, ForceNoise, MeasuredLegs, measurements_without_imu
from stadera.trunk.standing.poses import Alike, PoseMean, payload_between, sized_by_poses
from stadera.trust import Trust
from stadera.types import Array
from stadera.weigh.against_model import LIES
from stadera.weigh.changes import LevelLimits, changes_between, levels, loads, misfit
from stadera.weigh.lying import lying
from stadera.weigh.reading import CheckedLog, check_source
from stadera.weigh.rest import Rest, RestBlock, times_at_rest
from stadera.weigh.result import Balance, Timeline, Vertical, Weighing
from stadera.weigh.settings import Request, Source

Blocks = Sequence[RestBlock]

_REPORTED = 500  # samples between two progress reports


def weigh_at_rest(request: Request) -> Weighing:
    """Weighs from the times at rest. Raises as `stadera.weigh.weigh`."""
    return _AtRest(request).result()


@dataclass
class _Poses:
    """Means of the poses held during one load, of which the latest `most` are kept."""

    most: int
    alike: Alike = field(default_factory=Alike)
    means: list[PoseMean] = field(default_factory=list)

    def add(self, measurement: Measurement) -> None:
        if not (self.means and self.means[-1].takes(measurement, self.alike)):
            self.means.append(PoseMean(measurement))
            del self.means[: -self.most]


class _Within:
    """Tells whether times, queried in increasing order, lie in blocks at rest."""

    def __init__(self, blocks: Blocks) -> None:
        self._blocks, self._at = blocks, 0

    def has(self, time: float) -> bool:
        while self._at < len(self._blocks) and self._blocks[self._at].end < time:
            self._at += 1
        return self._at < len(self._blocks) and self._blocks[self._at].begin <= time


class _AtRest:
    """Working state of one weighing."""

    def __init__(self, request: Request) -> None:
        self.request, self.robot, self.settings = request, request.robot, request.settings
        self.errors = ConstantErrors.of_robot(self.robot, self.settings.trunk.model)
        torques = np.sqrt(np.diag(self.errors.covariance)[:12]).reshape(4, 3)
        noise = replace(ForceNoise.of(self.robot), torque_constant=torques)
        self.forces = ContactForceEstimator(self.robot, noise, MeasuredLegs(self.robot))
        self.limits = LevelLimits(
            self.settings.least_change * self.robot.mass, self.settings.change_deviations, self.errors
        )
        self.has_imu = check_source(request)
        self.log = CheckedLog(request, request.source)
        self._logs = [self.log]
        self._remarks: list[str] = []
        self._lies = False

    @property
    def _no_imu(self) -> str:
        return "" if self.has_imu else "; the log has no IMU, without which only rest can be weighed by"

    def result(self) -> Weighing:
        rest, source = self._rest(self.log), self.request.source.source
        means = loads(rest.blocks, self.limits)
        level = levels(rest.blocks, means)
        tare_poses, load_poses = _Poses(self.settings.poses), _Poses(self.settings.poses)
        last = [b for b, n in zip(rest.blocks, level, strict=True) if n == level[-1]]
        tare, loaded = self._split(rest, means, last)
        estimates = self._estimates(rest, means, ((tare, tare_poses), (loaded, load_poses)))
        final, scatter = estimates[-1], misfit(rest.blocks, level, means, self.limits)
        self.errors = sized_by_poses(tare_poses.means, load_poses.means, self.forces, self.errors)
        payload = self._payload(tare_poses.means, load_poses.means)
        vertical = vertical_at(load_poses.means[-1], self.forces, self.errors)
        if vertical.source == "forces":
            self._remarks.insert(0, _without_imu(vertical))
        self._remark_on(final)
        pose = load_poses.means[-1].measurement
        self._lies = bool(lying(self.robot, pose.joint_position[None], pose.up[None])[0])
        found = Weighing(
            robot=self.robot,
            source=source,
            method=self.request.method,
            status=str(final.status),
            trust=self._trust(scatter, rest),
            trunk=self._trunk(means[-1], final),
            time=rest.blocks[-1].end,
            payload=payload,
            changes=self._changes(means, payload),
            timeline=self._timeline(rest.blocks, estimates),
            refusals=tuple(sorted((*rest.refusals, *self.log.refusals), key=lambda refusal: refusal.begin)),
            begin=self.log.begin,
            end=self.log.end,
            balance=self._balance(load_poses.means[-1].measurement, final, means[-1].mass),
            vertical=vertical,
            notes=tuple(dict.fromkeys([*self._remarks, *(note for log in self._logs for note in log.notes)])),
        )
        return with_common_gain(found.widened(self._widening(scatter)), self.settings.trunk.model.common_gain)

    # -- the log ----------------------------------------------------------------------------------------------
    def _measurements(self, log: CheckedLog, what: str) -> Iterator[Measurement]:
        done = 0
        for chunk in log:
            if chunk.imu is None:
                if log is not self.log:
                    log.notes["no IMU in the tare's log: its vertical is the direction of the feet's forces"] = None
                measurements = measurements_without_imu(chunk, self.robot)
            else:
                measurements = measurements_of(chunk, self.robot, self.request.imu_frame)
            for m in measurements:
                done += 1
                if self.request.progress and done % _REPORTED == 0:
                    self.request.progress(what, done, 0)
                yield m

    def _rest(self, log: CheckedLog) -> Rest:
        found = self._measurements(log, f"looking for rest in {log.source.name}")
        rest = times_at_rest(found, self.forces, self.settings.block)
        if not rest.blocks:
            raise IdentificationError(
                f"{log.source.source}: the robot never stands still, nothing to weigh by: {rest.usual_reason}"
                f"{self._no_imu}"
            )
        return rest

    # -- tare -------------------------------------------------------------------------------------------------
    def _split(self, rest: Rest, means: Blocks, last: list[RestBlock]) -> tuple[list[RestBlock], list[RestBlock]]:
        """Blocks of the tare and of the load in this log."""
        tare, source = self.request.tare, self.request.source.source
        if not isinstance(tare, tuple):
            return [], last
        begin, end = tare
        within = [b for b in rest.blocks if begin <= b.begin and b.end <= end]
        if not within:
            raise IdentificationError(
                f"{source}: the robot does not stand still in the tare's time, {begin - rest.begin:g} to "
                f"{end - rest.begin:g} s; the log is {rest.end - rest.begin:.3g} s long{self._no_imu}"
            )
        for mean in means[1:]:
            if within[0].begin < mean.begin <= within[-1].begin:
                raise IdentificationError(
                    f"{source}: the load changes within the tare's time, at {mean.begin - rest.begin:.2f} s"
                )
        after = [b for b in last if b.begin > end]
        if not after:
            raise IdentificationError(
                f"{source}: the robot does not stand still after the tare's time, {end - rest.begin:g} s{self._no_imu}"
            )
        return within, after

    def _payload(self, tare: list[PoseMean], loaded: list[PoseMean]) -> Payload | None:
        if self.request.tare is None:
            return None
        if not isinstance(self.request.tare, tuple):
            tare = self._poses_of(self.request.tare)
        return payload_between(tare, loaded, self.forces, self.errors)

    def _poses_of(self, source: Source) -> list[PoseMean]:
        """Poses of the last load in another log."""
        log = CheckedLog(self.request, source)
        self._logs.append(log)
        rest = self._rest(log)
        means = loads(rest.blocks, self.limits)
        if len(means) > 1:
            raise IdentificationError(
                f"{source.source}: the load changes in the tare, at {means[1].begin - rest.begin:.2f} s"
            )
        within, poses = _Within(rest.blocks), _Poses(self.settings.poses)
        for m in self._measurements(log, f"weighing {source.name}"):
            if within.has(m.time):
                poses.add(m)
        return poses.means

    def _changes(self, means: Blocks, payload: Payload | None) -> tuple[LoadChange, ...]:
        """Changes of the load in this log. A single change since a tare in this log is the payload."""
        changes, tare = changes_between(means, self.errors), self.request.tare
        if not isinstance(tare, tuple):
            return changes
        before = tuple(c for c in changes if c.time <= tare[1])
        return (*before, *since_tare(changes[len(before) :], payload))

    # -- the centre of mass -----------------------------------------------------------------------------------
    def _estimates(self, rest: Rest, means: Blocks, gathered: Sequence[tuple[Blocks, _Poses]]) -> list[TrunkEstimate]:
        """The method's estimate at the end of each block. Also collects the poses of the given blocks."""
        found: list[TrunkEstimate] = []
        within = [(_Within(blocks), poses) for blocks, poses in gathered]
        starts = [mean.begin for mean in means[1:]]
        estimator: Estimator | None = None
        reference: Array | None = None
        for m in self._measurements(self.log, f"weighing {self.request.source.name}"):
            if estimator is None or (starts and m.time >= starts[0]):
                if estimator is None:
                    reference = m.rotation
                else:
                    starts.pop(0)
                estimator = make_estimator(self.request.method, self._setup(reference))
            estimator.update(m)
            for blocks, poses in within:
                if blocks.has(m.time):
                    poses.add(m)
            if len(found) < len(rest.blocks) and m.time >= rest.blocks[len(found)].end:
                found.append(estimator.estimate())
        return found

    def _setup(self, reference: Array | None) -> Setup:
        stiffness = self.request.stiffness
        if stiffness is None:
            return Setup(self.robot, forces=self.forces)
        if reference is None:
            raise IdentificationError(
                f"{self.request.source.source}: the method 'orientation' needs columns imu.orientation.x, ..."
            )
        return Setup(
            self.robot, forces=self.forces, posture=PostureLaw(np.array(stiffness), reference, feeds_back=False)
        )

    def _remark_on(self, final: TrunkEstimate) -> None:
        method = self.request.method
        if isnan(final.time):
            self._remarks.append(f"the method {method!r} found no centre of mass: {final.reason or 'no rest'}")
        elif final.status is Status.REFUSED:
            self._remarks.append(f"the centre of mass is the last good one: {final.reason}")
        elif final.status is not Status.CONVERGED:
            self._remarks.append(
                f"the method {method!r} had not settled by its own rule at the end of the log; a longer rest, or poses "
                "with the trunk tilted for methods that use poses, would tell more"
            )

    # -- the result -------------------------------------------------------------------------------------------
    def _trunk(self, mean: RestBlock, final: TrunkEstimate) -> TrunkParameters:
        """The mass by eq. 7 over the whole load, the centre of mass from the method, the inertia of the prior."""
        prior, hidden = self.robot.inertias[self.robot.trunk], np.isnan(final.std[1:])
        com = np.where(hidden, prior.com, final.trunk.com_trunk)
        covariance = np.zeros((4, 4))  # mass and centre of mass are estimated separately
        covariance[0, 0] = mean.std(self.errors) ** 2
        covariance[1:, 1:] = final.covariance[1:, 1:]
        return TrunkParameters(
            InertialParameters.from_com(mean.mass, com, prior.inertia_com),
            covariance,
            np.full(6, np.nan),
            np.array([True, *~hidden, *[False] * 6]),
        )

    def _trust(self, misfit: float, rest: Rest) -> Trust:
        trust = Trust("good", misfit)
        if self._widening(misfit) > 1.0:
            reason = f"the masses of blocks at rest scatter {misfit:.3g} times as much as stated (variance)"
            trust = trust.at_most("doubtful", f"{reason}; the error bars are widened by it")
        for log in self._logs:
            for verdict, reason in log.doubts:
                trust = trust.at_most(verdict, reason)
        if self._lies:
            trust = trust.at_most("doubtful", LIES)
        moved, last = self.log.end - rest.blocks[-1].end, rest.blocks[-1].end
        if moved > self.settings.stale:
            trust = trust.at_most(
                "doubtful",
                f"the robot stands still until {last - self.log.begin:.2f} s and not in the {moved:.1f} s after it; a "
                "change of the load from then on would not be seen",
            )
        return trust

    def _widening(self, misfit: float) -> float:
        """Factor on all error bars that accounts for the scatter of the blocks' masses."""
        return sqrt(misfit) if misfit > self.settings.doubtful_misfit else 1.0

    def _timeline(self, blocks: Blocks, estimates: list[TrunkEstimate]) -> Timeline:
        std = np.array([estimate.std[1:] for estimate in estimates])
        com = np.array([estimate.trunk.com_trunk for estimate in estimates])
        return Timeline(
            time=np.array([b.time for b in blocks]),
            mass=np.array([b.mass for b in blocks]),
            mass_std=np.array([b.std(self.errors) for b in blocks]),
            com=np.where(np.isnan(std), np.nan, com),
            com_std=std,
            load=np.array([b.load for b in blocks]),
        )

    def _balance(self, m: Measurement, final: TrunkEstimate, mass: float) -> Balance:
        forces, up = self.forces.at(m), m.up
        ahead = np.array([1.0, 0.0, 0.0]) - up[0] * up
        ahead /= np.linalg.norm(ahead)
        to_level = np.array([ahead, np.cross(up, ahead), up])
        load = np.where(forces.stance, np.nan_to_num(forces.force) @ up, 0.0)
        feet = forces.contact @ to_level.T
        seen = not isnan(final.time)
        legs = self.forces.legs
        com = (mass * final.trunk.com_trunk + legs.at(m).moment) / (mass + legs.mass)
        return Balance(
            to_level=to_level,
            feet=forces.contact,
            stance=forces.stance,
            force=load,
            pressure=load @ feet[:, :2] / load.sum(),
            robot_com=(to_level @ com)[:2] if seen else np.full(2, np.nan),
        )


def with_common_gain(found: Weighing, gain: float) -> Weighing:
    """With the error of a scale that all torques have in common, which no pose shows, added to the bars of masses."""
    trunk, payload = found.trunk, found.payload
    covariance = trunk.covariance.copy()
    covariance[0, 0] += (
        gain * (found.robot.mass - found.robot.inertias[found.robot.trunk].mass + trunk.inertial.mass)
    ) ** 2
    if payload is not None:
        alone = payload.mass_std
        payload = replace(payload, mass_std=float(np.hypot(alone, gain * payload.mass)), mass_std_without_scale=alone)
    changes = tuple(
        replace(c, mass_std=float(np.hypot(c.mass_std, gain * c.mass)), mass_std_without_scale=c.mass_std)
        for c in found.changes
    )
    trunk = replace(trunk, covariance=covariance, mass_std_without_scale=trunk.mass_std)
    return replace(found, trunk=trunk, payload=payload, changes=changes)


def vertical_at(pose: PoseMean, forces: ContactForceEstimator, errors: ConstantErrors) -> Vertical:
    """The vertical in a pose at rest, with the error due to constant errors and white noise."""
    m = pose.measurement
    if not m.vertical_by_forces:
        turned = skew(m.up)
        return Vertical("imu", m.up, _sizes(turned @ errors.covariance[24:27, 24:27] @ turned.T))
    found = forces.at(m)
    felt = weight_felt(found, forces.robot, m.joint_position, m.up)[1:]
    white = felt[:, :12] * (found.noise.torque_white.ravel() ** 2 / pose.count) @ felt[:, :12].T
    return Vertical("forces", m.up, _sizes(felt @ errors.covariance @ felt.T + white))


def _without_imu(vertical: Vertical) -> str:
    return (
        "no IMU: weighed while the joints stand still, with the direction of the feet's forces as the vertical, known "
        f"to ±{degrees(vertical.tilt_std):.2g}°, which is in the error bars; a steady push or pull and a floor that "
        "accelerates would be taken for weight, and neither inertia nor anything in motion is known"
    )


def _sizes(covariance: Array) -> Array:
    return np.sqrt(np.diag(covariance))
