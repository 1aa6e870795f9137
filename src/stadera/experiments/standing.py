"""One robot weighed while it stands: what Tables II to IV and Fig. 6 are made of.

A plant stands under the trunk controller, which begins with a centre of mass far off. First the mass is estimated
(eq. 7), then the centre of mass by one of the methods, whose estimate the controller takes over while it runs. Methods
that need several poses are led through them, and heard between one and the next; those that find the height in a phase
of its own get a trunk pitched by 10° for that. The plant's truth is read afterwards, and only to judge.

The start is CAD's trunk with its centre of mass shifted by shares of the hips' half spacing; the load presses down at
a point that is the paper's (-0.75, 0.4, 0.0) m on HyQ, and on other robots that point scaled with the hips' spacing.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from stadera.control import TestBed, TrunkController, TrunkPose
from stadera.estimate import ContactForceEstimator, Estimator, MassEstimator, Measurement, Status, TrunkModel
from stadera.estimate.contact_com import ContactCom
from stadera.estimate.orientation import OrientationCom, PostureLaw
from stadera.estimate.poses import PosesCom
from stadera.estimate.recursive import RecursiveCom
from stadera.estimate.registry import Setup, make_estimator
from stadera.estimate.static_poses import PoseOffset, static_poses
from stadera.robot import Robot, load_robot
from stadera.robot.stance import standing_configuration
from stadera.sim import IDEAL, Gaussian, Plant, SensorErrors, Sensors, Terrain, VirtualForce
from stadera.sim.sensors import plant_model

Array = NDArray[np.float64]

START = (0.3, -0.3, 0.3)
"""The start's error: shares of the hips' half spacing in x, of that in y, and again of that in x for z."""

_PAPER_ROBOT, _PAPER_POINT = "hyq", (-0.75, 0.4, 0.0)  # m, trunk frame
_SETTLE = 0.5  # s, before anything is estimated
_MASS, _MASS_AT_MOST = 1.0, 5.0  # s
_STEPPING, _STEPPING_UP = 6.0, 4.0  # s, of a recursive law in the plane and along the height: 12 and 8 time constants
_MOVE = 0.8  # s, from pose to pose
_TILT = np.deg2rad(10.0)  # of the reference, to find the height by the orientation error
_POSES = {"poses": 5, "combined": 11}
_TRACE_EVERY = 0.01  # s
_TRACE_POSES_EVERY = 0.2  # s, where every look solves for all poses anew


@dataclass(frozen=True)
class StandingCase:
    """What one run is made of.

    Attributes:
        robot: its name.
        method: of `stadera.estimate.registry.METHODS`.
        load: [N], pressing down at the paper's point; 0 for none.
        slope: of the ground, rising forwards [deg].
        errors: of the sensors.
        misled: the controller is given the sensors' foot positions as well; else it goes by the encoders.
        drive_offset: of every joint [N·m], drawn once a run: the drives follow a torque measured with this error, so
            that what acts is less by it. Zero for drives that give what is asked for.
        seed: of all draws.
        start: see `START`.
        every: the estimator looks at one measurement in so many.
        height: go on to look for the height with a tilted trunk, where the method has a phase of its own for it.
        hold: each static pose so long [s].
    """

    robot: str
    method: str
    load: float = 0.0
    slope: float = 0.0
    errors: SensorErrors = IDEAL
    misled: bool = False
    drive_offset: Gaussian = field(default_factory=Gaussian)
    seed: int = 0
    start: tuple[float, float, float] = START
    every: int = 5
    height: bool = True
    hold: float = 1.2


@dataclass(frozen=True, eq=False)
class StandingOutcome:
    """What one run found, and the truth it is judged by; trunk frame.

    Attributes:
        case: what was run.
        mass, true_mass: of trunk and load [kg].
        com, true_com, start: centres of mass: found, true, believed first, (3,) [m].
        std: (3,) [m], as the estimator states it; NaN where it observed nothing.
        one_pose_com: (3,) [m], what was found before the trunk was tilted for the height; `com` where it was not.
        rotation: (3, 3), of the trunk in the world when that was found.
        status, reason: of the estimate at the end.
        seconds: simulated [s].
        trace_time, trace_com: (k,) [s], (k, 3) [m], the estimate under way.
    """

    case: StandingCase
    mass: float
    true_mass: float
    com: Array
    true_com: Array
    start: Array
    std: Array
    one_pose_com: Array
    rotation: Array
    status: Status
    reason: str
    seconds: float
    trace_time: Array
    trace_com: Array

    @property
    def in_plane(self) -> float:
        """‖δ‖ [m] in the trunk's x-y plane."""
        return float(np.linalg.norm((self.com - self.true_com)[:2]))

    @property
    def in_plane_of_one_pose(self) -> float:
        """‖δ‖ [m] in the trunk's x-y plane, before the trunk was tilted for the height."""
        return float(np.linalg.norm((self.one_pose_com - self.true_com)[:2]))

    @property
    def level(self) -> float:
        """The same in the world's x-y plane, all that forces at rest in one pose can show [m]."""
        return float(np.linalg.norm((self.rotation @ (self.one_pose_com - self.true_com))[:2]))

    @property
    def height(self) -> float:
        """|δ_z| [m] in the trunk frame."""
        return float(abs(self.com[2] - self.true_com[2]))

    @property
    def start_error(self) -> float:
        """‖δ‖ [m] in x-y of what was believed first."""
        return float(np.linalg.norm((self.start - self.true_com)[:2]))

    @property
    def mass_error(self) -> float:
        """[kg], found minus true."""
        return self.mass - self.true_mass


