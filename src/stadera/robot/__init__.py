"""Robots: their kinematic tree, legs, limits and prior parameters."""

from stadera.robot.model import LEG_NAMES, Frame, JointDynamics, JointLimits, Leg, Robot, Shape, Tree

__all__ = ["LEG_NAMES", "Frame", "JointDynamics", "JointLimits", "Leg", "Robot", "Shape", "Tree"]
