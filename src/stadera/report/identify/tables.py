"""Tables of an identification for terminal and page, with a symbol in addition to each of Table I's colours."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import RenderableType
from rich.text import Text

from stadera.constants import SAME
from stadera.identify.result import MODELS, Identification, LegIdentification, Quantity
from stadera.inertia import ORDER
from stadera.report.identify.remarks import evaluated_part, level, overall_rmse, remarks, torque_rms, verdict
from stadera.report.numbers import number, percent, with_std
from stadera.report.table import Cell, TableData
from stadera.report.terminal import legend, rich_table
from stadera.report.trust import STYLES, marked

NOT_MEASURED = "not measured"

MODEL_NAMES: dict[str, str] = {"identified": "identified", "prior_friction": "CAD + friction", "prior": "CAD"}
"""Names of the compared models, best first."""


def shown(quantity: Quantity, prior: str = "CAD") -> str:
    """The value as text, without its unit.

    A value that was not measured is marked as such: it is the prior's, or in brackets if the prior or physical
    consistency changed it along with measured values.
    """
    if not quantity.is_held and quantity.std is not None:
        return with_std(quantity.value, quantity.std)
    if abs(quantity.value - quantity.prior) <= SAME * abs(quantity.prior):
        return f"{prior}, {NOT_MEASURED}"
    return f"{NOT_MEASURED} ({number(quantity.value, 3)})"


def compact_cell(quantity: Quantity) -> Cell:
    """Value and prior in one cell."""
    return Cell(shown(quantity, "prior"), quantity.verdict, note=f"[{number(quantity.prior, 3)}]")


def row(name: str, quantity: Quantity, prior: str = "CAD") -> tuple[Cell, ...]:
    """Name with unit, prior, and the value with its standard deviation."""
    held = quantity.is_held
    named = Cell(name, quantity.verdict, note=f"[{quantity.unit}]")
    return named, Cell(number(quantity.prior, 3)), Cell(shown(quantity, prior), strong=not held, muted=held)


_COMPARED = MODELS[::-1]  # best first
LINK_FRAMES = "in each link's own frame and axes, inertia about that frame's origin"
"""Frames of the links' centres of mass and inertias."""


def link_table(leg: LegIdentification) -> TableData:
    """The leg's links side by side, as in the paper's Table I."""
    rank, links = leg.estimate.observability.rank, leg.leg.links
    by_link = [dict(link_quantities(leg, link)) for link in links]
    rows = (
        [Cell(f"{name} [{q.unit}]"), *(compact_cell(found[name]) for found in by_link)]
        for name, q in by_link[0].items()
    )
    title = f"{leg.leg.name}: rank {rank} of {len(leg.estimate.columns)} parameters"
    return TableData.of(title, ("parameter", *links), rows, LINK_FRAMES, "l" * (1 + len(links)))


def joint_table(leg: LegIdentification) -> TableData:
    """The leg's joints side by side: rotor inertia, friction and torque offset."""
    joints, terms = leg.leg.joints, joint_quantities(leg)
    units = {term: quantity.unit for found in terms.values() for term, quantity in found.items()}
    rows = (
        [f"{term} [{unit}]", *(compact_cell(terms[j][term]) if term in terms.get(j, {}) else "" for j in joints)]
        for term, unit in units.items()
    )
    return TableData.of(f"{leg.leg.name}: joints", ("parameter", *joints), rows, sides="l" * (1 + len(joints)))


def tables(result: Identification) -> list[TableData]:
    """Tables for a paper: links and joints of each leg, then the torque errors."""
    found = [table(leg) for leg in result.legs for table in (link_table, joint_table)]
    return [*(table for table in found if any(rows for _, rows in table.groups)), rmse_table(result)]


