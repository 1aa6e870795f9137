"""JSON and table schema of a weighing. Keys are only ever added. SI units; null for unobserved quantities."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from stadera.inertia import ORDER
from stadera.results import data_frame
from stadera.trunk.load import LoadChange, Payload, scale_of
from stadera.trunk.result import TrunkParameters
from stadera.types import Array
from stadera.weigh.use import determined, next_steps

if TYPE_CHECKING:
    from stadera.weigh.result import Timeline, Vertical, Weighing

_TENSOR = tuple(name.removeprefix("I") for name in ORDER[4:])
_UNITS = {"time": "s", "mass": "kg", "com": "m", "inertia": "kg·m²", "torque_lag": "s", "tilt_std": "rad"} | {
    "armature": "kg·m²",
    "viscous": "N·m·s/rad",
    "coulomb": "N·m",
    "offset": "N·m",
}


def weighing_dict(result: Weighing) -> dict[str, Any]:
    """A weighing as plain values.

    The trunk's centre of mass is in the trunk frame ("frame"), its inertia about that frame's origin ("inertia_about")
    in its axes, null at rest. The payload's centre of mass is in the trunk frame too, its inertia about that centre in
    trunk axes. "joints" are rotor inertia, friction and offsets that the motion told; with "links", which weighing
    leaves as they are, they are what `--legs` takes. In a result that cannot be trusted, every mass and centre of mass
    of trunk, payload and changes has "trusted": false. "determined" says whether masses are known well enough to be of
    use, "next" what to do where not.
    """
    mark = {} if result.is_trusted else {"trusted": False}
    place = {"frame": result.robot.trunk, "inertia_about": "frame origin"}
    return {
        "robot": result.robot.name,
        "source": result.source,
        "method": result.method,
        "status": result.status,
        "trust": result.trust.to_dict(),
        "determined": determined(result),
        "next": [step.to_dict() for step in next_steps(result)],
        "time": result.time,
        "trunk": trunk_dict(result.trunk, mark) | place | ({"inertia": None} if result.torque_lag is None else {}),
        "payload": None if result.payload is None else payload_dict(result.payload, result.robot.trunk, mark),
        "changes": [change_dict(change, mark) for change in result.changes],
        "timeline": timeline_dict(result.timeline),
        "torque_lag": None if result.torque_lag is None else quantity(*result.torque_lag),
        "links": {},
        "joints": {} if result.drives is None else result.drives.to_dict(),
        "spikes": result.spikes,
        "impacts": result.impacts,
        "vertical": None if result.vertical is None else _vertical(result.vertical),
        "refused": [{"begin": r.begin, "end": r.end, "reason": r.reason} for r in result.refusals],
        "notes": list(result.notes),
        "units": _UNITS,
    }


def plain(values: Array) -> list[float | None]:
    """Numbers for JSON, None for NaN."""
    return [float(value) if isfinite(value) else None for value in values]


def quantity(value: float, std: float) -> dict[str, float | None]:
    """A value and its standard deviation, both None if not observed."""
    seen = isfinite(std) and isfinite(value)
    return {"value": float(value) if seen else None, "std": float(std) if seen else None}


def mass_quantity(value: float, std: float, without: float | None) -> dict[str, float | None]:
    """A mass: "std" in all, and apart "std_without_scale" [kg] and "scale" [1], of the scale that all torques have in
    common.
    """
    found, scale = quantity(value, std), scale_of(value, std, without)
    return found | {"std_without_scale": None if scale is None else without, "scale": scale}


def timeline_dict(line: Timeline) -> dict[str, Any]:
    """The timeline as plain values, with the payload's mass if it was tracked."""
    plain_line: dict[str, Any] = {
        "time": plain(line.time),
        "mass": plain(line.mass),
        "mass_std": plain(line.mass_std),
        "com": [plain(com) for com in line.com],
        "com_std": [plain(std) for std in line.com_std],
    }
    if line.payload is not None:
        plain_line |= {"payload_mass": plain(line.payload[:, 0]), "payload_mass_std": plain(line.payload[:, 1])}
    return plain_line


def timeline_frame(line: Timeline) -> Any:
    """See `Weighing.to_dataframe`."""
    columns = {"time": line.time, "mass": line.mass, "mass_std": line.mass_std}
    for k, axis in enumerate("xyz"):
        columns |= {f"com_{axis}": line.com[:, k], f"com_{axis}_std": line.com_std[:, k]}
    if line.payload is not None:
        columns |= {"payload_mass": line.payload[:, 0], "payload_mass_std": line.payload[:, 1]}
    return data_frame(columns)


def trunk_dict(trunk: TrunkParameters, mark: dict[str, bool]) -> dict[str, Any]:
    """A trunk as plain values; `mark` is added to each mass and centre of mass."""
    std = trunk.inertia_std if trunk.observed[4:].all() else np.full(6, np.nan)
    return {
        "mass": mass_quantity(trunk.inertial.mass, trunk.mass_std, trunk.mass_std_without_scale) | mark,
        "com": {"value": plain(trunk.com), "std": plain(trunk.com_std)} | mark,
        "inertia": {n: quantity(v, s) for n, v, s in zip(_TENSOR, trunk.inertial.vector[4:], std, strict=True)},
    }


def payload_dict(payload: Payload, frame: str, mark: dict[str, bool]) -> dict[str, Any]:
    """A payload as plain values, in the named frame."""
    tensor, std = payload.inertia, payload.inertia_std
    components = None if tensor is None else [tensor["xyz".index(name[0]), "xyz".index(name[1])] for name in _TENSOR]
    return {
        "mass": mass_quantity(payload.mass, payload.mass_std, payload.mass_std_without_scale) | mark,
        "com": {"value": plain(payload.com), "std": plain(payload.com_std)} | mark,
        "com_covariance": [plain(row) for row in payload.com_covariance],
        "inertia": components and dict(zip(_TENSOR, map(float, components), strict=True)),
        "inertia_std": None if std is None else dict(zip(_TENSOR, std.tolist(), strict=True)),
        "frame": frame,
        "inertia_about": "com",
    }


def change_dict(change: LoadChange, mark: dict[str, bool]) -> dict[str, Any]:
    """A change of the load as plain values."""
    mass = mass_quantity(change.mass, change.mass_std, change.mass_std_without_scale) | mark
    return {"time": change.time, "noticed": change.noticed, "kind": change.kind, "mass": mass}


def _vertical(vertical: Vertical) -> dict[str, Any]:
    return {
        "source": vertical.source,
        "up": {"value": plain(vertical.up), "std": plain(vertical.std)},
        "tilt_std": vertical.tilt_std,
    }
