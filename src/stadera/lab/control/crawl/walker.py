"""Adapts a crawl to the supervisor."""

from __future__ import annotations

from stadera.lab.control.crawl.crawl import Crawl
from stadera.lab.control.crawl.phase import CrawlPhase
from stadera.trunk.model import TrunkModel


class CrawlWalker:
    """Implements `Walker` with a `Crawl`, whose planner and trunk controller share one trunk model.

    Args:
        crawl: the crawl.
    """

    def __init__(self, crawl: Crawl) -> None:
        self.crawl = crawl

    @property
    def phase(self) -> str:
        """The crawl's phase, and its leg."""
        leg = self.crawl.leg
        return str(self.crawl.phase) if leg is None else f"{self.crawl.phase} of {leg}"

    @property
    def stopped(self) -> bool:
        """Whether it stands on four feet, at rest."""
        return self.crawl.stopped and self.crawl.phase is CrawlPhase.STAND

    @property
    def fault(self) -> str:
        """Why it stopped unasked; empty if it did not."""
        return self.crawl.reason if self.crawl.failed and self.crawl.phase is CrawlPhase.STAND else ""

    def request_stop(self) -> None:
        """Stops after the current step."""
        self.crawl.request_stop("asked by the supervisor")

    def resume(self) -> None:
        """Continues walking with the leg whose turn it is."""
        self.crawl.resume()

    def sit(self) -> None:
        """Sits down from a stand."""
        self.crawl.sit("asked by the supervisor")

    def update_trunk(self, trunk: TrunkModel) -> bool:
        """Sets the model used by controller and planner."""
        return self.crawl.update_trunk(trunk)
