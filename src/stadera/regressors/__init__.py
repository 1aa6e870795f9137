"""Regressors: measurements turned into rows that are linear in the parameters."""

from stadera.regressors.friction import FRICTION_TERMS, FRICTION_UNITS, FrictionModel
from stadera.regressors.joint_torques import JointTorqueRegressor, inertial_columns
from stadera.regressors.motion import STANDARD_GRAVITY, JointMotion, TrunkMotion
from stadera.regressors.rows import Rows, stack

__all__ = [
    "FRICTION_TERMS",
    "FRICTION_UNITS",
    "STANDARD_GRAVITY",
    "FrictionModel",
    "JointMotion",
    "JointTorqueRegressor",
    "Rows",
    "TrunkMotion",
    "inertial_columns",
    "stack",
]
