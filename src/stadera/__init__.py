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
        IdentificationError,
        MissingExtraError,
        ModelError,
        RecordingError,
        StaderaError,
        UnknownNameError,
        UntrustedError,
    )
    from stadera.excite.design import ExciteSettings, excite
    from stadera.excite.result import Excitation
    from stadera.identify.legs import identify
    from stadera.identify.result import Identification
    from stadera.identify.settings import IdentifySettings
    from stadera.inertia import InertialParameters
    from stadera.logs.recording import Recording
    from stadera.logs.topics import LogFile
    from stadera.robot.load import load_robot
    from stadera.robot.model import Robot
    from stadera.trunk.estimator import TrunkEstimator
    from stadera.trunk.measurement import Measurement
    from stadera.trust import Trust
    from stadera.weigh.result import Weighing
    from stadera.weigh.settings import WeighSettings
    from stadera.weigh.weigh import weigh

__all__ = [
    "Excitation",
    "ExciteSettings",
    "Identification",
    "IdentificationError",
    "IdentifySettings",
    "InertialParameters",
    "LogFile",
    "Measurement",
    "MissingExtraError",
    "ModelError",
    "Recording",
    "RecordingError",
    "Robot",
    "StaderaError",
    "TrunkEstimator",
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
    "Excitation": "stadera.excite.result",
    "ExciteSettings": "stadera.excite.design",
    "Identification": "stadera.identify.result",
    "IdentificationError": "stadera.errors",
    "IdentifySettings": "stadera.identify.settings",
    "InertialParameters": "stadera.inertia",
    "LogFile": "stadera.logs.topics",
    "Measurement": "stadera.trunk.measurement",
    "MissingExtraError": "stadera.errors",
    "ModelError": "stadera.errors",
    "Recording": "stadera.logs.recording",
    "RecordingError": "stadera.errors",
    "Robot": "stadera.robot.model",
    "StaderaError": "stadera.errors",
    "TrunkEstimator": "stadera.trunk.estimator",
    "Trust": "stadera.trust",
    "UnknownNameError": "stadera.errors",
    "UntrustedError": "stadera.errors",
    "WeighSettings": "stadera.weigh.settings",
    "Weighing": "stadera.weigh.result",
    "excite": "stadera.excite",
    "identify": "stadera.identify",
    "load_robot": "stadera.robot.load",
    "weigh": "stadera.weigh",
}

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _HOMES)
