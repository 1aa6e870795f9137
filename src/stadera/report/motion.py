"""A weighing in motion in the terminal and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from stadera.estimate.walking_result import Payload, TrunkParameters
from stadera.report.numbers import number, with_std
from stadera.report.terminal import titled_table
from stadera.report.weighed import (
    Body,
    bodies_table,
    figure,
    place,
    plain,
    prior_body,
    refusal_lines,
    refusals_json,
    timeline_json,
    true_bodies,
)
from stadera.simulate.truth import Truth
from stadera.weigh.in_motion import MotionWeighing

METHOD = "walking"

_TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")


def motion_json(result: MotionWeighing) -> dict[str, Any]:
    """What was found, as plain values: SI units, trunk frame, null for what was not observable.

    Keys: robot, source, method, status, trunk, payload, changes, timeline, torque_lag, refused, notes, units. The
    inertia is about the trunk frame's origin, in its axes, and null unless all of it was observed.
    """
    return {
        "robot": result.robot.name,
        "source": result.source,
        "method": METHOD,
        "status": result.status,
        "trunk": _trunk(result.trunk),
        "payload": None if result.payload is None else _payload(result.payload),
        "changes": [
            {
                "time": c.time,
                "noticed": c.noticed,
                "kind": c.kind,
                "mass": {"value": c.mass, "std": c.mass_std},
            }
            for c in result.changes
        ],
        "timeline": timeline_json(result.timeline),
        "torque_lag": {"value": result.torque_lag[0], "std": result.torque_lag[1]},
        "refused": refusals_json(result.refusals),
        "notes": list(result.notes),
        "units": {"time": "s", "mass": "kg", "com": "m", "inertia": "kg·m²", "torque_lag": "s"},
    }


def motion_tables(result: MotionWeighing, truth: Truth | None = None) -> Iterator[RenderableType]:
    """Trunk and payload, then the changes of the load, then what to be wary of."""
    whole = f"{result.begin:.2f} to {result.end:.2f} s, {result.status}"
    yield Text(f"{result.robot.name}, {result.source}: {whole}", style="bold")
    yield bodies_table("Weighed in motion", motion_rows(result, truth))
    if result.changes:
        yield _changes(result)
    yield Text(lag_text(result), style="dim")
    yield from (Text(f"note: {note}", style="dim") for note in result.notes)
    yield from refusal_lines("nothing learnt", result.refusals)


def lag_text(result: MotionWeighing) -> str:
    """The torques' lag as found."""
    lag, std = (1e3 * value for value in result.torque_lag)
    return f"torques arrive {with_std(lag, std)} ms late, as found; it is allowed for"


def motion_rows(result: MotionWeighing, truth: Truth | None = None) -> Iterator[Body]:
    """Name, mass, and centre of mass of the trunk of the model file, the trunk found, the payload, and the truth."""
    found, payload = result.trunk, result.payload
    std = np.sqrt(np.diag(found.covariance))
    yield prior_body(result.robot.inertias[result.robot.trunk])
    yield "trunk with all on it", figure(found.inertial.mass, std[0]), *place(found.inertial.com, std[1:])
    if payload is not None:
        mass = with_std(payload.mass, payload.mass_std)
        yield "payload since the tare", mass, *place(payload.com, payload.com_std)
    yield from true_bodies(truth, result.end)


def inertia_rows(result: MotionWeighing) -> Iterator[tuple[str, str, str]]:
    """Component, CAD and found, of the trunk's inertia about its centre of mass [kg·m²]."""
    found, prior = result.trunk, result.robot.inertias[result.robot.trunk]
    for name, (i, j), std in zip(
        _TENSOR, ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)), _inertia_std(found), strict=True
    ):
        value = figure(found.inertial.inertia_com[i, j], std)
        yield f"I{name}", number(prior.inertia_com[i, j]), value


def _quantity(value: float, std: float) -> dict[str, float | None]:
    known = isfinite(std) and isfinite(value)
    return {"value": float(value) if known else None, "std": float(std) if known else None}


def _inertia_std(found: TrunkParameters) -> NDArray[np.float64]:
    """(6,) [kg·m²], all NaN unless all six are observed: the tensor is the model's until then."""
    return found.inertia_std if found.observed[4:].all() else np.full(6, np.nan)


def _trunk(found: TrunkParameters) -> dict[str, Any]:
    std = np.sqrt(np.diag(found.covariance))
    com = np.where(np.isfinite(std[1:]), found.inertial.com, np.nan)
    tensor = zip(_TENSOR, found.inertial.vector[4:], _inertia_std(found), strict=True)
    return {
        "mass": _quantity(found.inertial.mass, std[0]),
        "com": {"value": plain(com), "std": plain(std[1:])},
        "inertia": {name: _quantity(value, s) for name, value, s in tensor},
    }


def _payload(payload: Payload) -> dict[str, Any]:
    return {
        "mass": {"value": payload.mass, "std": payload.mass_std},
        "com": {"value": plain(payload.com), "std": plain(payload.com_std)},
    }


def _changes(result: MotionWeighing) -> Table:
    table = titled_table("Changes of the load", ("time [s]", "kind", "mass [kg]"), "rlr")
    for change in result.changes:
        table.add_row(f"{change.time:.2f}", change.kind, with_std(change.mass, change.mass_std))
    return table
