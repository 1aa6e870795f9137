"""Draws the diagrams of the documentation as SVG: python docs/diagrams.py (needs pip install '.[figures]')."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import FancyBboxPatch, Polygon, Rectangle
from themed import BLUE, GREEN, INK, ORANGE, RED, SOFT, STEEL, panels, save

BODY, FORCE, WEIGHT, FRAME = INK, BLUE, ORANGE, GREEN
FAINT = 0.2  # opacity of areas


def arrow(
    axes: Axes, tail: tuple[float, float], head: tuple[float, float], colour: str, label: str, at: str = "left"
) -> None:
    axes.annotate(
        "", head, tail, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2, "shrinkA": 0, "shrinkB": 0}
    )
    shift = {"left": (-0.03, 0.0, "right"), "right": (0.03, 0.0, "left")}[at]
    middle = (tail[0] + head[0]) / 2 + shift[0], (tail[1] + head[1]) / 2 + shift[1]
    axes.text(*middle, label, color=colour, ha=shift[2], va="center")


def robot(axes: Axes) -> None:
    """A quadruped from its left side: trunk from x = -0.45 to 0.45 at a height of 0.6."""
    axes.add_patch(
        FancyBboxPatch((-0.45, 0.56), 0.9, 0.13, boxstyle="round,pad=0.02", fc=(*to_rgb(SOFT), FAINT), ec=BODY, lw=1.5)
    )
    for x in (-0.38, 0.38):
        hip, knee, foot = (x, 0.56), (x - 0.11, 0.3), (x, 0.02)
        axes.plot(*zip(hip, knee, foot, strict=True), color=BODY, lw=4, solid_capstyle="round", solid_joinstyle="round")
        axes.plot(*zip(hip, knee, strict=True), "o", color=SOFT, mec=BODY, ms=7)
    axes.plot([-0.8, 0.8], [0, 0], color=BODY, lw=1)


def canvas(width: float, height: float) -> tuple[plt.Figure, Axes]:
    figure, axes = plt.subplots(figsize=(width, height), layout="constrained")
    axes.set_aspect("equal")
    axes.axis("off")
    return figure, axes


def lever() -> plt.Figure:
    """Two feet's forces, the weight between them, and its lever arm."""
    figure, axes = canvas(7, 4.3)
    robot(axes)
    centre = (0.12, 0.68)
    for x, share, name in ((-0.38, 0.22, "hind"), (0.38, 0.4, "front")):
        arrow(axes, (x, 0.0), (x, share), FORCE, f"f {name}", "right")
    axes.plot(*centre, "o", color=WEIGHT, ms=8)
    arrow(axes, centre, (centre[0], 0.12), WEIGHT, "m g", "right")
    axes.add_patch(Rectangle((0.02, 0.71), 0.2, 0.14, fc=(*to_rgb(WEIGHT), FAINT), ec=WEIGHT))
    axes.text(0.12, 0.88, "payload", ha="center", color=WEIGHT)
    axes.plot([-0.38, -0.38], [-0.12, -0.04], color=BODY, lw=0.8)
    axes.plot([centre[0]] * 2, [-0.12, 0.1], color=WEIGHT, lw=0.8, ls=":")
    axes.annotate("", (centre[0], -0.08), (-0.38, -0.08), arrowprops={"arrowstyle": "<|-|>", "color": BODY})
    axes.text(-0.13, -0.13, "lever arm: where the forces balance", ha="center", va="top", color=BODY)
    return figure


