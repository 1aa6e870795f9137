"""A robot weighed while it stands: the runs of Tables II to IV.

The plant stands under the trunk controller, whose initial centre of mass is that of CAD's trunk shifted by shares of
the hips' half spacing; the load presses down at a point, the paper's (-0.75, 0.4, 0.0) m on HyQ, scaled with the hips'
spacing on other robots. First the mass is estimated (eq. 7), then the centre of mass by one of the methods, whose
estimate the controller uses meanwhile. Methods that need several poses are led through them, and the controller is
updated between poses; for methods with a separate phase for the height the trunk is then pitched by 10°. The plant's
truth is used for evaluation only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from stadera.lab.control.reference import TrunkPose
from stadera.lab.control.stand import TestBed
from stadera.lab.control.trunk import TrunkController
from stadera.lab.laws.equilibrium import NoisyForces
from stadera.lab.laws.orientation import PostureLaw
from stadera.lab.laws.recursive import RecursiveCom
from stadera.lab.laws.static import MassEstimator
from stadera.lab.laws.static_poses import PoseOffset, static_poses
from stadera.lab.plant.payload import VirtualForce
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import IDEAL, Gaussian, SensorErrors, Sensors, plant_model
from stadera.lab.plant.terrain import Terrain
from stadera.robot import Robot, load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import Estimator, Measurement, Status, TrunkModel
from stadera.trunk.registry import Setup, make_estimator
from stadera.types import Array

METHOD_NAMES: Mapping[str, str] = {
    "poses": "(a) static poses",
    "orientation": "(b) orientation error",
    "contact": "(c) contact forces",
    "combined": "combined",
}
"""The paper's names of the methods, by the registry's names."""

_PAPER_ROBOT, _PAPER_POINT = "hyq", (-0.75, 0.4, 0.0)  # m, trunk frame


@dataclass(frozen=True)
class StandingTimes:
    """Times of a run [s]."""

    settle: float = 0.5  # before anything is estimated
    mass: float = 1.0  # for the mass to converge
    mass_at_most: float = 5.0  # at most
    plane: float = 6.0  # for a recursive law in the plane: 12 of its time constants
    height: float = 4.0  # along the height: 8 of them
    move: float = 0.8  # to move between static poses
    hold: float = 1.2  # to hold each


@dataclass(frozen=True)
class StandingCase:
    """Settings of one run."""

    robot: str
    method: str  # of `stadera.trunk.registry.METHODS`
    load: float = 0.0  # [N], pressing down at the paper's point; 0 for none
    slope: float = 0.0  # of the ground, rising forwards [deg]
    errors: SensorErrors = IDEAL  # of the sensors
    misled: bool = False  # the controller also gets the sensors' foot positions; else it uses the encoders
    # of every joint [N·m], drawn once a run: the drives regulate a torque measured with this error, so that the actual
    # torque is lower by it. Zero for exact drives.
    drive_offset: Gaussian = field(default_factory=Gaussian)
    seed: int = 0  # of all draws
    # the prior's error: shares of the hips' half spacing in x, of that in y, and of that in x for z
    start: tuple[float, float, float] = (0.3, -0.3, 0.3)
    every: int = 5  # periods between two measurements for the estimator
    # whether to continue with a tilted trunk for the height, if the method has a separate phase for it
    height: bool = True
    tilt: float = float(np.deg2rad(10.0))  # of the trunk, for the height [rad]
    times: StandingTimes = field(default_factory=StandingTimes)


@dataclass(frozen=True, eq=False)
class StandingOutcome:
    """Outcome of one run, and the truth; trunk frame."""

    case: StandingCase
    mass: float  # of trunk and load [kg]
    true_mass: float  # [kg]
    com: Array  # (3,) [m], estimated centre of mass
    true_com: Array  # (3,) [m], the true one
    start: Array  # (3,) [m], the prior's
    std: Array  # (3,) [m], stated by the estimator; NaN where not observed
    one_pose_com: Array  # (3,) [m], estimate before the trunk was tilted for the height; `com` if it was not
    rotation: Array  # (3, 3), of the trunk in the world at that time
    seconds: float  # simulated [s]

    @property
    def in_plane(self) -> float:
        """‖δ‖ [m] in the trunk's x-y plane."""
        return _plane(self.com - self.true_com)

    @property
    def in_plane_of_one_pose(self) -> float:
        """‖δ‖ [m] in the trunk's x-y plane, before the trunk was tilted for the height."""
        return _plane(self.one_pose_com - self.true_com)

    @property
    def level(self) -> float:
        """The same in the world's x-y plane, which is all that static forces in one pose determine [m]."""
        return _plane(self.rotation @ (self.one_pose_com - self.true_com))

    @property
    def height(self) -> float:
        """|δ_z| [m] in the trunk frame."""
        return float(abs(self.com[2] - self.true_com[2]))

    @property
    def start_error(self) -> float:
        """‖δ‖ [m] in x-y of the prior."""
        return _plane(self.start - self.true_com)

    @property
    def mass_error(self) -> float:
        """Estimated minus true mass [kg]."""
        return self.mass - self.true_mass


