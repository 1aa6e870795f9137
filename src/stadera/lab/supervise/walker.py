"""Interface of a walker, and the common base of both supervisors."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, runtime_checkable

from stadera.lab.laws.static_poses import PoseOffset
from stadera.robot.model import Robot
from stadera.trunk.model import TrunkModel
from stadera.trunk.posture import PostureLaw


@runtime_checkable
class Walker(Protocol):
    """A robot that walks, stops and stands on request, with its own controller and planner."""

    @property
    def phase(self) -> str:
        """Present activity, in a word or two."""

    @property
    def stopped(self) -> bool:
        """True if it stands on four feet and is not about to move."""

    @property
    def fault(self) -> str:
        """Reason why it cannot continue walking, one sentence; empty if it can."""

    def request_stop(self) -> None:
        """Stops as soon as it is safe, on four feet."""

    def resume(self) -> None:
        """Continues walking."""

    def sit(self) -> None:
        """Lowers the trunk and stays there; requires that the robot has stopped."""

    def update_trunk(self, trunk: TrunkModel) -> bool:
        """Passes a model of the trunk to controller and planner, both or neither; False for neither."""


@runtime_checkable
class PosingWalker(Walker, Protocol):
    """A walker that can also be weighed by approaches (a) and (b)."""

    def posture(self) -> PostureLaw:
        """The control law that holds the trunk while it stands."""

    def lean(self, pose: PoseOffset, duration: float) -> None:
        """Moves the standing robot's trunk to a pose, relative to that in which it stopped, within a duration [s]."""


class State(StrEnum):
    """State of the supervised robot. `STANDING` and `SITTING` (as soon as it stands on four feet) are for the given
    reason; `WEIGHING` is without a stop, see `NonstopSupervisor`.
    """

    WALKING = "walking"
    STOPPING = "stopping"
    WEIGHING_MASS = "weighing mass"
    WEIGHING_COM = "weighing centre of mass"
    CONVERGED = "converged"
    WEIGHING = "weighing on the way"
    STANDING = "standing"
    SITTING = "sitting"


@dataclass(frozen=True)
class Transition:
    """One change of state."""

    time: float  # [s]
    before: State
    after: State
    reason: str  # one sentence

    def to_dict(self) -> dict[str, float | str]:
        """Plain values for JSON."""
        return {"time": self.time, "from": str(self.before), "to": str(self.after), "reason": self.reason}


class Supervised:
    """A walker under supervision: its state, and the trunk used by its controller and planner."""

    def __init__(self, robot: Robot, walker: Walker, trunk: TrunkModel | None) -> None:
        self.robot, self.walker, self.state = robot, walker, State.WALKING
        self.trunk = trunk or TrunkModel.prior(robot)
        self._transitions: list[Transition] = []

    @property
    def transitions(self) -> tuple[Transition, ...]:
        """All changes of state, in order."""
        return tuple(self._transitions)

    def _become(self, time: float, state: State, reason: str) -> None:
        self._transitions.append(Transition(time, self.state, state, reason))
        self.state = state
