"""Converts a fleet's table to series: each robot's quantities over its logs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from stadera.constants import EPOCH
from stadera.fleet.table import FleetTable
from stadera.types import Array

LogRow = Mapping[str, Any]

TRUNK: Mapping[str, tuple[str, str, float]] = {
    "trunk_mass": ("trunk mass", "kg", 1.0),
    "com_x": ("centre of mass x", "mm", 1e3),
    "com_y": ("centre of mass y", "mm", 1e3),
    "com_z": ("centre of mass z", "mm", 1e3),
    "payload_mass": ("payload", "kg", 1.0),
}
"""By column: title, displayed unit, and factor from the column's unit to it."""
JOINT: Mapping[str, tuple[str, str, float]] = {
    "armature": ("rotor inertia", "kg·m²", 1.0),
    "viscous": ("viscous friction", "N·m·s/rad", 1.0),
    "coulomb": ("Coulomb friction", "N·m", 1.0),
    "offset": ("torque offset", "N·m", 1.0),
}


@dataclass(frozen=True, eq=False)
class FleetSeries:
    """One quantity of one robot over its logs, in order of time: values and standard deviations (logs,), in `unit`; the
    joint, None for the trunk's quantities, with which the title of its parameter begins; and the rows of the table.
    """

    robot: str
    title: str
    unit: str
    joint: str | None
    value: Array
    std: Array
    rows: tuple[LogRow, ...]


def by_robot(rows: Sequence[LogRow]) -> dict[str, list[LogRow]]:
    """Rows by robot, robots by name, each robot's in order of time; rows of an unknown robot under "unknown"."""
    robots: dict[str, list[LogRow]] = {}
    for row in sorted(rows, key=lambda row: str(row["robot"] or "unknown")):
        robots.setdefault(row["robot"] or "unknown", []).append(row)
    return {name: _in_time(own) for name, own in robots.items()}


def when(row: LogRow) -> str:
    """Time of a log if it is stamped with the time of day; else empty."""
    begin = row["begin"]
    if begin is None or begin < EPOCH:
        return ""
    return datetime.fromtimestamp(begin, UTC).strftime("%Y-%m-%d %H:%M")


def series_of(table: FleetTable) -> Iterator[FleetSeries]:
    """Yields every quantity observed in at least one log: the trunk's, then the joints', robot by robot.

    Logs whose result cannot be trusted are excluded.
    """
    joints: dict[tuple[str, str, str], dict[str, LogRow]] = {}
    for entry in table.joints:
        key = (entry["robot"] or "unknown", entry["joint"], entry["parameter"])
        joints.setdefault(key, {})[entry["log"]] = entry
    for robot, rows in by_robot(table.rows).items():
        for column, (title, unit, factor) in TRUNK.items():
            pairs = [(row, row[column], row[f"{column}_std"]) for row in rows]
            yield from _series(robot, title, unit, None, factor, pairs)
        for (owner, joint, parameter), entries in joints.items():
            if owner == robot and parameter in JOINT:
                title, unit, factor = JOINT[parameter]
                found = [(row, entries[row["log"]]) for row in rows if row["log"] in entries]
                pairs = [(row, entry["value"], entry["std"]) for row, entry in found]
                yield from _series(robot, f"{joint} {title}", unit, joint, factor, pairs)


def _series(
    robot: str, title: str, unit: str, joint: str | None, factor: float, pairs: Sequence[tuple[LogRow, Any, Any]]
) -> Iterator[FleetSeries]:
    """Yields a series of the observed values; nothing if there are none."""
    good = ((row, value, std) for row, value, std in pairs if row["trust"] != "bad" and value is not None and std)
    seen = [(row, factor * value, factor * std) for row, value, std in good]
    if seen:
        rows, value, std = zip(*seen, strict=True)
        yield FleetSeries(robot, title, unit, joint, np.array(value), np.array(std), tuple(rows))


def _in_time(rows: Sequence[LogRow]) -> list[LogRow]:
    """Sorts by stamps if all count from 1970; otherwise keeps the order, since times that start at zero do not define
    one.
    """
    stamps = [row["begin"] for row in rows if row["begin"] is not None]
    if not stamps or min(stamps) < EPOCH:
        return list(rows)
    last = max(stamps)
    return sorted(rows, key=lambda row: last if row["begin"] is None else row["begin"])
