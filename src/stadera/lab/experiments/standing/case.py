"""Settings and outcome of one run of a standing robot.

The prior is CAD's trunk with its centre of mass shifted by shares of the hips' half spacing; the load presses down at a
point, the paper's (-0.75, 0.4, 0.0) m on HyQ, scaled with the hips' spacing on other robots.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from stadera.lab.plant import IDEAL, Gaussian, SensorErrors
from stadera.robot import Robot, load_robot
from stadera.trunk import Status, TrunkModel
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
    trace: float = 0.01  # between points of the trace
    trace_poses: float = 0.2  # the same if every evaluation solves for all poses again


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
    status: Status
    reason: str
    seconds: float  # simulated [s]
    trace_time: Array  # (k,) [s]
    trace_com: Array  # (k, 3) [m], the estimate over time

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
        """The same in the world's x-y plane, which is all that static forces in one pose determine [m]."""
        return float(np.linalg.norm((self.rotation @ (self.one_pose_com - self.true_com))[:2]))

    @property
    def height(self) -> float:
        """|δ_z| [m] in the trunk frame."""
        return float(abs(self.com[2] - self.true_com[2]))

    @property
    def start_error(self) -> float:
        """‖δ‖ [m] in x-y of the prior."""
        return float(np.linalg.norm((self.start - self.true_com)[:2]))

    @property
    def mass_error(self) -> float:
        """Estimated minus true mass [kg]."""
        return self.mass - self.true_mass


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
