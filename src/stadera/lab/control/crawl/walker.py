"""A crawl as the supervisor wants it."""

from __future__ import annotations

from stadera.lab.control.crawl.crawl import Crawl
from stadera.lab.control.crawl.phase import CrawlPhase
from stadera.trunk.model import TrunkModel


class CrawlWalker:
    """Meets `Walker` with a `Crawl`, whose planner and trunk controller share one trunk.

    Args:
        crawl: what walks.
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
        """Why it stopped by itself; empty if it did not."""
        return self.crawl.reason if self.crawl.failed and self.crawl.phase is CrawlPhase.STAND else ""

    def request_stop(self) -> None:
        """After the step under way."""
        self.crawl.request_stop("asked by the supervisor")

    def resume(self) -> None:
        """Walk on with the leg whose turn it is."""
        self.crawl.resume()

    def sit(self) -> None:
        """From a stand."""
        self.crawl.sit("asked by the supervisor")

    def update_trunk(self, trunk: TrunkModel) -> bool:
        """One model, used by controller and planner."""
        return self.crawl.update_trunk(trunk)
