"""Figures of a weighing: balance from above; payload, mass, centre of mass and forces over time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from stadera.report.figures import Axis, Figure, Guide, Panel, Series, band, line, stacked
from stadera.report.look import LEGS
from stadera.types import Array
from stadera.weigh.result import Balance, Weighing

if TYPE_CHECKING:
    from stadera.lab.truth import Truth


def figures(result: Weighing, truth: Truth | None = None) -> dict[str, Figure]:
    """All figures by name, the most informative first."""
    found = {
        "payload": payload_figure(result, truth),
        "mass": mass_figure(result, truth),
        "balance": None if result.balance is None else balance_figure(result, result.balance, truth),
        "convergence": com_figure(result, truth),
        "forces": force_figure(result),
    }
    return {name: figure for name, figure in found.items() if figure is not None and not figure.is_empty}


def balance_figure(result: Weighing, balance: Balance, truth: Truth | None = None) -> Figure:
    """Support polygon from above, with forces, centre of pressure and centres of mass; the right half is enlarged."""
    stance, centres = tuple(_stance(result, balance)), tuple(_centres(result, balance, truth))
    places = np.concatenate([np.column_stack([mark.x, mark.y]) for mark in centres])
    middle = 0.5 * (np.nanmax(places, axis=0) + np.nanmin(places, axis=0))
    around = 0.005  # m
    half = 0.6 * float(np.nanmax(np.nanmax(places, axis=0) - np.nanmin(places, axis=0))) + around
    feet = balance.level(balance.feet)[balance.stance]
    room = 0.2 * float(np.ptp(feet, axis=0).max())
    whole = _level_panel((*stance, *centres), feet.min(axis=0) - room, feet.max(axis=0) + room, "", 1.6)
    near = _level_panel(centres, middle - half, middle + half, "enlarged", 1.0)
    note = (
        "Support polygon from above, at the end of the last rest, level; the origin is the trunk's. At rest the whole "
        "robot's centre of mass is above the centre of pressure; a distance between them shows errors of the joint "
        "torques."
    )
    return Figure("The balance", ((whole, near),), note)


def _level_panel(marks: tuple[Series, ...], low: Array, high: Array, title: str, share: float) -> Panel:
    x, y = (Axis(f"{name} [m]", limits=(float(low[k]), float(high[k]))) for k, name in enumerate(("forward", "left")))
    return Panel(x, y, marks, title=title, equal=True, share=share)


def _stance(result: Weighing, balance: Balance) -> Iterator[Series]:
    """The polygon between the loaded feet, and their forces."""
    feet = balance.level(balance.feet)
    standing = np.flatnonzero(balance.stance)
    from_middle = feet[standing] - feet[standing].mean(axis=0)
    standing = standing[np.argsort(np.arctan2(from_middle[:, 1], from_middle[:, 0]))]  # in a row around the robot
    outline = feet[[*standing, standing[0]]]
    yield Series(outline[:, 0], outline[:, 1], "support polygon", "steel", 1.5, fill="self")
    names = [leg.name for leg in result.robot.legs]
    largest = 46.0  # px, the marker of the most loaded foot
    size = largest * np.sqrt(np.maximum(balance.force / balance.force.max(), 0.0))
    texts = tuple(f"{names[k]} {balance.force[k]:.0f} N" for k in standing)
    at = feet[standing]
    yield Series(
        at[:, 0], at[:, 1], "foot, area by force", "steel", 0.0, marker="dot", size=size[standing], labels=texts
    )


def _centres(result: Weighing, balance: Balance, truth: Truth | None) -> Iterator[Series]:
    if np.isfinite(result.com[:2]).all():
        yield from _with_uncertainty(result, balance)
    yield from _point(balance.robot_com, "whole robot's centre of mass, found", "plus", "orange")
    yield from _point(balance.pressure, "centre of pressure", "ring", "ink")
    if truth is not None:
        last = balance.level(np.array(truth.at(result.end).com))
        yield from _point(last, "trunk's centre of mass, truth", "cross", "green")


def _with_uncertainty(result: Weighing, balance: Balance) -> Iterator[Series]:
    """The trunk's centre of mass with the ellipse of two standard deviations."""
    at = balance.level(np.nan_to_num(result.com))
    turn = balance.to_level[:2]
    covariance = turn @ np.nan_to_num(result.trunk.covariance[1:, 1:]) @ turn.T
    sizes, axes = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, 61)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    x, y = at[:, None] + axes @ (2.0 * np.sqrt(np.maximum(sizes, 0.0))[:, None] * circle)
    yield Series(x, y, "± 2 standard deviations", "blue", 1.0, fill="self")
    yield from _point(at, "trunk's centre of mass, found", "diamond", "blue")


