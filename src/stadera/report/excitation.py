"""The report of an excitation: one page with what it would tell, against random draws, and the motion itself."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from stadera.identify.excite import Excitation
from stadera.report.excitation_summary import appraisals, verdict
from stadera.report.markup import Html, element, row, table, text
from stadera.report.numbers import number
from stadera.report.page import figure_html, page_html
from stadera.report.plots import short, styled
from stadera.report.sections import facts, header, words

Array = NDArray[np.float64]

_BLUE, _STEEL, _RED = "#0b6bcb", "#9aa4b2", "#b3261e"
_SHOWN = 30.0  # s of the motion in the plot
_RATE = 100.0  # Hz in the plot
_LONGEST = 60  # characters of a combination's name beside a plot
_TERMS = {
    "Information gain": "How much less uncertain all parameters together are after the log than before, by the prior "
    "model and the stated torque noise. One nat more is a standard deviation 2.7 times smaller in one direction.",
    "Combination": "A sum of parameters that the leg's torques depend on. A single parameter of a leg on a held trunk "
    "often cannot be told from others; its combination can.",
    "Known": "Better after the log than it was before it, by the spread that the model is believed to have.",
    "Torque": "What the prior model predicts for the motion, friction included where the model states it.",
    "Distance": "Between the shapes of this leg and of all else, the other legs standing still. As true as they are.",
}


def excitation_html(result: Excitation) -> str:
    """A whole page, with plots and their script library inside; it loads nothing from anywhere."""
    return page_html(
        f"Excitation: {result.experiment.bounds.robot.name} {result.experiment.bounds.leg}",
        _header(result),
        _worth(result),
        _motion(result),
        words(_TERMS),
    )


def std_figure(result: Excitation) -> go.Figure:
    """Standard deviation of each identifiable combination as a share of the prior's: the motion's and the draws'."""
    names = [_cut(str(combination)) for combination in result.combinations]
    figure = go.Figure()
    if result.draws:
        spread = 100.0 * np.array([draw.std for draw in result.draws])
        median = np.median(spread, axis=0)
        reach = {"array": spread.max(axis=0) - median, "arrayminus": median - spread.min(axis=0), "thickness": 1.5}
        figure.add_scatter(
            x=median,
            y=names,
            error_x={"type": "data", "symmetric": False, "width": 4, "color": _STEEL, **reach},
            mode="markers",
            marker={"color": _STEEL, "size": 9, "symbol": "diamond"},
            name=f"random draws, median and range of {len(result.draws)}",
            hovertemplate="%{x:.3g} %<extra>random</extra>",
        )
    figure.add_scatter(
        x=100.0 * result.chosen.std,
        y=names,
        mode="markers",
        marker={"color": _BLUE, "size": 10},
        name="optimised" if result.draws else "random draw",
        hovertemplate="%{x:.3g} %<extra>this motion</extra>",
    )
    figure.update_xaxes(type="log", title_text="standard deviation, share of the prior's [%]", dtick=1)
    figure.update_yaxes(autorange="reversed", automargin=True, tickfont_size=11)
    figure.add_vline(x=100.0, line={"color": _RED, "dash": "dot", "width": 1})
    return styled(figure, 120 + 24 * len(names))


def motion_figure(result: Excitation) -> go.Figure:
    """Position, velocity and predicted torque of the three joints over the first half minute, with their bounds."""
    bounds = result.experiment.bounds
    sampled = result.chosen.motion.sample(_RATE)
    until = sampled.time <= _SHOWN
    torque = bounds.torque(sampled.motion)
    rows = (
        ("position [rad]", sampled.position, bounds.lower, bounds.upper),
        ("velocity [rad/s]", sampled.velocity, -bounds.velocity, bounds.velocity),
        ("torque [N·m]", torque, -bounds.effort, bounds.effort),
    )
    figure = make_subplots(rows=3, cols=3, shared_xaxes=True, column_titles=list(bounds.joints), vertical_spacing=0.06)
    for r, (label, values, low, high) in enumerate(rows, start=1):
        for k in range(3):
            figure.add_scatter(
                x=short(sampled.time[until]),
                y=short(values[until, k]),
                mode="lines",
                line={"color": _BLUE, "width": 1.3},
                showlegend=False,
                hovertemplate=f"%{{y:.3g}} {label.split('[')[1][:-1]}<extra></extra>",
                row=r,
                col=k + 1,
            )
            for bound in (low[k], high[k]):
                if np.isfinite(bound) and (r == 1 or abs(bound) < 3.0 * np.abs(values[:, k]).max()):
                    figure.add_hline(y=bound, line={"color": _RED, "dash": "dot", "width": 1}, row=r, col=k + 1)
        figure.update_yaxes(title_text=label, row=r, col=1)
    figure.update_xaxes(title_text="time [s]", row=3)
    return styled(figure, 620)


