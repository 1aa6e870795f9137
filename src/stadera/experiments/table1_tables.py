"""Table I as values to be drawn: simulated, identified and CAD, with how far each is known."""

from __future__ import annotations

import numpy as np

from stadera.experiments.recovery import Compared, Recovery
from stadera.experiments.result import Cell, FigureData, Line, Panel, TableData
from stadera.identify.observability import Verdict
from stadera.inertia import ORDER

_LINKS = ("hip assembly", "upper leg", "lower leg")


def first_moment_table(found: Recovery) -> TableData:
    """Mass and centre of mass of each link, as the paper's Table I has them."""
    groups = []
    for words, link in zip(_LINKS, found.leg.leg.links, strict=True):
        mass = next(c for c in found.parameters if c.name == f"{link}.m")
        coms = [c for c in found.coms if c.name.startswith(f"{link}.")]
        groups.append((f"{words} ({link})", _rows([mass, *coms])))
    head = ("", "mass [kg]", "CoM x [m]", "CoM y [m]", "CoM z [m]")
    return TableData("Masses and centres of mass", head, tuple(groups), "In the link's frame.")


def inertia_table(found: Recovery) -> TableData:
    """Inertia of each link about its frame's origin."""
    groups = []
    for words, link in zip(_LINKS, found.leg.leg.links, strict=True):
        entries = [c for c in found.parameters if c.name.startswith(f"{link}.I")]
        groups.append((f"{words} ({link})", _rows(entries)))
    note = "About the origin of the link's frame, in its axes: there, not about the centre of mass, torques are linear."
    return TableData("Inertias [kg·m²]", ("", *ORDER[4:]), tuple(groups), note)


def combination_table(found: Recovery, title: str) -> TableData:
    """Identifiable combinations: simulated, identified, and by how many standard deviations they differ."""
    rows = tuple(
        (
            Cell(c.name),
            Cell(_figure(c.truth)),
            Cell(f"{_figure(c.value)} ± {c.std:.4f}", c.verdict, strong=c.verdict is Verdict.OBSERVABLE),
            Cell(_figure(c.prior)),
            Cell(f"{c.deviations:+.1f} σ"),
        )
        for c in found.combinations
    )
    head = ("combination [kg·m, kg·m²]", "simulated", "identified ± std", "CAD", "off by")
    note = (
        "Sums over links that no motion on a held trunk can take apart. With honest error bars two in three are off by "
        "less than 1 σ, nineteen in twenty by less than 2 σ."
    )
    return TableData(title, head, (("", rows),), note)


def deviation_figure(found: Recovery) -> FigureData:
    """Identifiable combinations beside the simulated ones, in units of what was plausible before."""
    compared = found.combinations
    position = np.arange(len(compared), dtype=float)
    widths = found.prior_widths
    before = np.array([c.prior - c.truth for c in compared]) / widths
    after = np.array([c.value - c.truth for c in compared]) / widths
    stds = np.array([c.std for c in compared]) / widths
    panel = Panel(
        "",
        "",
        "off from simulated [prior widths]",
        (
            Line("CAD", "prior", position, before, "markers"),
            Line("identified ± 1 σ", "identified", position, after, "markers", stds),
        ),
        labels=tuple(c.name.split(" ")[0] + (" + …" if " " in c.name else "") for c in compared),
    )
    note = "0 is the simulated value, 1 the prior's standard deviation; bars are what the estimate says of itself."
    return FigureData("With sensor errors: how far off CAD is, and how far what was identified", (panel,), note)


def _rows(compared: list[Compared]) -> tuple[tuple[Cell, ...], ...]:
    return (
        (Cell("simulated"), *(Cell(_figure(c.truth)) for c in compared)),
        (
            Cell("identified"),
            *(Cell(_figure(c.value), c.verdict, strong=c.verdict is Verdict.OBSERVABLE) for c in compared),
        ),
        (Cell("CAD"), *(Cell(_figure(c.prior)) for c in compared)),
    )


def _figure(value: float) -> str:
    text = f"{value:.4f}"
    return text.removeprefix("-") if float(text) == 0.0 else text
