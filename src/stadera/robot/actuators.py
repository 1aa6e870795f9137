"""Writes a robot's drives as YAML for the actuators of Isaac Lab and mjlab, with ranges for domain randomisation.

Both simulators take joints by name. Names of classes and fields are those of Isaac Lab 2.3 to 3.0
(`isaaclab.actuators`) and mjlab 1.6 (`mjlab.actuator`). Isaac Lab's `friction` and `dynamic_friction` are torques from
Isaac Sim 5 on. Delays are numbers of physics steps there, so they are given in seconds beside. The gains of the
controller are not in a log of torques: `stiffness` and `damping` are for the reader to fill in.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isfinite

import stadera
from stadera.robot.model import JointDynamics, Robot

_UNITS = {"armature": "kg·m²", "viscous": "N·m·s/rad", "coulomb": "N·m"}
_ISAAC = {"armature": "armature", "friction": "coulomb", "dynamic_friction": "coulomb", "viscous_friction": "viscous"}
_MJLAB = {"armature": "armature", "frictionloss": "coulomb"}


def actuators_yaml(robot: Robot, torque_lag: float | None = None, source: str = "", notes: Sequence[str] = ()) -> str:
    """The text of the file: drives by simulator, and ranges of what was determined.

    Args:
        robot: with identified joint dynamics and their standard deviations (`Robot.dynamics_std`).
        torque_lag: delay of the torques [s]; None if unknown.
        source: the log they come from.
        notes: more comments at the top, a line each.
    """
    joints = robot.tree.joints
    known = {joint: _known(robot, joint) for joint in joints}
    unknown = [f"{joint}: {', '.join(t for t in _UNITS if t not in known[joint])}" for joint in joints]
    kept = [line for line in unknown if not line.endswith(": ")]
    lines = [
        f"# Drives of {robot.name}{f', identified from {source}' if source else ''}, stadera {stadera.__version__}.",
        "# SI units, at the joint's side of the gear. Torque offsets are of the log's sensors and are left out.",
    ]
    if kept:
        lines += ["# Not determined by the log, the model's value:", *(f"#   {line}" for line in kept)]
    lines += [f"# {note}" for note in notes]
    delay = "" if torque_lag is None else f"  # torques acted {1e3 * torque_lag:.1f} ms after their stamps"
    named = f"[{', '.join(joints)}]"
    lines += ["", "isaac_lab:", "  class: isaaclab.actuators.DelayedPDActuatorCfg", f"  joint_names_expr: {named}"]
    lines += ["  stiffness: null  # of your controller", "  damping: null"]
    lines += _table("effort_limit", _finite((j, robot.limits[j].effort) for j in joints))
    for field, term in _ISAAC.items():
        lines += _table(field, {joint: getattr(robot.dynamics[joint], term) for joint in joints})
    lines += [f"  min_delay: 0{delay}", f"  max_delay: null  # {'delay' if delay else 'unknown delay'} / physics step"]
    lines += ["", "mjlab:", "  class: mjlab.actuator.IdealPdActuatorCfg"]
    lines += [f"  target_names_expr: {named}", "  stiffness: null", "  damping: null"]
    lines += _table("effort_limit", _finite((j, robot.limits[j].effort) for j in joints))
    for field, term in _MJLAB.items():
        lines += _table(field, {joint: getattr(robot.dynamics[joint], term) for joint in joints})
    lines += _table("joint_damping", {joint: robot.dynamics[joint].viscous for joint in joints})
    lines += ["", "randomisation:  # value ± 2 standard deviations, not below zero"]
    lines += _ranges(robot.dynamics, known)
    return "\n".join(lines) + "\n"


def _known(robot: Robot, joint: str) -> dict[str, float]:
    """Standard deviations of a joint's terms that were determined."""
    std = robot.dynamics_std.get(joint)
    return {} if std is None else {t: v for t in _UNITS if isfinite(v := getattr(std, t))}


def _finite(values: Iterable[tuple[str, float]]) -> dict[str, float]:
    return {name: value for name, value in values if isfinite(value)}


def _table(name: str, values: Mapping[str, float]) -> Iterator[str]:
    yield f"  {name}:" if values else f"  {name}: null"
    yield from (f"    {key}: {value:.6g}" for key, value in values.items())


def _ranges(dynamics: Mapping[str, JointDynamics], known: Mapping[str, Mapping[str, float]]) -> Iterator[str]:
    for term, unit in _UNITS.items():
        yield f"  {term}:  # {unit}"
        for joint, stds in known.items():
            if term in stds:
                value, off = getattr(dynamics[joint], term), 2.0 * stds[term]
                yield f"    {joint}: [{max(value - off, 0.0):.6g}, {value + off:.6g}]"
