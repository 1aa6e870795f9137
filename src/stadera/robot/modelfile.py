"""Output of the model readers: one file as a Pinocchio model, with the data that Pinocchio does not keep."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stadera.errors import ModelError
from stadera.robot.model import Shape
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class ModelFile:
    """A model file that has been read but not yet interpreted as a quadruped."""

    path: Path
    name: str
    model: Any  # `pinocchio.Model`; its joint 1 is the trunk's free-flyer, and every link of the file has a BODY frame
    trunk: str  # name of the trunk link
    links: Mapping[str, str]  # name of the link that each joint moves, by joint name
    masses: Mapping[str, float]  # mass of every single link of the file [kg], before any merging
    shapes: tuple[Shape, ...]  # primitive shapes, each on a link of the file and in that link's frame

    def __post_init__(self) -> None:
        for link, mass in self.masses.items():
            if mass < 0 or not np.isfinite(mass):
                raise ModelError(f"{self.path}: link {link!r} has mass {mass:g} kg; a mass is not negative")


def joint_axis(joint: Any) -> Array | None:
    """Unit axis (3,) of a Pinocchio revolute joint model in its own frame; None for any other kind of joint."""
    return _axis(joint, slice(3, 6))


def moving_axis(joint: Any) -> Array | None:
    """The same of a revolute or prismatic joint model."""
    about = joint_axis(joint)
    return _axis(joint, slice(0, 3)) if about is None else about


def _axis(joint: Any, part: slice) -> Array | None:
    """Unit vector of a part of the joint's motion, linear above angular; None if it has none."""
    if joint.nv != 1:
        return None
    data = joint.createData()
    zero_angle = np.array([0.0]) if joint.nq == 1 else np.array([1.0, 0.0])  # an unbounded joint has (cos, sin)
    joint.calc(data, zero_angle)
    axis = np.asarray(data.S).reshape(6)[part]
    length = float(np.linalg.norm(axis))
    return axis / length if length > 0.5 else None
