"""Figures of a weighing: where the load is; payload, mass and centre of mass over time."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stadera.report.figures import Axis, Figure, Guide, Panel, Series, band, line, stacked
from stadera.report.figures.robot import outline, poses, silhouette, soles
from stadera.report.numbers import number
from stadera.robot.limbs import place_of
from stadera.robot.model import Robot
from stadera.trunk.load import SIGNIFICANT, Payload
from stadera.trunk.standing.estimator import Balance, Stance
from stadera.types import Array
from stadera.weigh.result import Weighing


def figures(result: Weighing) -> dict[str, Figure]:
    """All figures by name, the most informative first."""
    result = result.since_beginning()
    found = {
        "payload": payload_figure(result),
        "mass": mass_figure(result),
        "balance": place_figure(result),
        "convergence": com_figure(result),
    }
    return {name: figure for name, figure in found.items() if figure is not None and not figure.is_empty}


def payload_figure(result: Weighing) -> Figure | None:
    """The payload's mass since the tare with two standard deviations; None if it was not tracked."""
    if (found := result.timeline.payload) is None:
        return None
    name = "payload since the tare"
    panel = _panel(result, "payload [kg]", name, found[:, 0], found[:, 1], lambda m: m.payload_mass or 0.0)
    return Figure("Payload over time", ((panel,),), "As known at that time.", 300.0)


def mass_figure(result: Weighing) -> Figure:
    """Mass of the trunk over time with two standard deviations, the changes, and the truth."""
    found, name = result.timeline, "trunk with all on it"
    panel = _panel(result, "trunk's mass [kg]", name, found.mass, found.mass_std, lambda m: m.mass)
    return Figure("Mass over time", ((panel,),), "As known at that time.", 300.0)


def com_figure(result: Weighing) -> Figure | None:
    """Centre of mass over time as estimated then, with two standard deviations, and the truth; None if not observed."""
    com, std, panels = result.timeline.com, result.timeline.com_std, []
    for k in range(3):
        if np.isfinite(com[:, k]).any():
            quantity = f"com {'xyz'[k]} [m]"
            panels.append(_panel(result, quantity, "found", com[:, k], std[:, k], lambda m, k=k: m.com[k]))  # type: ignore[misc]
    note = "As known at that time; a gap where it was not."
    return stacked("Centre of mass over time", panels, note) if panels else None


def _panel(
    result: Weighing, quantity: str, name: str, values: Array, std: Array, true: Callable[[Any], float]
) -> Panel:
    """A quantity (k,) over the timeline with two standard deviations, and what is `true` of the truth's moments."""
    time, axis = result.timeline.time, Axis("time [s]", limits=(result.begin, result.end))
    marks = [band(time, values, std), line(time, values, name, width=1.8)]
    if result.truth is not None:
        moments = result.truth.moments
        times, trues = [*(m.time for m in moments), result.end], [*map(true, moments), true(moments[-1])]
        marks.append(Series(np.array(times), np.array(trues), "truth", "green", 1.5, dashed=True, stairs="hold"))
    refused = (Guide(r.begin, r.end, colour="amber", name="not used") for r in result.refusals)
    guides = (*refused, *(Guide(change.time, name="change of the load") for change in result.changes))
    return Panel(axis, Axis(quantity, limits=room(values, std)), tuple(marks), guides)


def room(values: Array, std: Array) -> tuple[float, float] | None:
    """Range of a plot over time that shows all values (k,) and the last error bar [the same unit]. Wider bars
    before it, of the first rows after a change, are cut off.
    """
    known = np.isfinite(values) & np.isfinite(std)
    if not known.any():
        return None
    low, high = float(values[known].min()), float(values[known].max())
    room = max(3.0 * float(std[known][-1]), 0.15 * (high - low)) or 1.0
    return low - room, high + room


_DEVIATIONS = "± 2 standard deviations"
_NOTE = (
    "Level, the origin is the trunk's, each leg as on average while its foot is on the ground. A tall outline means "
    "that the height was not observed."
)
_AT_REST = (
    "As at the end of the last rest. At rest the whole robot's centre of mass is above the centre of pressure; a "
    "distance between them shows errors of the joint torques."
)


@dataclass(frozen=True, eq=False)
class _Centre:
    """A centre of mass (3,) [m] in the trunk frame, NaN where not observed; covariance (3, 3) [m²], None for none."""

    name: str
    at: Array
    marker: str
    colour: str
    covariance: Array | None = None
    label: str = ""


