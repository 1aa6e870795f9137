"""Table I as values for drawing: simulated, identified and CAD, with observability."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from stadera.identify.observability import Identifiability
from stadera.inertia import ORDER
from stadera.lab.experiments.legs.recovery import Compared, Recovery
from stadera.report.figures import Axis, Figure, Panel, Series
from stadera.report.table import Cell, Row, TableData

_LINKS = ("hip assembly", "upper leg", "lower leg")


def first_moment_table(found: Recovery) -> TableData:
    """Mass and centre of mass of each link, in the layout of the paper's Table I."""
    groups = {}
    for words, link in zip(_LINKS, found.leg.leg.links, strict=True):
        mass = next(c for c in found.parameters if c.name == f"{link}.m")
        coms = [c for c in found.coms if c.name.startswith(f"{link}.")]
        groups[f"{words} ({link})"] = _rows([mass, *coms])
    head = ("", "mass [kg]", "CoM x [m]", "CoM y [m]", "CoM z [m]")
    return TableData.of("Masses and centres of mass", head, groups, "In the link's frame.")


def inertia_table(found: Recovery) -> TableData:
    """Inertia of each link about its frame's origin."""
    groups = {}
    for words, link in zip(_LINKS, found.leg.leg.links, strict=True):
        entries = [c for c in found.parameters if c.name.startswith(f"{link}.I")]
        groups[f"{words} ({link})"] = _rows(entries)
    note = "About the origin of the link's frame, in its axes: there, not about the centre of mass, torques are linear."
    return TableData.of("Inertias [kg·m²]", ("", *ORDER[4:]), groups, note)


def combination_table(found: Recovery, title: str) -> TableData:
    """Identifiable combinations: simulated, identified, and their difference in standard deviations."""
    rows = [
        (
            c.name,
            _figure(c.truth),
            Cell(f"{_figure(c.value)} ± {c.std:.4f}", c.verdict, strong=c.verdict is Identifiability.OBSERVABLE),
            _figure(c.prior),
            f"{c.deviations:+.1f} σ",
        )
        for c in found.combinations
    ]
    head = ("combination [kg·m, kg·m²]", "simulated", "identified ± std", "CAD", "off by")
    note = (
        "Sums over links that no motion on a held trunk can take apart. With correct error bars two in three are off "
        "by less than 1 σ, nineteen in twenty by less than 2 σ."
    )
    return TableData.of(title, head, rows, note)


def paper_table(links: Mapping[str, Sequence[Sequence[float]]]) -> TableData:
    """The paper's own Table I: simulated and identified values by link."""
    rows = {
        link: [(name, *map(_figure, values)) for name, values in zip(("simulated", "identified"), both, strict=True)]
        for link, both in links.items()
    }
    head = ("", "mass [kg]", "CoM x [m]", "CoM y [m]", "CoM z [m]", *(f"{name} [kg·m²]" for name in ORDER[4:]))
    return TableData.of("The paper's Table I", head, rows, "Another draw of the perturbation than ours.")


def deviation_figure(found: Recovery) -> Figure:
    """Errors of the identifiable combinations, in units of the prior's standard deviation."""
    compared = found.combinations
    position = np.arange(len(compared), dtype=float)
    widths = found.prior_widths
    before = np.array([c.prior - c.truth for c in compared]) / widths
    after = np.array([c.value - c.truth for c in compared]) / widths
    stds = np.array([c.std for c in compared]) / widths
    names = tuple(c.name.split(" ")[0] + (" + …" if " " in c.name else "") for c in compared)
    marks = (
        Series(before, position, "CAD", "steel", 0.0, marker="dot"),
        Series(after, position, "identified ± 1 σ", "blue", 0.0, marker="dot", x_range=(after - stds, after + stds)),
    )
    panel = Panel(Axis("off from simulated [prior widths]"), Axis(labels=names), marks)
    note = "0 is the simulated value, 1 the prior's standard deviation; bars are the estimate's."
    return Figure("With sensor errors: how far off CAD is, and how far what was identified", ((panel,),), note)


def _rows(compared: list[Compared]) -> list[Row]:
    found = (Cell(_figure(c.value), c.verdict, strong=c.verdict is Identifiability.OBSERVABLE) for c in compared)
    return [
        ("simulated", *(_figure(c.truth) for c in compared)),
        ("identified", *found),
        ("CAD", *(_figure(c.prior) for c in compared)),
    ]


def _figure(value: float) -> str:
    text = f"{value:.4f}"
    return text.removeprefix("-") if float(text) == 0.0 else text
