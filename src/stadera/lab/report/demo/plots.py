"""Figures of the demo: margins, mass and centre of mass over time."""

from __future__ import annotations

from dataclasses import replace

from stadera.lab.demo import DemoResult
from stadera.lab.experiments.loaded_walk import LoadedWalkOutcome
from stadera.lab.report.demo.terminal import NAMES
from stadera.lab.supervise import State
from stadera.report.figures import Axis, Figure, Guide, Panel, band, line, stacked

_TRUE, _CONTROLLER = "true", "controller and planner"
_BAND = "as weighed, ± 2 standard deviations"
_SHADES = {
    State.STOPPING: "orange",
    State.WEIGHING_MASS: "steel",
    State.WEIGHING_COM: "blue",
    State.CONVERGED: "green",
    State.WEIGHING: "orange",
}


def margin_figure(result: DemoResult, note: str = "") -> Figure:
    """Margin of the true centre of mass in the support polygon, in both runs."""
    marks = tuple(
        line(run.outcome.trace.time, 100.0 * run.outcome.margin, name, colour)
        for name, run, colour in zip(NAMES, result.runs, ("red", "blue"), strict=True)
    )
    panel = Panel(Axis(), Axis("margin [cm]"), marks, (Guide(0.0, of="y", colour="ink"),))
    return _over_time("Margin of the true centre of mass", [panel], result, note)


def mass_figure(result: DemoResult, note: str = "") -> Figure:
    """Mass in controller and planner, true and estimated, of the run with identification."""
    film = result.identified.film
    marks = (
        band(film.time, film.mass[:, 2], film.std[:, 0], "orange", _BAND),
        line(film.time, film.mass[:, 0], _TRUE, "red", width=2.0, dashed=True),
        line(film.time, film.mass[:, 1], _CONTROLLER, "blue", width=2.2),
    )
    room = 0.1 * float(film.mass[:, 0].max())
    limits = float(film.mass[:, 0].min()) - room, float(film.mass[:, 0].max()) + room
    panel = Panel(Axis(), Axis("trunk with load [kg]", limits=limits), marks)
    return _over_time("Mass", [panel], result, note, window=_window(result))


def com_figure(result: DemoResult, note: str = "") -> Figure:
    """The trunk's centre of mass: true, in controller and planner, and estimated, with its band."""
    film, panels = result.identified.film, []
    for axis, label in enumerate("xy"):
        values = 100.0 * film.trunk_com[:, :, axis]
        marks = [
            band(film.time, values[:, 2], 100.0 * film.std[:, 1 + axis], "orange", _BAND),
            line(film.time, values[:, 0], _TRUE, "red", width=2.0, dashed=True),
            line(film.time, values[:, 1], _CONTROLLER, "blue", width=2.2),
        ]
        if result.settings.classic:
            marks.append(line(film.time, values[:, 2], "weighing", "orange", width=2.2))
        limits = float(values[:, :2].min() - 1.0), float(values[:, :2].max() + 1.0)
        panels.append(Panel(Axis(), Axis(f"{label} [cm]", limits=limits), tuple(marks)))
    return _over_time("Centre of mass of the trunk with its load", panels, result, note, window=_window(result))


def _window(result: DemoResult) -> tuple[float, float] | None:
    """Time range for weighing while walking, which converges quickly; None otherwise."""
    if result.settings.classic:
        return None
    at = result.settings.load_at
    return max(at - 1.0, 0.0), min(at + 2.5, result.settings.duration)


def _over_time(
    title: str, panels: list[Panel], result: DemoResult, note: str, window: tuple[float, float] | None = None
) -> Figure:
    """Plots over time, all of it or an initial window [s], with the load and the supervisor's states."""
    outcome = result.identified.outcome
    longest = float(outcome.trace.time[-1])
    guides = [Guide(a, b, colour=_SHADES[state]) for a, b, state in _spans(outcome) if state in _SHADES]
    guides += [Guide(a, colour="green", name="noticed") for a, _, state in _spans(outcome) if state is State.WEIGHING]
    guides.append(Guide(result.settings.load_at, name="load"))
    time = Axis("time [s]", limits=window or (0.0, longest))
    return stacked(title, [replace(p, x=time, guides=(*p.guides, *guides)) for p in panels], note, 240.0)


def _spans(outcome: LoadedWalkOutcome) -> list[tuple[float, float, State]]:
    """Begin, end and state of each state of the supervisor."""
    times = [t.time for t in outcome.transitions] + [float(outcome.trace.time[-1])]
    return [(t.time, end, t.after) for t, end in zip(outcome.transitions, times[1:], strict=True)]
