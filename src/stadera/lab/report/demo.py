"""Report of the demo: terminal, page and plots, and the data of its 3D scene: the robot's tree and parts, both films.

A film's columns are stored as 16-bit integers between each column's least and largest value, in base64: the error is
at most half of the range / 65534, 10 µm of a metre. -32768 marks missing values.
"""

import json
from base64 import b64encode
from collections.abc import Iterator
from dataclasses import replace
from importlib import resources
from typing import Any

import numpy as np
from markupsafe import Markup
from rich.console import RenderableType
from rich.text import Text
from scipy.spatial.transform import Rotation

from stadera.constants import GRAVITY
from stadera.lab.demo import NAMES, DemoResult, DemoRun, true_load
from stadera.lab.experiments.loaded_walk import LoadedWalkOutcome, WalkOutcome
from stadera.lab.plant.payload import Tray
from stadera.lab.supervise.supervisor import Mode
from stadera.report.figures import Axis, Figure, Guide, Panel, Series, band, line, stacked
from stadera.report.figures.robot import limbs
from stadera.report.numbers import fixed, number, with_std
from stadera.report.page import render, script_data
from stadera.report.table import Cell, Row, TableData, rich_table
from stadera.report.weigh.tables import place
from stadera.robot import load_robot
from stadera.robot.model import Robot
from stadera.types import Array

_VENDOR = resources.files("stadera.lab.report") / "vendor"


def demo_html(result: DemoResult) -> str:
    """The complete, self-contained page."""
    settings, identified = result.settings, result.identified.outcome
    drawn = scene(result)
    marks = {event["mark"]: event["time"] for run in drawn["runs"] for event in run["events"] if "mark" in event}
    return render(
        "demo.html.j2",
        package="stadera.lab.report",
        title=f"{settings.mass:g} kg land on a walking robot",
        headline=headline(result),
        scene_label="Two robots side by side. " + headline(result),
        moments=[(mark, time + 0.05) for mark, time in sorted(marks.items(), key=lambda moment: moment[1])],
        scene=script_data(json.dumps(drawn, separators=(",", ":"), allow_nan=False)),
        library=Markup((_VENDOR / "three.min.js").read_text(encoding="utf-8")),
        comparison=comparison_table(result),
        cards=[dict(zip(("label", "figure", "unit"), card, strict=True)) for card in _cards(result)],
        load=load_table(identified) if identified.payload is not None else None,
        log=log_table(identified),
        plots=list(_plots(result)),
        classic=settings.classic,
        facts=_facts(result),
    )


def _facts(result: DemoResult) -> dict[str, str]:
    settings = result.settings
    x, y, z = (f"{100.0 * edge:.0f}" for edge in settings.size)
    return {
        "Robot": f"{result.without.outcome.case.robot}, crawls at {100 * settings.speed:.0f} cm/s",
        "Box": f"{settings.mass:g} kg, {x} × {y} × {z} cm, let go {100.0 * settings.height:.0f} cm above the back's "
        f"{settings.corner} corner, at {settings.load_at:g} s",
        "Both runs": "the same controller, planner, limits and errors; in one of them the estimated trunk is fed back",
        "Sensors": f"standard errors, seed {settings.seed}; nothing of the truth reaches controller or estimators",
        "Simulation": "MuJoCo, 1 kHz; after a fall the drives brake",
    }


def _cards(result: DemoResult) -> Iterator[tuple[str, str, str]]:
    """Label, figure and unit of each card, for the run with identification."""
    identified = result.identified.outcome
    if identified.noticed_after is not None:
        yield "Noticed after", f"{identified.noticed_after:.2f}", "s"
    if identified.updated_after is not None:
        yield "Walks by the new trunk after", f"{identified.updated_after:.2f}", "s"
    if (payload := identified.payload) is not None:
        truth = number(true_load(identified).mass)
        yield f"Box weighed, truth {truth} kg", with_std(payload.mass, payload.mass_std), "kg"
    yield "Trunk's centre of mass off by", fixed(1e3 * identified.com_error, 1), "mm in x-y"


