"""Weighs legged robots with their own legs.

    robot = stadera.load_robot("go2")                     # or a path to a URDF or MJCF
    legs = stadera.identify(robot, "swing.csv")           # inertia, rotors and friction of the legs
    result = stadera.weigh(robot, "walk.mcap")            # the trunk, and the payload on it
    estimator = stadera.TrunkEstimator(robot)             # the same online

Every name is imported when first used. `identify`, `weigh` and `excite` are packages that can be called.
"""

from typing import TYPE_CHECKING

from stadera.lazy import lazy_names

if TYPE_CHECKING:
    from stadera.errors import (
        ClosedLoopError,
        IdentificationError,
        MissingExtraError,
        ModelError,
        RecordingError,
        StaderaError,
        UnknownNameError,
        UntrustedError,
    )
    from stadera.excite.design import Excitation, ExciteSettings, excite
    from stadera.identify.legs import identify
    from stadera.identify.result import Identification
    from stadera.identify.settings import IdentifySettings
    from stadera.inertia import InertialParameters
    from stadera.logs.recording import Imu, Recording
    from stadera.logs.topics import LogFile
    from stadera.robot.load import load_robot
    from stadera.robot.model import Robot
    from stadera.trunk.estimator import TrunkEstimator
    from stadera.trunk.load import Payload
    from stadera.trunk.measurement import Measurement
    from stadera.trunk.settings import TrunkSettings
    from stadera.trust import Trust
    from stadera.weigh.result import Weighing
    from stadera.weigh.settings import WeighSettings
    from stadera.weigh.weigh import weigh

__all__ = [
    "ClosedLoopError",
    "Excitation",
    "ExciteSettings",
    "Identification",
    "IdentificationError",
    "IdentifySettings",
    "Imu",
    "InertialParameters",
    "LogFile",
    "Measurement",
    "MissingExtraError",
    "ModelError",
    "Payload",
    "Recording",
    "RecordingError",
    "Robot",
    "StaderaError",
    "TrunkEstimator",
    "TrunkSettings",
    "Trust",
    "UnknownNameError",
    "UntrustedError",
    "WeighSettings",
    "Weighing",
    "excite",
    "identify",
    "load_robot",
    "weigh",
]
__version__ = "0.1.0"

_HOMES = {
    "errors": "ClosedLoopError IdentificationError MissingExtraError ModelError RecordingError StaderaError "
    "UnknownNameError UntrustedError",
    "excite": "excite",
    "excite.design": "Excitation ExciteSettings",
    "identify": "identify",
    "identify.result": "Identification",
    "identify.settings": "IdentifySettings",
    "inertia": "InertialParameters",
    "logs.recording": "Imu Recording",
    "logs.topics": "LogFile",
    "robot.load": "load_robot",
    "robot.model": "Robot",
    "trunk.estimator": "TrunkEstimator",
    "trunk.load": "Payload",
    "trunk.measurement": "Measurement",
    "trunk.settings": "TrunkSettings",
    "trust": "Trust",
    "weigh": "weigh",
    "weigh.result": "Weighing",
    "weigh.settings": "WeighSettings",
}

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _HOMES)
