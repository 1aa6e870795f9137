"""Ground truth of a prepared log, kept in a separate file: used by reports and never by estimators."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, Self

from stadera.boundary import foreign, require_input
from stadera.constants import ROUNDING
from stadera.inertia import InertialParameters


@dataclass(frozen=True)
class TruthAt:
    """True trunk parameters, payload included, from a time [s] on, trunk frame: mass [kg], centre of mass [m], inertia
    (Ixx, Ixy, Ixz, Iyy, Iyz, Izz) about the trunk's origin [kg·m²], and the payload's mass and centre, None where there
    is none.
    """

    time: float
    mass: float
    com: tuple[float, float, float]
    inertia: tuple[float, ...]
    payload_mass: float = 0.0
    payload_com: tuple[float, float, float] | None = None

    @classmethod
    def of(cls, time: float, trunk: InertialParameters, bare: InertialParameters) -> Self:
        """Computes the entry from the trunk with and without payload."""
        load = trunk - bare
        loaded = load.mass > ROUNDING
        return cls(
            time,
            float(trunk.mass),
            _triple(trunk.com),
            tuple(float(v) for v in trunk.vector[4:]),
            float(load.mass) if loaded else 0.0,
            _triple(load.com) if loaded else None,
        )


@dataclass(frozen=True)
class Truth:
    """Ground truth of one run: its settings and"""

    robot: str
    scenario: str
    errors: str
    seed: int
    slope: float  # of the ground [rad]
    # of the trunk controller about the trunk's axes [N·m/rad], for the method 'orientation'
    stiffness: tuple[float, ...]
    moments: tuple[TruthAt, ...]  # the trunk at the start and after each change
    # all random model and sensor errors, as `Drawn.to_dict`; None for other kinds of errors
    drawn: Mapping[str, Any] | None = None

    def since(self, first: float) -> Truth:
        """The same with times counted from `first` [s]."""
        return replace(self, moments=tuple(replace(m, time=m.time - first) for m in self.moments))

    def at(self, time: float) -> TruthAt:
        """The truth at a time [s]."""
        return next((m for m in reversed(self.moments) if m.time <= time), self.moments[0])


def truth_paths(log: str | PathLike[str]) -> tuple[Path, Path]:
    """Paths of a log's truth: its JSON, and the table of true motion and forces (in the log's format)."""
    path = Path(log)
    return path.with_name(f"{path.stem}.truth.json"), path.with_name(f"{path.stem}.truth{path.suffix}")


def truth_json(truth: Truth) -> dict[str, Any]:
    """The truth as plain values; SI units, trunk frame."""
    return {
        "robot": truth.robot,
        "scenario": truth.scenario,
        "errors": truth.errors,
        "seed": truth.seed,
        "slope": truth.slope,
        "controller": {"angular_stiffness": list(truth.stiffness)},
        "trunk": [
            {
                "time": m.time,
                "mass": m.mass,
                "com": list(m.com),
                "inertia": dict(zip(("xx", "xy", "xz", "yy", "yz", "zz"), m.inertia, strict=True)),
                "payload": None if m.payload_com is None else {"mass": m.payload_mass, "com": list(m.payload_com)},
            }
            for m in truth.moments
        ],
        **({} if truth.drawn is None else {"drawn": truth.drawn}),
    }


def read_truth(path: str | PathLike[str]) -> Truth:
    """Reads the truth written by `truth_json`. Raises RecordingError: no such file, or a file of another kind."""
    path = Path(path)
    require_input(path)
    with foreign(path, "not the truth of a simulated run (LOG.truth.json)"):
        value = json.loads(path.read_text(encoding="utf-8"))
        return Truth(
            robot=str(value["robot"]),
            scenario=str(value["scenario"]),
            errors=str(value["errors"]),
            seed=int(value["seed"]),
            slope=float(value["slope"]),
            stiffness=tuple(map(float, value["controller"]["angular_stiffness"])),
            moments=tuple(_moment(m) for m in value["trunk"]),
            drawn=value.get("drawn"),
        )


def _moment(value: dict[str, Any]) -> TruthAt:
    load = value["payload"]
    return TruthAt(
        float(value["time"]),
        float(value["mass"]),
        _triple(value["com"]),
        tuple(float(v) for v in value["inertia"].values()),
        0.0 if load is None else float(load["mass"]),
        None if load is None else _triple(load["com"]),
    )


def _triple(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
