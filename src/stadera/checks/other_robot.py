"""Whether a log is of another robot than the one it is weighed as.

Robots of one family have the same joints' names and nearly the same legs: a Go2's log weighed as an A1's balances well,
and gives a plausible payload. What differs is the whole robot's mass. Feet that slide less tell nothing: A1's own logs
fit a Go2's slightly longer legs as well as their own.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from stadera.checks.finding import Finding
from stadera.checks.instants import Instants
from stadera.checks.limits import CheckLimits
from stadera.checks.residual import Footing
from stadera.logs.mend import GEARED
from stadera.logs.recording import Recording
from stadera.robot.load import known_robots
from stadera.robot.model import Robot


def carried(recording: Recording, robot: Robot) -> float | None:
    """What the log's torques carry on a robot's legs, at rest or on average over steps [kg]; None if the log lacks some
    of its joints or torques.
    """
    if recording.effort is None or not set(robot.tree.joints) <= set(recording.joints) or len(recording) < 2:
        return None
    limits = CheckLimits()
    bare = Instants.of(replace(recording, imu=None), robot.tree.joints, None, limits)
    return float(Footing(robot, bare, limits).load.sum(axis=1).mean()) * robot.mass


def carriers(recording: Recording, robots: Iterable[Robot]) -> tuple[tuple[Robot, float], ...]:
    """Those of these robots that are, perhaps with a load, about as heavy as what the log's torques carry on their legs
    [kg], nearest first.
    """
    limits, found = CheckLimits(), ((robot, carried(recording, robot)) for robot in robots)
    alike = [(one, kg) for one, kg in found if kg and 1.0 - limits.bare < kg / one.mass < limits.loaded]
    return tuple(sorted(alike, key=lambda entry: abs(entry[1] / entry[0].mass - 1.0)))


def other_robots(robot: Robot, mass: float, loaded: bool) -> tuple[str, ...]:
    """Robots known by name, with the same joints, whose own mass is nearer to this one [kg], perhaps with a load on it,
    nearest first, each with its mass; none if the robot's own is near.
    """
    limits, own = CheckLimits(), abs(mass / robot.mass - 1.0)
    if own < limits.bare:
        return ()
    most = limits.loaded - 1.0 if loaded else limits.bare
    found = [(mass / other.mass - 1.0, other.name, other.mass) for other in kin(robot)]
    near = sorted((abs(x), name, other) for x, name, other in found if -limits.bare < x < most and abs(x) < own)
    return tuple(f"{name} ({other:.3g} kg)" for _, name, other in near)


def kin(robot: Robot) -> Iterator[Robot]:
    """The other robots known by name that have the same joints."""
    own = set(robot.tree.joints)
    return (other for other in known_robots() if other.name != robot.name and set(other.tree.joints) == own)


def or_other_robot(finding: Finding, recording: Recording, robot: Robot) -> Finding:
    """The finding; torques in another unit may be another robot's, whose log is not scaled, or of a wrong gear."""
    if finding.cause == "torque_unit" and any(note.startswith(GEARED) for note in recording.notes):
        return replace(finding, message=f"{finding.message}; leave --gear out, or give another ratio", option="")
    others = carriers(recording, kin(robot)) if finding.cause == "torque_unit" else ()
    if not others:
        return finding
    names = " or ".join(f"{one.name} ({one.mass:.3g} kg, its legs carry {kg:.3g})" for one, kg in others[:2])
    text = f"the robot is another one, perhaps {names}; or {finding.message}"
    return Finding(finding.cause, text, f"--robot {others[0][0].name}, or {finding.option or '--gear RATIO'}")
