"""Tables, figures and page of a replay."""

from pathlib import Path

import numpy as np

from stadera.lab.replay import Replay
from stadera.report.figures import Axis, Bars, Figure, Panel, line, stacked
from stadera.report.numbers import number
from stadera.report.page import render
from stadera.report.table import Cell, TableData

_COLOURS = ("blue", "green", "orange", "steel")


def model_table(result: Replay) -> TableData:
    """Error over all joints by model and window, and the tested model's against each other's."""
    tested = next(iter(result.paths))
    rows = []
    for model in result.paths:
        errors = [result.overall(model, window) for window in result.windows]
        less = [""] * len(errors)
        if model != tested:
            ratios = [result.overall(tested, w) / e for w, e in zip(result.windows, errors, strict=True)]
            less = [f"{100.0 * (1.0 - r):.0f} %" for r in ratios]
        cells: list[str | Cell] = [Cell(model, strong=model == tested), *(number(e, 3) for e in errors), *less]
        rows.append(cells)
    head = (
        "model",
        *(f"{w:g} s [rad]" for w in result.windows),
        *(f"{tested} is below, {w:g} s" for w in result.windows),
    )
    driven = "recorded torques" if result.gains is None else "the recorded commands, with their controller,"
    note = f"Root mean square over joints and {len(result.begins)} rollouts; {driven} drive each model."
    return TableData.of("Error of the joints' paths", head, rows, note)


def joint_table(result: Replay) -> TableData:
    """Error by joint and model over the middle window."""
    window = result.windows[len(result.windows) // 2]
    errors = [result.rmse(model, window) for model in result.paths]
    rows = [[joint, *(number(error[k], 3) for error in errors)] for k, joint in enumerate(result.joints)]
    return TableData.of(f"Error of each joint's path over {window:g} s [rad]", ("joint", *result.paths), rows)


def tables(result: Replay) -> list[TableData]:
    """RMSE by model and window, then by joint."""
    return [model_table(result), joint_table(result)]


def figures(result: Replay) -> dict[str, Figure]:
    """Paths of the joints over successive rollouts, then errors by joint."""
    window = result.windows[len(result.windows) // 2]
    within = result.time <= window + 1e-9
    chosen, last = [], -np.inf
    for k, begin in enumerate(result.begins.tolist()):
        if begin >= last:
            chosen.append(k)
            last = begin + 1.2 * window  # a gap, at which lines break
    time = np.concatenate([result.begins[k] + result.time[within] for k in chosen])
    shown = [name for name in result.paths if _shown(result, name, window)]
    panels = []
    for j, joint in enumerate(result.joints):
        marks = [
            line(time, np.concatenate([result.paths[name][k, within, j] for k in chosen]), name, _COLOURS[n % 4])
            for n, name in enumerate(shown)
        ]
        recorded = np.concatenate([result.recorded[k, within, j] for k in chosen])
        panels.append(
            Panel(Axis("time [s]"), Axis("[rad]"), (*marks[::-1], line(time, recorded, "recorded", "ink")), title=joint)
        )
    title = f"Paths over {window:g} s, begun at the recorded state"
    bars = tuple(Bars(result.rmse(name, window), name, _COLOURS[n % 4]) for n, name in enumerate(shown))
    by_joint = Panel(Axis("error [rad]", zero=True), Axis(labels=result.joints), bars)
    return {
        "paths": stacked(title, panels, "Models far off are left out of the picture.", 150.0),
        "errors": Figure(f"Root mean square error of each joint over {window:g} s", ((by_joint,),), row_height=420.0),
    }


def _shown(result: Replay, model: str, window: float, far: float = 10.0) -> bool:
    least = min(result.overall(name, window) for name in result.paths)
    return result.overall(model, window) <= far * least


def html(result: Replay) -> str:
    """The complete, self-contained page."""
    tested, *others = result.paths
    window = result.windows[len(result.windows) // 2]
    best = min(others, key=lambda name: result.overall(name, window))
    ratio = result.overall(tested, window) / result.overall(best, window)
    drawn = figures(result)
    off, less = number(result.overall(tested, window), 2), 100.0 * (1.0 - ratio)
    said = f"{abs(less):.0f} % {'below' if less > 0.0 else 'above'} {best!r}"
    return render(
        "replay.html.j2",
        "stadera.lab.report",
        title=f"Replay of {Path(result.source).name}",
        headline=f"Over {window:g} s the joints' paths by {tested!r} are off by {off} rad, {said}",
        level="good" if ratio < 1.0 else "warning",
        table=model_table(result),
        joints=joint_table(result),
        plots=[drawn["paths"], drawn["errors"]],
    )
