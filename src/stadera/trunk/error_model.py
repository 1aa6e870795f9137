"""Model and sensor errors that affect the rows: their names, indices and prior covariance.

The rows are Aθ + C p = b with p = 0 if the robot equals its model. For sensors p is the reading minus the true value,
for the robot the true value minus the model's. Most of p is estimated from legs in the air (`stadera.trunk.swing`) and
from loaded ones (`stadera.trunk.joint_errors`); of the rest only the covariance is used (Schmidt's consider
parameters).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from stadera.constants import GRAVITY
from stadera.robot.limbs import Limbs
from stadera.robot.model import JointDynamics, Robot
from stadera.robot.shapes import FLAT
from stadera.trunk.settings import ModelErrors
from stadera.types import Array, Bools

QUIETEST = 0.15
"""Square of the rows' residual, in their unit (1 % of the weight), below which it does not make an estimate sharper.

Robots that are as their models leave 0.01 to 0.2 with half to three times the usual noise, drawn robots 0.12 to 1.6.
With 0.25 bars of robots that are as their models are up to a fifth wider; with 0.06 what errors leave of an exact log
counts for more than it is: a stand's trunk is 0.1 % off.
"""

_POSITIVE = 2.0 / np.pi
"""Correlation about zero of positive values that are the halves of independent normal distributions, E|x| E|y| / E x².
It is used where friction is known worst, in legs on flat feet. In those of quadrupeds, which steps show, it moves no
payload (36 simulated logs), and masses of a real Mini Cheetah's walks spread by 3.1 % in place of 2.7.
"""


@dataclass(frozen=True)
class ErrorLayout:
    """Places of the errors in p, of a robot whose legs have some joints, by leg and outwards, some links, in the order
    of its tree, some contacts, and some joints in other limbs.

    `link_com` goes by axis and link, `contact` by leg and trunk axis. `stiction` is the torque of static friction,
    `unfelt` a moment or force of a foot that its leg's joints do not tell (`stadera.robot.sole`), `sampling` half the
    difference between rows of every other sample, `standstill` the mean friction of a joint at standstill that slides
    at other times.

    Friction of legs on flat feet, `flat`, is known worst: their gears may be planetary or harmonic
    (`ModelErrors.gears`).
    """

    joints: int
    links: int
    contacts: int
    legs: tuple[int, ...]  # joints of each leg
    limbs: int = 0
    unfelt: tuple[int, ...] = ()  # legs with a moment or force that their joints do not tell
    flat: bool = False  # some feet are

    @classmethod
    def of(cls, robot: Robot) -> ErrorLayout:
        """Of a robot."""
        legs = tuple(len(leg.joints) for leg in robot.legs)
        few = tuple(k for k, leg in enumerate(robot.legs) if any(leg.unfelt))
        flat = any(leg.contact == FLAT for leg in robot.legs)
        return cls(sum(legs), len(robot.tree.joints), len(legs), legs, len(Limbs.of(robot).joints), few, flat)

    @cached_property
    def places(self) -> Mapping[str, slice]:
        """Index ranges of the errors in p, by name."""
        joints, links, sizes = self.joints, self.links, {}
        for name in ("rotor", "viscous", "coulomb", "load_friction"):
            sizes[name] = joints
        sizes |= {"torque_lag": 1, "offset": joints, "gain": joints}
        sizes |= {"encoder": joints, "contact": 3 * self.contacts}
        sizes |= {"link_mass": links, "link_com": 3 * links}
        for name in ("rotor", "viscous", "coulomb", "offset", "mass"):
            sizes[f"limb_{name}"] = self.limbs
        sizes |= {"limb_com": 3 * self.limbs, "imu_lever": 3, "imu_rotation": 3, "accelerometer": 3}
        sizes |= {"imu_response": 3, "standstill": joints, "velocity_lag": 1}
        sizes |= {"stiction": joints, "unfelt": len(self.unfelt)}
        sizes |= {"limb_stiction": self.limbs}
        sizes |= {"limb_gain": self.limbs, "common_gain": 1, "sampling": 1}
        ends = np.cumsum(list(sizes.values())).tolist()
        return MappingProxyType(
            {name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)}
        )

    def at(self, *names: str) -> NDArray[np.int64]:
        """Indices of the errors of these names in p."""
        return np.concatenate([np.arange(self.count)[self.places[name]] for name in names])

    @cached_property
    def count(self) -> int:
        """Number of errors."""
        return int(self.places["sampling"].stop)

    @cached_property
    def by_swing(self) -> slice:
        """Errors that legs in the air determine: those of the joints up to offsets."""
        return slice(0, self.places["offset"].stop)

    @cached_property
    def learnt(self) -> slice:
        """Errors that are estimated together with the trunk (`stadera.trunk.joint_errors`). Of all others the mean is
        zero.
        """
        return slice(0, self.places["velocity_lag"].stop)

    @property
    def _of_loads(self) -> tuple[str, ...]:
        """Errors that may change with the load: static friction, and moments of flat feet that no joint tells.

        On flat feet also the friction of joints that stop in each stance or slide so slowly that their direction is
        unknown. As one value under both loads it makes payloads of four simulated G1s that step up to 5.9 standard
        deviations wrong, as `ModelErrors.renewed` has it 1.9. Quadrupeds' payloads are within their bars without it.
        """
        return ("stiction", *(("standstill",) if self.flat else ()), "unfelt", "limb_stiction")

    @property
    def changing(self) -> tuple[slice, ...]:
        """Errors that may change with the load, see `_of_loads`."""
        return tuple(self.places[name] for name in self._of_loads)

    @cached_property
    def changing_at(self) -> NDArray[np.int64]:
        """Their indices in p."""
        return self.at(*self._of_loads)

    @property
    def sticking(self) -> slice:
        """Static friction. Before any row, these errors and those in `by_swing` alone are correlated with others."""
        return self.places["stiction"]


_AS_STATED = (
    "torque_lag",
    "gain",
    "load_friction",
    "encoder",
    "contact",
    "link_mass",
    "link_com",
    "imu_lever",
    "imu_rotation",
    "imu_response",
    "velocity_lag",
    "common_gain",
)
"""Errors whose standard deviations are those of `ModelErrors`, in the same unit."""


def _identified(robot: Robot, sizes: ModelErrors, limit: Array) -> dict[str, Array]:
    """Standard deviations (joints,) of the terms of identified joints, by error: those of the identification, and what
    changes from log to log, in squares. NaN where there are none.
    """
    joints, none = [joint for leg in robot.legs for joint in leg.joints], JointDynamics(*[np.nan] * 4)
    values, stds = (
        np.array([(d.armature, d.viscous, d.coulomb, d.offset) for d in found]).T
        for found in ([robot.dynamics[j] for j in joints], [robot.dynamics_std.get(j, none) for j in joints])
    )
    friction = sizes.friction_drift
    drift = (sizes.rotor_drift * values[0], friction * values[1], friction * values[2], sizes.offset_drift * limit)
    names = ("rotor", "viscous", "coulomb", "offset")
    return {name: np.hypot(std, change) for name, std, change in zip(names, stds, drift, strict=True)}


class ErrorModel:
    """Prior covariance of one robot's model errors.

    Args:
        robot: provides effort limits and sizes.
        sizes: standard deviations.

    Attributes:
        layout: places of the errors.
        limit: (joints,) `Robot.effort_limits` by leg and joint [N·m].
        dry: (joints,) Coulomb friction that the robot's model has [N·m]; the errors are beyond it, static friction is
            not. resting: (joints,) [N·m], what bounds static friction before any row.
        drift: (joints,), standard deviation of the torques' offsets under one load from their mean of all [N·m].
        covariance: (count, count). variance: (count,), its diagonal.
        held, renewed, friction_law: as in `ModelErrors`.
    """

    def __init__(self, robot: Robot, sizes: ModelErrors) -> None:
        self.layout, self.held, self.renewed = ErrorLayout.of(robot), sizes.held, sizes.renewed
        self.friction_law = sizes.friction_law
        joints = [joint for leg in robot.legs for joint in leg.joints]
        self.limit = robot.effort_limits[[robot.tree.joints.index(joint) for joint in joints]]
        self.drift = sizes.drift / np.sqrt(2.0) * self.limit
        self.dry = np.abs([robot.dynamics[joint].coulomb for joint in joints])
        leg_mass = sum(robot.inertias[link].mass for leg in robot.legs for link in leg.links) / len(robot.legs)
        rotor, limb = sizes.rotor * leg_mass * robot.leg_length**2, limb_limits(robot)
        legs = _of_drives(sizes, self.limit, np.full(len(joints), rotor), sizes.gears if self.layout.flat else 1.0)
        for name, term in {"rotor": "armature", "viscous": "viscous", "coulomb": "coulomb"}.items():
            stated = np.abs([getattr(robot.dynamics[joint], term) for joint in joints])
            legs[name] = np.maximum(legs[name], sizes.stated * stated)
        known = _identified(robot, sizes, self.limit)
        for name, own in known.items():  # NaN for a joint or term that was not identified
            legs[name] = np.fmin(legs[name], np.maximum(own, sizes.surest * legs[name]))
        limbs = _of_drives(sizes, limb, rotor * limb / self.limit.mean(), sizes.limbs)  # rotors as large as strong
        self.resting = np.hypot(self.dry, np.minimum(legs["coulomb"], sizes.coulomb * self.limit))
        std: dict[str, Array | float] = {**legs, **{f"limb_{name}": own for name, own in limbs.items()}}
        std |= {name: getattr(sizes, name) for name in _AS_STATED}
        std["accelerometer"] = np.array([sizes.accelerometer, sizes.accelerometer, sizes.accelerometer_vertical])
        std |= dict.fromkeys(("stiction", "standstill"), sizes.held * self.resting)
        std |= {"unfelt": robot.unfelt_std[list(self.layout.unfelt)], "sampling": 1.0}
        # an arm that is held trembles with the robot: friction of its joints is anywhere between its bounds
        std |= {"limb_stiction": sizes.held * limbs["coulomb"] / np.sqrt(3.0), "limb_gain": sizes.gain}
        std |= {"limb_mass": sizes.link_mass, "limb_com": sizes.link_com}
        deviation = np.zeros(self.layout.count)
        for name, place in self.layout.places.items():
            deviation[place] = std[name]
        alike = dict.fromkeys(("rotor", "viscous", "coulomb"), sizes.alike)
        alike |= {"load_friction": sizes.alike_loaded, "stiction": sizes.sagging}
        found = {name: np.isfinite(own) for name, own in known.items()}
        found["stiction"] = found["coulomb"]
        found["load_friction"] = np.zeros(len(joints), dtype=bool)  # no model file has it
        correlation = _correlation(self.layout, alike, found, _POSITIVE if self.layout.flat else 0.0)
        self.covariance: Array = correlation * np.outer(deviation, deviation)
        self.variance = np.diag(self.covariance).copy()

    def scaled(self, scale: Array) -> tuple[Array, Array]:
        """Covariance of static friction (joints, joints) and variances (count,), with all standard deviations
        multiplied by `scale` (count,).
        """
        place = self.layout.sticking
        return self.covariance[place, place] * np.outer(scale[place], scale[place]), self.variance * scale**2


def _of_drives(sizes: ModelErrors, limit: Array, rotor: Array, friction: float) -> dict[str, Array]:
    """Standard deviations (joints,) of the terms of joints that nobody identified, by error.

    Args:
        limit: (joints,), effort limits [N·m]. rotor: (joints,) [kg·m²]. friction: factor on theirs [1].
    """
    own = {"viscous": friction * sizes.viscous * limit, "coulomb": friction * sizes.coulomb * limit}
    return {"rotor": rotor, **own, "offset": sizes.offset * limit}


def limb_limits(robot: Robot) -> Array:
    """Effort limits of the limbs' joints [N·m]; where the model has none, the torque that carries a tenth of the
    robot's weight on a lever as long as a leg.
    """
    extra, largest = robot.extra, 0.1 * GRAVITY * robot.mass * robot.leg_length
    given = np.array([extra.effort[k] for k in Limbs.of(robot).joints]) if extra is not None else np.zeros(0)
    return np.where(np.isfinite(given), given, largest)


def _correlation(layout: ErrorLayout, alike: Mapping[str, float], known: Mapping[str, Bools], positive: float) -> Array:
    """Correlation matrix (count, count) of errors that are alike, by name, in joints of one kind: the n-th ones of legs
    with as many joints. Coulomb friction of any two joints has `positive` at least.

    Errors of identified joints, `known` (joints,) by name, are changes since the identification; those of other joints
    are differences from the model file, which these tell nothing about.
    """
    correlation = np.eye(layout.count)
    kind = np.array([(size, k) for size in layout.legs for k in range(size)])
    same = (kind[:, None] == kind).all(axis=-1)
    for name, shared in alike.items():
        both = same & (known[name][:, None] == known[name])
        place = layout.places[name]
        correlation[place, place] = np.where(both, shared, 0.0) + (1.0 - shared) * np.eye(layout.joints)
    place, unknown = layout.places["coulomb"], ~known["coulomb"]
    correlation[place, place] = np.maximum(correlation[place, place], positive * np.outer(unknown, unknown))
    return correlation
