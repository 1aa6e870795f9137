"""Controllers with which the test-bed's robots stand and walk."""

from stadera.lab.control.crawl.crawl import Crawl
from stadera.lab.control.crawl.run import WalkMonitor, walk
from stadera.lab.control.crawl.settings import CrawlCommand, CrawlPhase
from stadera.lab.control.gains import TrunkGains
from stadera.lab.control.reference import Shake, TrunkPose
from stadera.lab.control.stand import TestBed
from stadera.lab.control.trot import Trot
from stadera.lab.control.trunk import ControlError, TrunkController

__all__ = [
    "ControlError",
    "Crawl",
    "CrawlCommand",
    "CrawlPhase",
    "Shake",
    "TestBed",
    "Trot",
    "TrunkController",
    "TrunkGains",
    "TrunkPose",
    "WalkMonitor",
    "walk",
]
