"""The page of the demo: both walks side by side, to be watched, and what was measured meanwhile."""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stadera.demo import DemoResult, DemoRun
from stadera.inertia import InertialParameters
from stadera.report.demo import KNOWN, comparison_rows, headline, known_after, true_load, verdict, weighed_rows
from stadera.report.demo_plots import com_figure, force_figure, margin_figure, mass_figure
from stadera.report.markup import Html, element, row, table, text
from stadera.report.numbers import number, with_std
from stadera.report.page import page_html
from stadera.report.sections import card, cards, facts, header, plot, words
from stadera.robot import load_robot
from stadera.supervise import LoadTestSettings, State

Array = NDArray[np.float64]

_LEGEND = (
    ("truth", "●", "true centre of mass of robot and load"),
    ("belief", "○", "centre of mass as controller and planner have it"),
    ("polygon", "■", "support polygon; red while the true centre of mass is outside it"),
    ("force", "▲", "the ground's vertical force on a foot"),
    ("box", "■", "the load"),
)

_MOMENTS = {
    (State.CONVERGED, State.WALKING): "walks on",
    (State.WALKING, State.WEIGHING): "noticed",
    (State.WEIGHING, State.WALKING): "taken over",
}
_SHADED = {
    False: "Shaded: what the supervisor does, stopping (orange), weighing (blue), taking over (green).",
    True: "Shaded: from the moment the load is noticed until controller and planner have the new trunk.",
}


def demo_html(result: DemoResult) -> str:
    """A whole page; it loads nothing from anywhere."""
    sections = (_header(result), _walks(result), *_numbers(result), *_plots(result), _words(result.settings.nonstop))
    return page_html("A load on the way", *sections)


def _header(result: DemoResult) -> Html:
    settings, identified = result.settings, result.identified.outcome
    load = true_load(identified)
    about = {
        "Robot": f"{settings.robot}, crawls at {100 * settings.speed:.0f} cm/s",
        "Load": f"a box of {settings.mass:g} kg, dropped on its back's left-hind corner at {settings.load_at:g} s",
        "Sensors": f"standard errors, seed {settings.seed}; nothing of the truth reaches controller or estimators",
        "Simulation": "MuJoCo, 1 kHz",
    }
    lead = element("p", text(headline(result)), css="lead")
    return header("A load on the way", lead, facts(about), cards(_figures(result, load)))


def _figures(result: DemoResult, load: InertialParameters) -> list[Html]:
    identified, nonstop = result.identified.outcome, result.settings.nonstop
    figures = [card("Noticed after", f"{identified.noticed_after:.2f}", "s", good=identified.noticed_after > 0)]
    if identified.taken_over_after is not None:
        label, digits = ("Taken over after", 2) if nonstop else ("Walks on after", 1)
        figures.append(card(label, f"{identified.taken_over_after:.{digits}f}", "s"))
    if nonstop and (known := known_after(result.identified)) is not None:
        share, length = KNOWN
        figures.append(card(f"Known to {100 * share:g} % and {1e3 * length:g} mm (2σ) after", f"{known:.2f}", "s"))
    figures.append(card("Steps lost", str(identified.steps_lost), "", good=identified.steps_lost == 0))
    if (payload := identified.payload) is not None:
        mass = with_std(payload.mass, payload.mass_std)
        figures.append(card(f"Load weighed, truth {number(load.mass)} kg", mass, "kg"))
        error = 100.0 * float(np.linalg.norm((identified.believed.com_trunk - identified.truth.com)[:2]))
        figures.append(card("Trunk's centre of mass off by", f"{error:.2f}", "cm in x-y"))
    return figures