def place_figure(result: Weighing) -> Figure | None:
    """The robot from the side and from above: payload, trunk's centre of mass before and after, support polygon, at
    rest also forces and centre of pressure, and an enlargement; None if no foot was seen to carry.
    """
    stance = result.balance or result.stance
    if stance is None:
        return None
    side, top = stance.to_level[[0, 2]], stance.to_level[:2]
    centres, ground = list(_centres(result, stance)), _ground(result, stance)
    if not len(ground):
        return None
    from_side = (*silhouette(result.robot, stance.position, side), _level(ground @ side.T))
    x, y = outline(ground @ top.T).T
    support = Series(x, y, "support polygon", "green", 1.2, fill="self")
    from_above = (support, *silhouette(result.robot, stance.position, top))
    over = tuple(_at_rest(result, result.balance)) if result.balance is not None else ()
    low, high = _bounds((*from_side, *_marks(centres, side, None)))
    seen = tuple(_marks(centres, side, (float(low[1]), float(high[1]))))
    upper = _view_panel("up", low, high, (*from_side, *seen), "from the side")
    marks = tuple(_marks(centres, top, None))
    least, most = _bounds((*from_above, *marks))
    least[0], most[0] = (min(low[0], least[0]), max(high[0], most[0]))
    lower = _view_panel("left", least, most, (*from_above, *over, *marks), "from above")
    tall = high[1] - low[1] > high[0] - low[0]
    upper = replace(upper, x=replace(upper.x, limits=lower.x.limits))
    rows: tuple[tuple[Panel, ...], ...] = ((upper, lower),) if tall else ((upper,), (lower,))
    if near := (*over[1:], *marks) if over else ():
        rows = (*rows, (_view_panel("left", *_bounds(near, 0.3), near, "from above, enlarged"),))
    return Figure("Where it is", rows, _AT_REST if result.balance is not None else _NOTE, width=560.0)


def _bounds(marks: tuple[Series, ...], room: float = 0.04) -> tuple[Array, Array]:
    """Lower left and upper right corner (2,) [m] of all marks, and room around them, as a share."""
    points = np.concatenate([np.column_stack([mark.x, mark.y]) for mark in marks])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    more = room * float((high - low).max()) + 0.004
    return low - more, high + more


def _view_panel(up: str, low: Array, high: Array, marks: tuple[Series, ...], title: str) -> Panel:
    x, y = (Axis(f"{name} [m]", limits=(float(low[k]), float(high[k]))) for k, name in enumerate(("forward", up)))
    return Panel(x, y, marks, title=title, equal=True)


# -- centres of mass --------------------------------------------------------------------------------------------------
def _centres(result: Weighing, stance: Stance) -> Iterator[_Centre]:
    payload, trunk = result.payload, result.trunk
    spread = trunk.covariance[1:, 1:]
    if payload is None:
        yield _Centre("trunk, model", np.asarray(result.robot.inertias[result.robot.trunk].com), "ring", "ink")
    elif not payload.at and payload.mass < trunk.inertial.mass:
        before = result.mass * result.com - payload.mass * payload.com
        yield _Centre("trunk before", before / (result.mass - payload.mass), "ring", "ink")
    after = "trunk, found" if payload is None or payload.at else "trunk with the load"
    yield _Centre(after, result.com, "dot", "blue", spread)
    if payload is not None and payload.mass > SIGNIFICANT * payload.mass_std:
        yield from _payload(result, stance, payload)
    if result.truth is not None:
        moment = result.truth.at(result.time)
        yield _Centre("truth, trunk", np.asarray(moment.com), "cross", "green")
        if moment.payload_com is not None:
            turned, start = _frame(result.robot, stance, moment.link or result.robot.trunk)
            yield _Centre("truth, payload", start + turned @ np.asarray(moment.payload_com), "cross", "green")


def _payload(result: Weighing, stance: Stance, payload: Payload) -> Iterator[_Centre]:
    """The payload on the trunk, or at each link that carries it, at that link's origin where its centre is unknown."""
    label = f"{number(payload.mass, 3)} kg"
    if not payload.at:
        yield _Centre("payload", payload.com, "diamond", "box", payload.com_covariance, label)
        return
    for name in payload.at.split(" + "):
        turned, start = _frame(result.robot, stance, name)
        if np.isfinite(payload.com).all():
            spread = turned @ payload.com_covariance @ turned.T
            yield _Centre("payload", start + turned @ payload.com, "diamond", "box", spread, label)
        else:
            yield _Centre("link that carries the payload", start, "diamond", "box", None, label)
        label = ""


