"""The controllers that the test-bed stands and walks by."""

from stadera.control.belief import SmoothBelief
from stadera.control.crawl import Crawl
from stadera.control.crawl_phase import CrawlEvent, Phase
from stadera.control.crawl_run import Fall, WalkJudge, walk
from stadera.control.crawl_settings import CrawlCommand, CrawlError, CrawlSettings
from stadera.control.distribution import ContactLimits, ForceDistribution
from stadera.control.gains import Response, TrunkGains
from stadera.control.odometry import LegOdometry
from stadera.control.planner_com import ComPlan, SupportPhase, plan_com
from stadera.control.planner_support import PlanError, SupportPolygon
from stadera.control.reference import Move, Reference, TrunkPose
from stadera.control.shake import Shake
from stadera.control.stand import Controller, TestBed
from stadera.control.swing import SwingLegs, SwingTrajectory
from stadera.control.trot import Trot, TrotSettings
from stadera.control.trunk import ControlError, TrunkController

__all__ = [
    "ComPlan",
    "ContactLimits",
    "ControlError",
    "Controller",
    "Crawl",
    "CrawlCommand",
    "CrawlError",
    "CrawlEvent",
    "CrawlSettings",
    "Fall",
    "ForceDistribution",
    "LegOdometry",
    "Move",
    "Phase",
    "PlanError",
    "Reference",
    "Response",
    "Shake",
    "SmoothBelief",
    "SupportPhase",
    "SupportPolygon",
    "SwingLegs",
    "SwingTrajectory",
    "TestBed",
    "Trot",
    "TrotSettings",
    "TrunkController",
    "TrunkGains",
    "TrunkPose",
    "WalkJudge",
    "plan_com",
    "walk",
]