# -- the walks ----------------------------------------------------------------------------------------------------
def _walks(result: DemoResult) -> Html:
    keys = (
        element("span", element("b", text(mark), css=name), " ", text(meaning), css="key")
        for name, mark, meaning in _LEGEND
    )
    jumps = (
        element("button", text(label), type="button", **{"data-jump": f"{time:.3f}"})
        for label, time in _moments(result)
    )
    controls = element(
        "div",
        element("button", text("Play"), type="button", id="play"),
        element("input", type="range", id="moment", min="0", max="1", value="0", **{"aria-label": "time"}),
        element("output", id="clock"),
        element("select", *(_speed(s) for s in (0.25, 0.5, 1, 2)), id="speed", **{"aria-label": "speed"}),
        css="controls",
    )
    script = (resources.files("stadera.report") / "walk_view.js").read_text(encoding="utf-8")
    data = json.dumps(_data(result), separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
    return element(
        "section",
        element("h2", text("The same walk twice")),
        element("div", *(_walk(run) for run in result.runs), css="beside walks"),
        controls,
        element("p", text("Look at: "), *jumps, css="jumps"),
        element("p", *keys, css="legend"),
        element("script", Html(data), type="application/json", id="walks"),
        element("script", Html(script)),
    )


def _speed(value: float) -> Html:
    chosen = {"selected": "selected"} if value == 1 else {}
    return element("option", text(f"{value:g}x"), value=f"{value:g}", **chosen)


def _walk(run: DemoRun) -> Html:
    ok = run.outcome.survived
    return element(
        "figure",
        element(
            "figcaption",
            element("strong", text(run.name.capitalize())),
            " ",
            element("span", text(verdict(run.outcome)), css="good" if ok else "bad"),
        ),
        element("canvas", css="side", role="img", **{"aria-label": f"{run.name}, from the side"}),
        element("canvas", css="top", role="img", **{"aria-label": f"{run.name}, from above"}),
        element("p", css="told"),
        css="walk",
    )


def _moments(result: DemoResult) -> Iterator[tuple[str, float]]:
    """Moments worth a look, in the order of time."""
    yield "the box lands", result.settings.load_at + 0.12
    if result.without.outcome.least_margin < 0.0:
        yield "the worst without identification", float(result.without.film.time[_worst(result.without)])
    for transition in result.identified.outcome.transitions:
        if transition.after is not State.STOPPING or transition.time < result.settings.load_at + 3.0:
            yield _MOMENTS.get((transition.before, transition.after), str(transition.after)), transition.time + 0.04
    yield "the end", result.identified.outcome.seconds


def _worst(run: DemoRun) -> int:
    """The frame of the least margin since the load."""
    since = run.film.time >= run.outcome.loaded_at
    return int(np.argmin(np.where(since & np.isfinite(run.film.margin), run.film.margin, np.inf)))


def _data(result: DemoResult) -> dict[str, Any]:
    robot, film = load_robot(result.settings.robot), result.without.film
    every = float(np.median(np.diff(film.time)))
    return {
        "every": round(every, 6),
        "start": _worst(result.without),
        "foot": max(leg.foot_radius for leg in robot.legs),
        "feet": [leg.name for leg in robot.legs],
        "films": [_film(run) for run in result.runs],
    }


def _film(run: DemoRun) -> dict[str, Any]:
    film = run.film
    states = sorted(set(film.state))
    return {
        "time": _rounded(film.time, 2),
        "legs": _rounded(film.legs),
        "trunk": _rounded(film.trunk),
        "box": _rounded(film.box),
        "com": _rounded(film.com, 4),
        "believed": _rounded(film.believed, 4),
        "force": _rounded(film.force, 0),
        "down": film.down.tolist(),
        "margin": _rounded(film.margin, 4),
        "states": states,
        "state": [states.index(state) for state in film.state],
        "fell": run.outcome.fall is not None,
    }


def _rounded(values: Array, digits: int = 3) -> Any:
    """As nested lists, None for what is not there."""
    rounded = np.round(values, digits).astype(object)
    rounded[np.isnan(values)] = None
    return rounded.tolist()


# -- numbers and plots --------------------------------------------------------------------------------------------
def _numbers(result: DemoResult) -> Iterator[Html]:
    names = [text("since the load came on"), *(text(run.name) for run in result.runs)]
    compared = (row(text(name), *(text(figure) for figure in figures)) for name, *figures in comparison_rows(result))
    outcome = result.identified.outcome
    weighed = (row(text(name), *(text(figure) for figure in figures)) for name, *figures in weighed_rows(outcome))
    head = [text(title) for title in ("trunk frame", "mass [kg]", "com x [m]", "com y [m]", "com z [m]")]
    yield element(
        "section",
        element("h2", text("What was measured")),
        table(names, compared),
        element("h3", text("The load")),
        table(head, weighed),
    )
    log = (
        row(text(f"{t.time:.2f} s"), element("td", text(t.after)), element("td", text(t.reason), css="reason"))
        for t in outcome.transitions
    )
    yield element(
        "section",
        element("h2", text("What the supervisor did")),
        table([text("time"), text("state"), text("because")], log, css="combinations log"),
    )


def _plots(result: DemoResult) -> Iterator[Html]:
    yield plot(
        "Margin of the true centre of mass",
        "Its distance from the nearest edge of the support polygon; below zero the robot tips. "
        f"{_SHADED[result.settings.nonstop]}",
        margin_figure(result),
    )
    yield plot("Mass", _mass_note(result.settings.nonstop), mass_figure(result))
    way = result.identified.name.capitalize()
    yield plot("Centre of mass of the trunk with its load", f"{way}, trunk frame.", com_figure(result))
    for run in result.runs:
        yield plot(f"Forces on the feet, {run.name}", "As they were.", force_figure(run, result))


def _mass_note(nonstop: bool) -> str:
    if nonstop:
        return (
            "Weighed on the way, 50 times a second. What is known has wide bars when a load has just been noticed; "
            "controller and planner get it as soon as they are narrow. Shown is the time around the load; double-click "
            "for all of it."
        )
    settings = LoadTestSettings()
    return (
        "With identification. At each moment near rest the mass is tested against what is believed; with "
        f"{settings.deviations:.2f} standard deviations, {settings.false_alarms:g} false alarms an hour are expected."
    )


def _words(nonstop: bool) -> Html:
    at_rest = {
        "Check": "Near rest, the ground's upward force from joint torques, over the specific force, less the legs.",
        "Weighing": "First the mass (eq. 7), then the centre of mass from the contact forces' line of action, approach "
        "(c); both have to converge before controller and planner get either.",
        "Not observed": "A level trunk at rest does not show how high a centre of mass is.",
    }
    on_the_way = {
        "Weighing on the way": "Joint torques, joint angles, gyro and accelerometer of every 20 ms give six equations "
        "that are linear in the trunk's mass and centre of mass, whatever the robot does.",
        "Noticed": "The last rows fit a trunk that jumped better than one that is as it was, by a factor of 10¹⁵.",
    }
    terms = {
        "Support polygon": "The hull of the feet that carry, seen from above. A slow robot stands while its centre of "
        "mass is over it.",
        "Steps lost": "Steps for which there was time, as commanded, while none was taken.",
        **(on_the_way if nonstop else at_rest),
    }
    return words(terms, "How to read this")