def _plots(result: DemoResult) -> Iterator[Figure]:
    """The margin of both runs; then mass and centre of mass of the trunk, true, in controller and planner, estimated,
    of the run with identification.
    """
    settings, film = result.settings, result.identified.film
    shaded = "Shaded: from the moment the load is noticed until controller and planner have the new trunk."
    if settings.classic:
        shaded = "Shaded: what the supervisor does, stopping (orange), weighing (gray, blue), updating (green)."
    note = f"Its distance from the nearest edge of the support polygon; below zero the robot tips. {shaded}"
    margins = tuple(
        line(run.outcome.trace.time, 100.0 * run.outcome.trace.margin, name, colour)
        for name, run, colour in zip(NAMES, result.runs, ("red", "blue"), strict=True)
    )
    panel = Panel(Axis(), Axis("margin [cm]"), margins, (Guide(0.0, of="y", colour="ink"),))
    yield _over_time("Margin of the true centre of mass", [panel], result, note)
    # weighing while walking converges quickly
    window = (
        None if settings.classic else (max(settings.load_at - 1.0, 0.0), min(settings.load_at + 2.5, settings.duration))
    )
    room = 0.1 * float(film.mass[:, 0].max())
    limits = float(film.mass[:, 0].min()) - room, float(film.mass[:, 0].max()) + room
    panel = Panel(Axis(), Axis("trunk with load [kg]", limits=limits), _compared(film.time, film.mass, film.std[:, 0]))
    yield _over_time("Mass", [panel], result, "With identification, around the load.", window)
    panels = []
    for axis, label in enumerate("xy"):
        values = 100.0 * film.trunk_com[:, :, axis]
        marks = _compared(film.time, values, 100.0 * film.std[:, 1 + axis])
        if settings.classic:
            marks = (*marks, line(film.time, values[:, 2], "weighing", "orange", width=2.2))
        limits = float(values[:, :2].min() - 1.0), float(values[:, :2].max() + 1.0)
        panels.append(Panel(Axis(), Axis(f"{label} [cm]", limits=limits), marks))
    title = "Centre of mass of the trunk with its load"
    yield _over_time(title, panels, result, "With identification, trunk frame.", window)


def _compared(time: Array, values: Array, std: Array) -> tuple[Series, ...]:
    """A quantity (k, 3), true, in controller and planner, and estimated with its standard deviation (k,)."""
    return (
        band(time, values[:, 2], std, "orange", "as weighed, ± 2 standard deviations"),
        line(time, values[:, 0], "true", "red", width=2.0, dashed=True),
        line(time, values[:, 1], "controller and planner", "blue", width=2.2),
    )


_SHADES = {
    Mode.STOPPING: "orange",
    Mode.WEIGHING_MASS: "steel",
    Mode.WEIGHING_COM: "blue",
    Mode.CONVERGED: "green",
    Mode.WEIGHING: "orange",
}


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
    worked = result.identified.outcome.trace.outcome is WalkOutcome.WALKED
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
    match trace.outcome:
        case WalkOutcome.FELL:
            return f"falls after {trace.time[-1] - trace.loaded_at:.1f} s"
        case WalkOutcome.STUCK:
            return f"gets stuck after {trace.distance:.2f} m: {trace.reasons[0]}"
        case WalkOutcome.WALKED if trace.steps_lost:
            return f"walks on after {outcome.updated_after or np.nan:.1f} s, {trace.steps_lost} steps lost"
        case WalkOutcome.WALKED:
            return "walks on without a stop"


