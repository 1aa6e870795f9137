"""The tables of a weighing as plain values, and its answer in a sentence."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from stadera.report.numbers import number, with_std
from stadera.report.table import Cell, TableData
from stadera.report.trust import UNTRUSTED
from stadera.types import Array
from stadera.weigh.result import Weighing

if TYPE_CHECKING:
    from stadera.weigh.truth import Truth

_HEAD = ("trunk frame", "mass [kg]", "com x [m]", "com y [m]", "com z [m]")
_TENSOR = (("Ixx", 0, 0), ("Ixy", 0, 1), ("Ixz", 0, 2), ("Iyy", 1, 1), ("Iyz", 1, 2), ("Izz", 2, 2))


def place(com: Array, std: Array) -> tuple[str, str, str]:
    """A centre of mass (3,) with its standard deviations."""
    x, y, z = (with_std(float(value), float(s)) for value, s in zip(com, std, strict=True))
    return x, y, z


def headline(result: Weighing) -> str:
    """The answer: the payload if there was a tare, else the trunk."""
    if (payload := result.payload) is not None:
        answer = f"Payload {with_std(payload.mass, payload.mass_std)} kg"
    else:
        answer = f"Trunk with all that is on it {with_std(result.mass, result.mass_std)} kg"
    return answer if result.is_trusted else f"{answer}, {UNTRUSTED}"


def answer(result: Weighing) -> str:
    """The headline with the centre of mass, as far as it was observed."""
    body = result if result.payload is None else result.payload
    seen = zip("xyz", place(body.com, body.com_std), body.com_std, strict=True)
    known = ", ".join(f"{axis} {text}" for axis, text, std in seen if std == std)
    where = f"centre of mass {known} m in the trunk's frame" if known else "its centre of mass was not observed"
    return f"{headline(result)}; {where}."


def lag_text(lag: tuple[float, float]) -> str:
    """The torques' delay."""
    return f"torques arrive {with_std(1e3 * lag[0], 1e3 * lag[1])} ms late, which is allowed for"


def bodies_table(result: Weighing, truth: Truth | None = None) -> TableData:
    """Mass and centre of mass of the model file's trunk, the trunk found, the payload, and the truth."""
    return TableData.of(f"Weighed by the method {result.method!r}", _HEAD, _bodies(result, truth))


def inertia_table(result: Weighing) -> TableData:
    """The trunk's inertia about its centre of mass, of the model file and as found."""
    found, prior = result.trunk, result.robot.inertias[result.robot.trunk].inertia_com
    std = found.inertia_std if found.observed[4:].all() else np.full(6, np.nan)
    rows = [
        (name, number(prior[i, j]), _marked(result, with_std(found.inertial.inertia_com[i, j], s)))
        for (name, i, j), s in zip(_TENSOR, std, strict=True)
    ]
    about = "The trunk's inertia about its centre of mass, trunk axes; the error bars are of that about the origin."
    return TableData.of("", ("component", "CAD [kg·m²]", "found [kg·m²]"), rows, note=about)


def changes_table(result: Weighing, most: int | None = None) -> TableData:
    """The changes of the load, the first `most` of them."""
    rows = (
        (f"{c.time:.2f}", f"{c.noticed:.2f}", c.kind, _marked(result, with_std(c.mass, c.mass_std)))
        for c in result.changes[:most]
    )
    return TableData.of("Changes of the load", ("about [s]", "noticed [s]", "kind", "mass [kg]"), rows, sides="rrlr")


def refusals_table(result: Weighing, most: int) -> TableData:
    """Times that were not used, and why; the first `most`."""
    rows = ((f"{r.begin:.2f} to {r.end:.2f} s", r.reason) for r in result.refusals[:most])
    return TableData.of("Times not used", ("time", "because"), rows, sides="lw")


def _bodies(result: Weighing, truth: Truth | None) -> Iterator[tuple[str | Cell, ...]]:
    prior, payload = result.robot.inertias[result.robot.trunk], result.payload
    yield "trunk, CAD", number(prior.mass), *_exact(prior.com)
    found = (with_std(result.mass, result.mass_std), *place(result.com, result.com_std))
    yield "trunk with all on it", *(_marked(result, text) for text in found)
    if payload is not None:
        found = (with_std(payload.mass, payload.mass_std), *place(payload.com, payload.com_std))
        yield "payload since the tare", *(_marked(result, text) for text in found)
    if truth is not None:
        moment = truth.at(result.time)
        yield "truth: trunk with all on it", number(moment.mass), *_exact(moment.com)
        if moment.payload_com is not None:
            yield "truth: payload", number(moment.payload_mass), *_exact(moment.payload_com)


def _marked(result: Weighing, figure: str) -> Cell:
    return Cell(figure) if result.is_trusted else Cell(figure, good=False, note=UNTRUSTED)


def _exact(com: Iterable[float]) -> tuple[str, str, str]:
    x, y, z = (number(round(float(value), 6)) for value in com)
    return x, y, z
