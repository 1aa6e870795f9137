"""Units of a log's columns, and their factors to SI."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from math import isfinite, pi

import numpy as np

from stadera.errors import RecordingError, UnknownNameError
from stadera.types import Array

_DEGREE = pi / 180.0
FACTORS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9},
    "position": {"rad": 1.0, "deg": _DEGREE, "°": _DEGREE, "mrad": 1e-3, "rev": 2.0 * pi},
    "velocity": {"rad/s": 1.0, "deg/s": _DEGREE, "°/s": _DEGREE, "rpm": pi / 30.0, "rev/s": 2.0 * pi},
    "acceleration": {"rad/s2": 1.0, "rad/s²": 1.0, "deg/s2": _DEGREE, "°/s²": _DEGREE},
    "effort": {"Nm": 1.0, "N·m": 1.0, "N*m": 1.0, "N.m": 1.0, "mNm": 1e-3, "Ncm": 1e-2, "kNm": 1e3},
    "gyro": {"rad/s": 1.0, "deg/s": _DEGREE, "°/s": _DEGREE, "dps": _DEGREE},
    "accelerometer": {"m/s2": 1.0, "m/s²": 1.0, "m/s^2": 1.0, "g": 9.80665, "mg": 9.80665e-3},
    "force": {"N": 1.0, "kN": 1e3},
}
"""By quantity, the factor of each unit to the first one, the SI unit. g is the standard acceleration of free fall."""
RECORDED: dict[str, tuple[str, float]] = {
    "position": ("rad", 1e5),
    "velocity": ("rad/s", 1e4),
    "acceleration": ("rad/s²", 1e7),
    "effort": ("N·m", 1e6),
    "angular_velocity": ("rad/s", 1e4),
    "linear_acceleration": ("m/s²", 1e6),
    "orientation": ("", 1e3),
    "force": ("N", 1e7),
}
"""By quantity, its SI unit and the largest plausible value, far above any sensor's range and far below overflow: drives
reach 50 rad/s and 500 N·m, MEMS sensors 70 rad/s and 2000 m/s². A position may include thousands of turns, and a
quaternion need not be normalised.
"""
_QUANTITY = {
    "position_desired": "position",
    "velocity_desired": "velocity",
    "effort_desired": "effort",
    "angular_velocity": "gyro",
    "linear_acceleration": "accelerometer",
}
_LABEL = re.compile(r"^(?P<name>.*\S)\s*[\[(](?P<unit>[^\[\]()]+)[\])]$")
_UNIX = (1.0e9, 4.1e9)
"""Unix time from 2001 to 2099 [s]."""
_STEPS = (1e-5, 10.0)
"""Steps between samples of any log [s]; distinguishes milliseconds since 1970 from nanoseconds since power-on."""


@dataclass(frozen=True)
class Units:
    """Units of a log that does not state them; UnknownNameError for unknown ones."""

    of: Mapping[str, str] = field(default_factory=dict)  # unit by quantity (a key of `FACTORS`); SI for the others
    rate_hz: float | None = None  # rows per second of a log without a column of time; None if there is time

    def __post_init__(self) -> None:
        for quantity, unit in self.of.items():
            if quantity not in FACTORS:
                raise UnknownNameError("quantity with a unit", quantity, FACTORS)
            if unit not in FACTORS[quantity]:
                raise UnknownNameError(f"unit of {quantity}", unit, FACTORS[quantity])
        if self.rate_hz is not None and not (isfinite(self.rate_hz) and self.rate_hz > 0):
            raise RecordingError(f"a rate of rows needs to be above 0 Hz, got {self.rate_hz:g}")

    @classmethod
    def parse(cls, text: str) -> Units:
        """Parses units from a list such as "deg,ms,gyro=deg/s,200Hz"; UnknownNameError for unknown ones.

        A unit without a quantity applies to every quantity that has it: deg/s to joint velocities and to the gyro.
        """
        of: dict[str, str] = {}
        rate = None
        for part in filter(None, (part.strip() for part in text.split(","))):
            quantity, _, unit = (word.strip() for word in part.rpartition("="))
            if match := re.fullmatch(r"([\d.]+)\s*[Hh]z", unit):
                rate = float(match[1])
                continue
            found = [quantity] if quantity else [name for name, units in FACTORS.items() if unit in units]
            if not found:
                raise UnknownNameError("unit", unit, dict.fromkeys(u for units in FACTORS.values() for u in units))
            of |= dict.fromkeys(found, unit)
        return cls(of, rate)

    def over(self, other: Units) -> Units:
        """These units, completed by another's where they are unspecified."""
        return Units({**other.of, **self.of}, other.rate_hz if self.rate_hz is None else self.rate_hz)

    @property
    def of_time(self) -> str:
        """What is said of time, a unit or a rate, as in `parse`; empty for nothing."""
        rate = "" if self.rate_hz is None else f"{self.rate_hz:g}Hz"
        return ",".join(filter(None, [self.of.get("time", ""), rate]))


def quantity_of(column: str) -> str:
    """The quantity of a column of the flat table, a key of `FACTORS`; empty for one without a unit."""
    name = re.sub(r"\.(?:[xyzw]|\{axis\})$", "", column)
    last = _QUANTITY.get(name.rpartition(".")[-1], name.rpartition(".")[-1])
    return last if last in FACTORS else ""


def labelled(names: Iterable[str]) -> dict[str, tuple[str, str]]:
    """By column, its name and unit if it ends in a known unit in brackets, such as "FL_hip.position [deg]"."""
    found = {name: match for name in names if (match := _LABEL.match(name))}
    known = {unit for units in FACTORS.values() for unit in units}
    return {name: (match["name"], unit) for name, match in found.items() if (unit := match["unit"].strip()) in known}


def unix_unit(stamps: Array) -> str:
    """Unit of Unix time stamps other than seconds, from their size; empty for seconds and for other clocks."""
    if len(stamps) < 2:
        return ""
    step = float(np.median(np.diff(stamps)))
    for unit, factor in FACTORS["time"].items():
        if factor < 1.0 and _UNIX[0] <= factor * stamps[0] <= _UNIX[1] and _STEPS[0] <= factor * step <= _STEPS[1]:
            return unit
    return ""


def longer_unit(stamps: Array, factor: float) -> str:
    """Unit of stamps that were taken to be in a shorter one, of this factor to seconds, with which samples would follow
    each other closer than in any log; empty if they do not.
    """
    step = float(np.ptp(stamps)) / (len(stamps) - 1) if len(stamps) > 1 else np.inf  # stamps may be in bursts
    longer = (unit for unit, known in FACTORS["time"].items() if factor < known and 1e-4 <= known * step <= 0.5)
    return next(longer, "") if factor * step < _STEPS[0] else ""


@cache
def largest_of(column: str) -> float:
    """Largest plausible value of a column of the flat table: `<joint>.<quantity>`, `imu.<quantity>.<axis>`; time..."""
    parts = column.split(".")
    return next((RECORDED[part][1] for part in reversed(parts[-2:]) if part in RECORDED), 1e15)