def comparison_table(result: DemoResult) -> TableData:
    """How both runs ended."""

    def shown(outcome: LoadedWalkOutcome) -> Row:
        trace, fell = outcome.trace, outcome.trace.fall is not None
        return (
            Cell(str(trace.outcome), strong=True, good=trace.outcome is WalkOutcome.WALKED),
            "; ".join(trace.reasons) or "–",
            f"{trace.distance:.2f}" + ("" if fell else f" of {trace.commanded:.2f}"),
            "–" if fell else str(trace.steps_lost),
            fixed(100.0 * trace.least_margin, 1),
            fixed(outcome.model.mass - outcome.truth.mass, 2),
            fixed(1e3 * outcome.com_error, 1),
        )

    names = (
        "outcome",
        "because",
        "got ahead, of what was commanded [m]",
        "steps lost",
        "least margin of the true centre of mass [cm]",
        "error of the trunk's mass in the controller [kg]",
        "error of its centre of mass there, in x-y [mm]",
    )
    rows = list(zip(names, shown(result.without.outcome), shown(result.identified.outcome), strict=True))
    return TableData.of("The same walk twice", ("since the box was let go", *NAMES), rows)


def load_table(outcome: LoadedWalkOutcome) -> TableData:
    """Mass and centre of mass of the estimated payload, and the truth."""
    head = ("trunk frame", "mass [kg]", "com x [m]", "com y [m]", "com z [m]")
    payload, load = outcome.payload, true_load(outcome)
    assert payload is not None
    weighed = ("as weighed", with_std(payload.mass, payload.mass_std), *place(payload.com, payload.com_std))
    truth = ("truth", number(load.mass), *(number(round(c, 5)) for c in load.com.tolist()))
    return TableData.of("The box", head, [weighed, truth])


def log_table(outcome: LoadedWalkOutcome) -> TableData:
    """Changes of the supervisor's state, and their reasons."""
    rows = ((f"{t.time:.2f}", str(t.after), t.reason) for t in outcome.transitions)
    return TableData.of("What the supervisor did", ("time [s]", "state", "because"), rows, sides="lww")


# -- the scene --------------------------------------------------------------------------------------------------------
def robot_parts(robot: Robot) -> dict[str, Any]:
    """Plain values, metres in the link's frame: meshes, each packed once, and parts on the tree's numbered links."""
    bundled = json.loads((_VENDOR / f"{robot.name}.json").read_text(encoding="utf-8"))
    meshes = [_mesh_part(part, robot.tree.joints) for part in bundled["parts"]]
    tray = Tray.of(robot)
    # the plate on which boxes land; slightly higher than in the plant, so that it covers a back at the same height
    at = short(tray.centre + np.array([0.0, 0.0, 0.002]))
    plate = {"link": 0, "kind": "plate", "size": short(2.0 * tray.half_size), "at": at}
    feet = [
        {"link": part.link, "kind": "foot", "at": short(at), "radius": radius}
        for part in (part for leg in robot.legs for part in limbs(robot, leg) if part.kind == "foot")
        for at, radius in zip(part.centres, part.radii.tolist(), strict=True)
    ]
    return {"meshes": bundled["meshes"], "parts": [*meshes, plate, *feet]}


def _mesh_part(part: dict[str, Any], joints: tuple[str, ...]) -> dict[str, Any]:
    joint = joints.index(part["joint"]) if part["joint"] else None
    place = {"link": 0 if joint is None else joint + 1, "at": part["at"], "turn": part["turn"]}
    return {"kind": "mesh", "mesh": part["mesh"], **place} | ({} if joint is None else {"joint": joint})


def short(values: Any) -> list[float]:
    """Rounds each value to six digits."""
    return [float(f"{value:.6g}") for value in values]


_MOST, _NONE = 32767, -32768
_COLUMNS = ("trunk", "joints", "box", "feet", "force", "down", "limited", "com", "model", "margin")


def scene(result: DemoResult) -> dict[str, Any]:
    """Plain values for `walk_view.js`: metres, seconds, quaternions xyzw; links are numbered as in the robot's tree."""
    settings, robot = result.settings, load_robot(result.without.outcome.case.robot)
    tree = robot.tree
    turns = Rotation.from_matrix(tree.rotations).as_quat()
    joints = [
        {"parent": parent, "at": short(at), "turn": short(turn), "axis": short(axis)}
        for parent, at, turn, axis in zip(tree.parents, tree.translations, turns, tree.axes, strict=True)
    ]
    return {
        "load": settings.load_at,
        "box": list(settings.size),
        "weight": robot.mass * GRAVITY,
        "robot": {"joints": joints, **robot_parts(robot)},
        "runs": [_run(run, name, result) for name, run in zip(NAMES, result.runs, strict=True)],
    }


