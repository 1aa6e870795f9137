"""A robot weighed while it stands: the runs of Tables II to IV and Fig. 6.

The plant stands under the trunk controller, whose initial centre of mass is far off. First the mass is estimated (eq.
7), then the centre of mass by one of the methods, whose estimate the controller uses meanwhile. Methods that need
several poses are led through them, and the controller is updated between poses; for methods with a separate phase for
the height the trunk is then pitched by 10°. The plant's truth is used for evaluation only.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from stadera.lab.control import TestBed, TrunkController, TrunkPose
from stadera.lab.experiments.standing.case import StandingCase, StandingOutcome, load_point, start_model
from stadera.lab.laws.contact_com import ContactCom
from stadera.lab.laws.mass import MassEstimator
from stadera.lab.laws.orientation import OrientationCom
from stadera.lab.laws.recursive import RecursiveCom
from stadera.lab.laws.static_poses import PoseOffset, static_poses
from stadera.lab.plant import Plant, Sensors, Terrain, VirtualForce
from stadera.lab.sensors import plant_model
from stadera.robot import Robot, load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import ContactForceEstimator, Estimator, Measurement, Status
from stadera.trunk.posture import PostureLaw
from stadera.trunk.registry import Setup, make_estimator
from stadera.trunk.standing.poses import PosesCom
from stadera.types import Array

_POSES = {"poses": 5, "combined": 11}


def stand(case: StandingCase) -> StandingOutcome:
    run = _StandingRun(case)
    run.weigh()
    run.locate()
    return run.outcome()


@cache
def poses_of(robot: str, count: int) -> tuple[PoseOffset, ...]:
    """The first static poses of a named robot."""
    return static_poses(load_robot(robot), count=count)


class _ByEncoders(TrunkController):
    """A controller with exact kinematics, whatever foot positions the estimators get."""

    def update(self, measurement: Measurement) -> Array:
        if measurement.foot_position is not None:
            measurement = replace(measurement, foot_position=None)
        return super().update(measurement)


class _StandingRun:
    """A run in progress."""

    def __init__(self, case: StandingCase) -> None:
        self.case, self.times, self.robot = case, case.times, load_robot(case.robot)
        self.start = start_model(self.robot, case.start)
        plant = Plant(_with_drive_offset(plant_model(self.robot, case.errors), case), Terrain(np.deg2rad(case.slope)))
        plant.reset(standing_configuration(self.robot))
        if case.load:
            plant.apply_payload(VirtualForce(case.load, load_point(self.robot)))
        kind = TrunkController if case.misled else _ByEncoders
        controller = self.controller = kind(self.robot, trunk=self.start, jacobian="encoders")
        sensors = Sensors(case.errors, case.seed, self.robot)
        self.bed = TestBed(plant, sensors, controller, feed_back=True, every=case.every)
        self.forces = ContactForceEstimator(self.robot, legs=controller.legs)
        self.estimator: Estimator = MassEstimator(self.robot, self.start, self.forces)
        self._trace: list[tuple[float, Array]] = []
        self._next_trace = 0.0
        self._one_pose: tuple[Array, Array] | None = None

    def weigh(self) -> None:
        """Estimates the mass by eq. 7, until it has converged."""
        self.bed.run(self.times.settle)
        self.home = self.controller.reference
        self._watched(self.estimator, self.times.mass)
        waited = self.times.mass
        while self.estimator.estimate().status is not Status.CONVERGED and waited < self.times.mass_at_most:
            self._watched(self.estimator, 0.25)
            waited += 0.25
        self.weighed = self.estimator.estimate().trunk

    def locate(self) -> None:
        self.estimator = self._made()
        estimator = self.estimator
        if self.case.method in _POSES:
            for pose in poses_of(self.case.robot, _POSES[self.case.method]):
                self._move(self.home.moved(pose.shift, pose.turn))
                self._hold(self.times.hold)
            return
        self._watched(estimator, self.times.plane)
        self._one_pose = estimator.estimate().trunk.com_trunk, self.bed.plant.state.rotation
        if not (self.case.height and isinstance(estimator, RecursiveCom)):
            return
        if estimator.estimate().status is Status.CONVERGED:
            tilted = self.home.moved(np.zeros(3), np.array([0.0, self.case.tilt, 0.0]))
            self._move(tilted)
            if isinstance(estimator, OrientationCom):
                estimator.look_for_height(tilted.rotation)
            elif isinstance(estimator, ContactCom):
                estimator.look_for_height()
            self._watched(estimator, self.times.height)

    def outcome(self) -> StandingOutcome:
        found, plant = self.estimator.estimate(), self.bed.plant
        truth = plant.truth()
        one_pose_com, rotation = self._one_pose or (found.trunk.com_trunk, plant.state.rotation)
        return StandingOutcome(
            case=self.case,
            mass=found.trunk.mass,
            true_mass=truth.mass,
            com=found.trunk.com_trunk,
            true_com=truth.com,
            start=self.start.com_trunk,
            std=np.sqrt(np.diag(found.covariance)[1:]),
            one_pose_com=one_pose_com,
            rotation=rotation,
            status=found.status,
            reason=found.reason,
            seconds=plant.time,
            trace_time=np.array([time for time, _ in self._trace]),
            trace_com=np.array([com for _, com in self._trace]),
        )

    def _made(self) -> Estimator:
        posture = PostureLaw(self.controller.gains.angular_stiffness, self.home.rotation)
        return make_estimator(self.case.method, Setup(self.robot, self.weighed, self.forces, posture))

    def _watched(self, estimator: Estimator, seconds: float) -> None:
        self.bed.estimator = estimator
        self.bed.run(seconds, self._note)
        self.bed.estimator = None

    def _hold(self, seconds: float) -> None:
        """Holds a pose. Static poses need a trunk at rest, so the controller gets the estimate between poses only."""
        self.bed.feed_back = False
        self._watched(self.estimator, seconds)
        self.bed.feed_back = True
        found = self.estimator.estimate()
        if found.status in (Status.MOVING, Status.CONVERGED):
            self.controller.update_trunk(found.trunk)

    def _note(self, bed: TestBed) -> None:
        time = bed.plant.time
        if time >= self._next_trace and bed.estimator is not None:
            self._next_trace = time + (
                self.times.trace_poses if isinstance(bed.estimator, PosesCom) else self.times.trace
            )
            self._trace.append((time, bed.estimator.estimate().trunk.com_trunk))

    def _move(self, goal: TrunkPose) -> None:
        """Moves the trunk without the estimator."""
        self.controller.move(goal, self.times.move)
        self.bed.run(self.times.move)


def _with_drive_offset(robot: Robot, case: StandingCase) -> Robot:
    if case.drive_offset.is_zero:
        return robot
    offset, rng = case.drive_offset, np.random.default_rng(np.random.SeedSequence((case.seed, 1)))
    drawn = rng.normal(offset.mean, offset.std, len(robot.tree.joints))
    dynamics = {
        joint: replace(robot.dynamics[joint], offset=robot.dynamics[joint].offset + float(value))
        for joint, value in zip(robot.tree.joints, drawn, strict=True)
    }
    return replace(robot, dynamics=dynamics)