def frames() -> plt.Figure:
    """Trunk, IMU, joints of a leg and contact point."""
    figure, axes = canvas(7, 4.1)
    robot(axes)
    axes.set(xlim=(-0.85, 0.95), ylim=(-0.14, 0.92))
    for (x, z), name, length in (((-0.05, 0.625), "trunk", 0.2), ((0.24, 0.62), "IMU", 0.09)):
        arrow(axes, (x, z), (x + length, z), FRAME, "", "right")
        arrow(axes, (x, z), (x, z + length), FRAME, "", "right")
        axes.text(x - 0.02, z + length * 0.8, name, color=FRAME, ha="right")
    for (x, z), name in (((0.38, 0.56), "HAA, HFE"), ((0.27, 0.3), "KFE")):
        axes.text(x + 0.05, z - 0.06, name, color=BODY, ha="left", va="top")
    axes.plot(0.38, 0.0, "o", color=FORCE, ms=7)
    axes.text(0.42, 0.03, "contact point", color=FORCE, ha="left")
    axes.text(
        0.0,
        -0.08,
        "x forwards, y to the left, z upwards; joints' axes and offsets from the model file",
        ha="center",
        color=BODY,
        fontsize=9,
    )
    return figure


def information() -> plt.Figure:
    """Many rows, one triangle, one answer."""
    figure, axes = canvas(7, 2.9)
    generator = np.random.default_rng(0)
    for row in range(26):
        for column in range(5):
            shade = 0.2 + 0.5 * generator.random()
            axes.add_patch(Rectangle((0.07 * column, 0.035 * row), 0.064, 0.03, fc=FORCE, alpha=shade, ec="none"))
        axes.add_patch(Rectangle((0.42, 0.035 * row), 0.064, 0.03, fc=WEIGHT, alpha=0.5, ec="none"))
    axes.text(0.24, -0.08, "A, b: a row a sample\nand equation", ha="center", va="top", color=BODY)
    arrow(axes, (0.6, 0.45), (0.9, 0.45), BODY, "", "right")
    axes.text(0.75, 0.49, "QR", ha="center", color=BODY)
    axes.add_patch(Polygon([(1.0, 0.64), (1.35, 0.64), (1.35, 0.29)], fc=(*to_rgb(FORCE), FAINT), ec=FORCE))
    axes.add_patch(Rectangle((1.4, 0.29), 0.06, 0.35, fc=(*to_rgb(WEIGHT), FAINT), ec=WEIGHT))
    axes.text(1.24, 0.22, "R, z: small, mergeable", ha="center", va="top", color=BODY)
    arrow(axes, (1.55, 0.45), (1.8, 0.45), BODY, "", "right")
    axes.text(1.68, 0.49, "solve", ha="center", color=BODY)
    axes.text(1.88, 0.45, "values\nerror bars\nwhat was not observed\nfit", va="center", color=BODY)
    axes.set_xlim(-0.02, 2.5)
    return figure


def live() -> plt.Figure:
    """Three ways in, one estimator, who gets the result."""
    figure, axes = canvas(9, 3.6)

    def box(x: float, y: float, width: float, text: str, colour: str) -> None:
        look = {"boxstyle": "round,pad=0.02", "fc": "none", "ec": colour, "lw": 1.5}
        axes.add_patch(FancyBboxPatch((x, y - 0.16), width, 0.32, **look))
        axes.text(x + width / 2, y, text, ha="center", va="center", color=colour, fontsize=9)

    ways = (
        (1.2, "Unitree robot\nrt/lowstate, DDS", "zenoh-bridge-ros2dds\non the laptop"),
        (0.6, "ROS 2 nodes\n/joint_states, /imu", "rmw_zenoh\nrouter"),
        (0.0, "control loop\nof your own", "examples/\nlive_client.py"),
    )
    for y, robot_, way in ways:
        box(0.0, y, 0.95, robot_, BODY)
        box(1.25, y, 0.95, way, BODY)
        arrow(axes, (0.98, y), (1.22, y), BODY, "", "right")
        arrow(axes, (2.23, y), (2.72, 0.3 * y + 0.42), FORCE, "", "right")
    box(2.75, 0.6, 1.0, "stadera live\nestimator in a thread", FORCE)
    axes.text(2.45, 1.12, "Zenoh, CDR", color=FORCE, ha="left", fontsize=9)
    out = (
        (1.2, "stadera/trunk, stadera/payload\nInertiaStamped"),
        (0.6, "stadera/state, stadera/diagnostics\nstadera/tare, stadera/reset"),
        (0.0, "terminal, Rerun,\nrecording (MCAP)"),
    )
    for y, text in out:
        box(4.2, y, 1.5, text, WEIGHT)
        arrow(axes, (3.78, 0.3 * y + 0.42), (4.17, y), WEIGHT, "", "right")
    axes.set(xlim=(-0.05, 5.78), ylim=(-0.25, 1.45))
    return figure


