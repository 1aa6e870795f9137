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
    from stadera.errors import ClosedLoopError as ClosedLoopError
    from stadera.errors import IdentificationError as IdentificationError
    from stadera.errors import MissingExtraError as MissingExtraError
    from stadera.errors import ModelError as ModelError
    from stadera.errors import RecordingError as RecordingError
    from stadera.errors import StaderaError as StaderaError
    from stadera.errors import UnknownNameError as UnknownNameError
    from stadera.errors import UntrustedError as UntrustedError
    from stadera.excite.design import Excitation as Excitation
    from stadera.excite.design import ExciteSettings as ExciteSettings
    from stadera.excite.design import excite as excite
    from stadera.identify.legs import identify as identify
    from stadera.identify.result import Identification as Identification
    from stadera.identify.settings import IdentifySettings as IdentifySettings
    from stadera.inertia import InertialParameters as InertialParameters
    from stadera.logs.recording import Imu as Imu
    from stadera.logs.recording import Recording as Recording
    from stadera.logs.topics import LogFile as LogFile
    from stadera.robot.load import load_robot as load_robot
    from stadera.robot.model import Robot as Robot
    from stadera.trunk.estimator import TrunkEstimator as TrunkEstimator
    from stadera.trunk.load import Payload as Payload
    from stadera.trunk.measurement import Measurement as Measurement
    from stadera.trunk.settings import TrunkSettings as TrunkSettings
    from stadera.trust import Trust as Trust
    from stadera.weigh.result import Weighing as Weighing
    from stadera.weigh.settings import WeighSettings as WeighSettings
    from stadera.weigh.weigh import weigh as weigh
__version__ = "0.1.0"

if not TYPE_CHECKING:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