def _point(at: Array, name: str, marker: str, colour: str) -> Iterator[Series]:
    if np.isfinite(at).all():
        yield Series(at[:1], at[1:2], name, colour, 0.0, marker=marker, size=13.0)  # type: ignore[arg-type]


def payload_figure(result: Weighing, truth: Truth | None = None) -> Figure | None:
    """The payload's mass since the tare with two standard deviations; None if it was not tracked."""
    if (found := result.timeline.payload) is None:
        return None
    true = None if truth is None else [m.payload_mass or 0.0 for m in truth.moments]
    panel = _panel(result, "payload [kg]", "payload since the tare", found[:, 0], found[:, 1], truth, true)
    return Figure("Payload over time", ((panel,),), "As known at that time.", 300.0)


def mass_figure(result: Weighing, truth: Truth | None = None) -> Figure:
    """Mass of the trunk over time with two standard deviations, the changes, and the truth."""
    line_, true = result.timeline, None if truth is None else [m.mass for m in truth.moments]
    panel = _panel(result, "trunk's mass [kg]", "trunk with all on it", line_.mass, line_.mass_std, truth, true)
    note = "As known at that time." if result.torque_lag is not None else "Of each block at rest alone."
    return Figure("Mass over time", ((panel,),), note, 300.0)


def com_figure(result: Weighing, truth: Truth | None = None) -> Figure | None:
    """Centre of mass over time as estimated then, with two standard deviations, and the truth; None if not observed."""
    com, std, panels = result.timeline.com, result.timeline.com_std, []
    for k in range(3):
        if np.isfinite(com[:, k]).any():
            true = None if truth is None else [m.com[k] for m in truth.moments]
            panels.append(_panel(result, f"com {'xyz'[k]} [m]", "found", com[:, k], std[:, k], truth, true))
    note = "As known at that time; a gap where it was not."
    if result.torque_lag is None:
        note += (
            " Methods at rest start from the model's value, and anew after each change: the bands do not include the "
            "settling transient."
        )
    return stacked("Centre of mass over time", panels, note) if panels else None


def force_figure(result: Weighing) -> Figure | None:
    """Vertical force of each foot over time, from joint torques; None in motion."""
    if (load := result.timeline.load) is None:
        return None
    marks = tuple(
        line(result.timeline.time, load[:, k], leg.name, LEGS[k % len(LEGS)]) for k, leg in enumerate(result.robot.legs)
    )
    panel = Panel(_time(result), Axis("vertical force [N]", zero=True), marks, _guides(result))
    return Figure("Forces of the ground", ((panel,),), "Vertical, from joint torques.", 300.0)


def _panel(
    result: Weighing, quantity: str, name: str, values: Array, std: Array, truth: Truth | None, true: list[float] | None
) -> Panel:
    """A quantity (k,) over the timeline with two standard deviations, and its true values at the truth's moments."""
    time = result.timeline.time
    marks = [band(time, values, std), line(time, values, name, width=1.8)]
    if truth is not None and true is not None:
        times = np.array([*(m.time for m in truth.moments), result.end])
        marks.append(Series(times, np.array([*true, true[-1]]), "truth", "green", 1.5, dashed=True, stairs="hold"))
    return Panel(_time(result), Axis(quantity, limits=_room(values, std)), tuple(marks), _guides(result))


def _room(values: Array, std: Array) -> tuple[float, float] | None:
    """Range of a plot over time that shows all values (k,) and the last error bar [the same unit]. Wider bars
    before it, of the first rows after a change, are cut off.
    """
    known = np.isfinite(values) & np.isfinite(std)
    if not known.any():
        return None
    low, high = float(values[known].min()), float(values[known].max())
    room = max(3.0 * float(std[known][-1]), 0.15 * (high - low)) or 1.0
    return low - room, high + room


def _time(result: Weighing) -> Axis:
    return Axis("time [s]", limits=(result.begin, result.end))


def _guides(result: Weighing) -> tuple[Guide, ...]:
    refused = (Guide(r.begin, r.end, colour="amber", name="not used") for r in result.refusals)
    return (*refused, *(Guide(change.time, name="change of the load") for change in result.changes))
