"""Numbers of list entries shown to a reader; omitted ones are counted."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Shown:
    """Largest number of entries in each list."""

    gaps: int = 5  # of a log
    failed: int = 10  # logs of a fleet
    reasons: int = 3  # why times of a log were not used, in the terminal
    changes: int = 5  # of the load, live
    rows: int = 12  # of a table on a page
    records: int = 24  # of an experiment there; if there are more, only those that miss their bound
    named: int = 400  # points of a figure with tooltips; more make a page too heavy


SHOWN = Shown()
