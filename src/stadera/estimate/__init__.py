"""The online estimators of the trunk's mass and centre of mass."""

from stadera.estimate.measurement import Measurement, measurements_of
from stadera.estimate.protocol import COMPONENTS, Estimator, Status, TrunkEstimate, unobserved
from stadera.estimate.trunk import ImplausibleError, TrunkBounds, TrunkModel

__all__ = [
    "COMPONENTS",
    "Estimator",
    "ImplausibleError",
    "Measurement",
    "Status",
    "TrunkBounds",
    "TrunkEstimate",
    "TrunkModel",
    "measurements_of",
    "unobserved",
]
