"""A weighing in the terminal and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from stadera.report.numbers import number, with_std
from stadera.simulate.truth import Truth
from stadera.weigh.result import Weighing

Array = NDArray[np.float64]

_MOST_REASONS = 3


def weighing_json(result: Weighing) -> dict[str, Any]:
    """What `weigh` found, as plain values: SI units, trunk frame, null for what was not observable.

    Keys: robot, source, method, status, trunk, payload, changes, timeline, vertical, refused, notes, units.
    """
    line, payload, vertical = result.timeline, result.payload, result.vertical
    return {
        "robot": result.robot.name,
        "source": result.source,
        "method": result.method,
        "status": result.status,
        "trunk": {
            "mass": {"value": result.mass, "std": result.mass_std},
            "com": {"value": plain(result.com), "std": plain(result.com_std)},
            "inertia": None,
        },
        "payload": None
        if payload is None
        else {
            "mass": {"value": payload.mass, "std": payload.mass_std},
            "com": {"value": plain(payload.com), "std": plain(payload.com_std)},
            "com_covariance": [plain(row) for row in payload.covariance],
        },
        "changes": [{"time": c.time, "mass": {"value": c.mass, "std": c.mass_std}} for c in result.changes],
        "timeline": {
            "time": plain(line.time),
            "mass": plain(line.mass),
            "mass_std": plain(line.mass_std),
            "com": [plain(com) for com in line.com],
            "com_std": [plain(std) for std in line.com_std],
        },
        "vertical": {
            "source": vertical.source,
            "up": {"value": plain(vertical.up), "std": plain(vertical.std)},
            "tilt_std": vertical.tilt_std,
        },
        "refused": [{"begin": r.begin, "end": r.end, "reason": r.reason} for r in result.refusals],
        "notes": list(result.notes),
        "units": {"time": "s", "mass": "kg", "com": "m", "tilt_std": "rad"},
    }


def plain(values: Array) -> list[float | None]:
    """Numbers as JSON has them, None for NaN."""
    return [float(value) if isfinite(value) else None for value in values]


def weighing_tables(result: Weighing, truth: Truth | None = None) -> Iterator[RenderableType]:
    """Trunk and payload, then the changes of the load, then what to be wary of."""
    yield Text(f"{result.robot.name}, {result.source}: {rested(result)}", style="bold")
    yield _bodies(result, truth)
    if result.changes:
        yield _changes(result)
    yield from (Text(f"note: {note}", style="dim") for note in result.notes)
    longest = sorted(result.refusals, key=lambda r: r.begin - r.end)[:_MOST_REASONS]
    for refusal in sorted(longest, key=lambda r: r.begin):
        yield Text(f"not weighed from {refusal.begin:.2f} to {refusal.end:.2f} s: {refusal.reason}", style="yellow")
    if (more := len(result.refusals) - len(longest)) > 0:
        yield Text(f"and {more} shorter times", style="yellow")


def rested(result: Weighing) -> str:
    """How much of the log could be weighed by."""
    whole = result.end - result.begin
    return f"stands still for {whole - result.refused:.1f} of {whole:.1f} s"


def body_rows(result: Weighing, truth: Truth | None = None) -> Iterator[tuple[str, str, str, str, str]]:
    """Name, mass, and centre of mass of the trunk of the model file, the trunk found, the payload, and the truth."""
    prior = result.robot.inertias[result.robot.trunk]
    x, y, z = (number(round(float(value), 6)) for value in prior.com)
    yield "trunk, CAD", number(prior.mass), x, y, z
    x, y, z = _shown(result.com, result.com_std)
    yield "trunk with all on it", with_std(result.mass, result.mass_std), x, y, z
    if (payload := result.payload) is not None:
        x, y, z = _shown(payload.com, payload.com_std)
        yield "payload since the tare", with_std(payload.mass, payload.mass_std), x, y, z
    if truth is not None:
        last = truth.at(result.end)
        x, y, z = (number(round(value, 6)) for value in last.com)
        yield "truth: trunk with all on it", number(last.mass), x, y, z
        if last.payload_com is not None:
            x, y, z = (number(round(value, 6)) for value in last.payload_com)
            yield "truth: payload", number(last.payload_mass), x, y, z


def _shown(values: Array, stds: Array) -> tuple[str, str, str]:
    x, y, z = (
        with_std(float(value), float(std)) if isfinite(value) else "not observed"
        for value, std in zip(values, stds, strict=True)
    )
    return x, y, z


def _bodies(result: Weighing, truth: Truth | None) -> Table:
    table = Table(title=f"Weighed by eq. 7, method {result.method!r}", title_justify="left", title_style="bold")
    table.add_column("trunk frame")
    for heading in ("mass [kg]", "com x [m]", "com y [m]", "com z [m]"):
        table.add_column(heading, justify="right")
    for name, *figures in body_rows(result, truth):
        table.add_row(name, *figures)
    return table


def _changes(result: Weighing) -> Table:
    table = Table(title="Changes of the load", title_justify="left", title_style="bold")
    table.add_column("time [s]", justify="right")
    table.add_column("mass [kg]", justify="right")
    for change in result.changes:
        table.add_row(f"{change.time:.2f}", with_std(change.mass, change.mass_std))
    return table
