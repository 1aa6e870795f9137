"""Tables of an identification for terminal and page, with a symbol in addition to each of Table I's colours."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import nan

from rich.console import RenderableType
from rich.text import Text

from stadera.constants import NOTHING, SAME
from stadera.identify.result import Identification, LegIdentification, Quantity
from stadera.inertia import ORDER
from stadera.report.identify.remarks import evaluated_part, level, overall_rmse, remarks, torque_rms, verdict
from stadera.report.numbers import compared, counted, listed, number, with_std
from stadera.report.table import Cell, TableData
from stadera.report.terminal import legend, rich_table
from stadera.report.trust import STYLES, marked

NOT_MEASURED = "not measured"

MODEL_NAMES: dict[str, str] = {"identified": "identified", "prior_friction": "CAD + friction", "prior": "CAD"}
"""Names of the compared models, best first."""

LINK_FRAMES = "in each link's own frame and axes, inertia about that frame's origin"
"""Frames of the links' centres of mass and inertias."""


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


def _prior(quantity: Quantity) -> str:
    """The prior, zero except for rounding as zero."""
    return number(quantity.prior if abs(quantity.prior) > NOTHING else 0.0, 3)


def _compact(quantity: Quantity | None) -> Cell | str:
    """Value and prior in one cell."""
    if quantity is None:
        return ""
    return Cell(shown(quantity, "prior"), quantity.verdict, note=f"[{_prior(quantity)}]")


def _drive(quantity: Quantity | None) -> Cell | str:
    """As `_compact`, without the number of a value that was not measured, and without a prior of zero."""
    if quantity is None:
        return ""
    if quantity.is_held:
        return Cell(NOT_MEASURED, quantity.verdict, muted=True)
    prior = f"[{_prior(quantity)}]" if abs(quantity.prior) > NOTHING else ""
    return Cell(shown(quantity), quantity.verdict, note=prior)


def _row(name: str, quantity: Quantity) -> tuple[Cell, ...]:
    """Name with unit, prior, and the value with its standard deviation."""
    named = Cell(name, quantity.verdict, note=f"[{quantity.unit}]")
    return named, Cell(_prior(quantity)), Cell(shown(quantity), strong=True)


def leg_table(result: Identification) -> TableData:
    """One row for each leg: directions determined, torque error, misfit, and physical consistency."""
    part, rows = evaluated_part(result), []
    for leg in result.legs:
        name, seen = leg.leg.name, leg.estimate.observability
        errors = overall_rmse(result, part, (name,))
        rows.append(
            (
                Cell(name, strong=True),
                f"{seen.rank} of {leg.structural_rank}",
                number(errors["identified"], 3) if errors.get("identified") else "none",
                _against_cad(errors),
                number(result.trust.by_leg.get(name, nan), 3),
                "yes" if leg.estimate.is_physical else Cell("NO", good=False),
            )
        )
    columns = ("directions determined", "torque RMSE [N·m]", "against CAD + friction", "misfit", "physically possible")
    return TableData.of("Legs at a glance", ("leg", *columns), rows)


def link_table(leg: LegIdentification) -> TableData:
    """The leg's links side by side, as in the paper's Table I."""
    rank, links = leg.estimate.observability.rank, leg.leg.links
    by_link = [_link_quantities(leg, link) for link in links]
    rows = (
        [Cell(f"{name} [{q.unit}]"), *(_compact(found[name]) for found in by_link)] for name, q in by_link[0].items()
    )
    title = f"{leg.leg.name}: rank {rank} of {len(leg.estimate.columns)} parameters"
    return TableData.of(title, ("parameter", *links), rows, LINK_FRAMES, "l" * (1 + len(links)))


def drives_table(result: Identification) -> TableData:
    """A row for each joint of all legs: rotor inertia, friction and torque offset; no rows if none were fitted."""
    of_leg = {leg.leg.name: _joint_quantities(leg) for leg in result.legs}
    units = {t: q.unit for joints in of_leg.values() for terms in joints.values() for t, q in terms.items()}
    body = {
        leg: [[joint, *(_drive(terms.get(term)) for term in units)] for joint, terms in joints.items()]
        for leg, joints in of_leg.items()
        if joints
    }
    head = ("joint", *(f"{term} [{unit}]" for term, unit in units.items()))
    return TableData.of("Drives: rotor inertia, friction, torque offset", head, body, sides="l" * len(head))


def tables(result: Identification) -> list[TableData]:
    """Tables for a paper: links of each leg, drives, then the torque errors."""
    drives = drives_table(result)
    trunk = [] if result.trunk is None else [trunk_table(result)]
    return [*map(link_table, result.legs), *trunk, *([drives] if drives.groups else []), rmse_table(result)]


