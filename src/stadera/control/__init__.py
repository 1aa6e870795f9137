"""The trunk controller that the test-bed stands by."""

from stadera.control.belief import SmoothBelief
from stadera.control.distribution import ContactLimits, ForceDistribution
from stadera.control.gains import Response, TrunkGains
from stadera.control.odometry import LegOdometry
from stadera.control.reference import Move, TrunkPose
from stadera.control.stand import TestBed
from stadera.control.trunk import ControlError, TrunkController

__all__ = [
    "ContactLimits",
    "ControlError",
    "ForceDistribution",
    "LegOdometry",
    "Move",
    "Response",
    "SmoothBelief",
    "TestBed",
    "TrunkController",
    "TrunkGains",
    "TrunkPose",
]
