"""The page of the demo: both walks side by side, to be watched, and what was measured meanwhile."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from stadera.inertia import InertialParameters
from stadera.lab.demo import DemoResult, DemoRun
from stadera.lab.demo.schema import KNOWN, known_after, true_load
from stadera.lab.report.demo.plots import com_figure, force_figure, margin_figure, mass_figure
from stadera.lab.report.demo.terminal import comparison_table, headline, load_table, log_table, verdict
from stadera.report.figures import Figure
from stadera.report.numbers import number, with_std
from stadera.report.page import render, script_data
from stadera.robot import load_robot
from stadera.supervise import LoadTestSettings, State
from stadera.types import Array

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
    (State.WEIGHING, State.WALKING): "updated",
}
_SHADED = {
    False: "Shaded: what the supervisor does, stopping (orange), weighing (blue), updating (green).",
    True: "Shaded: from the moment the load is noticed until controller and planner have the new trunk.",
}


def demo_html(result: DemoResult) -> str:
    """A whole page; it loads nothing from anywhere."""
    settings, identified = result.settings, result.identified.outcome
    return render(
        "demo.html.j2",
        package="stadera.lab.report",
        title="A load on the way",
        headline=headline(result),
        cards=list(_cards(result, true_load(identified))),
        facts=_facts(result),
        walks=[
            {"name": run.name, "survived": run.outcome.survived, "verdict": verdict(run.outcome)} for run in result.runs
        ],
        moments=list(_moments(result)),
        legend=_LEGEND,
        films=script_data(json.dumps(_data(result), separators=(",", ":"), allow_nan=False)),
        comparison=comparison_table(result),
        load=load_table(identified),
        log=log_table(identified),
        plots=list(_plots(result)),
        terms=_terms(settings.nonstop),
    )


def _facts(result: DemoResult) -> dict[str, str]:
    settings = result.settings
    return {
        "Robot": f"{settings.robot}, crawls at {100 * settings.speed:.0f} cm/s",
        "Load": f"a box of {settings.mass:g} kg, dropped on its back's left-hind corner at {settings.load_at:g} s",
        "Sensors": f"standard errors, seed {settings.seed}; nothing of the truth reaches controller or estimators",
        "Simulation": "MuJoCo, 1 kHz",
    }


def _cards(result: DemoResult, load: InertialParameters) -> Iterator[dict[str, str]]:
    """Arguments of the macro `card`."""
    identified, nonstop = result.identified.outcome, result.settings.nonstop
    yield _card("Noticed after", f"{identified.noticed_after:.2f}", "s", good=identified.noticed_after > 0)
    if identified.updated_after is not None:
        label, digits = ("Updated after", 2) if nonstop else ("Walks on after", 1)
        yield _card(label, f"{identified.updated_after:.{digits}f}", "s")
    if nonstop and (known := known_after(result.identified)) is not None:
        share, length = KNOWN
        yield _card(f"Known to {100 * share:g} % and {1e3 * length:g} mm (2σ) after", f"{known:.2f}", "s")
    yield _card("Steps lost", str(identified.steps_lost), "", good=identified.steps_lost == 0)
    if (payload := identified.payload) is not None:
        yield _card(f"Load weighed, truth {number(load.mass)} kg", with_std(payload.mass, payload.mass_std), "kg")
        error = 100.0 * float(np.linalg.norm((identified.model.com_trunk - identified.truth.com)[:2]))
        yield _card("Trunk's centre of mass off by", f"{error:.2f}", "cm in x-y")


def _card(label: str, figure: str, unit: str, good: bool = True) -> dict[str, str]:
    return {"label": label, "figure": figure, "unit": unit, "css": "identified" if good else ""}


# -- the walks ----------------------------------------------------------------------------------------------------
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
        "model": _rounded(film.model, 4),
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


# -- plots and terms ----------------------------------------------------------------------------------------------
def _plots(result: DemoResult) -> Iterator[Figure]:
    yield margin_figure(
        result,
        "Its distance from the nearest edge of the support polygon; below zero the robot tips. "
        f"{_SHADED[result.settings.nonstop]}",
    )
    yield mass_figure(result, _mass_note(result.settings.nonstop))
    yield com_figure(result, f"{result.identified.name.capitalize()}, trunk frame.")
    for run in result.runs:
        yield force_figure(run, result, "True forces.")


def _mass_note(nonstop: bool) -> str:
    if nonstop:
        return (
            "Weighed on the way, 50 times a second. What is known has wide bars when a load has just been noticed; "
            "controller and planner get it as soon as they are narrow. Shown is the time around the load; double-click "
            "for all of it."
        )
    settings = LoadTestSettings()
    return (
        "With identification. At each moment near rest the mass is tested against the present model; with "
        f"{settings.deviations:.2f} standard deviations, {settings.false_alarms:g} false alarms an hour are expected."
    )


def _terms(nonstop: bool) -> dict[str, str]:
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
    return {
        "Support polygon": "The hull of the feet that carry, seen from above. A slow robot stands while its centre of "
        "mass is over it.",
        "Steps lost": "Steps for which there was time, as commanded, while none was taken.",
        **(on_the_way if nonstop else at_rest),
    }
