"""The tables of a result for the terminal, as rich renderables; Table I's colours, each with a symbol beside."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from stadera.identify.result import MODELS, Identification, LegIdentification, Quantity
from stadera.inertia import ORDER
from stadera.report.findings import findings, judged_part, overall_rmse
from stadera.report.numbers import number, percent
from stadera.report.quantities import MARKS, MODEL_NAMES, shown
from stadera.report.terminal import titled_table

STYLES = {"green": "green", "gray": "bright_black", "red": "red"}
_LEVEL_STYLES = {"bad": "bold red", "warning": "yellow", "note": "dim"}
_LEVEL_WORDS = {"bad": "problem", "warning": "warning", "note": "note"}


def identification_tables(result: Identification) -> Iterator[RenderableType]:
    """Everything `identify` found: the links and joints of each leg, then the errors, then what to be wary of.

    The last thing printed is what a terminal shows, so the judgement comes last.
    """
    for leg in result.legs:
        yield link_table(leg)
        if any(name.split(".")[0] in leg.leg.joints for name in leg.estimate.columns):
            yield joint_table(leg)
    yield legend()
    yield rmse_table(result)
    found = findings(result)
    for level in ("note", "warning", "bad"):  # the worst last, where a terminal is read first
        for finding in found:
            if finding.level == level:
                yield Text(f"{_LEVEL_WORDS[level]}: {finding.text}", style=_LEVEL_STYLES[level])


def link_table(leg: LegIdentification) -> Table:
    """The leg's links side by side, as in the paper's Table I."""
    seen = leg.estimate.observability
    title = f"{leg.leg.name}: rank {seen.rank} of {len(leg.estimate.columns)} parameters"
    table = titled_table(title, ("parameter", *leg.leg.links), "l" * (1 + len(leg.leg.links)))
    for label, quantities in _link_rows(leg):
        table.add_row(Text(label), *(_cell(quantity) for quantity in quantities))
    return table


def joint_table(leg: LegIdentification) -> Table:
    """The leg's joints side by side: rotor inertia, friction and torque offset."""
    terms: dict[str, dict[str, Quantity]] = {}
    for name, quantity in leg.parameters.items():
        owner, term = name.rsplit(".", 1)
        if owner in leg.leg.joints:
            terms.setdefault(term, {})[owner] = quantity
    table = titled_table(f"{leg.leg.name}: joints", ("parameter", *leg.leg.joints), "l" * (1 + len(leg.leg.joints)))
    for term, by_joint in terms.items():
        unit = next(iter(by_joint.values())).unit
        table.add_row(
            Text(f"{term} [{unit}]"), *(_cell(by_joint[j]) if j in by_joint else Text("") for j in leg.leg.joints)
        )
    return table


def rmse_table(result: Identification) -> Table:
    """Torque errors of each joint under each model, and over all joints."""
    part = judged_part(result)
    where = result.validated_on if part == "validation" and result.validated_on else "the training data themselves"
    models = (MODEL_NAMES[model] for model in MODELS[::-1])
    table = titled_table(f"Torque RMSE [N·m] on {where}", ("joint", *models, "against CAD + friction"))
    for leg in result.legs:
        errors = leg.rmse.get(part, {})
        for joint in leg.leg.joints:
            by_model = {m: errors[m][joint] for m in MODELS if joint in errors.get(m, {})}
            table.add_row(Text(joint), *_rmse_cells(by_model))
        table.add_section()
    table.add_row("all", *_rmse_cells(overall_rmse(result, part)), style="bold")
    return table


def legend() -> Text:
    """What the symbols and colours mean."""
    text = Text()
    for mark in MARKS.values():
        text.append(f"{mark.symbol} {mark.word}  ", style=STYLES[mark.colour])
    return text.append("(in square brackets: what was believed before)", style="dim")


def _link_rows(leg: LegIdentification) -> Iterator[tuple[str, list[Quantity]]]:
    links, found = leg.leg.links, leg.parameters
    yield "mass [kg]", [found[f"{link}.m"] for link in links]
    for k, axis in enumerate("xyz"):
        yield f"com {axis} [m]", [leg.coms[link][k] for link in links]
    for name in ORDER[4:]:
        yield f"{name} [kg·m²]", [found[f"{link}.{name}"] for link in links]


def _cell(quantity: Quantity) -> Text:
    mark = MARKS[quantity.verdict]
    text = Text(f"{mark.symbol} {shown(quantity, 'prior')}", style=STYLES[mark.colour])
    return text.append(f" [{number(quantity.prior, 3)}]", style="dim")


def _rmse_cells(errors: Mapping[str, float]) -> list[str]:
    cells = [number(errors[model], 3) if model in errors else "" for model in MODELS[::-1]]
    both = "identified" in errors and "prior_friction" in errors
    return [*cells, percent(errors["identified"], errors["prior_friction"]) if both else ""]
