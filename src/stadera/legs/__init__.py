"""The model of the legs: kinematics, contact forces, friction, and rows that are linear in the parameters."""

from stadera.legs.friction import FRICTION_TERMS, FRICTION_UNITS, FrictionModel
from stadera.legs.joint_torques import JointTorqueRegressor, inertial_columns
from stadera.legs.motion import JointMotion, TrunkMotion
from stadera.legs.rows import Rows, stack

__all__ = [
    "FRICTION_TERMS",
    "FRICTION_UNITS",
    "FrictionModel",
    "JointMotion",
    "JointTorqueRegressor",
    "Rows",
    "TrunkMotion",
    "inertial_columns",
    "stack",
]
