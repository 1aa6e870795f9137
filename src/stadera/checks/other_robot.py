"""Whether a log is of another robot than the one it is weighed as.

Robots of one family have the same joints' names and nearly the same legs: a Go2's log weighed as an A1's balances well,
and gives a plausible payload. What differs is the whole robot's mass. Feet that slide less tell nothing: A1's own logs
fit a Go2's slightly longer legs as well as their own.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from stadera.checks.footing import Footing
from stadera.checks.instants import Instants
from stadera.checks.limits import CheckLimits
from stadera.constants import GRAVITY
from stadera.errors import StaderaError, require_positive
from stadera.logs.recording import Recording
from stadera.robot import CATALOG, load_robot
from stadera.robot.model import Robot

SAME = 0.2
"""Share of the model's mass by which a bare robot may differ from it: batteries, cameras, a model of another version,
torques with an error in common."""
HEAVIEST = 1.6
"""Mass of a loaded robot in its own: quadrupeds are built for loads of a third to a half of their mass."""


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
        return 1.0 - SAME < self.ratio < HEAVIEST


def likeness(recording: Recording, robot: Robot) -> Likeness | None:
    """What the log's torques carry on a robot's legs; None if the log lacks some of its joints or torques."""
    if recording.effort is None or not set(robot.tree.joints) <= set(recording.joints) or len(recording) < 2:
        return None
    footing = Footing(robot, Instants.of(recording, robot.tree.joints, None, CheckLimits()))
    carried = (footing.forces.sum(axis=1) * footing.up.T).sum(axis=0).mean() / GRAVITY
    return Likeness(robot.name, robot.mass, float(carried))


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
    own, most = abs(mass / robot.mass - 1.0), HEAVIEST - 1.0 if loaded else SAME
    if own < SAME:
        return ()
    found = sorted((mass / other.mass - 1.0, other.name, other.mass) for other in _kin(robot))
    near = sorted((abs(off), name, other) for off, name, other in found if -SAME < off < most and abs(off) < own)
    return tuple(f"{name} ({other:.3g} kg)" for _, name, other in near)


def _kin(robot: Robot) -> Iterator[Robot]:
    """The other robots known by name that have the same joints."""
    for name in CATALOG:
        try:
            other = load_robot(name)
        except StaderaError:  # not installed
            continue
        if other.name != robot.name and set(other.tree.joints) == set(robot.tree.joints):
            yield other