def trunk_table(result: Identification) -> TableData:
    """The trunk of a robot on its feet, payload included, beside the model's."""
    assert result.trunk is not None
    prior, found = result.robot.inertias[result.robot.trunk], result.trunk
    names = ("mass [kg]", "com x [m]", "com y [m]", "com z [m]")
    values = zip(
        names, (prior.mass, *prior.com), (found.inertial.mass, *found.inertial.com), (found.mass_std, *found.com_std),
        strict=True,
    )  # fmt: skip
    rows = [
        [name, number(model, 3), number(value, 4), number(std, 2) if std == std else "not observed"]
        for name, model, value, std in values
    ]
    return TableData.of(f"Trunk ({result.robot.trunk}), payload included", ("", "model", "value", "std"), rows)


def rmse_table(result: Identification) -> TableData:
    """Torque errors of each joint under each model, and over all joints."""
    part = evaluated_part(result)
    where = result.validated_on if part == "validation" and result.validated_on else "the training data themselves"
    head = ("joint", "torque RMS", *MODEL_NAMES.values(), "against CAD + friction")
    legs: dict[str, list[list[Cell]]] = {}
    for leg in result.legs:
        errors, rms = leg.rmse.get(part, {}), torque_rms(leg, part)
        legs[leg.leg.name] = [
            _rmse_row(joint, {m: found[joint] for m, found in errors.items() if joint in found}, rms.get(joint))
            for joint in leg.leg.joints
        ]
    body = legs | {"all": [_rmse_row("all joints", overall_rmse(result, part))]}
    return TableData.of(f"Torque RMSE [N·m] on {where}", head, body)


def _rmse_row(joint: str, errors: dict[str, float], rms: float | None = None) -> list[Cell]:
    strong = joint == "all joints"
    cells = [Cell(number(errors[model], 3) if model in errors else "", strong=strong) for model in MODEL_NAMES]
    return [Cell(joint, strong=strong), Cell("" if rms is None else number(rms, 3)), *cells, _against_cad(errors)]


def _against_cad(errors: dict[str, float]) -> Cell:
    """How much smaller an error is than that of CAD with fitted friction."""
    if not {"identified", "prior_friction"} <= errors.keys():
        return Cell("")
    found, cad = errors["identified"], errors["prior_friction"]
    return Cell(compared(found, cad), good=found <= cad)


def link_tables(leg: LegIdentification) -> Iterator[TableData]:
    """What was measured of each link's mass, centre of mass and inertia, a table a link; its note names the rest."""
    for link in leg.leg.links:
        found = _link_quantities(leg, link)
        hidden = [name for name, quantity in found.items() if quantity.is_held]
        table = _quantity_table(link, found, "CAD", "parameter")
        yield replace(table, note=f"Not measured: {listed(hidden)}." if hidden else "")


def combination_table(leg: LegIdentification) -> TableData:
    """The measured ones of the combinations of parameters that this kind of motion can determine; its note counts the
    others.
    """
    found = {c.text: Quantity(c.prior, c.value, c.std, c.verdict, c.unit) for c in leg.combinations}
    hidden = sum(quantity.is_held for quantity in found.values())
    table = _quantity_table("Identifiable combinations of parameters", found, "prior", "combination")
    return replace(table, note=f"{counted(hidden, 'more combination')} not measured." if hidden else "")


def _quantity_table(title: str, found: Mapping[str, Quantity], prior: str, name: str) -> TableData:
    """Measured quantities in rows: prior and identified value."""
    rows = [_row(text, quantity) for text, quantity in found.items() if not quantity.is_held]
    return TableData.of(title, (name, prior, "identified ± std"), rows)


def _link_quantities(leg: LegIdentification, link: str) -> dict[str, Quantity]:
    """Mass, centre of mass and inertia of a link, by name."""
    com = {f"com {axis}": quantity for axis, quantity in zip("xyz", leg.coms[link], strict=True)}
    return {"mass": leg.parameters[f"{link}.m"], **com, **{n: leg.parameters[f"{link}.{n}"] for n in ORDER[4:]}}


def _joint_quantities(leg: LegIdentification) -> dict[str, dict[str, Quantity]]:
    """Identified quantities by joint and term."""
    terms: dict[str, dict[str, Quantity]] = {}
    for name, quantity in leg.parameters.items():
        owner, term = name.rsplit(".", 1)
        if owner in leg.leg.joints:
            terms.setdefault(owner, {})[term] = quantity
    return terms


def identification_tables(result: Identification) -> Iterator[RenderableType]:
    """Links of each leg, drives, torque errors, then remarks and verdict.

    The verdict comes last, since a terminal shows the end of the output.
    """
    *found, errors = tables(result)
    yield from (rich_table(marked(table, result.trust)) for table in found)
    yield legend(f"({LINK_FRAMES}; in square brackets: the prior)")
    yield rich_table(errors)
    for remark in reversed(remarks(result)):
        word = {"bad": "problem"}.get(remark.level, remark.level)
        yield Text(f"{word}: {remark.text}", style=STYLES[remark.level])
    yield Text(verdict(result), style="bold" if result.trust.verdict == "good" else STYLES[level(result)])