def _header(result: Excitation) -> Html:
    bounds, settings = result.experiment.bounds, result.settings
    height = settings.stand_height
    ground = "not given" if height is None else f"{number(height)} m below the trunk's origin"
    noise = ", ".join(number(float(value), 3) for value in result.experiment.noise)
    about = {
        "Robot": bounds.robot.name,
        "Leg": f"{bounds.leg}, trunk held level",
        "Motion": "the paper's random draw" if settings.random else "Fourier series, optimised",
        "Duration": f"{number(settings.duration)} s, from rest to rest",
        "Table": f"{number(settings.rate)} Hz",
        "Torque noise": f"{noise} N·m for one sample",
        "Ground": ground,
        "Least distance": _distance(result.peaks.distance),
        "Seed": str(settings.seed),
    }
    lead = element("p", text(verdict(result)), css="lead")
    title = f"Excitation: {bounds.robot.name} {bounds.leg}"
    return header(title, lead, facts(about), notes=bounds.clearance.notes)


def _worth(result: Excitation) -> Html:
    head = (
        text("motion"),
        text("information gain [nat]"),
        text(f"combinations known, of {len(result.combinations)}"),
        text(f"links' alone, of {result.rigid_rank}"),
        text("median std [% of prior's]"),
        text("worst std [% of prior's]"),
    )
    rows = (
        row(
            text(name),
            text(f"{a.gain:.1f}"),
            text(a.rank),
            text(a.rigid_rank),
            text(number(100.0 * float(np.median(a.std)), 2)),
            text(number(100.0 * float(a.std.max()), 2)),
        )
        for name, a in appraisals(result)
    )
    label = "Standard deviation of each identifiable combination of parameters, this motion against random draws"
    return element(
        "section",
        element("h2", text("What a log of it would tell")),
        element(
            "p",
            text(
                "Every identifiable combination of parameters, and how well it would be known after the log, in per "
                "cent of how well it was before (dotted line: the log adds nothing). Same duration, rate and torque "
                "noise for all."
            ),
            css="lead",
        ),
        table(head, rows),
        figure_html(std_figure(result), label),
    )


def _motion(result: Excitation) -> Html:
    bounds, peaks = result.experiment.bounds, result.peaks
    head = [text(h) for h in ("joint", "position [rad]", "velocity [rad/s]", "acceleration [rad/s²]", "torque [N·m]")]
    rows = (
        row(
            text(joint),
            text(f"{number(peaks.lower[k], 3)} to {number(peaks.upper[k], 3)}"),
            text(f"{number(peaks.velocity[k], 3)}{_of(bounds.velocity[k])}"),
            text(number(peaks.acceleration[k], 3)),
            text(f"{number(peaks.torque[k], 3)}{_of(bounds.effort[k])}"),
        )
        for k, joint in enumerate(bounds.joints)
    )
    seconds = min(_SHOWN, result.settings.duration)
    return element(
        "section",
        element("h2", text("The motion")),
        element(
            "p",
            text(
                f"Extremes of the whole motion, and its first {seconds:.0f} s with what is allowed dotted where near."
            ),
            css="lead",
        ),
        table(head, rows),
        figure_html(motion_figure(result), "Position, velocity and predicted torque of the three joints over time"),
    )


def _distance(value: float) -> str:
    if not np.isfinite(value):
        return "no shapes to judge by"
    return f"{number(value, 2)} m" if value < 0.1 else "0.1 m or more"


def _of(bound: float) -> str:
    return f" of {number(bound, 3)}" if np.isfinite(bound) else ""


def _cut(name: str) -> str:
    return name if len(name) <= _LONGEST else name[: _LONGEST - 1] + "…"
