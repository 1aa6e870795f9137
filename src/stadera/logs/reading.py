"""How to interpret a log's columns if the log itself does not state it."""

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
    """Interpretation of a log's columns."""

    columns: ColumnMap | None = None  # assignment of columns; None to recognise them by their names
    units: Units = field(default_factory=Units)  # of the columns, if neither their names nor the map states them
    pd: PdGains | None = None  # gains for computing efforts from desired positions; None to use recorded efforts
    limits: Limits = DEFAULTS  # for reading
    changes: tuple[Change, ...] = ()  # applied to what is read, in order: gear ratios, corrections of faults
    # joints of no leg, an arm's or a lidar's, to read besides the requested ones if they are recorded
    others: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        columns: str | Path | ColumnMap | None = None,
        units: str | Units | None = None,
        pd: str | PdGains | None = None,
        limits: Limits = DEFAULTS,
        gear: str | Gear | None = None,
    ) -> Reading:
        """Parses the options' texts: a preset's name or a map's path, "deg,ms", "20,0.5", gear ratios "6.33".
        RecordingError for an invalid one, UnknownNameError for an unknown unit.
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
"""Interprets columns by their names, in SI units unless the names state others."""