def _plane(error: Array) -> float:
    return float(np.linalg.norm(error[:2]))


def start_range(outcomes: Sequence[StandingOutcome]) -> str:
    """Range of the priors' errors in x-y, in words."""
    errors = [100 * o.start_error for o in outcomes]
    return f"the centre of mass {min(errors):.0f} to {max(errors):.0f} cm off in x-y"


def load_point(robot: Robot) -> tuple[float, float, float]:
    """Point of application of the load, trunk frame [m]."""
    scale = hip_spacing(robot) / hip_spacing(load_robot(_PAPER_ROBOT))
    x, y, z = np.asarray(_PAPER_POINT) * [*scale, 1.0]
    return float(x), float(y), float(z)


def hip_spacing(robot: Robot) -> Array:
    """Half the distance between the legs' first joints, along x and along y, (2,) [m]."""
    return np.asarray(0.5 * np.ptp(robot.hips, axis=0)[:2])


def start_model(robot: Robot, shares: tuple[float, float, float]) -> TrunkModel:
    """CAD's trunk, its centre of mass shifted by shares of the hips' half spacing, see `StandingCase.start`."""
    prior, (x, y) = TrunkModel.prior(robot), hip_spacing(robot)
    return TrunkModel(prior.mass, prior.com_trunk + np.asarray(shares) * [x, y, x], prior.inertia_com)


_POSES = {"poses": 5, "combined": 11}


def stand(case: StandingCase) -> StandingOutcome:
    """Weighs the robot, then finds its centre of mass."""
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
    def __init__(self, case: StandingCase) -> None:
        self.case, self.times, self.robot = case, case.times, load_robot(case.robot)
        self.start = start_model(self.robot, case.start)
        plant = Plant(_with_drive_offset(plant_model(self.robot, case.errors), case), Terrain(np.deg2rad(case.slope)))
        plant.reset(standing_configuration(self.robot))
        if case.load:
            plant.apply_payload(VirtualForce(case.load, load_point(self.robot)))
        kind = TrunkController if case.misled else _ByEncoders
        controller = self.controller = kind(self.robot, trunk=self.start, by_encoders=True)
        sensors = Sensors(case.errors, case.seed, self.robot)
        self.bed = TestBed(plant, sensors, controller, feed_back=True, every=case.every)
        self.forces = NoisyForces(self.robot)
        self.estimator: Estimator = MassEstimator(self.robot, self.start, self.forces)
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
        posture = PostureLaw(self.controller.gains.angular_stiffness, self.home.rotation)
        setup = Setup(self.robot, self.weighed, self.forces, posture)
        estimator = self.estimator = make_estimator(self.case.method, setup)
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
            estimator.look_for_height(tilted.rotation)
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
            seconds=plant.time,
        )

    def _watched(self, estimator: Estimator, seconds: float) -> None:
        self.bed.estimator = estimator
        self.bed.run(seconds)
        self.bed.estimator = None

    def _hold(self, seconds: float) -> None:
        """Holds a pose. Static poses need a trunk at rest, so the controller gets the estimate between poses only."""
        self.bed.feed_back = False
        self._watched(self.estimator, seconds)
        self.bed.feed_back = True
        found = self.estimator.estimate()
        if found.status in (Status.MOVING, Status.CONVERGED):
            self.controller.update_trunk(found.trunk)

    def _move(self, goal: TrunkPose) -> None:
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
    return robot.with_dynamics(dynamics)