def rmse_table(result: Identification) -> TableData:
    """Torque errors of each joint under each model, and over all joints."""
    part = evaluated_part(result)
    where = result.validated_on if part == "validation" and result.validated_on else "the training data themselves"
    head = ("joint", "torque RMS", *(MODEL_NAMES[model] for model in _COMPARED), "against CAD + friction")
    legs: dict[str, list[list[Cell]]] = {}
    for leg in result.legs:
        errors, rms = leg.rmse.get(part, {}), torque_rms(leg, part)
        legs[leg.leg.name] = [
            _rmse_row(joint, {m: errors[m][joint] for m in MODELS if joint in errors.get(m, {})}, rms.get(joint))
            for joint in leg.leg.joints
        ]
    body = legs | {"all": [_rmse_row("all joints", overall_rmse(result, part))]}
    return TableData.of(f"Torque RMSE [N·m] on {where}", head, body)


def link_tables(leg: LegIdentification) -> Iterator[TableData]:
    """Each link's mass, centre of mass and inertia, one table per link."""
    for link in leg.leg.links:
        yield quantity_table(link, [row(name, q) for name, q in link_quantities(leg, link)])


def joint_tables(leg: LegIdentification) -> Iterator[TableData]:
    """Each joint's rotor inertia, friction and torque offset, one table per joint."""
    for joint, terms in joint_quantities(leg).items():
        yield quantity_table(joint, [row(term, q, "prior") for term, q in terms.items()], "prior")


def combination_table(leg: LegIdentification) -> TableData:
    """Combinations of parameters that this kind of motion can determine."""
    rows = [row(c.text, Quantity(c.prior, c.value, c.std, c.verdict, c.unit), "prior") for c in leg.combinations]
    return quantity_table("Identifiable combinations of parameters", rows, "prior", "combination")


def quantity_table(title: str, rows: list[tuple[Cell, ...]], prior: str = "CAD", name: str = "parameter") -> TableData:
    """Quantities in rows: prior and identified value."""
    return TableData.of(title, (name, prior, "identified ± std"), rows)


def link_quantities(leg: LegIdentification, link: str) -> Iterator[tuple[str, Quantity]]:
    """Mass, centre of mass and inertia of a link, by name."""
    yield "mass", leg.parameters[f"{link}.m"]
    yield from ((f"com {axis}", quantity) for axis, quantity in zip("xyz", leg.coms[link], strict=True))
    yield from ((name, leg.parameters[f"{link}.{name}"]) for name in ORDER[4:])


def joint_quantities(leg: LegIdentification) -> dict[str, dict[str, Quantity]]:
    """Identified quantities by joint and term."""
    terms: dict[str, dict[str, Quantity]] = {}
    for name, quantity in leg.parameters.items():
        owner, term = name.rsplit(".", 1)
        if owner in leg.leg.joints:
            terms.setdefault(owner, {})[term] = quantity
    return terms


def _rmse_row(joint: str, errors: dict[str, float], rms: float | None = None) -> list[Cell]:
    strong, compared = joint == "all joints", Cell("")
    if {"identified", "prior_friction"} <= errors.keys():
        worse = errors["identified"] > errors["prior_friction"]
        change = percent(errors["identified"], errors["prior_friction"])
        compared = Cell(f"{change} {'worse' if worse else 'better'}", good=not worse)
    cells = [Cell(number(errors[model], 3) if model in errors else "", strong=strong) for model in _COMPARED]
    return [Cell(joint, strong=strong), Cell("" if rms is None else number(rms, 3)), *cells, compared]


_WORDS = {"bad": "problem", "warning": "warning", "note": "note"}


def identification_tables(result: Identification) -> Iterator[RenderableType]:
    """Links and joints of each leg, torque errors, then remarks and verdict.

    The verdict comes last, since a terminal shows the end of the output.
    """
    for leg in result.legs:
        yield rich_table(marked(link_table(leg), result.trust))
        if any(name.split(".")[0] in leg.leg.joints for name in leg.estimate.columns):
            yield rich_table(marked(joint_table(leg), result.trust))
    yield legend(f"({LINK_FRAMES}; in square brackets: the prior)")
    yield rich_table(rmse_table(result))
    for remark in reversed(remarks(result)):
        yield Text(f"{_WORDS[remark.level]}: {remark.text}", style=STYLES[remark.level])
    yield Text(verdict(result), style="bold" if result.trust.verdict == "good" else STYLES[level(result)])
