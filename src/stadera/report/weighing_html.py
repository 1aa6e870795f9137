"""The report of a weighing: one self-contained page, what was found before how it came about."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees

from stadera.estimate.registry import METHODS
from stadera.report.markup import Html, element, row, table, text
from stadera.report.numbers import number, with_std
from stadera.report.page import figure_html, page_html
from stadera.report.sections import card, cards, facts, header, listing, plot, words
from stadera.report.weighed import HEADINGS
from stadera.report.weighing import body_rows, rested
from stadera.report.weighing_plots import balance_figure, com_figure, force_figure, mass_figure
from stadera.simulate.truth import Truth
from stadera.weigh.changes import DEVIATIONS, LEAST_SHARE
from stadera.weigh.result import Weighing

_MOST_REFUSALS = 12
_VERTICAL = {"imu": "by the IMU", "forces": "by the direction of the feet's forces, for the log has no IMU"}
_TERMS = {
    "Trunk": "The base link of the model with all that is fixed to it or lies on it. Centres of mass are in its frame.",
    "Mass": "The ground's upward force, from joint torques, over gravity, less the legs of the model (eq. 7).",
    "±": "One standard deviation, from torque noise and from errors that stay the same over the log; plots show two.",
    "Not observed": "Level poses do not show how high a centre of mass is; poses with the trunk tilted do.",
    "Payload": "What was added since the tare. Errors that both have in common cancel, so it is known better.",
    "Change": f"Two quarters of a second at rest in a row that differ from all before by more than "
    f"{100 * LEAST_SHARE:.0f} % of the robot's mass and {DEVIATIONS:.0f} standard deviations. Shaded: not weighed.",
}


def weighing_html(result: Weighing, truth: Truth | None = None) -> str:
    """A whole page, with plots and their script library inside; it loads nothing from anywhere."""
    title = f"Weighing: {result.robot.name}"
    return page_html(title, _header(result, title), _found(result, truth), *_times(result, truth), words(_TERMS))


def _header(result: Weighing, title: str) -> Html:
    about = {
        "Robot": f"{result.robot.name}, {number(result.robot.mass)} kg by its model",
        "Log": result.source,
        "Time": f"{result.begin:.2f} to {result.end:.2f} s; {rested(result)}",
        "Method": f"{result.method}: {METHODS[result.method].summary}",
        "State": result.status,
        "Vertical": _VERTICAL[result.vertical.source] + f", ±{degrees(result.vertical.tilt_std):.2g}°",
    }
    figures = [card("Trunk with all on it", with_std(result.mass, result.mass_std))]
    if result.payload is not None:
        figures.append(card("Payload since the tare", with_std(result.payload.mass, result.payload.mass_std)))
    figures += [card(f"Change at {c.time:.2f} s", with_std(c.mass, c.mass_std)) for c in result.changes[-2:]]
    return header(title, facts(about), cards(figures), notes=result.notes)


def _found(result: Weighing, truth: Truth | None) -> Html:
    head = [text(heading) for heading in HEADINGS]
    rows = (row(text(name), *(text(figure) for figure in figures)) for name, *figures in body_rows(result, truth))
    return element(
        "section",
        element("h2", text("The balance")),
        table(head, rows, css="numbers"),
        element(
            "p",
            text(
                "At the end of the log, from above, level; the origin is the trunk's. At rest the whole robot's centre "
                "of mass is above the centre of pressure; what is between them here are errors of the joint torques."
            ),
            css="lead",
        ),
        figure_html(balance_figure(result, truth), "Support polygon from above with feet, forces and centres of mass"),
    )


def _times(result: Weighing, truth: Truth | None) -> Iterator[Html]:
    yield plot("Mass over time", "Each point a quarter of a second at rest.", mass_figure(result, truth))
    if len(com_figure(result).data):
        note = (
            "As the method had it at that time; it starts from the model's value, and anew after each change. The "
            "bands do not reckon with a way that it is still on."
        )
        yield plot("Centre of mass over time", note, com_figure(result, truth))
    yield plot("Forces of the ground", "Vertical, foot by foot, from joint torques.", force_figure(result))
    if result.refusals:
        shown = result.refusals[:_MOST_REFUSALS]
        rows = (
            row(text(f"{r.begin:.2f} to {r.end:.2f} s"), element("td", text(r.reason), css="reason")) for r in shown
        )
        listed = table([text("time"), text("because")], rows, css="combinations")
        yield listing("Not weighed", listed, len(result.refusals) - len(shown))
