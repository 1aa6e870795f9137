"""Numbers of list entries shown to a reader; omitted ones are counted."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Shown:
    """Largest number of entries in each list.

    Attributes:
        gaps: of a log. failed: logs of a fleet. reasons: why times of a log were not used, in the terminal.
        changes: of the load, live. rows: of a table on a page, and
        records: of an experiment there; if there are more, only those that miss their bound.
        named: points of a figure with tooltips; more make a page too heavy.
    """

    gaps: int = 5
    failed: int = 10
    reasons: int = 3
    changes: int = 5
    rows: int = 12
    records: int = 24
    named: int = 400


SHOWN = Shown()
