"""What all weighings have in common in the terminal and as JSON, at rest or in motion."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from math import isfinite
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from rich.text import Text

from stadera.inertia import InertialParameters
from stadera.report.numbers import number, with_std
from stadera.report.terminal import titled_table
from stadera.simulate.truth import Truth
from stadera.weigh.result import Refusal

Array = NDArray[np.float64]
Body = tuple[str, str, str, str, str]
"""Name, mass [kg], and centre of mass x, y, z [m] of one body, as text."""

HEADINGS = ("trunk frame", "mass [kg]", "com x [m]", "com y [m]", "com z [m]")
"""Of a table of bodies."""

_MOST_REASONS = 3


class Known(Protocol):
    """What was known over time: mass and centre of mass with standard deviations, NaN where not observed."""

    @property
    def time(self) -> Array: ...
    @property
    def mass(self) -> Array: ...
    @property
    def mass_std(self) -> Array: ...
    @property
    def com(self) -> Array: ...
    @property
    def com_std(self) -> Array: ...


def plain(values: Array) -> list[float | None]:
    """Numbers as JSON has them, None for NaN."""
    return [float(value) if isfinite(value) else None for value in values]


def timeline_json(line: Known) -> dict[str, Any]:
    """What was known when, as plain values."""
    return {
        "time": plain(line.time),
        "mass": plain(line.mass),
        "mass_std": plain(line.mass_std),
        "com": [plain(com) for com in line.com],
        "com_std": [plain(std) for std in line.com_std],
    }


def refusals_json(refusals: Iterable[Refusal]) -> list[dict[str, Any]]:
    """When nothing was learnt and why, as plain values."""
    return [{"begin": r.begin, "end": r.end, "reason": r.reason} for r in refusals]


def figure(value: float, std: float) -> str:
    """A value with its standard deviation, or that it was not observed."""
    return with_std(float(value), float(std)) if isfinite(std) and isfinite(value) else "not observed"


def place(com: Array, std: Array) -> tuple[str, str, str]:
    """A centre of mass (3,) with its standard deviations."""
    x, y, z = (figure(value, s) for value, s in zip(com, std, strict=True))
    return x, y, z


def prior_body(prior: InertialParameters) -> Body:
    """The model file's trunk."""
    return "trunk, CAD", number(prior.mass), *_exact(prior.com)


def true_bodies(truth: Truth | None, time: float) -> Iterator[Body]:
    """What was true at a time, where that is known."""
    if truth is not None:
        moment = truth.at(time)
        yield "truth: trunk with all on it", number(moment.mass), *_exact(moment.com)
        if moment.payload_com is not None:
            yield "truth: payload", number(moment.payload_mass), *_exact(moment.payload_com)


def bodies_table(title: str, bodies: Iterable[Body]) -> Table:
    """Bodies one below the other."""
    table = titled_table(title, HEADINGS)
    for body in bodies:
        table.add_row(*body)
    return table


def refusal_lines(what: str, refusals: Sequence[Refusal]) -> Iterator[Text]:
    """The longest times in which there was nothing to learn from, and why; `what` says what did not happen."""
    longest = sorted(refusals, key=lambda r: r.begin - r.end)[:_MOST_REASONS]
    for refusal in sorted(longest, key=lambda r: r.begin):
        yield Text(f"{what} from {refusal.begin:.2f} to {refusal.end:.2f} s: {refusal.reason}", style="yellow")
    if (more := len(refusals) - len(longest)) > 0:
        yield Text(f"and {more} shorter times", style="yellow")


def _exact(com: Iterable[float]) -> tuple[str, str, str]:
    x, y, z = (number(round(float(value), 6)) for value in com)
    return x, y, z
