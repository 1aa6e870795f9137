"""A weighing in the terminal and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from stadera.report.numbers import with_std
from stadera.report.terminal import titled_table
from stadera.report.weighed import (
    Body,
    bodies_table,
    place,
    plain,
    prior_body,
    refusal_lines,
    refusals_json,
    timeline_json,
    true_bodies,
)
from stadera.simulate.truth import Truth
from stadera.weigh.result import Weighing

Array = NDArray[np.float64]


def weighing_json(result: Weighing) -> dict[str, Any]:
    """What `weigh` found, as plain values: SI units, trunk frame, null for what was not observable.

    Keys: robot, source, method, status, trunk, payload, changes, timeline, vertical, refused, notes, units.
    """
    payload, vertical = result.payload, result.vertical
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
        "timeline": timeline_json(result.timeline),
        "vertical": {
            "source": vertical.source,
            "up": {"value": plain(vertical.up), "std": plain(vertical.std)},
            "tilt_std": vertical.tilt_std,
        },
        "refused": refusals_json(result.refusals),
        "notes": list(result.notes),
        "units": {"time": "s", "mass": "kg", "com": "m", "tilt_std": "rad"},
    }


def weighing_tables(result: Weighing, truth: Truth | None = None) -> Iterator[RenderableType]:
    """Trunk and payload, then the changes of the load, then what to be wary of."""
    yield Text(f"{result.robot.name}, {result.source}: {rested(result)}", style="bold")
    yield bodies_table(f"Weighed by eq. 7, method {result.method!r}", body_rows(result, truth))
    if result.changes:
        yield _changes(result)
    yield from (Text(f"note: {note}", style="dim") for note in result.notes)
    yield from refusal_lines("not weighed", result.refusals)


def rested(result: Weighing) -> str:
    """How much of the log could be weighed by."""
    whole = result.end - result.begin
    return f"stands still for {whole - result.refused:.1f} of {whole:.1f} s"


def body_rows(result: Weighing, truth: Truth | None = None) -> Iterator[Body]:
    """Name, mass, and centre of mass of the trunk of the model file, the trunk found, the payload, and the truth."""
    yield prior_body(result.robot.inertias[result.robot.trunk])
    yield "trunk with all on it", with_std(result.mass, result.mass_std), *place(result.com, result.com_std)
    if (payload := result.payload) is not None:
        mass = with_std(payload.mass, payload.mass_std)
        yield "payload since the tare", mass, *place(payload.com, payload.com_std)
    yield from true_bodies(truth, result.end)


def _changes(result: Weighing) -> Table:
    table = titled_table("Changes of the load", ("time [s]", "mass [kg]"), "rr")
    for change in result.changes:
        table.add_row(f"{change.time:.2f}", with_std(change.mass, change.mass_std))
    return table
