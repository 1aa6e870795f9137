"""Registry of the methods that estimate the trunk.

A new method is one file and an entry here; or a user's class that is made with the robot and follows
`stadera.trunk.protocol.Estimator`, named as `FILE.py:Name` or by an entry point of the group "stadera.estimators".
"""

from __future__ import annotations

import importlib.util
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from stadera.errors import IdentificationError, UnknownNameError
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.model import TrunkModel
from stadera.trunk.protocol import OwnEstimator, Weigher, own_failure
from stadera.trunk.settings import TrunkSettings
from stadera.trunk.standing.estimator import StandingEstimator

if TYPE_CHECKING:
    from stadera.lab.laws.equilibrium import NoisyForces
    from stadera.lab.laws.orientation import PostureLaw

GROUP = "stadera.estimators"
"""Group of the entry points of installed packages that are methods, too."""


@dataclass(frozen=True, eq=False)
class Setup:
    """Arguments for constructing an estimator.

    Attributes:
        robot: the model of the legs.
        start: initial estimate; None for the robot's own trunk.
        forces: estimator of contact forces, for the laboratory's laws; None for a new one.
        posture: control law that holds the trunk, for methods that need it; None if unknown.
        mount: of the IMU that supplies the values; None for the model's.
        settings: of the estimator for any motion; None for the defaults.
        at: link or frame on which the load is, for the estimator for any motion; None to find where it is.
    """

    robot: Robot
    start: TrunkModel | None = None
    forces: NoisyForces | None = None
    posture: PostureLaw | None = None
    mount: ImuMount | None = None
    settings: TrunkSettings | None = None
    at: str | None = None


@dataclass(frozen=True)
class Method:
    """A method that estimates the trunk.

    Attributes:
        summary: one line on what it uses.
        make: constructs an estimator.
        needs_imu: False if it works with joints alone.
        at_rest: True if it learns from a robot that stands still, and nothing in motion.
    """

    summary: str
    make: Callable[[Setup], Weigher]
    needs_imu: bool = True
    at_rest: bool = False


def _orientation(setup: Setup) -> Weigher:
    if setup.posture is None:
        raise IdentificationError("the method 'orientation' needs the trunk controller's stiffness and reference")
    from stadera.lab.laws.orientation import OrientationCom

    return OrientationCom(setup.robot, setup.posture, setup.start, setup.forces)


def _law(module: str, name: str, settings: str = "") -> Callable[[Setup], Weigher]:
    """Constructs one of the laboratory's laws, perhaps with settings, which are imported when first asked for."""

    def make(setup: Setup) -> Weigher:
        laws = import_module(f"stadera.lab.laws.{module}")
        more = [getattr(laws, settings)] if settings else []
        law: Weigher = getattr(laws, name)(setup.robot, setup.start, setup.forces, *more)
        return law

    return make


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "poses": Method("least squares over static poses", _law("poses", "PosesCom"), needs_imu=False, at_rest=True),
        "orientation": Method(
            "steps by the trunk's orientation error under a known controller", _orientation, at_rest=True
        ),
        "contact": Method("steps by the contact forces' line of action", _law("recursive", "ContactCom"), at_rest=True),
        "combined": Method(
            "static poses, with torque offsets and feet as unknowns",
            _law("poses", "PosesCom", "COMBINED"),
            needs_imu=False,
            at_rest=True,
        ),
        "standing": Method(
            "as walking, of the times at rest; with or without an IMU",
            lambda s: StandingEstimator(s.robot, s.start, s.settings, s.mount),
            needs_imu=False,
            at_rest=True,
        ),
        "walking": Method(
            "every instant, whatever the motion; torque offsets as unknowns",
            lambda s: TrunkEstimator(s.robot, start=s.start, settings=s.settings, mount=s.mount, at=s.at),
        ),
    }
)
"""The methods by name."""


def is_own(name: str) -> bool:
    """True for a method in a user's file, `FILE.py:Name`."""
    return name.rpartition(":")[0].endswith(".py")


def method_of(name: str) -> Method:
    """The method of a name in `METHODS`, in a user's file, or of an installed package.

    Raises:
        UnknownNameError: no such method, or no such class in the file.
        IdentificationError: the file or package cannot be read or imported, or the class is no estimator.
    """
    if name in METHODS:
        return METHODS[name]
    installed = entry_points(group=GROUP)
    if not is_own(name) and name not in installed.names:
        raise UnknownNameError("method", name, [*METHODS, *sorted(installed.names), "FILE.py:Name"])
    file, _, called = name.rpartition(":")
    try:
        made: Any = _class_in(file, called) if is_own(name) else installed[name].load()
    except (UnknownNameError, IdentificationError):
        raise
    except Exception as error:
        where = file or f"the entry point {name!r}"
        raise IdentificationError(f"--method {name}: {where} cannot be imported: {error}") from error
    if missing := [part for part in ("update", "estimate") if not callable(getattr(made, part, None))]:
        raise IdentificationError(f"--method {name}: {called} has no {' and no '.join(missing)}; an estimator has both")
    summary = (inspect.getdoc(made) or "an own estimator").splitlines()[0]
    return Method(summary, lambda setup: _own(made, called, setup.robot))


def _class_in(file: str, called: str) -> Any:
    """A class of a user's file."""
    path = Path(file)
    if not path.is_file():
        raise IdentificationError(f"--method {file}:{called}: no such file {file!r}")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = {key: value for key, value in vars(module).items() if inspect.isclass(value)}
    if called not in found:
        own = [key for key, value in found.items() if value.__module__ == module.__name__]
        raise UnknownNameError("estimator", called, own, file)
    return found[called]


def _own(of_class: Any, called: str, robot: Robot) -> Weigher:
    """A user's estimator; one that has only `update` and `estimate` gets the rest."""
    try:
        made = of_class(robot)
    except Exception as error:
        raise own_failure(called, error) from error
    return made if isinstance(made, Weigher) else OwnEstimator(made, robot)


def make_estimator(name: str, setup: Setup, methods: Mapping[str, Method] = METHODS) -> Weigher:
    """Constructs an estimator of the named method, of the available `methods`.

    Raises:
        UnknownNameError: no such method.
        IdentificationError: the setup lacks what the method needs.
    """
    if name not in methods:
        raise UnknownNameError("method", name, methods)
    return methods[name].make(setup)
