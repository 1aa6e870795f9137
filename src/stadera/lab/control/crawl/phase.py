"""Phases and events of a crawl."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class CrawlPhase(StrEnum):
    """Phase of a crawl."""

    STAND = "stand"
    BODY = "body motion"
    SWING = "swing"
    RETREAT = "retreat"
    SIT = "sit"


@dataclass(frozen=True)
class CrawlEvent:
    """A transition: time [s], the phase that begins, the leg concerned (or None), and the reason."""

    time: float
    phase: CrawlPhase
    leg: str | None
    reason: str
