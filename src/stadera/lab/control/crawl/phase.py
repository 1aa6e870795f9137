"""What a crawl is doing, and how it came to."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class CrawlPhase(StrEnum):
    """What a crawl is doing."""

    STAND = "stand"
    BODY = "body motion"
    SWING = "swing"
    RETREAT = "retreat"
    SIT = "sit"


@dataclass(frozen=True)
class CrawlEvent:
    """A transition: time [s], the phase that began, the leg it is about (or None), and why."""

    time: float
    phase: CrawlPhase
    leg: str | None
    reason: str