def _frame(robot: Robot, stance: Stance, name: str) -> tuple[Array, Array]:
    """Rotation (3, 3) and origin (3,) [m] of a link or frame, trunk frame."""
    place, (rotations, origins) = place_of(robot, name), poses(robot, stance.position[None])
    turned = rotations[0, place.body + 1]
    return turned @ place.rotation, turned @ place.translation + origins[0, place.body + 1]


def _marks(centres: list[_Centre], view: Array, span: tuple[float, float] | None) -> Iterator[Series]:
    """Points and ellipses as seen along `view` (2, 3); where the height is not known and `span` is the panel's, an
    outline over all of it.
    """
    for centre in centres:
        seen = np.isfinite(centre.at)
        at = view @ np.nan_to_num(centre.at)
        known = seen[:2].all() and (seen[2] or span is None)
        if centre.covariance is not None and seen[:2].all():
            covariance = view @ np.nan_to_num(centre.covariance) @ view.T
            if known:
                yield _ellipse(at, covariance, centre.colour)
            elif span is not None:
                wide = 2.0 * float(np.sqrt(covariance[0, 0]))
                x, y = (
                    at[0] + wide * np.array([-1.0, 1.0, 1.0, -1.0, -1.0]),
                    np.array([span[k] for k in (0, 0, 1, 1, 0)]),
                )
                yield Series(x, y, _DEVIATIONS, centre.colour, 1.0, fill="self")
        if known and (seen[2] or abs(view[:, 2]).max() < 0.5):
            label = (centre.label,) if centre.label else ()
            look = {"marker": centre.marker, "size": 12.0, "labels": label}
            yield Series(at[:1], at[1:], centre.name, centre.colour, 0.0, **look)  # type: ignore[arg-type]


def _ellipse(at: Array, covariance: Array, colour: str) -> Series:
    sizes, axes = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, 61)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    x, y = at[:, None] + axes @ (2.0 * np.sqrt(np.maximum(sizes, 0.0))[:, None] * circle)
    return Series(x, y, _DEVIATIONS, colour, 1.2, fill="self")


# -- the ground -------------------------------------------------------------------------------------------------------
def _ground(result: Weighing, stance: Stance) -> Array:
    """Points (k, 3) [m] of the feet that carry, on the ground, trunk frame."""
    if isinstance(stance, Balance):
        return stance.feet[stance.stance]
    (rotations,), (origins,) = poses(result.robot, stance.position[None])
    points = []
    for leg in result.robot.legs:
        last = result.robot.tree.links.index(leg.links[-1])
        centres = soles(result.robot, leg) @ rotations[last].T + origins[last]
        points.append(centres - leg.foot_radius * stance.to_level[2])
    return np.concatenate(points)


def _level(points: Array) -> Series:
    """The ground from the side, as high as the mean of the feet."""
    left, right = points[:, 0].min(), points[:, 0].max()
    more = 0.15 * (right - left) + 0.05
    return Series(np.array([left - more, right + more]), np.full(2, points[:, 1].mean()), "", "steel", 1.2)


def _at_rest(result: Weighing, balance: Balance) -> Iterator[Series]:
    """Forces of the feet, then the points of the balance, from above."""
    standing, top = np.flatnonzero(balance.stance), balance.to_level[:2]
    names, largest = [leg.name for leg in result.robot.legs], 34.0  # px, the marker of the most loaded foot
    x, y = (balance.feet[standing] @ top.T).T
    size = largest * np.sqrt(np.maximum(balance.force / balance.force.max(), 0.0))[standing]
    texts = tuple(f"{names[k]} {balance.force[k]:.0f} N" for k in standing)
    yield Series(x, y, "foot, area by force", "steel", 0.0, marker="dot", size=size, labels=texts)
    points = (
        ("whole robot's centre of mass, found", "plus", "orange", balance.robot_com),
        ("centre of pressure", "ring", "ink", balance.pressure),
    )
    for name, marker, colour, at in points:
        if np.isfinite(at).all():
            yield Series(at[:1], at[1:], name, colour, 0.0, marker=marker, size=13.0)  # type: ignore[arg-type]