def _run(run: DemoRun, name: str, result: DemoResult) -> dict[str, Any]:
    film, before = run.film, 2.0  # time shown before the drop [s]
    shown = film.time >= result.settings.load_at - before - 1e-6
    columns = {name: getattr(film, name)[shown].reshape(int(shown.sum()), -1) for name in _COLUMNS}
    return {
        "name": name,
        "good": run.outcome.trace.outcome is WalkOutcome.WALKED,
        "begin": float(film.time[shown][0]),
        "every": float(np.median(np.diff(film.time))),
        "frames": int(shown.sum()),
        "widths": {name: values.shape[1] for name, values in columns.items()},
        "events": list(_events(run, result.settings.mass)),
        **packed(np.concatenate([_smooth(name, values) for name, values in columns.items()], axis=1)),
    }


def _smooth(name: str, values: Array) -> Array:
    """Quaternions with the sign nearest to the previous frame, for interpolation."""
    if name not in ("trunk", "box"):
        return values.astype(float)
    found = np.array(values)
    turns = found[:, 3:]
    flips = np.nancumprod(np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    turns[1:] *= flips[:, None]
    return found


def packed(values: Array) -> dict[str, Any]:
    """Columns (k, c) as {low, step: c numbers each, data: base64 of int16 little-endian, row by row}."""
    seen = np.isfinite(values)
    low, high = np.where(seen, values, np.inf).min(axis=0), np.where(seen, values, -np.inf).max(axis=0)
    low, high = np.where(seen.any(axis=0), low, 0.0), np.where(seen.any(axis=0), high, 0.0)
    step = (high - low) / (2 * _MOST)
    scaled = np.where(seen, (values - low) / np.where(step > 0.0, step, 1.0) - _MOST, _NONE)
    return {
        "low": [float(f"{v:.7g}") for v in low],
        "step": [float(f"{v:.7g}") for v in step],
        "data": b64encode(np.rint(scaled).astype("<i2").tobytes()).decode(),
    }


def _events(run: DemoRun, mass: float) -> Iterator[dict[str, Any]]:
    """Yields captions on a robot with their times, in order; `mark` names a moment of interest."""
    outcome = run.outcome
    trace, payload = outcome.trace, outcome.payload
    yield {"time": 0.0, "text": "walking", "level": ""}
    lands = float(trace.time[trace.since])
    yield {"time": lands, "text": f"{mass:.0f} kg land", "level": "", "mark": "box lands"}
    if (trace.fall is not None) and (tips := _tips(run)) is not None:
        yield {"time": tips, "text": "tips over", "level": "bad", "mark": "tips over"}
    for transition in outcome.transitions:
        text, mark = str(transition.after), str(transition.after)
        if transition.after is Mode.WEIGHING:
            text = mark = "load noticed"
        elif transition.after is Mode.WALKING and payload is not None:
            text, mark = f"weighed {with_std(payload.mass, payload.mass_std)} kg, walking on", "weighed"
        yield {"time": transition.time, "text": text, "level": "good", "mark": mark}
    if trace.fall is not None:
        text = f"fell after {trace.fall.time - trace.loaded_at:.1f} s"
        yield {"time": trace.fall.time, "text": text, "level": "bad", "mark": "falls"}
    elif trace.outcome is WalkOutcome.STUCK:
        yield {"time": trace.loaded_at + 1.0, "text": "stuck", "level": "bad"}


def _tips(run: DemoRun) -> float | None:
    """Time at which the trunk is first tilted by more than 10° with the load."""
    film = run.film
    upright = 1.0 - 2.0 * (film.trunk[:, 3] ** 2 + film.trunk[:, 4] ** 2)
    tilted = np.flatnonzero((upright < np.cos(np.deg2rad(10.0))) & (film.time > run.outcome.trace.loaded_at))
    return float(film.time[tilted[0]]) if len(tilted) else None
