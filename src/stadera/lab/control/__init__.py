"""Controllers with which the test-bed's robots stand and walk."""

from stadera.lab.control.crawl.crawl import Crawl
from stadera.lab.control.crawl.run import WalkMonitor, walk
from stadera.lab.control.crawl.settings import CrawlCommand, CrawlError, CrawlPhase, CrawlSettings
from stadera.lab.control.distribution import ContactLimits, ForceDistribution
from stadera.lab.control.gains import TrunkGains
from stadera.lab.control.odometry import LegOdometry
from stadera.lab.control.planner.com import SupportPhase, plan_com
from stadera.lab.control.planner.feet import PlanError, SupportPolygon
from stadera.lab.control.reference import Move, Shake, TrunkPose
from stadera.lab.control.smooth import SmoothTrunk
from stadera.lab.control.stand import TestBed
from stadera.lab.control.swing import SwingTrajectory
from stadera.lab.control.trot import Trot, TrotSettings
from stadera.lab.control.trunk import ControlError, TrunkController

__all__ = [
    "ContactLimits",
    "ControlError",
    "Crawl",
    "CrawlCommand",
    "CrawlError",
    "CrawlPhase",
    "CrawlSettings",
    "ForceDistribution",
    "LegOdometry",
    "Move",
    "PlanError",
    "Shake",
    "SmoothTrunk",
    "SupportPhase",
    "SupportPolygon",
    "SwingTrajectory",
    "TestBed",
    "Trot",
    "TrotSettings",
    "TrunkController",
    "TrunkGains",
    "TrunkPose",
    "WalkMonitor",
    "plan_com",
    "walk",
]
