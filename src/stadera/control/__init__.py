"""The controllers that the test-bed stands and walks by."""

from stadera.control.belief import SmoothBelief
from stadera.control.distribution import ContactLimits, ForceDistribution
from stadera.control.gains import Response, TrunkGains
from stadera.control.odometry import LegOdometry
from stadera.control.reference import Move, Reference, TrunkPose
from stadera.control.shake import Shake
from stadera.control.stand import Controller, TestBed
from stadera.control.swing import SwingLegs, SwingTrajectory
from stadera.control.trot import Trot, TrotSettings
from stadera.control.trunk import ControlError, TrunkController

__all__ = [
    "ContactLimits",
    "ControlError",
    "Controller",
    "ForceDistribution",
    "LegOdometry",
    "Move",
    "Reference",
    "Response",
    "Shake",
    "SmoothBelief",
    "SwingLegs",
    "SwingTrajectory",
    "TestBed",
    "Trot",
    "TrotSettings",
    "TrunkController",
    "TrunkGains",
    "TrunkPose",
]
