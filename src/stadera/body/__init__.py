"""A legged robot as a floating tree with contacts: one set of rows for any of them."""

from stadera.body.friction import FRICTION_TERMS, FRICTION_UNITS, FrictionModel
from stadera.body.rows import Rows, discounted
from stadera.body.torques import JointMotion, JointTorqueRegressor, TrunkMotion, inertial_columns
from stadera.body.tree import Body, Motion, State

__all__ = [
    "FRICTION_TERMS",
    "FRICTION_UNITS",
    "Body",
    "FrictionModel",
    "JointMotion",
    "JointTorqueRegressor",
    "Motion",
    "Rows",
    "State",
    "TrunkMotion",
    "discounted",
    "inertial_columns",
]
