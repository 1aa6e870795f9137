"""Controllers with which the test-bed's robots stand and walk."""

from stadera.lab.control.com_plan import PlanError
from stadera.lab.control.crawl import Crawl, CrawlPhase
from stadera.lab.control.monitor import Fall, Falls, WalkMonitor, walk
from stadera.lab.control.reference import ControlError, Shake, TrunkPose
from stadera.lab.control.stand import Controller, TestBed
from stadera.lab.control.steps import CrawlCommand, CrawlSettings
from stadera.lab.control.trot import Trot
from stadera.lab.control.trunk import TrunkController, TrunkGains

__all__ = [
    "ControlError",
    "Controller",
    "Crawl",
    "CrawlCommand",
    "CrawlPhase",
    "CrawlSettings",
    "Fall",
    "Falls",
    "PlanError",
    "Shake",
    "TestBed",
    "Trot",
    "TrunkController",
    "TrunkGains",
    "TrunkPose",
    "WalkMonitor",
    "walk",
]
