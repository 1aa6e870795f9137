"""Registry of the methods that estimate the trunk. A new method is one file and an entry here, or a user's own file:
`FILE.py:Name`, of a class that is made with the robot and follows `stadera.trunk.protocol.Estimator`.
"""

from __future__ import annotations

import importlib.util
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from stadera.errors import IdentificationError, UnknownNameError
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.model import TrunkModel
from stadera.trunk.posture import PostureLaw
from stadera.trunk.protocol import Estimator
from stadera.trunk.standing.forces import ContactForceEstimator
from stadera.trunk.standing.poses import COMBINED, PosesCom


@dataclass(frozen=True, eq=False)
class Setup:
    """Arguments for constructing an estimator.

    Attributes:
        robot: the model of the legs.
        start: initial estimate; None for the robot's own trunk.
        forces: estimator of contact forces; None for a new one.
        posture: control law that holds the trunk, for methods that need it; None if unknown.
        mount: of the IMU that supplies the values; None for the model's.
    """

    robot: Robot
    start: TrunkModel | None = None
    forces: ContactForceEstimator | None = None
    posture: PostureLaw | None = None
    mount: ImuMount | None = None


@dataclass(frozen=True)
class Method:
    """A method that estimates the centre of mass.

    Attributes:
        summary: one line on what it uses.
        make: constructs an estimator.
        needs_imu: False if it works with joints alone.
    """

    summary: str
    make: Callable[[Setup], Estimator]
    needs_imu: bool = True


def _orientation(setup: Setup) -> Estimator:
    if setup.posture is None:
        raise IdentificationError("the method 'orientation' needs the trunk controller's stiffness and reference")
    from stadera.lab.laws.orientation import OrientationCom

    return OrientationCom(setup.robot, setup.posture, setup.start, setup.forces)


def _contact(setup: Setup) -> Estimator:
    from stadera.lab.laws.contact_com import ContactCom

    return ContactCom(setup.robot, setup.start, setup.forces)


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "poses": Method(
            "least squares over static poses", lambda s: PosesCom(s.robot, s.start, s.forces), needs_imu=False
        ),
        "orientation": Method("steps by the trunk's orientation error under a known controller", _orientation),
        "contact": Method("steps by the contact forces' line of action", _contact),
        "combined": Method(
            "static poses, with torque offsets and feet as unknowns",
            lambda s: PosesCom(s.robot, s.start, s.forces, COMBINED),
            needs_imu=False,
        ),
        "walking": Method(
            "every instant, whatever the motion; torque offsets as unknowns",
            lambda s: TrunkEstimator(s.robot, start=s.start, mount=s.mount),
        ),
    }
)
"""The methods by name."""


def is_own(name: str) -> bool:
    """True for a method in a user's file, `FILE.py:Name`."""
    return name.rpartition(":")[0].endswith(".py")


def method_of(name: str) -> Method:
    """The method of a name in `METHODS`, or in a user's file.

    Raises:
        UnknownNameError: no such method, or no such class in the file.
        IdentificationError: the file cannot be read or imported, or the class is no estimator.
    """
    if not is_own(name):
        if name not in METHODS:
            raise UnknownNameError("method", name, [*METHODS, "FILE.py:Name"])
        return METHODS[name]
    file, _, called = name.rpartition(":")
    path = Path(file)
    if not path.is_file():
        raise IdentificationError(f"--method {name}: no such file {file!r}")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise IdentificationError(f"--method {name}: {file} cannot be imported: {error}") from error
    found = {key: value for key, value in vars(module).items() if inspect.isclass(value)}
    own = [key for key, value in found.items() if value.__module__ == module.__name__]
    if called not in found:
        raise UnknownNameError("estimator", called, own, file)
    made: Any = found[called]
    if missing := [part for part in ("update", "estimate") if not callable(getattr(made, part, None))]:
        raise IdentificationError(f"--method {name}: {called} has no {' and no '.join(missing)}; an estimator has both")
    summary = (inspect.getdoc(made) or "an own estimator").splitlines()[0]
    return Method(summary, lambda setup: made(setup.robot))


def make_estimator(name: str, setup: Setup, methods: Mapping[str, Method] = METHODS) -> Estimator:
    """Constructs an estimator of the named method.

    Args:
        name: key of `methods`.
        setup: its arguments.
        methods: the available methods.

    Raises:
        UnknownNameError: no such method.
        IdentificationError: the setup lacks what the method needs.
    """
    if name not in methods:
        raise UnknownNameError("method", name, methods)
    return methods[name].make(setup)
