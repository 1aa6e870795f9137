"""Figures of an excitation: its expected information, and the motion itself."""

from __future__ import annotations

import numpy as np

from stadera.excite.result import Excitation
from stadera.report.figures import Axis, Figure, Guide, Panel, Series, line

SHOWN = 30.0  # s of the motion in the plot
_RATE = 100.0  # Hz, in the plot
_LONGEST = 60  # characters of a combination's name next to a plot


def figures(result: Excitation) -> dict[str, Figure]:
    """All figures by name."""
    return {"information": std_figure(result), "motion": motion_figure(result)}


def std_figure(result: Excitation) -> Figure:
    """Standard deviation of each identifiable combination as a share of the prior's, for the motion and the draws."""
    names = tuple(_cut(str(combination)) for combination in result.combinations)
    at, marks = np.arange(float(len(names))), []
    if result.draws:
        spread = 100.0 * np.array([draw.std for draw in result.draws])
        name = f"random draws, median and range of {len(result.draws)}"
        ends = spread.min(axis=0), spread.max(axis=0)
        marks.append(Series(np.median(spread, axis=0), at, name, "steel", 0.0, marker="diamond", x_range=ends))
    name = "optimised" if result.draws else "random draw"
    marks.append(Series(100.0 * result.chosen.std, at, name, "blue", 0.0, marker="dot", size=10.0))
    x = Axis("standard deviation, share of the prior's [%]", log=True)
    nothing = Guide(100.0, colour="red", name="the log adds nothing")
    panel = Panel(x, Axis(labels=names), tuple(marks), (nothing,))
    return Figure("Standard deviation of each identifiable combination of parameters", ((panel,),))


def motion_figure(result: Excitation) -> Figure:
    """Position, velocity and predicted torque of the three joints over the first half minute, with their bounds."""
    bounds = result.experiment.bounds
    sampled = result.chosen.motion.sample(_RATE)
    until = sampled.time <= SHOWN
    quantities = (
        ("position [rad]", sampled.position, bounds.lower, bounds.upper),
        ("velocity [rad/s]", sampled.velocity, -bounds.velocity, bounds.velocity),
        ("torque [N·m]", bounds.torque(sampled.motion), -bounds.effort, bounds.effort),
    )
    rows = []
    for r, (label, values, low, high) in enumerate(quantities):
        panels = []
        for k, joint in enumerate(bounds.joints):
            near = 3.0 * np.abs(values[:, k]).max()
            ends = [b for b in (low[k], high[k]) if np.isfinite(b) and (r == 0 or abs(b) < near)]
            guides = tuple(Guide(float(b), of="y", colour="red", name="limit") for b in ends)
            curve = line(sampled.time[until], values[until, k], "", width=1.3)
            panels.append(
                Panel(Axis("time [s]" if r == 2 else ""), Axis(label), (curve,), guides, joint if r == 0 else "")
            )
        rows.append(tuple(panels))
    return Figure("The motion of the three joints", tuple(rows), row_height=210.0)


def _cut(name: str) -> str:
    return name if len(name) <= _LONGEST else name[: _LONGEST - 1] + "…"
