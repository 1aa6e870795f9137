"""How a log's columns are to be understood where the log itself does not say."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from stadera.limits import DEFAULTS, Limits
from stadera.logs.pd_law import PdGains
from stadera.logs.units import Units

if TYPE_CHECKING:
    from stadera.logs.foreign.column_map import ColumnMap
    from stadera.logs.mend import Change, Gear


@dataclass(frozen=True)
class Reading:
    """How a log's columns are to be understood.

    Attributes:
        columns: which of them are what; None to find out by their names.
        units: that they are in, where neither their names nor the map says so.
        pd: gains that make efforts of desired positions; None for the efforts recorded.
        limits: what reading it may take.
        changes: of what is read, in order: gears, faults undone.
    """

    columns: ColumnMap | None = None
    units: Units = field(default_factory=Units)
    pd: PdGains | None = None
    limits: Limits = DEFAULTS
    changes: tuple[Change, ...] = ()

    @classmethod
    def of(
        cls,
        columns: str | Path | ColumnMap | None = None,
        units: str | Units | None = None,
        pd: str | PdGains | None = None,
        limits: Limits = DEFAULTS,
        gear: str | Gear | None = None,
    ) -> Reading:
        """From their texts: a preset's name or a map's path, "deg,ms", "20,0.5", gear ratios "6.33".

        Raises:
            RecordingError: no such preset or file, a file that is no map, gains or ratios that are none.
            UnknownNameError: no such unit.
        """
        if isinstance(columns, str | Path):
            from stadera.logs.foreign.column_map import column_map

            columns = column_map(columns)
        if isinstance(gear, str):
            from stadera.logs.mend import Gear

            gear = Gear.parse(gear)
        return cls(
            columns,
            Units.parse(units) if isinstance(units, str) else units or Units(),
            PdGains.parse(pd) if isinstance(pd, str) else pd,
            limits,
            () if gear is None else (gear,),
        )


AS_RECORDED = Reading()
"""By the names of the columns, in SI units where they say nothing else."""
