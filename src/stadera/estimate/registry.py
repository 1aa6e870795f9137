"""The methods of finding the trunk's centre of mass, by name. A new one is a file of its own and an entry here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from stadera.errors import IdentificationError, UnknownNameError
from stadera.estimate.baseline_kalman import KalmanTrunk
from stadera.estimate.baseline_rls import RlsTrunk
from stadera.estimate.combined import CombinedCom
from stadera.estimate.contact_com import ContactCom
from stadera.estimate.forces import ContactForceEstimator
from stadera.estimate.orientation import OrientationCom, PostureLaw
from stadera.estimate.poses import PosesCom
from stadera.estimate.protocol import Estimator
from stadera.estimate.trunk import TrunkModel
from stadera.estimate.walking import WalkingEstimator
from stadera.robot.model import Robot


@dataclass(frozen=True, eq=False)
class Setup:
    """What a method may be made from.

    Attributes:
        robot: whose legs are believed in.
        start: what is believed first; None for the robot's own trunk.
        forces: source of contact forces; None for one of the method's own.
        posture: what holds the trunk, for methods that need to know; None where nobody says.
    """

    robot: Robot
    start: TrunkModel | None = None
    forces: ContactForceEstimator | None = None
    posture: PostureLaw | None = None


@dataclass(frozen=True)
class Method:
    """A way to find the centre of mass.

    Attributes:
        summary: what it lives on, one line.
        make: an estimator of this kind.
        needs_imu: it does not weigh by joints alone.
    """

    summary: str
    make: Callable[[Setup], Estimator]
    needs_imu: bool = True


def _orientation(setup: Setup) -> Estimator:
    if setup.posture is None:
        raise IdentificationError("the method 'orientation' needs the trunk controller's stiffness and reference")
    return OrientationCom(setup.robot, setup.posture, setup.start, setup.forces)


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "poses": Method(
            "least squares over static poses", lambda s: PosesCom(s.robot, s.start, s.forces), needs_imu=False
        ),
        "orientation": Method("steps by the trunk's orientation error under a known controller", _orientation),
        "contact": Method(
            "steps by the contact forces' line of action", lambda s: ContactCom(s.robot, s.start, s.forces)
        ),
        "combined": Method(
            "static poses, with torque offsets and feet as unknowns",
            lambda s: CombinedCom(s.robot, s.start, s.forces),
            needs_imu=False,
        ),
        "walking": Method(
            "every instant, whatever the motion; torque offsets as unknowns",
            lambda s: WalkingEstimator(s.robot, start=s.start),
        ),
        "rls": Method(
            "baseline: recursive least squares with constant forgetting", lambda s: RlsTrunk(s.robot, s.start)
        ),
        "kalman": Method("baseline: a Kalman filter on m, m cx, m cy", lambda s: KalmanTrunk(s.robot, s.start)),
    }
)
"""By name."""


def make_estimator(name: str, setup: Setup) -> Estimator:
    """An estimator of the named method.

    Raises:
        UnknownNameError: no such method.
        IdentificationError: the setup lacks what the method needs.
    """
    if name not in METHODS:
        raise UnknownNameError("method", name, METHODS)
    return METHODS[name].make(setup)
