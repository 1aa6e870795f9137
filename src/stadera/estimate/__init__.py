"""The online estimators of the trunk's mass and centre of mass."""

from stadera.estimate.changes import ChangeLimits
from stadera.estimate.combined import CombinedCom
from stadera.estimate.contact import ContactForces, ground_normal
from stadera.estimate.contact_com import ContactCom
from stadera.estimate.equilibrium import ConstantErrors
from stadera.estimate.forces import ContactForceEstimator, contact_forces
from stadera.estimate.legs import MeasuredLegs
from stadera.estimate.mass import MassEstimator
from stadera.estimate.measurement import Measurement, measurements_of
from stadera.estimate.noise import ForceNoise
from stadera.estimate.orientation import OrientationCom, PostureLaw
from stadera.estimate.poses import PosesCom
from stadera.estimate.protocol import COMPONENTS, Estimator, Status, TrunkEstimate, unobserved
from stadera.estimate.recursive import Phase, Plane
from stadera.estimate.registry import METHODS, Method, Setup, make_estimator
from stadera.estimate.static_poses import PoseOffset, expected_covariance, static_poses
from stadera.estimate.stillness import StillnessGate, StillnessLimits
from stadera.estimate.trunk import ImplausibleError, TrunkBounds, TrunkModel
from stadera.estimate.vertical import measurements_without_imu, vertical_by_forces
from stadera.estimate.walking import WalkingEstimator, WalkingSettings
from stadera.estimate.walking_noise import WalkingNoise
from stadera.estimate.walking_result import LoadChange, Payload, TrunkParameters
from stadera.estimate.walking_samples import Samples

__all__ = [
    "COMPONENTS",
    "METHODS",
    "ChangeLimits",
    "CombinedCom",
    "ConstantErrors",
    "ContactCom",
    "ContactForceEstimator",
    "ContactForces",
    "Estimator",
    "ForceNoise",
    "ImplausibleError",
    "LoadChange",
    "MassEstimator",
    "MeasuredLegs",
    "Measurement",
    "Method",
    "OrientationCom",
    "Payload",
    "Phase",
    "Plane",
    "PoseOffset",
    "PosesCom",
    "PostureLaw",
    "Samples",
    "Setup",
    "Status",
    "StillnessGate",
    "StillnessLimits",
    "TrunkBounds",
    "TrunkEstimate",
    "TrunkModel",
    "TrunkParameters",
    "WalkingEstimator",
    "WalkingNoise",
    "WalkingSettings",
    "contact_forces",
    "expected_covariance",
    "ground_normal",
    "make_estimator",
    "measurements_of",
    "measurements_without_imu",
    "static_poses",
    "unobserved",
    "vertical_by_forces",
]
