"""The online estimators of the trunk's mass and centre of mass."""

from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.ground import ground_normal
from stadera.trunk.load import LoadChange, Payload
from stadera.trunk.measurement import Measurement, measurements_of
from stadera.trunk.model import ImplausibleError, TrunkBounds, TrunkModel
from stadera.trunk.protocol import Estimator, Status, TrunkEstimate
from stadera.trunk.registry import METHODS, Method, Setup, make_estimator
from stadera.trunk.result import TrunkParameters, unobserved
from stadera.trunk.samples import Samples
from stadera.trunk.settings import ChangeSettings, ModelErrors, OutlierSettings, SwingDetection, TrunkSettings
from stadera.trunk.standing.detection import StaticDetector, StaticLimits
from stadera.trunk.standing.forces import ContactForceEstimator

__all__ = [
    "METHODS",
    "ChangeSettings",
    "ContactForceEstimator",
    "Estimator",
    "ImplausibleError",
    "LoadChange",
    "Measurement",
    "Method",
    "ModelErrors",
    "OutlierSettings",
    "Payload",
    "Samples",
    "Setup",
    "StaticDetector",
    "StaticLimits",
    "Status",
    "SwingDetection",
    "TrunkBounds",
    "TrunkEstimate",
    "TrunkEstimator",
    "TrunkModel",
    "TrunkParameters",
    "TrunkSettings",
    "ground_normal",
    "make_estimator",
    "measurements_of",
    "unobserved",
]
