"""Tables of `benchmarks/limits.py`, by gait."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stadera.lab.experiments.reality import RealityCase
from stadera.report.table import TableData
from stadera.types import Array

FIGURES = ("trunk mass", "trunk x", "trunk y", "trunk z", "payload mass", "payload x", "payload y", "payload z")
"""Percent of the robot's mass, and mm."""

DETECTED = 5.0
"""Standard deviations that a load needs to be found in 95 % of cases, at one false alarm in ten minutes."""


_TABLED = ("trunk mass [%]", "trunk x [mm]", "y", "x-y", "z", "payload mass [%]", "payload x-y [mm]")
_TITLES = {
    "floor": "floor",
    "best": "best estimate's errors",
    "joint": "joint estimate's errors",
    "weigh": "errors of weigh",
}


def tables(pairs: Sequence[tuple[RealityCase, Mapping[str, Any]]]) -> list[TableData]:
    """Floors and errors, shares, and detection, by gait and of all gaits."""
    stood = [(case.scenario, found) for case, found in pairs if "floor" in found]
    groups = {gait: [found for name, found in stood if name == gait] for gait, _ in stood}
    groups["all"] = [found for _, found in stood]
    body, shares, detection = {}, {}, {}
    for gait, runs in groups.items():
        values = {name: _columns([run[name] for run in runs]) for name in _TITLES}
        body[gait] = [(title, *map(_spread, values[name].T)) for name, title in _TITLES.items()]
        body[gait] += [
            (f"{name} over floor, rms", *map(_rms, (values[name] / values["floor"]).T))
            for name in _TITLES
            if name != "floor"
        ]
        kinds = dict.fromkeys(kind for run in runs for kind in run["shares"])
        shares[gait] = [
            (kind, *map(_rms, _columns([run["shares"].get(kind, [0.0] * 8) for run in runs]).T)) for kind in kinds
        ]
        z = np.array([run["detection"] for run in runs])
        detection[gait] = [(f"{np.median(z):.1f}", f"{z.min():.1f} to {z.max():.1f}", f"{(z > DETECTED).mean():.0%}")]
    return [
        TableData.of("Floors and errors: median; 95th percentile", ("", *_TABLED), body),
        TableData.of("Share of each kind of error in least squares, rms", ("", *_TABLED), shares),
        TableData.of("A load of 5 % in half a second, in σ", ("median", "range", f"above {DETECTED:g}"), detection),
    ]


def _columns(values: Sequence[Sequence[float | None]]) -> Array:
    """(runs, 7): sizes of the figures (runs, 8) in a table."""
    each = np.abs(np.array(values, dtype=float).reshape(len(values), 8))
    trunk, load = np.hypot(each[:, 1], each[:, 2]), np.hypot(each[:, 5], each[:, 6])
    return np.column_stack([each[:, :3], trunk, each[:, 3], each[:, 4], load])


def _spread(column: Array) -> str:
    """Median and 95th percentile."""
    seen = column[np.isfinite(column)]
    return f"{np.median(seen):.2g}; {np.percentile(seen, 95):.2g}" if len(seen) else "–"


def _rms(column: Array) -> str:
    seen = column[np.isfinite(column)]
    return f"{np.sqrt(np.mean(seen**2)):.2g}" if len(seen) else "–"
