"""Page of the demo: both walks in one animated scene, and the measured results."""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib import resources

import numpy as np
from markupsafe import Markup

from stadera.inertia import InertialParameters
from stadera.lab.demo import DemoResult
from stadera.lab.demo.schema import KNOWN, known_after, true_load
from stadera.lab.report.demo.plots import com_figure, margin_figure, mass_figure
from stadera.lab.report.demo.scene import scene
from stadera.lab.report.demo.terminal import comparison_table, headline, load_table, log_table
from stadera.report.figures import Figure
from stadera.report.numbers import number, with_std
from stadera.report.page import render, script_data

_LEGEND = (
    ("truth", "●", "true centre of mass of robot and box"),
    ("model", "○", "centre of mass as controller and planner have it"),
    ("polygon", "■", "support polygon; red while the true centre of mass is outside it"),
    ("force", "▲", "the ground's forces on the feet"),
    ("hot", "■", "a link whose drive is at its torque limit"),
)


def demo_html(result: DemoResult) -> str:
    """The complete, self-contained page."""
    settings, identified = result.settings, result.identified.outcome
    drawn = scene(result)
    return render(
        "demo.html.j2",
        package="stadera.lab.report",
        title=f"{settings.mass:g} kg land on a walking robot",
        headline=headline(result),
        scene_label="Two robots side by side. " + headline(result),
        moments=[(event["mark"], event["time"] + 0.05) for event in _marked(drawn["runs"])],
        legend=_LEGEND,
        scene=script_data(json.dumps(drawn, separators=(",", ":"), allow_nan=False)),
        library=Markup((resources.files("stadera.lab.report") / "vendor" / "three.min.js").read_text(encoding="utf-8")),
        comparison=comparison_table(result),
        cards=list(_cards(result, true_load(identified))),
        load=load_table(identified) if identified.payload is not None else None,
        log=log_table(identified),
        plots=list(_plots(result)),
        terms=_terms(settings.classic),
        facts=_facts(result),
    )


def _marked(runs: list[dict[str, list[dict[str, str | float]]]]) -> list[dict[str, float]]:
    """Moments of interest, without duplicates, in order of time."""
    marks = {str(event["mark"]): event for run in runs for event in run["events"] if "mark" in event}
    return sorted(marks.values(), key=lambda event: event["time"])  # type: ignore[return-value, arg-type]


def _facts(result: DemoResult) -> dict[str, str]:
    settings = result.settings
    x, y, z = (f"{100.0 * edge:.0f}" for edge in settings.size)
    return {
        "Robot": f"{settings.robot}, crawls at {100 * settings.speed:.0f} cm/s",
        "Box": f"{settings.mass:g} kg, {x} × {y} × {z} cm, let go {100.0 * settings.height:.0f} cm above the back's "
        f"{settings.corner} corner, at {settings.load_at:g} s",
        "Both runs": "the same controller, planner, limits and errors; in one of them the estimated trunk is fed back",
        "Sensors": f"standard errors, seed {settings.seed}; nothing of the truth reaches controller or estimators",
        "Simulation": "MuJoCo, 1 kHz; after a fall the drives brake",
    }


def _cards(result: DemoResult, load: InertialParameters) -> Iterator[dict[str, str]]:
    """Arguments of the macro `card`, for the run with identification."""
    identified = result.identified.outcome
    yield _card("Noticed after", f"{identified.noticed_after:.2f}", "s")
    if identified.updated_after is not None:
        yield _card("Walks by the new trunk after", f"{identified.updated_after:.2f}", "s")
    if (known := known_after(result.identified)) is not None:
        share, length = KNOWN
        yield _card(f"Known to {100 * share:g} % and {1e3 * length:g} mm (2σ) after", f"{known:.2f}", "s")
    if (payload := identified.payload) is not None:
        yield _card(f"Box weighed, truth {number(load.mass)} kg", with_std(payload.mass, payload.mass_std), "kg")
    error = 100.0 * float(np.linalg.norm((identified.model.com_trunk - identified.truth.com)[:2]))
    yield _card("Trunk's centre of mass off by", f"{error:.1f}", "cm in x-y")


def _card(label: str, figure: str, unit: str) -> dict[str, str]:
    return {"label": label, "figure": figure, "unit": unit}


def _plots(result: DemoResult) -> Iterator[Figure]:
    shaded = "Shaded: from the moment the load is noticed until controller and planner have the new trunk."
    if result.settings.classic:
        shaded = "Shaded: what the supervisor does, stopping (orange), weighing (gray, blue), updating (green)."
    note = f"Its distance from the nearest edge of the support polygon; below zero the robot tips. {shaded}"
    yield margin_figure(result, note)
    yield mass_figure(result, "With identification, around the load.")
    yield com_figure(result, "With identification, trunk frame.")


def _terms(classic: bool) -> dict[str, str]:
    noticed = {
        "Noticed": "Joint torques, joint angles, gyro and accelerometer of every 20 ms give six equations that are "
        "linear in the trunk's mass and centre of mass, whatever the robot does. The last of them fit a trunk that "
        "jumped better than one that is as it was, by a factor of 10¹⁵.",
    }
    at_rest = {
        "Weighing": "First the mass, from the sum of the contact forces, then the centre of mass, from their line of "
        "action (the paper's approach (c)); both have to converge before controller and planner get either.",
        "Not observed": "A level trunk at rest does not show how high a centre of mass is.",
    }
    on_the_way = {"Weighed on the way": "By the same equations, from the jump on, while the robot walks."}
    return {
        "Walked, stuck, fell": "Fell: the trunk tilted by 45°, or trunk, hip or knee on the ground. Stuck: not half of "
        "the commanded way or steps in the last gait cycle, a joint at its torque limit for 0.5 s, or the trunk 15 % "
        "too low for 0.8 s.",
        "Support polygon": "The hull of the feet that carry, seen from above. A slow robot stands while its centre of "
        "mass is over it.",
        "Steps lost": "Steps for which there was time, as commanded, while none was taken.",
        **noticed,
        **(at_rest if classic else on_the_way),
    }
