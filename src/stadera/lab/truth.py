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
from stadera.trunk.load import TENSOR


@dataclass(frozen=True)
class TruthAt:
    """True trunk parameters, payload included, from a time [s] on, trunk frame: mass [kg], centre of mass [m], inertia
    (Ixx, Ixy, Ixz, Iyy, Iyz, Izz) about the trunk's origin [kg·m²], and the payload's mass and centre, None where there
    is none. A payload on another link than the trunk has its centre in the frame of that `link`.
    """

    time: float
    mass: float
    com: tuple[float, ...]
    inertia: tuple[float, ...]
    payload_mass: float = 0.0
    payload_com: tuple[float, ...] | None = None
    link: str | None = None

    @classmethod
    def of(cls, time: float, trunk: InertialParameters, bare: InertialParameters) -> Self:
        """Computes the entry from the trunk with and without payload."""
        load, found = trunk - bare, cls(time, float(trunk.mass), _floats(trunk.com), _floats(trunk.vector[4:]))
        return replace(found, payload_mass=load.mass, payload_com=_floats(load.com)) if load.mass > ROUNDING else found

    def holding(self, load: InertialParameters, link: str) -> Self:
        """The same with a payload on a link, in its frame."""
        return replace(self, payload_mass=load.mass, payload_com=_floats(load.com), link=link)

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        found = {name: getattr(self, name) for name in ("time", "mass", "com")}
        load = {"mass": self.payload_mass, "com": self.payload_com} | ({"link": self.link} if self.link else {})
        inertia = dict(zip(TENSOR, self.inertia, strict=True))
        return found | {"inertia": inertia, "payload": None if self.payload_com is None else load}

    @classmethod
    def from_dict(cls, value: dict[str, Any]) -> Self:
        """From `to_dict`."""
        found = cls(value["time"], value["mass"], _floats(value["com"]), _floats(value["inertia"].values()))
        if (load := value["payload"]) is None:
            return found
        return replace(found, payload_mass=load["mass"], payload_com=_floats(load["com"]), link=load.get("link"))


@dataclass(frozen=True)
class Truth:
    """Ground truth of one run: its settings and the true trunk."""

    robot: str
    scenario: str
    errors: str
    seed: int
    moments: tuple[TruthAt, ...]  # the trunk at the start and after each change
    slope: float = 0.0  # of the ground [rad]
    # of the trunk controller about the trunk's axes [N·m/rad], for the method 'orientation'
    stiffness: tuple[float, ...] = ()
    # all random model and sensor errors, as `Drawn.to_dict`; None for other kinds of errors
    drawn: Mapping[str, Any] | None = None
    fell: tuple[float, str] | None = None  # time [s] and description of a fall; None if there was none

    def since(self, first: float) -> Truth:
        """The same with times counted from `first` [s]."""
        fell = self.fell and (self.fell[0] - first, self.fell[1])
        return replace(self, moments=tuple(replace(m, time=m.time - first) for m in self.moments), fell=fell)

    def at(self, time: float) -> TruthAt:
        """The truth at a time [s]."""
        return next((m for m in reversed(self.moments) if m.time <= time), self.moments[0])


_PLAIN = ("robot", "scenario", "errors", "seed", "slope")


def truth_paths(log: str | PathLike[str]) -> tuple[Path, Path]:
    """Paths of a log's truth: its JSON, and the table of true motion and forces (in the log's format)."""
    path = Path(log)
    return path.with_name(f"{path.stem}.truth.json"), path.with_name(f"{path.stem}.truth{path.suffix}")


def truth_json(truth: Truth) -> dict[str, Any]:
    """The truth as plain values; SI units, trunk frame."""
    return {
        **{name: getattr(truth, name) for name in _PLAIN},
        "controller": {"angular_stiffness": list(truth.stiffness)},
        "trunk": [moment.to_dict() for moment in truth.moments],
        **({} if truth.drawn is None else {"drawn": truth.drawn}),
        **({} if truth.fell is None else {"fell": {"time": truth.fell[0], "how": truth.fell[1]}}),
    }


def read_truth(path: str | PathLike[str]) -> Truth:
    """Reads the truth written by `truth_json`. Raises RecordingError: no such file, or a file of another kind."""
    path = Path(path)
    require_input(path)
    with foreign(path, "not the truth of a simulated run (LOG.truth.json)"):
        value = json.loads(path.read_text(encoding="utf-8"))
        fell = value.get("fell")
        return Truth(
            **{name: value[name] for name in _PLAIN},
            stiffness=_floats(value["controller"]["angular_stiffness"]),
            moments=tuple(map(TruthAt.from_dict, value["trunk"])),
            drawn=value.get("drawn"),
            fell=fell and (fell["time"], fell["how"]),
        )


def _floats(values: Any) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
