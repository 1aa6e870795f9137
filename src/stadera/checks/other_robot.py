"""Whether a log is of another robot than the one it is weighed as.

Robots of one family have the same joints' names and nearly the same legs: a Go2's log weighed as an A1's balances well,
and gives a plausible payload. What differs is the whole robot's mass. Feet that slide less tell nothing: A1's own logs
fit a Go2's slightly longer legs as well as their own.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from stadera.checks.instants import Instants
from stadera.checks.limits import CheckLimits
from stadera.checks.residual import Footing
from stadera.errors import require_positive
from stadera.logs.recording import Recording
from stadera.robot.load import known_robots
from stadera.robot.model import Robot


@dataclass(frozen=True)
class Likeness:
    """How heavy a log's robot is on the legs of a robot known by name."""

    name: str
    mass: float  # of the model [kg]
    carried: float  # by the feet, at rest or on average over steps [kg]

    def __post_init__(self) -> None:
        require_positive("a robot's likeness", self, ["mass"])

    @property
    def ratio(self) -> float:
        """Of the mass carried to the model's [1]."""
        return self.carried / self.mass

    @property
    def alike(self) -> bool:
        """Whether the robot, perhaps with a load, is about as heavy."""
        limits = CheckLimits()
        return 1.0 - limits.bare < self.ratio < limits.loaded


def likeness(recording: Recording, robot: Robot) -> Likeness | None:
    """What the log's torques carry on a robot's legs; None if the log lacks some of its joints or torques."""
    if recording.effort is None or not set(robot.tree.joints) <= set(recording.joints) or len(recording) < 2:
        return None
    limits = CheckLimits()
    bare = Instants.of(replace(recording, imu=None), robot.tree.joints, None, limits)
    footing = Footing(robot, bare, limits)
    return Likeness(robot.name, robot.mass, float(footing.load.sum(axis=1).mean()) * robot.mass)


def carried_by_others(recording: Recording, robot: Robot) -> tuple[Likeness, ...]:
    """The other robots known by name that have the log's joints, and whose legs carry about their mass, nearest first.
    Raises nothing: a log without torques has none.
    """
    found = [likeness(recording, other) for other in _kin(robot)]
    return tuple(sorted((each for each in found if each and each.alike), key=lambda each: abs(each.ratio - 1.0)))


def other_robots(robot: Robot, mass: float, loaded: bool) -> tuple[str, ...]:
    """Robots known by name, with the same joints, whose own mass is nearer to this one [kg], perhaps with a load on it,
    nearest first, each with its mass; none if the robot's own is near.
    """
    limits, own = CheckLimits(), abs(mass / robot.mass - 1.0)
    if own < limits.bare:
        return ()
    most = limits.loaded - 1.0 if loaded else limits.bare
    found = [(mass / other.mass - 1.0, other.name, other.mass) for other in _kin(robot)]
    near = sorted((abs(x), name, other) for x, name, other in found if -limits.bare < x < most and abs(x) < own)
    return tuple(f"{name} ({other:.3g} kg)" for _, name, other in near)


def _kin(robot: Robot) -> Iterator[Robot]:
    """The other robots known by name that have the same joints."""
    own = set(robot.tree.joints)
    return (other for other in known_robots() if other.name != robot.name and set(other.tree.joints) == own)
