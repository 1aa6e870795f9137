"""Plots of the demo, as plotly figures: margins, mass, centre of mass and forces over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stadera.lab.demo import DemoResult, DemoRun
from stadera.lab.experiments.moving.loaded_walk import LoadedWalkOutcome
from stadera.report.plots import add_band, short, styled
from stadera.supervise import LoadCheck, State

_BLUE, _ORANGE, _INK, _STEEL, _GREEN, _RED = "#0b6bcb", "#d9822b", "#20262e", "#9aa4b2", "#1a7f43", "#b3261e"
_LEGS = (("LF", "#0b6bcb"), ("RF", "#d9822b"), ("LH", "#1a7f43"), ("RH", "#8a4fbf"))
CLOSE = (1.0, 2.5)
"""Before the load and after it [s], that plots of a weighing on the way begin with."""

_LOOKS = (
    ("true", {"color": _RED, "width": 2, "dash": "dot"}),
    ("controller and planner", {"color": _BLUE, "width": 2.2}),
)
_BAND = {"fillcolor": "rgba(217,130,43,0.30)", "name": "as weighed, ± 2 standard deviations"}
_SHADES = {
    State.STOPPING: "rgba(217,130,43,0.14)",
    State.WEIGHING_MASS: "rgba(11,107,203,0.08)",
    State.WEIGHING_COM: "rgba(11,107,203,0.15)",
    State.CONVERGED: "rgba(26,127,67,0.14)",
    State.WEIGHING: "rgba(217,130,43,0.35)",
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
    """Mass in controller and planner, true and as weighed on the way, of the run with identification."""
    figure, film, outcome = go.Figure(), result.identified.film, result.identified.outcome
    if outcome.checks:
        _add_thresholds(figure, outcome.checks)
    else:
        add_band(figure, film.time, film.mass[:, 2], film.std[:, 0], **_BAND)
    for which, (name, line) in enumerate(_LOOKS):
        figure.add_scatter(x=short(film.time), y=short(film.mass[:, which]), line=line, name=name)
    if outcome.checks:
        _add_checks(figure, outcome.checks)
    masses = np.concatenate([film.mass[:, 0], [check.mass for check in outcome.checks]])
    figure.update_yaxes(title_text="trunk with load [kg]", range=[masses.min() - 2.0, masses.max() + 2.0])
    return _over_time(figure, result, 380, window=_window(result))


def _window(result: DemoResult) -> tuple[float, float] | None:
    """What is weighed on the way is known so soon that it is looked at closely."""
    if not result.settings.nonstop:
        return None
    at, (before, after) = result.settings.load_at, CLOSE
    return max(at - before, 0.0), min(at + after, result.settings.seconds)


def _add_thresholds(figure: go.Figure, checks: Sequence[LoadCheck]) -> None:
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


def _add_checks(figure: go.Figure, checks: Sequence[LoadCheck]) -> None:
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


def com_figure(result: DemoResult) -> go.Figure:
    """The trunk's centre of mass: true, in controller and planner, and as weighed, with its band."""
    figure, film = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.07), result.identified.film
    looks = (*_LOOKS, ("weighing", {"color": _ORANGE, "width": 2.2}))
    for axis, label in enumerate("xy"):
        place = {"row": axis + 1, "col": 1}
        values = 100.0 * film.trunk_com[:, :, axis]
        add_band(figure, film.time, values[:, 2], 100.0 * film.std[:, 1 + axis], **_BAND, showlegend=axis == 0, **place)
        for which, (name, line) in enumerate(looks[: 2 if result.settings.nonstop else 3]):
            figure.add_scatter(
                x=short(film.time),
                y=short(values[:, which]),
                line=line,
                name=name,
                legendgroup=name,
                showlegend=axis == 0,
                **place,
            )
        low, high = values[:, :2].min() - 1.0, values[:, :2].max() + 1.0
        figure.update_yaxes(title_text=f"{label} [cm]", range=[low, high], row=axis + 1, col=1)
    return _over_time(figure, result, 460, window=_window(result))


def force_figure(run: DemoRun, result: DemoResult) -> go.Figure:
    """The ground's vertical forces on the feet."""
    figure = go.Figure()
    for leg, (name, colour) in enumerate(_LEGS):
        figure.add_scatter(
            x=short(run.film.time), y=short(run.film.force[:, leg]), line={"color": colour, "width": 1.4}, name=name
        )
    figure.update_yaxes(title_text="vertical force [N]")
    return _over_time(figure, result, 340, run)


def _over_time(
    figure: go.Figure,
    result: DemoResult,
    height: int,
    run: DemoRun | None = None,
    window: tuple[float, float] | None = None,
) -> go.Figure:
    """Time axes, all of it or a window [s] to begin with, the load, and what the supervisor did meanwhile."""
    outcome = (run or result.identified).outcome
    longest = max(run.outcome.seconds for run in result.runs)
    for begin, end, state in _spans(outcome):
        if state in _SHADES:
            figure.add_vrect(x0=begin, x1=end, fillcolor=_SHADES[state], line_width=0, layer="below")
        if state is State.WEIGHING:
            _mark(figure, begin, " noticed", _GREEN, "left")
    _mark(figure, result.settings.load_at, "load ", _ORANGE, "right")
    figure.update_xaxes(range=[0.0, longest] if window is None else window)
    figure = styled(figure, height)
    rows = len({trace.xaxis for trace in figure.data if trace.xaxis}) or 1
    figure.update_xaxes(title_text="time [s]", row=rows if rows > 1 else None, col=1 if rows > 1 else None)
    return figure


def _mark(figure: go.Figure, time: float, name: str, colour: str, side: str) -> None:
    annotation = {"text": name, "font": {"color": colour}, "yanchor": "bottom", "y": 1.0, "xanchor": side}
    figure.add_vline(x=time, line={"color": colour, "width": 2}, annotation=annotation)


def _spans(outcome: LoadedWalkOutcome) -> list[tuple[float, float, State]]:
    """Begin, end and state of the supervisor's states."""
    times = [t.time for t in outcome.transitions] + [outcome.seconds]
    return [(t.time, end, t.after) for t, end in zip(outcome.transitions, times[1:], strict=True)]
