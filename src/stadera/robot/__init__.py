"""Robots: their kinematic tree, legs, limits and prior parameters."""

from stadera.joint_words import LEG_NAMES
from stadera.robot.catalog import CATALOG
from stadera.robot.load import load_robot
from stadera.robot.model import JointDynamics, JointLimits, Robot, Shape

__all__ = ["CATALOG", "LEG_NAMES", "JointDynamics", "JointLimits", "Robot", "Shape", "load_robot"]
