"""The report of a weighing in motion: one self-contained page."""

from __future__ import annotations

from collections.abc import Iterator

from stadera.report.markup import Html, element, row, table, text
from stadera.report.motion import inertia_rows, lag_text, motion_rows
from stadera.report.numbers import number, with_std
from stadera.report.page import page_html
from stadera.report.sections import card, cards, facts, header, listing, plot, words
from stadera.report.weighed import HEADINGS
from stadera.report.weighing_plots import com_figure, mass_figure
from stadera.simulate.truth import Truth
from stadera.weigh.in_motion import MotionWeighing

_MOST_LISTED = 12
_TERMS = {
    "Trunk": "The base link of the model with all that is fixed to it or lies on it. Centres of mass are in its frame.",
    "±": "One standard deviation, from sensor noise and from errors that stay the same over the log (torque offsets, "
    "accelerometer bias); plots show two.",
    "Not observed": "Motion shows what it excites: a robot that stands still does not show how high its centre of mass "
    "is, nor its inertia. What was not seen is not shown as if it were.",
    "Payload": "What was added since the tare. Errors that both have in common cancel, so it is known better.",
    "Change": "The equations of motion were no longer met by what was known; from there on the trunk is found anew. "
    "Dotted in the plots.",
}


def motion_html(result: MotionWeighing, truth: Truth | None = None) -> str:
    """A whole page, with plots and their script library inside; it loads nothing from anywhere."""
    title = f"Weighing in motion: {result.robot.name}"
    return page_html(title, _header(result, title), _found(result, truth), *_times(result, truth), words(_TERMS))


def _header(result: MotionWeighing, title: str) -> Html:
    about = {
        "Robot": f"{result.robot.name}, {number(result.robot.mass)} kg by its model",
        "Log": result.source,
        "Time": f"{result.begin:.2f} to {result.end:.2f} s",
        "Method": "walking: every instant, whatever the motion; torque offsets as unknowns",
        "State": result.status,
        "Torques": lag_text(result),
    }
    mass_std = float(result.trunk.covariance[0, 0]) ** 0.5
    figures = [card("Trunk with all on it", with_std(result.trunk.inertial.mass, mass_std))]
    if result.payload is not None:
        figures.append(card("Payload since the tare", with_std(result.payload.mass, result.payload.mass_std)))
    figures += [card(f"{c.kind} at {c.time:.2f} s", with_std(c.mass, c.mass_std)) for c in result.changes[-2:]]
    return header(title, facts(about), cards(figures), notes=result.notes)


def _found(result: MotionWeighing, truth: Truth | None) -> Html:
    head = [text(heading) for heading in HEADINGS]
    bodies = (row(text(name), *(text(figure) for figure in figures)) for name, *figures in motion_rows(result, truth))
    tensor = (row(text(name), text(prior), text(found)) for name, prior, found in inertia_rows(result))
    about = "The trunk's inertia about its centre of mass, trunk axes; the error bars are of that about the origin."
    return element(
        "section",
        element("h2", text("What it weighs")),
        table(head, bodies, css="numbers"),
        element("p", text(about), css="lead"),
        table([text(t) for t in ("component", "CAD [kg·m²]", "found [kg·m²]")], tensor, css="numbers"),
    )


def _times(result: MotionWeighing, truth: Truth | None) -> Iterator[Html]:
    yield plot("Mass over time", "As it was known at that time.", mass_figure(result, truth))
    if len((figure := com_figure(result, truth)).data):
        yield plot("Centre of mass over time", "As it was known at that time; a gap where it was not.", figure)
    if result.changes:
        head = [text(t) for t in ("about [s]", "noticed [s]", "kind", "mass [kg]")]
        shown = result.changes[:_MOST_LISTED]
        rows = (
            row(text(f"{c.time:.2f}"), text(f"{c.noticed:.2f}"), text(c.kind), text(with_std(c.mass, c.mass_std)))
            for c in shown
        )
        yield listing("Changes of the load", table(head, rows, css="numbers"), len(result.changes) - len(shown))
    if result.refusals:
        refused = result.refusals[:_MOST_LISTED]
        rows = (
            row(text(f"{r.begin:.2f} to {r.end:.2f} s"), element("td", text(r.reason), css="reason")) for r in refused
        )
        listed = table([text("time"), text("because")], rows, css="combinations")
        yield listing("Nothing learnt", listed, len(result.refusals) - len(refused))
