"""Parses option values. Malformed values are bad usage (exit 2); unknown names are left to the callee."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from stadera.errors import IdentificationError

if TYPE_CHECKING:
    from stadera.weigh.settings import TestWeight

Point = tuple[float, float, float]


def names(value: str | None) -> tuple[str, ...] | None:
    """A comma-separated list of names; None stays None."""
    if value is None:
        return None
    found = tuple(part.strip() for part in value.split(",") if part.strip())
    if not found:
        raise typer.BadParameter("a comma-separated list needs at least one name")
    return found


def terms(value: str) -> tuple[str, ...]:
    """A comma-separated list of names, or "none" for no names."""
    return () if value.lower() == "none" else names(value) or ()


def cutoff(value: str) -> float | Literal["auto"] | None:
    """A frequency [Hz], "auto", or "none"."""
    if value.lower() == "auto":
        return "auto"
    if value.lower() == "none":
        return None
    return _number(value, "a frequency in Hz, 'auto' or 'none'", fits=lambda frequency: frequency > 0.0)


def torque_lag(value: str) -> float | None:
    """Seconds, or None for "auto"."""
    if value.lower() == "auto":
        return None
    from stadera.logs.processing import LONGEST_DELAY

    wanted = f"seconds between -{LONGEST_DELAY:g} and {LONGEST_DELAY:g}, or 'auto'"
    return _number(value, wanted, "'--torque-lag'", lambda lag: abs(lag) <= LONGEST_DELAY)


def split(value: str) -> float:
    """The share of the log to fit, above 0 and below 1; 1 for "none"."""
    if value.lower() == "none":
        return 1.0
    return _number(value, "a share between 0 and 1, or 'none'", "'--split'", lambda share: 0.0 < share < 1.0)


def direction(value: str) -> Point | None:
    """Three numbers with commas between, not all zero; None for "auto"."""
    if value.lower() == "auto":
        return None
    x, y, z = point(value)
    if not (x or y or z):
        raise typer.BadParameter("a direction needs a component that is not zero")
    return x, y, z


def point(value: str) -> Point:
    """Three numbers with commas between."""
    parts = value.split(",")
    if len(parts) != 3:
        raise typer.BadParameter(f"{value!r} is not three numbers x,y,z")
    x, y, z = (_number(part, "three numbers x,y,z") for part in parts)
    return x, y, z


def load(value: str) -> tuple[float, Literal["kg", "N"]]:
    """A mass, "5kg" or plain "5", or a force, "50N"."""
    text = value.strip()
    unit: Literal["kg", "N"] = "N" if text.endswith("N") else "kg"
    return _number(text.removesuffix(unit), "a load like 5kg or 50N"), unit


def tare(value: str) -> tuple[float, float] | Path:
    """A range of time "T0:T1" [s], or the path of a log."""
    from stadera.weigh.settings import tare_of

    try:
        found = tare_of(value)
    except IdentificationError as error:
        raise typer.BadParameter(str(error)) from None
    return Path(found) if isinstance(found, str) else found


def weight(value: str) -> tuple[float, float]:
    """Mass and standard deviation [kg], "15.2kg±0.05" (also "+-", "kg" optional); without the latter a bathroom
    scale's.
    """
    from stadera.weigh.settings import weight_std

    first, _, last = value.replace("+-", "±").replace("kg", "").partition("±")
    mass, *std = _numbers([first, last] if last else [first])
    if not mass > 0.0 or not min(std, default=0.0) >= 0.0:
        raise typer.BadParameter(f"{value!r} is not a weight like 15.2kg or 15.2kg±0.05")
    return mass, std[0] if std else weight_std(mass)


def known(value: str) -> TestWeight:
    """A payload that is known, "5kg@0.1,0,0.08"."""
    from stadera.weigh.settings import TestWeight

    weighs, _, place = value.partition("@")
    mass, *at = _numbers([weighs.replace("kg", ""), *place.split(",")])
    if len(at) != 3 or not mass > 0.0:
        raise typer.BadParameter(f"{value!r} is not a test weight like 5kg@0.1,0,0.08")
    return TestWeight(mass, (at[0], at[1], at[2]))


def _numbers(texts: list[str]) -> list[float]:
    """The numbers; all NaN if one is none or not finite."""
    try:
        found = [float(text) for text in texts]
    except ValueError:
        found = []
    return found if found and isfinite(sum(found)) else [float("nan")] * len(texts)


def _number(
    value: str, wanted: str, option: str | None = None, fits: Callable[[float], bool] = lambda number: True
) -> float:
    try:
        number = float(value)
    except ValueError:
        number = float("nan")
    if not (isfinite(number) and fits(number)):
        raise typer.BadParameter(f"{value!r} is not {wanted}", param_hint=option)
    return number


def counted(text: str | None, hint: str, count: int = 1000) -> tuple[int, Path | None]:
    """Parses "[N=]FILE": a number above 0, and the file, None if there is no text. What is no number belongs to the
    file's name.
    """
    if text is None:
        return count, None
    number, sign, path = text.partition("=")
    if not sign or not (number.isascii() and number.isdecimal()):
        return count, Path(text)
    if not int(number):
        raise typer.BadParameter(f"{number!r} is no number above 0", param_hint=hint)
    return int(number), Path(path)
