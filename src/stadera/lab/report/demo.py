"""Report of the demo: terminal, page and plots."""

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import resources

import numpy as np
from markupsafe import Markup
from rich.console import RenderableType
from rich.text import Text

from stadera.inertia import InertialParameters
from stadera.lab.demo import KNOWN, DemoResult, known_after, true_load
from stadera.lab.experiments.loaded_walk import LoadedWalkOutcome, WalkOutcome
from stadera.lab.report.demo_scene import NAMES, scene
from stadera.lab.supervise.supervisor import Mode
from stadera.report.figures import Axis, Figure, Guide, Panel, band, line, stacked
from stadera.report.numbers import number, with_std
from stadera.report.page import render, script_data
from stadera.report.table import Cell, Row, TableData, rich_table
from stadera.report.weigh.tables import place


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
        scene=script_data(json.dumps(drawn, separators=(",", ":"), allow_nan=False)),
        library=Markup((resources.files("stadera.lab.report") / "vendor" / "three.min.js").read_text(encoding="utf-8")),
        comparison=comparison_table(result),
        cards=list(_cards(result, true_load(identified))),
        load=load_table(identified) if identified.payload is not None else None,
        log=log_table(identified),
        plots=list(_plots(result)),
        classic=settings.classic,
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
    yield _card("Trunk's centre of mass off by", f"{100.0 * identified.com_error:.1f}", "cm in x-y")


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


_TRUE, _CONTROLLER = "true", "controller and planner"
_BAND = "as weighed, ± 2 standard deviations"
_SHADES = {
    Mode.STOPPING: "orange",
    Mode.WEIGHING_MASS: "steel",
    Mode.WEIGHING_COM: "blue",
    Mode.CONVERGED: "green",
    Mode.WEIGHING: "orange",
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
    guides += [Guide(a, colour="green", name="noticed") for a, _, state in _spans(outcome) if state is Mode.WEIGHING]
    guides.append(Guide(result.settings.load_at, name="load"))
    time = Axis("time [s]", limits=window or (0.0, longest))
    return stacked(title, [replace(p, x=time, guides=(*p.guides, *guides)) for p in panels], note, 240.0)


def _spans(outcome: LoadedWalkOutcome) -> list[tuple[float, float, Mode]]:
    times = [t.time for t in outcome.transitions] + [float(outcome.trace.time[-1])]
    return [(t.time, end, t.after) for t, end in zip(outcome.transitions, times[1:], strict=True)]


def demo_tables(result: DemoResult) -> Iterator[RenderableType]:
    """Outcomes of both runs, the estimated payload, and the supervisor's actions."""
    worked = result.identified.outcome.verdict.outcome is WalkOutcome.WALKED
    yield Text(headline(result), style="bold" if worked else "bold red")
    yield rich_table(comparison_table(result))
    identified = result.identified.outcome
    if identified.payload is not None:
        yield rich_table(load_table(identified))
    if identified.transitions:
        yield rich_table(log_table(identified))


def headline(result: DemoResult) -> str:
    """Summary in two sentences."""
    without, identified = result.without.outcome, result.identified.outcome
    payload = identified.payload
    weighed = "" if payload is None else f", having weighed {with_std(payload.mass, payload.mass_std)} kg"
    return f"Without identification it {_ended(without)}. With it, it {_ended(identified)}{weighed}."


def _ended(outcome: LoadedWalkOutcome) -> str:
    """Outcome of a run, as the end of a sentence."""
    trace = outcome.trace
    match outcome.verdict.outcome:
        case WalkOutcome.FELL:
            return f"falls after {trace.time[-1] - trace.loaded_at:.1f} s"
        case WalkOutcome.STUCK:
            return f"gets stuck after {trace.distance:.2f} m: {outcome.verdict.reasons[0]}"
        case WalkOutcome.WALKED if trace.steps_lost:
            return f"walks on after {outcome.updated_after or np.nan:.1f} s, {trace.steps_lost} steps lost"
        case WalkOutcome.WALKED:
            return "walks on without a stop"


def comparison_table(result: DemoResult) -> TableData:
    """How both runs ended."""

    def each(name: str, shown: Callable[[LoadedWalkOutcome], str | Cell]) -> Row:
        return name, shown(result.without.outcome), shown(result.identified.outcome)

    def ended(outcome: LoadedWalkOutcome) -> Cell:
        verdict = outcome.verdict
        return Cell(str(verdict.outcome), strong=True, good=verdict.outcome is WalkOutcome.WALKED)

    def lost(outcome: LoadedWalkOutcome) -> str:
        return "–" if outcome.trace.fall else str(outcome.trace.steps_lost)

    def ahead(outcome: LoadedWalkOutcome) -> str:
        trace = outcome.trace
        return f"{trace.distance:.2f}" + ("" if trace.fall else f" of {trace.commanded:.2f}")

    rows = (
        each("outcome", ended),
        each("because", lambda o: "; ".join(o.verdict.reasons) or "–"),
        each("got ahead, of what was commanded [m]", ahead),
        each("steps lost", lost),
        each("least margin of the true centre of mass [cm]", lambda o: f"{100.0 * o.least_margin_ever:.1f}"),
        each("error of the trunk's mass in the controller [kg]", lambda o: f"{o.model.mass - o.truth.mass:+.2f}"),
        each("error of its centre of mass in x-y, the same [cm]", lambda o: f"{100.0 * o.com_error:.2f}"),
    )
    return TableData.of("The same walk twice", ("since the box was let go", *NAMES), rows)


def load_table(outcome: LoadedWalkOutcome) -> TableData:
    """Mass and centre of mass of the estimated payload, and the truth."""
    head = ("trunk frame", "mass [kg]", "com x [m]", "com y [m]", "com z [m]")
    payload, load = outcome.payload, true_load(outcome)
    rows: list[Row] = [("truth", number(load.mass), *(number(round(c, 5)) for c in load.com.tolist()))]
    if payload is not None:
        mass = with_std(payload.mass, payload.mass_std)
        rows.insert(0, ("as weighed", mass, *place(payload.com, payload.com_std)))
    return TableData.of("The box", head, rows)


def log_table(outcome: LoadedWalkOutcome) -> TableData:
    """Changes of the supervisor's state, and their reasons."""
    rows = ((f"{t.time:.2f}", str(t.after), t.reason) for t in outcome.transitions)
    return TableData.of("What the supervisor did", ("time [s]", "state", "because"), rows, sides="lww")
