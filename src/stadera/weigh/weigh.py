"""A standing robot weighed from its log, in two passes of it, memory flat in its length.

The first finds the times at rest, the mass of each by eq. 7 and the changes of the load. The second runs the method for
the centre of mass as if online, begun anew after each change, and gathers the poses that the payload is told by.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import isnan
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from stadera.errors import IdentificationError
from stadera.estimate.equilibrium import ConstantErrors
from stadera.estimate.forces import ContactForceEstimator
from stadera.estimate.legs import MeasuredLegs
from stadera.estimate.measurement import Measurement, measurements_of
from stadera.estimate.orientation import PostureLaw
from stadera.estimate.pose_means import Alike, PoseMean
from stadera.estimate.protocol import Estimator, Status, TrunkEstimate
from stadera.estimate.registry import Setup, make_estimator
from stadera.estimate.vertical import measurements_without_imu
from stadera.recording import LogFile, stream
from stadera.robot.model import Robot
from stadera.weigh.changes import changes_between, levels, loads
from stadera.weigh.diagnosis import checked
from stadera.weigh.imu import has_imu, method_for, vertical_at, without_imu_note
from stadera.weigh.payload import PayloadEstimate, payload_between
from stadera.weigh.rest import Block, MeanMass, Rest, times_at_rest
from stadera.weigh.result import Balance, Timeline, Weighing
from stadera.weigh.settings import WeighSettings

Array = NDArray[np.float64]
Log = str | PathLike[str]
Progress = Callable[[str, int, int], None]

_MOST_POSES = 200  # kept of one load; more are let go, the oldest first
_TOLD_EVERY = 500  # samples


def weigh(robot: Robot, log: Log, settings: WeighSettings | None = None, progress: Progress | None = None) -> Weighing:
    """Weighs a standing robot.

    Args:
        robot: whose legs are believed in; its trunk is where the centre of mass is looked for from.
        log: of joint positions, velocities and torques, and of an IMU where there is one; a LogFile chooses among a
            bag's topics.
        settings: None for the defaults.
        progress: told how many samples are done.

    Raises:
        RecordingError: a log that cannot be read or lacks a joint, its velocity or torque, or the IMU that the
            method needs.
        IdentificationError: signs, orders or frames of the log are wrong, the robot never stands still, or not in the
            tare's time.
    """
    return _Weighing(robot, log, settings or WeighSettings(), progress).result()


@dataclass
class _Poses:
    """Poses held in the blocks of one load, as means."""

    alike: Alike = field(default_factory=Alike)
    means: list[PoseMean] = field(default_factory=list)

    def add(self, measurement: Measurement) -> None:
        if not (self.means and self.means[-1].takes(measurement, self.alike)):
            self.means.append(PoseMean(measurement))
            del self.means[:-_MOST_POSES]


class _Within:
    """Whether times, asked in order, lie in blocks at rest."""

    def __init__(self, blocks: Sequence[Block]) -> None:
        self._blocks, self._at = blocks, 0

    def has(self, time: float) -> bool:
        while self._at < len(self._blocks) and self._blocks[self._at].end < time:
            self._at += 1
        return self._at < len(self._blocks) and self._blocks[self._at].begin <= time


class _Weighing:
    """One weighing's working state."""

    def __init__(self, robot: Robot, log: Log, settings: WeighSettings, progress: Progress | None) -> None:
        self.robot, self.log, self.settings = robot, LogFile.of(log), settings
        self.forces = ContactForceEstimator(robot, legs=MeasuredLegs(robot))
        self.errors = ConstantErrors.of(self.forces.noise)
        self.method = method_for(self.log, robot, self.settings)
        self._progress = progress
        self._notes: dict[str, None] = {}

    def result(self) -> Weighing:
        rest = self._rest(self.log)
        means = loads(rest.blocks, self.robot.mass, self.errors)
        level = levels(rest.blocks, means)
        tare_poses, load_poses = _Poses(), _Poses()
        last = [b for b, n in zip(rest.blocks, level, strict=True) if n == level[-1]]
        tare, loaded = self._split(rest, means, last)
        estimates = self._estimates(rest, means, ((tare, tare_poses), (loaded, load_poses)))
        final = estimates[-1]
        self._judge(final)
        payload = self._payload(tare_poses.means, load_poses.means)
        covariance = final.covariance[1:, 1:]
        com = np.where(np.isnan(np.diag(covariance)), np.nan, final.trunk.com_trunk)
        changes = changes_between(means, self.errors)
        vertical = vertical_at(load_poses.means[-1], self.forces, self.errors)
        said = (without_imu_note(vertical),) if vertical.source == "forces" else ()
        return Weighing(
            robot=self.robot,
            source=str(self.log),
            method=self.method,
            status=str(final.status),
            mass=means[-1].mass,
            mass_std=means[-1].std(self.errors),
            com=com,
            covariance=covariance,
            payload=payload,
            changes=changes,
            timeline=self._timeline(rest.blocks, estimates, level),
            refusals=rest.refusals,
            begin=rest.begin,
            end=rest.end,
            balance=self._balance(load_poses.means[-1].measurement, final, means[-1].mass),
            vertical=vertical,
            notes=(*said, *self._notes),
        )

    # -- the log ----------------------------------------------------------------------------------------------
    def _measurements(self, log: LogFile, what: str) -> Iterator[Measurement]:
        joints, done = self.robot.tree.joints, 0
        for chunk in stream(log, joints=joints, require=("velocity", "effort")):
            self._notes |= dict.fromkeys((*chunk.notes, *checked(chunk, self.robot, self.settings.imu_frame)))
            if chunk.imu is None:
                if log is not self.log:
                    self._notes["no IMU in the tare's log: its vertical is by the direction of the feet's forces"] = (
                        None
                    )
                measurements = measurements_without_imu(chunk, self.robot)
            else:
                measurements = measurements_of(chunk, self.robot, self.settings.imu_frame)
            for m in measurements:
                done += 1
                if self._progress and done % _TOLD_EVERY == 0:
                    self._progress(what, done, 0)
                yield m

    def _rest(self, log: LogFile) -> Rest:
        rest = times_at_rest(self._measurements(log, f"looking for rest in {log.name}"), self.forces)
        if not rest.blocks:
            alone = "" if has_imu(log, self.robot) else "; the log has no IMU, without which only rest is weighed by"
            raise IdentificationError(
                f"{log}: the robot never stands still, nothing to weigh by: {rest.usual_reason}{alone}"
            )
        return rest

    # -- tare -------------------------------------------------------------------------------------------------
    def _split(self, rest: Rest, means: Sequence[MeanMass], last: list[Block]) -> tuple[list[Block], list[Block]]:
        """Blocks of the tare and of the load, of this log."""
        tare = self.settings.tare
        if not isinstance(tare, tuple):
            return [], last
        begin, end = tare
        within = [b for b in rest.blocks if begin <= b.begin and b.end <= end]
        if not within:
            raise IdentificationError(
                f"{self.log}: the robot does not stand still in the tare's time, {begin:g} to {end:g} s; the log goes "
                f"from {rest.begin:g} to {rest.end:g} s"
            )
        for mean in means[1:]:
            if within[0].begin < mean.begin <= within[-1].begin:
                raise IdentificationError(f"{self.log}: the load changes within the tare's time, at {mean.begin:.2f} s")
        after = [b for b in last if b.begin > end]
        if not after:
            raise IdentificationError(f"{self.log}: the robot does not stand still after the tare's time, {end:g} s")
        return within, after

    def _payload(self, tare: list[PoseMean], loaded: list[PoseMean]) -> PayloadEstimate | None:
        if self.settings.tare is None:
            return None
        if not isinstance(self.settings.tare, tuple):
            tare = self._poses_of(LogFile.of(self.settings.tare))
        return payload_between(tare, loaded, self.forces, self.errors)

    def _poses_of(self, log: LogFile) -> list[PoseMean]:
        """Poses of the last load of another log."""
        rest = self._rest(log)
        means = loads(rest.blocks, self.robot.mass, self.errors)
        level = levels(rest.blocks, means)
        if len(means) > 1:
            raise IdentificationError(f"{log}: the load changes in the tare, at {means[1].begin:.2f} s")
        within, poses = _Within([b for b, n in zip(rest.blocks, level, strict=True) if n == level[-1]]), _Poses()
        for m in self._measurements(log, f"weighing {log.name}"):
            if within.has(m.time):
                poses.add(m)
        return poses.means

    # -- the centre of mass -----------------------------------------------------------------------------------
    def _estimates(
        self, rest: Rest, means: Sequence[MeanMass], gathered: Sequence[tuple[list[Block], _Poses]]
    ) -> list[TrunkEstimate]:
        """What the method believes at the end of each block; and the poses of the given blocks."""
        found: list[TrunkEstimate] = []
        within = [(_Within(blocks), poses) for blocks, poses in gathered]
        starts = [mean.begin for mean in means[1:]]
        estimator: Estimator | None = None
        reference: Array | None = None
        for m in self._measurements(self.log, f"weighing {self.log.name}"):
            if estimator is None or (starts and m.time >= starts[0]):
                if estimator is None:
                    reference = m.rotation
                else:
                    starts.pop(0)
                estimator = make_estimator(self.method, self._setup(reference))
            estimator.update(m)
            for blocks, poses in within:
                if blocks.has(m.time):
                    poses.add(m)
            if len(found) < len(rest.blocks) and m.time >= rest.blocks[len(found)].end:
                found.append(estimator.estimate())
        return found

    def _setup(self, reference: Array | None) -> Setup:
        stiffness = self.settings.stiffness
        if self.method != "orientation" or stiffness is None:
            return Setup(self.robot, forces=self.forces)
        if reference is None:
            raise IdentificationError(f"{self.log}: the method 'orientation' needs columns imu.orientation.x, ...")
        return Setup(
            self.robot, forces=self.forces, posture=PostureLaw(np.array(stiffness), reference, feeds_back=False)
        )

    def _judge(self, final: TrunkEstimate) -> None:
        if isnan(final.time):
            self._notes[f"the method {self.method!r} found no centre of mass: {final.reason or 'no rest'}"] = None
        elif final.status is Status.REFUSED:
            self._notes[f"the centre of mass is the last good one: {final.reason}"] = None
        elif final.status is not Status.CONVERGED:
            self._notes[
                f"the method {self.method!r} had not settled by its own rule at the end of the log; a longer "
                "rest, or poses with the trunk tilted for those that live on poses, would tell more"
            ] = None

    # -- put together -----------------------------------------------------------------------------------------
    def _timeline(self, blocks: Sequence[Block], estimates: list[TrunkEstimate], level: NDArray[np.int64]) -> Timeline:
        std = np.array([estimate.std[1:] for estimate in estimates])
        com = np.array([estimate.trunk.com_trunk for estimate in estimates])
        return Timeline(
            time=np.array([b.time for b in blocks]),
            mass=np.array([b.mass for b in blocks]),
            mass_std=np.array([MeanMass.of(b).std(self.errors) for b in blocks]),
            com=np.where(np.isnan(std), np.nan, com),
            com_std=std,
            load=np.array([b.load for b in blocks]),
            level=level,
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
