"""What a supervisor needs of a walker, and what both supervisors have in common."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, runtime_checkable

from stadera.robot.model import Robot
from stadera.trunk.model import TrunkModel
from stadera.trunk.standing.orientation import PostureLaw
from stadera.trunk.standing.static_poses import PoseOffset


@runtime_checkable
class Walker(Protocol):
    """A robot that walks, stops and stands on request, under a controller and a planner of its own."""

    @property
    def phase(self) -> str:
        """What it is doing, in a word or two."""
        ...

    @property
    def stopped(self) -> bool:
        """Whether it stands on four feet and is not about to move."""
        ...

    @property
    def fault(self) -> str:
        """Why it cannot walk on, one sentence; empty while it can."""
        ...

    def request_stop(self) -> None:
        """Stop as soon as it is safe, on four feet."""
        ...

    def resume(self) -> None:
        """Walk on."""
        ...

    def sit(self) -> None:
        """Lower the trunk, and stay there; asked of a robot that has stopped."""
        ...

    def update_trunk(self, trunk: TrunkModel) -> bool:
        """Give a model of the trunk to controller and planner, both or neither; False for neither."""
        ...


@runtime_checkable
class PosingWalker(Walker, Protocol):
    """A walker that can be weighed by approaches (a) and (b) as well."""

    def posture(self) -> PostureLaw:
        """What holds the trunk while it stands."""
        ...

    def lean(self, pose: PoseOffset, duration: float) -> None:
        """While it stands: bring the trunk to a pose, relative to how it came to stand, within a duration [s]."""
        ...


class State(StrEnum):
    """What the supervised robot is doing.

    `STANDING`: it stays where it is, for the reason given; `SITTING`: it is set down as soon as it stands on four feet.
    `WEIGHING` is without a stop, see `NonstopSupervisor`.
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
    """One change of state.

    Attributes:
        time: [s].
        before, after: the states.
        reason: one sentence.
    """

    time: float
    before: State
    after: State
    reason: str

    def to_dict(self) -> dict[str, float | str]:
        """Plain values, for JSON."""
        return {"time": self.time, "from": str(self.before), "to": str(self.after), "reason": self.reason}


class Supervised:
    """A walker under supervision: its state, and the trunk that its controller and planner use.

    Args:
        robot: the model that estimators use.
        walker: taken to walk.
        trunk: that controller and planner use at first; None for the robot's own.

    Attributes:
        state: what the robot is doing.
        trunk: that controller and planner use.
    """

    def __init__(self, robot: Robot, walker: Walker, trunk: TrunkModel | None) -> None:
        self.robot, self.walker, self.state = robot, walker, State.WALKING
        self.trunk = trunk or TrunkModel.prior(robot)
        self._transitions: list[Transition] = []

    @property
    def transitions(self) -> tuple[Transition, ...]:
        """Every change of state, in order."""
        return tuple(self._transitions)

    def _become(self, time: float, state: State, reason: str) -> None:
        self._transitions.append(Transition(time, self.state, state, reason))
        self.state = state
