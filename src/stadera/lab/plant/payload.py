"""What acts on a trunk: loads, and external forces such as a person who pushes or lifts, a rope, a wall.

There are three kinds of loads: a force in place of a weight, a fixed mass, and a box dropped on the back. Each provides
its contribution to the trunk's ten parameters, in the trunk frame: the ground truth of weighing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.constants import GRAVITY
from stadera.inertia import InertialParameters
from stadera.robot.model import Robot
from stadera.types import Array


@dataclass(frozen=True)
class VirtualForce:
    """The paper's virtual load (section V.A): a downward force in the world, at a point fixed to the trunk.

    It has weight but no inertia: its contribution is the equivalent point mass at rest, whose tensor has no effect.
    """

    force: float  # [N], downwards
    position: tuple[float, float, float]  # [m], in the trunk frame

    @property
    def parameters(self) -> InertialParameters:
        """Mass and first moment of the static equivalent, in the trunk frame; the tensor is zero."""
        mass = self.force / GRAVITY
        return InertialParameters.from_moments(mass, mass * np.asarray(self.position), np.zeros((3, 3)))


@dataclass(frozen=True, eq=False)
class RigidMass:
    """A body fixed to the trunk, or to another link."""

    parameters: InertialParameters  # its ten parameters in the link's frame
    link: str | None = None  # None for the trunk

    @classmethod
    def box(
        cls,
        mass: float,
        size: tuple[float, float, float],
        position: tuple[float, float, float],
        link: str | None = None,
    ) -> RigidMass:
        """A homogeneous box: mass [kg], full edges [m] along the link's axes, centre in the link's frame [m]."""
        return cls(InertialParameters.from_com(mass, position, box_inertia(mass, size)), link)


@dataclass(frozen=True)
class DroppedBox:
    """A homogeneous box dropped on the trunk's tray, held by friction only; it can slide and fall off."""

    mass: float  # [kg]
    size: tuple[float, float, float] = (0.2, 0.2, 0.1)  # full edge lengths [m]
    position: tuple[float, float] = (0.0, 0.0)  # (x, y) of its centre in the trunk frame [m]
    height: float = 0.02  # [m] of its underside above the tray when it is released
    friction: float = 0.8  # Coulomb friction coefficient of the box, on the tray and on the ground

    @property
    def parameters(self) -> InertialParameters:
        """Its ten parameters in its own frame, at its centre."""
        return InertialParameters.from_com(self.mass, np.zeros(3), box_inertia(self.mass, self.size))


Payload = VirtualForce | RigidMass | DroppedBox


@dataclass(frozen=True, eq=False)
class Tray:
    """The flat top of the trunk: a box that spans the hips, its upper face level with the trunk's largest box shape."""

    centre: Array  # (3,) [m], in the trunk frame
    half_size: Array  # (3,) [m]

    @property
    def top(self) -> float:
        """Height of the upper face in the trunk frame [m]."""
        return float(self.centre[2] + self.half_size[2])

    @classmethod
    def of(cls, robot: Robot, thickness: float = 0.02) -> Tray:
        """The tray of a robot, `thickness` [m]; without a box shape of its trunk its face is at the hips' height."""
        low, high = robot.hips.min(axis=0), robot.hips.max(axis=0)
        boxes = [shape for shape in robot.shapes if shape.link == robot.trunk and shape.kind == "box"]
        top = float(high[2])
        if boxes:
            largest = max(boxes, key=lambda shape: float(np.prod(shape.size)))
            top = float(largest.translation[2] + 0.5 * np.abs(largest.rotation[2]) @ np.asarray(largest.size))
        half = np.array([*np.maximum(0.5 * (high - low)[:2], thickness), 0.5 * thickness])
        return cls(np.array([*(0.5 * (high + low)[:2]), top - 0.5 * thickness]), half)


def box_inertia(mass: float, size: tuple[float, float, float]) -> Array:
    """Inertia of a homogeneous box about its centre, edges along the axes [kg·m²], (3, 3)."""
    x, y, z = (edge**2 for edge in size)
    return np.diag([y + z, x + z, x + y]) * mass / 12.0


@dataclass(frozen=True)
class OutsideForce:
    """An external force on the trunk."""

    size: float  # F [N], not negative
    direction: tuple[float, float, float]  # n, world axes; any nonzero length
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)  # point of application [m], trunk frame
    begin: float = 0.0  # [s]
    end: float = float("inf")  # [s]
    stiffness: float = 0.0  # k [N/m], not negative
    ramp: float = 0.1  # time to rise and to fall [s]

    def force(self, time: float, moved: Array) -> Array:
        """Force (3,) [N] at a time [s], its point having moved by p - p_0 (3,) [m]; world axes."""
        share = max(0.0, min((time - self.begin) / self.ramp, (self.end - time) / self.ramp, 1.0))
        n = np.asarray(self.direction) / np.linalg.norm(self.direction)
        return np.asarray(n * share * max(0.0, self.size - self.stiffness * float(n @ moved)))
