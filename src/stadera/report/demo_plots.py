"""Plots of the demo, as plotly figures: margins, mass, centre of mass and forces over time."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from stadera.demo import DemoResult, DemoRun
from stadera.experiments.loaded_walk import LoadedWalkOutcome
from stadera.report.plots import short, styled
from stadera.supervise import State

Array = NDArray[np.float64]

_BLUE, _ORANGE, _INK, _STEEL, _GREEN, _RED = "#0b6bcb", "#d9822b", "#20262e", "#9aa4b2", "#1a7f43", "#b3261e"
_LEGS = (("LF", "#0b6bcb"), ("RF", "#d9822b"), ("LH", "#1a7f43"), ("RH", "#8a4fbf"))
_SHADES = {
    State.STOPPING: "rgba(217,130,43,0.14)",
    State.WEIGHING_MASS: "rgba(11,107,203,0.08)",
    State.WEIGHING_COM: "rgba(11,107,203,0.15)",
    State.CONVERGED: "rgba(26,127,67,0.14)",
}


def margin_figure(result: DemoResult) -> go.Figure:
    """How far the true centre of mass was inside the support polygon, in both runs."""
    figure = go.Figure()
    for run, colour in zip(result.runs, (_RED, _BLUE), strict=True):
        figure.add_scatter(
            x=short(run.outcome.time),
            y=short(100.0 * run.outcome.margin),
            line={"color": colour, "width": 1.6},
            name=run.name,
            connectgaps=False,
        )
    figure.add_hline(y=0.0, line={"color": _INK, "width": 1, "dash": "dot"})
    figure.update_yaxes(title_text="margin [cm]")
    return _over_time(figure, result, 340)


def mass_figure(result: DemoResult) -> go.Figure:
    """Checks of the mass with their thresholds; believed and true mass, of the run with identification."""
    figure, film = go.Figure(), result.identified.film
    checks = result.identified.outcome.checks
    time = np.array([check.time for check in checks])
    expected, threshold = (np.array([getattr(c, name) for c in checks]) for name in ("expected", "threshold"))
    wide = np.minimum(threshold, 5.0)
    figure.add_scatter(
        x=short(np.concatenate([time, time[::-1]])),
        y=short(np.concatenate([expected + wide, (expected - wide)[::-1]])),
        fill="toself",
        fillcolor="rgba(154,164,178,0.22)",
        line={"width": 0},
        name="not a change",
        hoverinfo="skip",
    )
    figure.add_scatter(
        x=short(film.time), y=short(film.mass[:, 0]), line={"color": _RED, "width": 2, "dash": "dot"}, name="true"
    )
    figure.add_scatter(
        x=short(film.time), y=short(film.mass[:, 1]), line={"color": _BLUE, "width": 2.2}, name="controller and planner"
    )
    for changed, symbol, colour, name in (
        (False, "circle-open", _STEEL, "check at rest"),
        (True, "diamond", _ORANGE, "check: the load has changed"),
    ):
        chosen = [check for check in checks if check.changed == changed]
        figure.add_scatter(
            x=short(np.array([check.time for check in chosen])),
            y=short(np.array([check.mass for check in chosen])),
            mode="markers",
            marker={"symbol": symbol, "color": colour, "size": 12 if changed else 7, "line": {"width": 1.5}},
            name=name,
        )
    masses = np.concatenate([film.mass[:, 0], [check.mass for check in checks]])
    figure.update_yaxes(title_text="trunk with load [kg]", range=[masses.min() - 2.0, masses.max() + 2.0])
    return _over_time(figure, result, 380)


def com_figure(result: DemoResult) -> go.Figure:
    """The trunk's centre of mass: true, in controller and planner, and the weighing under way."""
    figure, film = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.07), result.identified.film
    looks = (
        ("true", {"color": _RED, "width": 2, "dash": "dot"}),
        ("controller and planner", {"color": _BLUE, "width": 2.2}),
        ("weighing", {"color": _ORANGE, "width": 2.2}),
    )
    for axis, label in enumerate("xy"):
        for which, (name, line) in enumerate(looks):
            figure.add_scatter(
                x=short(film.time),
                y=short(100.0 * film.trunk_com[:, which, axis]),
                line=line,
                name=name,
                legendgroup=name,
                showlegend=axis == 0,
                row=axis + 1,
                col=1,
            )
        figure.update_yaxes(title_text=f"{label} [cm]", row=axis + 1, col=1)
    return _over_time(figure, result, 460)


def force_figure(run: DemoRun, result: DemoResult) -> go.Figure:
    """The ground's vertical forces on the feet."""
    figure = go.Figure()
    for leg, (name, colour) in enumerate(_LEGS):
        figure.add_scatter(
            x=short(run.film.time), y=short(run.film.force[:, leg]), line={"color": colour, "width": 1.4}, name=name
        )
    figure.update_yaxes(title_text="vertical force [N]")
    return _over_time(figure, result, 340, run)


def _over_time(figure: go.Figure, result: DemoResult, height: int, run: DemoRun | None = None) -> go.Figure:
    """Time axes, the load, and what the supervisor did meanwhile."""
    outcome = (run or result.identified).outcome
    longest = max(run.outcome.seconds for run in result.runs)
    for begin, end, state in _spans(outcome):
        if state in _SHADES:
            figure.add_vrect(x0=begin, x1=end, fillcolor=_SHADES[state], line_width=0, layer="below")
    figure.add_vline(
        x=result.settings.load_at,
        line={"color": _ORANGE, "width": 2},
        annotation={"text": "load", "font": {"color": _ORANGE}, "yanchor": "bottom", "y": 1.0},
    )
    figure.update_xaxes(range=[0.0, longest])
    figure = styled(figure, height)
    rows = len({trace.xaxis for trace in figure.data if trace.xaxis}) or 1
    figure.update_xaxes(title_text="time [s]", row=rows if rows > 1 else None, col=1 if rows > 1 else None)
    return figure


def _spans(outcome: LoadedWalkOutcome) -> list[tuple[float, float, State]]:
    """Begin, end and state of the supervisor's states."""
    times = [t.time for t in outcome.transitions] + [outcome.seconds]
    return [(t.time, end, t.after) for t, end in zip(outcome.transitions, times[1:], strict=True)]
