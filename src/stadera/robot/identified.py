"""A robot with the legs that `stadera identify` found, from its JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from stadera.errors import ModelError
from stadera.inertia import ORDER, InertialParameters
from stadera.robot.model import JointDynamics, Robot

_FRICTION = ("armature", "viscous", "coulomb")


def with_identified_legs(robot: Robot, path: str | PathLike[str]) -> Robot:
    """The robot with the links' inertias and the joints' rotor inertia and friction of an identification.

    Legs that were not identified stay the model's. A joint's torque offset is left out: it belongs to the day's
    sensors, and weighing has unknowns of its own for it. Negative friction or rotor inertia, which noise can leave,
    counts as none.

    Args:
        path: the JSON that `identify --json` wrote.

    Raises:
        ModelError: no such file, not such a JSON, a link that no body could be.
        UnknownNameError: a link or joint that this robot has not.
    """
    path = Path(path)
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
        links = {name: _link(entry) for name, entry in value["links"].items()}
        joints = {name: _known(entry) for name, entry in value["joints"].items()}
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ModelError(f"{path}: not the JSON of an identification (identify --json): {error!r}") from None
    for name, body in links.items():
        if not body.is_physical():
            raise ModelError(f"{path}: link {name!r} was identified as a body that cannot be")
    robot = robot.with_inertias(links)
    return robot.with_dynamics(
        {name: replace(robot.dynamics.get(name, JointDynamics()), **terms) for name, terms in joints.items()}
    )


def _link(entry: dict[str, Any]) -> InertialParameters:
    mass = _number(entry["mass"])
    moment = [mass * _number(component) for component in entry["com"]]
    tensor = [_number(entry["inertia"][name.removeprefix("I")]) for name in ORDER[4:]]
    return InertialParameters(np.array([mass, *moment, *tensor]))


def _known(entry: dict[str, Any]) -> dict[str, float]:
    return {term: max(_number(entry[term]), 0.0) for term in _FRICTION if term in entry}


def _number(entry: dict[str, Any]) -> float:
    value = float(entry["value"])
    if not isfinite(value):
        raise ValueError(f"{value} is no value")
    return value
