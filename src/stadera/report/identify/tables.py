"""Tables of an identification, for terminal and page."""

from __future__ import annotations

from collections.abc import Iterator

from stadera.identify.result import MODELS, Identification, LegIdentification, Quantity
from stadera.inertia import ORDER
from stadera.report.identify.quantities import MODEL_NAMES, compact_cell, row
from stadera.report.identify.remarks import evaluated_part, overall_rmse, torque_rms
from stadera.report.numbers import number, percent
from stadera.report.table import Cell, TableData

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
