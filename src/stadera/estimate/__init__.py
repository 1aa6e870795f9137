"""The online estimators of the trunk's mass and centre of mass."""

from stadera.estimate.contact import ContactForces, ground_normal
from stadera.estimate.forces import ContactForceEstimator, contact_forces
from stadera.estimate.legs import MeasuredLegs
from stadera.estimate.mass import MassEstimator
from stadera.estimate.measurement import Measurement, measurements_of
from stadera.estimate.noise import ForceNoise
from stadera.estimate.protocol import COMPONENTS, Estimator, Status, TrunkEstimate, unobserved
from stadera.estimate.stillness import StillnessGate, StillnessLimits
from stadera.estimate.trunk import ImplausibleError, TrunkBounds, TrunkModel

__all__ = [
    "COMPONENTS",
    "ContactForceEstimator",
    "ContactForces",
    "Estimator",
    "ForceNoise",
    "ImplausibleError",
    "MassEstimator",
    "MeasuredLegs",
    "Measurement",
    "Status",
    "StillnessGate",
    "StillnessLimits",
    "TrunkBounds",
    "TrunkEstimate",
    "TrunkModel",
    "contact_forces",
    "ground_normal",
    "measurements_of",
    "unobserved",
]