def tilt() -> plt.Figure:
    """One pose determines a line through the centre of mass, two poses a point."""
    figure, axes = panels(2, height=2.6)
    for axis, tilts, said in ((axes[0], (0.0,), "level: a line"), (axes[1], (0.0, 0.3), "two tilts: a point")):
        axis.set_aspect("equal")
        axis.axis("off")
        axis.add_patch(
            FancyBboxPatch((-0.5, -0.1), 1.0, 0.2, boxstyle="round,pad=0.02", fc=(*to_rgb(SOFT), FAINT), ec=BODY)
        )
        for angle, colour in zip(tilts, (FORCE, FRAME), strict=False):
            along = 0.55 * np.array([np.sin(angle), np.cos(angle)])
            axis.plot(
                *zip(np.array([0.1, 0.02]) - along, np.array([0.1, 0.02]) + along, strict=True), color=colour, ls="--"
            )
            axis.annotate("u", np.array([0.1, 0.02]) + along, color=colour, xytext=(4, 0), textcoords="offset points")
        if len(tilts) == 2:
            axis.plot(0.1, 0.02, "o", color=WEIGHT, ms=9)
        axis.set_title(said, loc="center")
    return figure


def gain() -> plt.Figure:
    """What the scale of all torques adds to the bars of a trunk and of a payload, without and with a scale."""
    figure, (axis,) = panels(height=1.9)
    names = ["trunk, 60 kg", "trunk, robot on a scale", "payload, 5 kg"]
    own, common = np.array([0.48, 0.48, 0.04]), 0.03 * np.array([60.0, 0.0, 5.0])
    axis.barh(names, own, color=FORCE, label="everything else")
    axis.barh(names, common, left=own, color=WEIGHT, label="scale of all torques, 3 %")
    axis.set(xlabel="standard deviation [kg]", title="an example")
    axis.invert_yaxis()
    axis.legend()
    return figure


def friction() -> plt.Figure:
    """Coulomb friction over the joint's velocity: a band at rest, a line in motion."""
    figure, (axis,) = panels(height=2.4)
    speed = np.array([-1.0, 0.0, 0.0, 1.0])
    axis.plot(speed, [-0.92, -0.8, 0.8, 0.92], color=FORCE)
    axis.plot([0, 0], [-0.8, 0.8], color=RED, lw=5, alpha=0.6)
    axis.annotate("at rest: anything between, by how the robot settled", (0.03, -0.35), color=RED)
    axis.annotate("in motion: known", (0.55, 0.62), color=FORCE)
    axis.set(xlabel="joint velocity", ylabel="friction torque", xticks=[0], yticks=[-0.8, 0, 0.8])
    axis.set_yticklabels(["−τ_c", "0", "τ_c"])
    return figure


def window() -> plt.Figure:
    """A window of 40 ms every 20 ms on the rows of both sides."""
    figure, (axis,) = panels(height=2.0)
    time = np.linspace(0.0, 140.0, 700)
    axis.plot(
        time,
        1.25 + 0.25 * np.sin(time / 9.0) + 0.1 * np.sin(time / 2.0),
        color=STEEL,
        lw=1,
        label="a row, every sample",
    )
    for k in range(6):
        inside = (time >= 20 * k) & (time <= 20 * k + 40)
        bell = np.where(inside, np.sin(np.pi * (time - 20 * k) / 40.0) ** 2, np.nan)
        axis.fill_between(time, 0.6 * bell, color=FORCE, alpha=0.25, lw=0)
        axis.plot(time, 0.6 * bell, color=FORCE, lw=1.2, label="windows, zero at both ends" if k == 0 else "")
    axis.set(xlabel="time [ms]", yticks=[], ylim=(0, 1.75), xlim=(0, 140))
    axis.legend(loc="upper right", ncols=2, fontsize=8)
    return figure


