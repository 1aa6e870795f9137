"""Table of a fleet: one row per log, in Parquet; for identified legs also one row per parameter of a joint.

Columns are only ever added. SI units; a value that was not observed is null, and so are all values of a log that
failed. `changes` is the number of detected changes of the load. The file's metadata contain the key of each row, by
which a later run recognises finished logs.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stadera.boundary import foreign
from stadera.errors import StaderaError
from stadera.files import written_together
from stadera.results import Result, data_frame

if TYPE_CHECKING:
    from stadera.robot.model import Robot
    from stadera.trunk.memory import Memory

_VALUES = ("trunk_mass", "com_x", "com_y", "com_z", "payload_mass")
_OF_LOG = {"log": "string", "robot": "string"}
COLUMNS: dict[str, str] = {
    **dict.fromkeys(("log", "sha256", "robot"), "string"),
    **dict.fromkeys(("begin", "end"), "double"),
    **dict.fromkeys(("status", "error"), "string"),
    **{name: "double" for value in _VALUES for name in (value, f"{value}_std")},
    "changes": "int64",
    "trust": "string",
    "misfit": "double",
    "seconds": "double",
    "version": "string",
    "memory": "string",
}
"""Columns of the table, with their types. `memory` is how many earlier logs the robot's memory held, or why it stays as
it was.
"""
JOINTS = _OF_LOG | {"joint": "string", "parameter": "string", "value": "double", "std": "double"}
"""Columns of the table of joints: armature [kg·m²], viscous [N·m·s/rad], coulomb and offset [N·m]; `std` is null if the
data do not measure the value.
"""
LEGS = {
    **_OF_LOG,
    "leg": "string",
    "columns": "list<string>",
    "R": "list<double>",
    "z": "list<double>",
    **dict.fromkeys(("cost", "count"), "double"),
    "G": "list<double>",
}
"""Columns of the table of each log's information on each leg: `stadera.information.Information`, R and G row by row."""
SIDES: dict[str, dict[str, str]] = {"joints": JOINTS, "legs": LEGS}
"""Additional tables, by the attribute of `FleetTable` that holds them."""
_LATER = ("G", "memory")  # columns that tables of earlier versions lack
_KEYS = b"stadera.keys"


@dataclass(frozen=True)
class FleetTable(Result):
    """Results of a fleet's logs."""

    rows: tuple[dict[str, Any], ...]  # by column, see `COLUMNS`
    # joints, legs: by column, see `JOINTS` and `LEGS`; empty if trunks were weighed
    joints: tuple[dict[str, Any], ...] = ()
    legs: tuple[dict[str, Any], ...] = ()
    keys: tuple[str | None, ...] = ()  # of each row, None for one that is to be tried again

    def save(self, path: str | PathLike[str]) -> None:
        """Writes the table, and those of joints and legs if there are any; all files or none. Raises StaderaError: the
        path cannot be written or does not end in .parquet.
        """
        import pyarrow as pa
        from pyarrow import parquet

        target = table_path(path)
        sides = {name: columns for name, columns in SIDES.items() if getattr(self, name)}
        keys = {_KEYS: json.dumps(self.keys)}
        with written_together([target, *(side_path(target, name) for name in sides)]) as (first, *others):
            parquet.write_table(_arrow(pa, self.rows, COLUMNS).replace_schema_metadata(keys), first)
            for draft, (name, columns) in zip(others, sides.items(), strict=True):
                parquet.write_table(_arrow(pa, getattr(self, name), columns), draft)

    def to_dict(self) -> dict[str, Any]:
        """Rows, joints, and departures, the most significant first, see `stadera.fleet.departures`."""
        from stadera.fleet.departures import departures, series_of

        found = departures(list(series_of(self)))
        return {"logs": list(self.rows), "joints": list(self.joints), "stands_out": [d.to_dict() for d in found]}

    def to_html(
        self, pages: Mapping[str, str] | None = None, memories: Mapping[str, tuple[Robot, Memory]] | None = None
    ) -> str:
        """The report as one self-contained HTML page, with links to the `pages` of logs, addresses by log, and what is
        remembered of robots, by name.
        """
        from stadera.report.fleet import fleet_html

        return fleet_html(self, pages or {}, memories or {})

    def to_dataframe(self) -> Any:
        """The rows as a pandas DataFrame. Raises MissingExtraError: pandas is not installed."""
        return data_frame({name: [row[name] for row in self.rows] for name in COLUMNS})


def read_fleet(path: str | PathLike[str]) -> FleetTable:
    """Reads a table written by `FleetTable.save`. Raises StaderaError: no such file, or another kind of table."""
    target = table_path(path)
    rows, keys = _read(target, COLUMNS)
    listed = tuple(json.loads(keys)) if keys else (None,) * len(rows)
    paths = {name: side_path(target, name) for name in SIDES}
    sides = {name: _read(path, SIDES[name])[0] for name, path in paths.items() if path.exists()}
    return FleetTable(rows, keys=listed, **sides)


def table_path(path: str | PathLike[str]) -> Path:
    """Checks the path of a table. Raises StaderaError: it does not end in .parquet."""
    target = Path(path)
    if target.suffix.lower() != ".parquet":
        raise StaderaError(f"{target}: a fleet's table is written as .parquet")
    return target


def side_path(table: Path, name: str) -> Path:
    """Path of one of the tables in `SIDES`."""
    return table.with_suffix(f".{name}.parquet")


def _arrow(pa: Any, rows: Sequence[dict[str, Any]], columns: dict[str, str]) -> Any:
    def type_of(kind: str) -> Any:
        inner = kind.removeprefix("list<").removesuffix(">")
        return pa.type_for_alias(kind) if inner == kind else pa.list_(pa.type_for_alias(inner))

    schema = pa.schema([(name, type_of(kind)) for name, kind in columns.items()])
    return pa.Table.from_pylist(list(rows), schema=schema)


def _read(path: Path, columns: dict[str, str]) -> tuple[tuple[dict[str, Any], ...], bytes]:
    from pyarrow import parquet

    with foreign(path, "not a fleet's table", StaderaError):
        table = parquet.read_table(path)
    for name in _LATER:
        if name in columns and name not in table.column_names:
            table = table.append_column(name, [[None] * table.num_rows])
    if missing := [name for name in columns if name not in table.column_names]:
        raise StaderaError(f"{path}: not a fleet's table: no column {', '.join(missing)}")
    return tuple(table.select(list(columns)).to_pylist()), (table.schema.metadata or {}).get(_KEYS, b"")
