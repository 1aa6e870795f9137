"""Weighs legged robots with their own legs."""

from stadera.errors import StaderaError
from stadera.inertia import InertialParameters

__all__ = ["InertialParameters", "StaderaError"]
__version__ = "0.1.0"
