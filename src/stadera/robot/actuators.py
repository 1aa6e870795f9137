"""Writes a robot's drives as YAML for the actuators of Isaac Lab and mjlab, with ranges for domain randomisation.

Both simulators take joints by name. Names of classes and fields are those of Isaac Lab 2.3 to 3.0
(`isaaclab.actuators`) and mjlab 1.6 (`mjlab.actuator`). Isaac Lab's `friction` and `dynamic_friction` are torques from
Isaac Sim 5 on. Delays are numbers of physics steps there, so they are given in seconds beside. The gains of the
controller are not in a log of torques: `stiffness` and `damping` are for the reader to fill in.
"""

from collections.abc import Sequence
from math import isfinite
from pathlib import Path

import stadera
from stadera.files import filled
from stadera.robot.model import Robot

_UNITS = {"armature": "kg·m²", "viscous": "N·m·s/rad", "coulomb": "N·m"}
_ISAAC = {"armature": "armature", "friction": "coulomb", "dynamic_friction": "coulomb", "viscous_friction": "viscous"}
_MJLAB = {"armature": "armature", "frictionloss": "coulomb", "viscous_damping": "viscous"}


def actuators_yaml(robot: Robot, torque_lag: float | None = None, source: str = "", notes: Sequence[str] = ()) -> str:
    """The text of the file: drives by simulator, and ranges of what was determined, of a robot with identified joint
    dynamics and their standard deviations (`Robot.dynamics_std`). `torque_lag` is the torques' delay [s], None if
    unknown; `source` the log they come from; `notes` are more comments at the top, a line each.
    """
    joints = robot.tree.joints
    known = {joint: _known(robot, joint) for joint in joints}
    unknown = {joint: [term for term in _UNITS if term not in known[joint]] for joint in joints}
    drives = {term: {joint: getattr(robot.dynamics[joint], term) for joint in joints} for term in _UNITS}
    ranges = {
        term: {
            joint: (max(value - 2.0 * known[joint][term], 0.0), value + 2.0 * known[joint][term])
            for joint, value in values.items()
            if term in known[joint]
        }
        for term, values in drives.items()
    }
    return filled(
        Path(__file__).with_name("templates") / "actuators.yaml.j2",
        robot=robot,
        source=source,
        version=stadera.__version__,
        unknown={joint: terms for joint, terms in unknown.items() if terms},
        notes=notes,
        limits={joint: most for joint in joints if isfinite(most := robot.limits[joint].effort)},
        lag=torque_lag,
        isaac=_ISAAC,
        mjlab=_MJLAB,
        drives=drives,
        units=_UNITS,
        ranges=ranges,
    )


def _known(robot: Robot, joint: str) -> dict[str, float]:
    """Standard deviations of a joint's terms that were determined."""
    std = robot.dynamics_std.get(joint)
    return {} if std is None else {t: v for t in _UNITS if isfinite(v := getattr(std, t))}