def stand(case: StandingCase) -> StandingOutcome:
    """Runs one case.

    Raises:
        UnknownNameError: no such method or robot.
        MissingExtraError: the robot's model is not installed.
        SimulationError: the motion ran away.
    """
    run = _Run(case)
    run.weigh()
    run.locate()
    return run.outcome()


def load_point(robot: Robot) -> tuple[float, float, float]:
    """Where the load presses, trunk frame [m]."""
    scale = hip_spacing(robot) / hip_spacing(load_robot(_PAPER_ROBOT))
    x, y, z = np.asarray(_PAPER_POINT) * [*scale, 1.0]
    return float(x), float(y), float(z)


def hip_spacing(robot: Robot) -> Array:
    """Half the distance between the legs' first joints, along x and along y, (2,) [m]."""
    hips = np.array([robot.tree.translations[robot.tree.joints.index(leg.joints[0])] for leg in robot.legs])
    return np.asarray(0.5 * (hips.max(axis=0) - hips.min(axis=0))[:2])


def start_belief(robot: Robot, shares: tuple[float, float, float] = START) -> TrunkModel:
    """CAD's trunk, its centre of mass shifted."""
    prior, (x, y) = TrunkModel.prior(robot), hip_spacing(robot)
    return TrunkModel(prior.mass, prior.com_trunk + np.asarray(shares) * [x, y, x], prior.inertia_com)


@cache
def poses_of(robot: str, count: int) -> tuple[PoseOffset, ...]:
    """The first static poses of a named robot."""
    return static_poses(load_robot(robot), count=count)


class _ByEncoders(TrunkController):
    """A controller whose own kinematics are right, whatever others are told of the feet."""

    def update(self, measurement: Measurement) -> Array:
        if measurement.foot_position is not None:
            measurement = replace(measurement, foot_position=None)
        return super().update(measurement)


class _Run:
    """A case under way."""

    def __init__(self, case: StandingCase) -> None:
        self.case, self.robot = case, load_robot(case.robot)
        self.start = start_belief(self.robot, case.start)
        plant = Plant(_with_drive_offset(plant_model(self.robot, case.errors), case), Terrain(np.deg2rad(case.slope)))
        plant.reset(standing_configuration(self.robot))
        if case.load:
            plant.apply_payload(VirtualForce(case.load, load_point(self.robot)))
        kind = TrunkController if case.misled else _ByEncoders
        controller = self.controller = kind(self.robot, belief=self.start, jacobian="encoders")
        sensors = Sensors(case.errors, case.seed, self.robot)
        self.bed = TestBed(plant, sensors, controller, feed_back=True, every=case.every)
        self.forces = ContactForceEstimator(self.robot, legs=controller.legs)
        self.estimator: Estimator = MassEstimator(self.robot, self.start, self.forces)
        self._trace: list[tuple[float, Array]] = []
        self._next_trace = 0.0
        self._one_pose: tuple[Array, Array] | None = None

    def weigh(self) -> None:
        """Eq. 7: the mass, until it has converged."""
        self.bed.run(_SETTLE)
        self.home = self.controller.reference
        self._watched(self.estimator, _MASS)
        waited = _MASS
        while self.estimator.estimate().status is not Status.CONVERGED and waited < _MASS_AT_MOST:
            self._watched(self.estimator, 0.25)
            waited += 0.25
        self.weighed = self.estimator.estimate().trunk

    def locate(self) -> None:
        """The centre of mass."""
        self.estimator = self._made()
        estimator = self.estimator
        if self.case.method in _POSES:
            for pose in poses_of(self.case.robot, _POSES[self.case.method]):
                self._move(self.home.moved(pose.shift, pose.turn))
                self._hold(self.case.hold)
            return
        self._watched(estimator, _STEPPING)
        self._one_pose = estimator.estimate().trunk.com_trunk, self.bed.plant.state.rotation
        if not (self.case.height and isinstance(estimator, RecursiveCom)):
            return
        if estimator.estimate().status is Status.CONVERGED:
            tilted = self.home.moved(np.zeros(3), np.array([0.0, _TILT, 0.0]))
            self._move(tilted)
            if isinstance(estimator, OrientationCom):
                estimator.look_for_height(tilted.rotation)
            elif isinstance(estimator, ContactCom):
                estimator.look_for_height()
            self._watched(estimator, _STEPPING_UP)

    def outcome(self) -> StandingOutcome:
        """Held against the truth."""
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
        """Static poses want a trunk that stays where it is: the controller is told between them."""
        self.bed.feed_back = False
        self._watched(self.estimator, seconds)
        self.bed.feed_back = True
        found = self.estimator.estimate()
        if found.status in (Status.MOVING, Status.CONVERGED):
            self.controller.believe(found.trunk)

    def _note(self, bed: TestBed) -> None:
        time = bed.plant.time
        if time >= self._next_trace and bed.estimator is not None:
            self._next_trace = time + (_TRACE_POSES_EVERY if isinstance(bed.estimator, PosesCom) else _TRACE_EVERY)
            self._trace.append((time, bed.estimator.estimate().trunk.com_trunk))

    def _move(self, goal: TrunkPose) -> None:
        """Nobody estimates meanwhile."""
        self.controller.move(goal, _MOVE)
        self.bed.run(_MOVE)


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
