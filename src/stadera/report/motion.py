"""A weighing in motion in the terminal and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from stadera.estimate.walking_result import Payload, TrunkParameters
from stadera.report.numbers import number, with_std
from stadera.report.weighing import plain
from stadera.simulate.truth import Truth
from stadera.weigh.in_motion import MotionWeighing

METHOD = "walking"

_TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")
_MOST_REASONS = 3


def motion_json(result: MotionWeighing) -> dict[str, Any]:
    """What was found, as plain values: SI units, trunk frame, null for what was not observable.

    Keys: robot, source, method, status, trunk, payload, changes, timeline, torque_lag, refused, notes, units. The
    inertia is about the trunk frame's origin, in its axes.
    """
    line = result.timeline
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
        "timeline": {
            "time": plain(line.time),
            "mass": plain(line.mass),
            "mass_std": plain(line.mass_std),
            "com": [plain(com) for com in line.com],
            "com_std": [plain(std) for std in line.com_std],
        },
        "torque_lag": {"value": result.torque_lag[0], "std": result.torque_lag[1]},
        "refused": [{"begin": r.begin, "end": r.end, "reason": r.reason} for r in result.refusals],
        "notes": list(result.notes),
        "units": {"time": "s", "mass": "kg", "com": "m", "inertia": "kg·m²", "torque_lag": "s"},
    }


def motion_tables(result: MotionWeighing, truth: Truth | None = None) -> Iterator[RenderableType]:
    """Trunk and payload, then the changes of the load, then what to be wary of."""
    whole = f"{result.begin:.2f} to {result.end:.2f} s, {result.status}"
    yield Text(f"{result.robot.name}, {result.source}: {whole}", style="bold")
    table = Table(title="Weighed in motion", title_justify="left", title_style="bold")
    table.add_column("trunk frame")
    for heading in ("mass [kg]", "com x [m]", "com y [m]", "com z [m]"):
        table.add_column(heading, justify="right")
    for name, *figures in motion_rows(result, truth):
        table.add_row(name, *figures)
    yield table
    if result.changes:
        yield _changes(result)
    yield Text(lag_text(result), style="dim")
    yield from (Text(f"note: {note}", style="dim") for note in result.notes)
    longest = sorted(result.refusals, key=lambda r: r.begin - r.end)[:_MOST_REASONS]
    for refusal in sorted(longest, key=lambda r: r.begin):
        yield Text(f"nothing learnt from {refusal.begin:.2f} to {refusal.end:.2f} s: {refusal.reason}", style="yellow")
    if (more := len(result.refusals) - len(longest)) > 0:
        yield Text(f"and {more} shorter times", style="yellow")


def lag_text(result: MotionWeighing) -> str:
    """The torques' lag as found."""
    lag, std = (1e3 * value for value in result.torque_lag)
    return f"torques arrive {with_std(lag, std)} ms late, as found; it is allowed for"


def motion_rows(result: MotionWeighing, truth: Truth | None = None) -> Iterator[tuple[str, str, str, str, str]]:
    """Name, mass, and centre of mass of the trunk of the model file, the trunk found, the payload, and the truth."""
    prior, found = result.robot.inertias[result.robot.trunk], result.trunk
    yield "trunk, CAD", number(prior.mass), *_exact(prior.com)
    std = np.sqrt(np.diag(found.covariance))
    texts = [_figure(v, s) for v, s in zip([found.inertial.mass, *found.inertial.com], std, strict=True)]
    yield "trunk with all on it", texts[0], texts[1], texts[2], texts[3]
    if (payload := result.payload) is not None:
        x, y, z = (_figure(v, s) for v, s in zip(payload.com, payload.com_std, strict=True))
        yield "payload since the tare", with_std(payload.mass, payload.mass_std), x, y, z
    if truth is not None:
        last = truth.at(result.end)
        yield "truth: trunk with all on it", number(last.mass), *_exact(np.array(last.com))
        if last.payload_com is not None:
            yield "truth: payload", number(last.payload_mass), *_exact(np.array(last.payload_com))


def inertia_rows(result: MotionWeighing) -> Iterator[tuple[str, str, str]]:
    """Component, CAD and found, of the trunk's inertia about its centre of mass [kg·m²]."""
    found, prior = result.trunk, result.robot.inertias[result.robot.trunk]
    for name, (i, j), std in zip(
        _TENSOR, ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)), found.inertia_std, strict=True
    ):
        value = _figure(found.inertial.inertia_com[i, j], std)
        yield f"I{name}", number(prior.inertia_com[i, j]), value


def _exact(com: Any) -> tuple[str, str, str]:
    x, y, z = (number(round(float(value), 6)) for value in com)
    return x, y, z


def _figure(value: float, std: float) -> str:
    return with_std(float(value), float(std)) if isfinite(std) and isfinite(value) else "not observed"


def _quantity(value: float, std: float) -> dict[str, float | None]:
    known = isfinite(std) and isfinite(value)
    return {"value": float(value) if known else None, "std": float(std) if known else None}


def _trunk(found: TrunkParameters) -> dict[str, Any]:
    std = np.sqrt(np.diag(found.covariance))
    com = np.where(np.isfinite(std[1:]), found.inertial.com, np.nan)
    tensor = zip(_TENSOR, found.inertial.vector[4:], found.inertia_std, strict=True)
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
    table = Table(title="Changes of the load", title_justify="left", title_style="bold")
    table.add_column("time [s]", justify="right")
    table.add_column("kind")
    table.add_column("mass [kg]", justify="right")
    for change in result.changes:
        table.add_row(f"{change.time:.2f}", change.kind, with_std(change.mass, change.mass_std))
    return table
