"""Draws the diagrams of "The idea" and "Live" as SVG: python docs/diagrams.py (needs pip install '.[figures]')."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyBboxPatch, Polygon, Rectangle

FOLDER = Path(__file__).parent / "figures"
BODY, FORCE, WEIGHT, FRAME = "#5b6472", "#0b6cc4", "#c2410c", "#15803d"
plt.rcParams.update({"svg.fonttype": "path", "svg.hashsalt": "stadera", "font.size": 11})


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
    axes.add_patch(FancyBboxPatch((-0.45, 0.56), 0.9, 0.13, boxstyle="round,pad=0.02", fc="#e5e7eb", ec=BODY, lw=1.5))
    for x in (-0.38, 0.38):
        hip, knee, foot = (x, 0.56), (x - 0.11, 0.3), (x, 0.02)
        axes.plot(*zip(hip, knee, foot, strict=True), color=BODY, lw=4, solid_capstyle="round", solid_joinstyle="round")
        axes.plot(*zip(hip, knee, strict=True), "o", color="white", mec=BODY, ms=7)
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
        arrow(axes, (x, 0.0), (x, share), FORCE, rf"$f_\mathrm{{{name}}}$", "right")
    axes.plot(*centre, "o", color=WEIGHT, ms=8)
    arrow(axes, centre, (centre[0], 0.12), WEIGHT, r"$m\,g$", "right")
    axes.add_patch(Rectangle((0.02, 0.71), 0.2, 0.14, fc="#fde7d9", ec=WEIGHT))
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
            shade = 0.55 + 0.4 * generator.random()
            axes.add_patch(Rectangle((0.07 * column, 0.035 * row), 0.064, 0.03, fc=(shade, shade, 1.0), ec="none"))
        axes.add_patch(Rectangle((0.42, 0.035 * row), 0.064, 0.03, fc="#fcd9c4", ec="none"))
    axes.text(0.24, -0.08, "A, b: a row a sample\nand equation", ha="center", va="top", color=BODY)
    arrow(axes, (0.6, 0.45), (0.9, 0.45), BODY, "", "right")
    axes.text(0.75, 0.49, "QR", ha="center", color=BODY)
    axes.add_patch(Polygon([(1.0, 0.64), (1.35, 0.64), (1.35, 0.29)], fc="#d6d6ff", ec=FORCE))
    axes.add_patch(Rectangle((1.4, 0.29), 0.06, 0.35, fc="#fcd9c4", ec=WEIGHT))
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
        look = {"boxstyle": "round,pad=0.02", "fc": "white", "ec": colour, "lw": 1.5}
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


if __name__ == "__main__":
    for draw in (lever, frames, information, live):
        draw().savefig(FOLDER / f"{draw.__name__}.svg", metadata={"Date": None}, facecolor="white")