def boxes(
    places: dict[str, tuple[float, float]],
    links: Sequence[tuple[str, str]],
    size: tuple[float, float],
    colours: dict[str, str],
) -> plt.Figure:
    """Boxes with words at places (centres), joined by arrows; a box is 1.5 wide and 0.42 tall."""
    figure, axes = canvas(*size)
    for text, (x, y) in places.items():
        colour = colours.get(text, BODY)
        look = {"boxstyle": "round,pad=0.03", "fc": (*to_rgb(colour), 0.12), "ec": colour, "lw": 1.4}
        axes.add_patch(FancyBboxPatch((x - 0.75, y - 0.21), 1.5, 0.42, **look))
        axes.text(x, y, text, ha="center", va="center", color=colour, fontsize=9)
    for begin, end in links:
        a, b = np.array(places[begin]), np.array(places[end])
        way = b - a
        reach = min(0.78 / max(abs(way[0]), 1e-9), 0.24 / max(abs(way[1]), 1e-9))
        head, tail = tuple(b - reach * way), tuple(a + reach * way)
        axes.annotate("", head, tail, arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.4})
    xs, ys = zip(*places.values(), strict=True)
    axes.set(xlim=(min(xs) - 0.85, max(xs) + 0.85), ylim=(min(ys) - 0.3, max(ys) + 0.3))
    return figure


def errors() -> plt.Figure:
    """A model error is estimated, considered or caught."""
    names = (
        "an error of the robot",
        "estimated:\na column and a prior",
        "considered:\nwidens the bar",
        "caught:\nno figure, a reason",
    )
    places = dict(zip(names, ((0.0, 0.7), (2.6, 1.4), (2.6, 0.7), (2.6, 0.0)), strict=True))
    colours = {names[1]: FORCE, names[2]: WEIGHT, names[3]: RED}
    return boxes(places, [(names[0], other) for other in names[1:]], (6.5, 2.6), colours)


def nonstop() -> plt.Figure:
    """States of the supervisor that never stops."""
    places = {"walking": (0.0, 0.0), "weighing on the way": (2.4, 0.0), "standing": (4.8, 0.0)}
    links = [
        ("walking", "weighing on the way"),
        ("weighing on the way", "walking"),
        ("weighing on the way", "standing"),
    ]
    return boxes(places, links, (7.2, 0.9), {"walking": FRAME, "standing": RED})


def classic() -> plt.Figure:
    """States of the supervisor that stops to weigh."""
    places = {
        "walking": (0.0, 0.9),
        "stopping": (2.1, 0.9),
        "weighing mass": (4.2, 0.9),
        "weighing centre": (4.2, 0.0),
        "converged": (2.1, 0.0),
        "standing": (6.3, 0.45),
    }
    chain = ("walking", "stopping", "weighing mass", "weighing centre", "converged", "walking")
    links = [*pairwise(chain), ("weighing mass", "standing"), ("weighing centre", "standing")]
    return boxes(places, links, (8.0, 1.8), {"walking": FRAME, "standing": RED})


def checks() -> plt.Figure:
    """What a log passes on its way to a figure."""
    said = ("log", "consistency checks", "estimate", "fit", "against the model")
    places = {text: (1.9 * k, 0.8) for k, text in enumerate(said)} | {
        "refused: why,\nand the option": (1.9, 0.0),
        "good, doubtful\nor bad": (1.9 * (len(said) - 1), 0.0),
    }
    links = [
        *pairwise(said),
        (said[1], "refused: why,\nand the option"),
        (said[-1], "good, doubtful\nor bad"),
    ]
    return boxes(places, links, (9.4, 1.5), {"refused: why,\nand the option": RED, "good, doubtful\nor bad": FRAME})


def fleet() -> plt.Figure:
    """Logs to rows to one table and a page."""
    places = {
        "logs: paths, globs,\nURLs, a manifest": (0.0, 0.6),
        "a worker a core,\nor a Dask cluster": (2.2, 0.6),
        "table (Parquet)\nand journal": (4.4, 0.6),
        "page, JSON": (6.6, 1.2),
        "merged legs": (6.6, 0.0),
    }
    names = list(places)
    links = [(names[0], names[1]), (names[1], names[2]), (names[2], names[3]), (names[2], names[4])]
    return boxes(places, links, (8.4, 1.9), {names[1]: FORCE, names[2]: WEIGHT})


def structure() -> plt.Figure:
    """The way of a log through the package."""
    places = {
        "robot/": (2.0, 0.0),
        "lab/": (0.0, 0.0),
        "logs/": (0.0, 0.8),
        "checks/": (2.0, 0.8),
        "body/ rows": (4.0, 0.8),
        "information.py": (6.0, 0.8),
        "trunk/ identify/": (8.0, 0.8),
        "weigh/ fleet/\nlive/": (8.0, 0.0),
        "report/ cli/": (6.0, 0.0),
    }
    links = [
        ("lab/", "logs/"),
        ("logs/", "checks/"),
        ("checks/", "body/ rows"),
        ("robot/", "body/ rows"),
        ("body/ rows", "information.py"),
        ("information.py", "trunk/ identify/"),
        ("trunk/ identify/", "weigh/ fleet/\nlive/"),
        ("weigh/ fleet/\nlive/", "report/ cli/"),
    ]
    return boxes(places, links, (9.4, 1.6), {"information.py": WEIGHT, "body/ rows": FORCE})


def recording() -> plt.Figure:
    """What a log for weighing contains, over time."""
    figure, (axis,) = panels(height=1.7)
    spans = (
        (0, 10, "walk or sway, empty: the tare", FRAME),
        (10, 14, "load", STEEL),
        (14, 24, "walk or sway, loaded", FORCE),
    )
    for begin, end, text, colour in spans:
        axis.axvspan(begin, end, color=colour, alpha=0.25, lw=0)
        axis.text((begin + end) / 2, 0.5, text, ha="center", va="center", color=colour, fontsize=9)
    axis.set(xlim=(0, 24), ylim=(0, 1), yticks=[], xlabel="seconds since the log's beginning (--tare 0:10)")
    return figure


def held() -> plt.Figure:
    """A robot on a stand with one leg swinging."""
    figure, axes = canvas(6.0, 3.0)
    axes.add_patch(
        FancyBboxPatch((-0.45, 0.66), 0.9, 0.13, boxstyle="round,pad=0.02", fc=(*to_rgb(SOFT), FAINT), ec=BODY, lw=1.5)
    )
    axes.add_patch(
        Polygon([(-0.16, 0.63), (0.16, 0.63), (0.24, 0.0), (-0.24, 0.0)], fc=(*to_rgb(STEEL), FAINT), ec=STEEL)
    )
    axes.text(0.0, 0.28, "stand", ha="center", color=STEEL)
    for shift, opacity in ((-0.16, 0.25), (-0.05, 0.5), (0.08, 1.0)):
        axes.plot(
            [0.38, 0.38 - 0.11 + shift, 0.38 + 2 * shift],
            [0.66, 0.42, 0.2],
            color=FORCE,
            lw=4,
            alpha=opacity,
            solid_capstyle="round",
        )
    axes.plot([-0.38, -0.49, -0.38], [0.66, 0.42, 0.2], color=BODY, lw=4, solid_capstyle="round")
    axes.plot([-0.8, 0.8], [0, 0], color=BODY, lw=1)
    axes.annotate("no foot touches", (0.58, 0.1), color=INK)
    return figure


DIAGRAMS = (
    lever,
    frames,
    information,
    live,
    tilt,
    gain,
    friction,
    window,
    errors,
    nonstop,
    classic,
    checks,
    fleet,
    structure,
    recording,
    held,
)

if __name__ == "__main__":
    for draw in DIAGRAMS:
        save(draw(), draw.__name__)
