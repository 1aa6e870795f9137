"""Draws the figures of the documentation: python docs/figures.py [GO2_LOG] (needs pip install 'stadera[docs,models]').

GO2_LOG is a flat table of a Go2 whose legs swing in the air, trunk on a stand; without it that figure stays as it is.
The demo's scene is photographed by a Chromium that is installed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from itertools import pairwise
from pathlib import Path

import matplotlib
import numpy as np
from stadera.weigh.truth import TruthAt

from stadera.identify.legs import identify
from stadera.identify.result import LegIdentification
from stadera.lab.demo import run_demo
from stadera.lab.report.demo.page import demo_html
from stadera.lab.scenarios.run import simulate
from stadera.lab.scenarios.settings import Load, SimulateSettings
from stadera.report.pdf import find_browser
from stadera.robot import load_robot
from stadera.trunk import Samples, TrunkEstimator

matplotlib.use("Agg")
import matplotlib.pyplot as plt

FOLDER = Path(__file__).parent / "figures"
COLOURS = {"prior": "#b8bcc4", "prior_friction": "#e08e45", "identified": "#0b6cc4"}
NAMES = {"prior": "CAD", "prior_friction": "CAD + friction", "identified": "identified"}


def go2_leg(leg: LegIdentification, path: Path) -> None:
    """Torques of one leg on the part that was kept back, and how far each model is off."""
    trace = next(t for t in leg.traces if t.part == "validation")
    time = trace.time - trace.time[0]
    figure, axes = plt.subplots(3, 2, figsize=(11, 6), sharex="col", width_ratios=(3, 1), layout="constrained")
    for row, joint in enumerate(leg.leg.joints):
        left, right = axes[row]
        left.plot(time, trace.measured[:, row], color="black", lw=1.6, label="measured")
        for model in ("prior", "prior_friction", "identified"):
            left.plot(time, trace.predicted[model][:, row], color=COLOURS[model], lw=1.1, label=NAMES[model])
        left.set_ylabel(f"{joint.removesuffix('_joint')}\ntorque [N·m]")
        left.margins(x=0)
        rmse = [leg.rmse["validation"][model][joint] for model in NAMES]
        bars = right.barh(list(NAMES.values()), rmse, color=[COLOURS[m] for m in NAMES])
        right.bar_label(bars, fmt=" %.2f", fontsize=9)
        right.set_xlim(0, max(rmse) * 1.25)
        for axis in (left, right):
            axis.spines[["top", "right"]].set_visible(False)
    axes[0][0].legend(ncols=4, frameon=False, loc="lower left", bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
    axes[-1][0].set_xlabel("time on data that was not used to identify [s]")
    axes[-1][1].set_xlabel("RMSE [N·m]")
    figure.savefig(path, dpi=130)
    plt.close(figure)


def payload_at_a_trot(path: Path) -> None:
    """What a trotting HyQ says of a box that comes onto its back: mass and place, two standard deviations wide."""
    robot, loaded_at, box = load_robot("hyq"), 3.0, 8.0
    settings = SimulateSettings("standard", Load(box), duration=6.0, rate=1000.0, load_time=loaded_at)
    log = simulate(robot, "trot-load", settings)
    samples = Samples.of_recording(log.recording, robot)
    estimator = TrunkEstimator(robot)
    edges = np.searchsorted(samples.time, np.arange(0.0, samples.time[-1], 0.02))
    rows = []
    for start, stop in pairwise(edges):
        estimator.add(samples[int(start) : int(stop)])
        if samples.time[stop] > loaded_at - 0.05 and estimator.payload is None:
            estimator.tare()
        if (found := estimator.payload) is not None:
            rows.append((samples.time[stop] - loaded_at, found.mass, found.mass_std, *found.com, *found.com_std))
    draw_payload(np.array(rows), log.truth.moments[-1], estimator.changes[0].noticed - loaded_at, path)


def draw_payload(rows: np.ndarray, truth: TruthAt, noticed: float, path: Path) -> None:
    """Rows of time since the load [s], mass and its deviation [kg], place (3) and its deviations [m]."""
    assert truth.payload_com is not None
    time, mass, mass_std = rows[:, :3].T
    place, place_std = rows[:, 3:6], rows[:, 6:9]
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 3.6), layout="constrained")
    left.fill_between(time, mass - 2 * mass_std, mass + 2 * mass_std, color="#0b6cc4", alpha=0.25, lw=0)
    left.plot(time, mass, color="#0b6cc4", lw=1.8)
    left.axhline(truth.payload_mass, color="black", lw=1, ls="--")
    left.axvline(noticed, color="#e08e45", lw=1.2)
    left.annotate(f"noticed after {1e3 * noticed:.0f} ms", (noticed, 2), xytext=(6, 0), textcoords="offset points")
    left.set(xlim=(-0.05, 1.0), ylim=(-1, 10), xlabel="time since the box came on [s]", ylabel="payload's mass [kg]")
    for axis, colour in enumerate(("#0b6cc4", "#c2410c", "#4d7c0f")):
        low, high = place[:, axis] - 2 * place_std[:, axis], place[:, axis] + 2 * place_std[:, axis]
        right.fill_between(time, low, high, color=colour, alpha=0.25, lw=0)
        right.plot(time, place[:, axis], color=colour, lw=1.8, label="xyz"[axis])
        right.axhline(truth.payload_com[axis], color="black", lw=1, ls="--")
    right.set(xlim=(-0.05, 3.0), ylim=(-0.6, 0.6), xlabel="time since the box came on [s]")
    right.set_ylabel("payload's place, trunk frame [m]")
    right.legend(ncols=3, frameon=False, loc="upper right")
    for axis in (left, right):
        axis.spines[["top", "right"]].set_visible(False)
    left.set_title("bands: two standard deviations; dashed: the truth", fontsize=9, loc="left")
    figure.savefig(path, dpi=130)
    plt.close(figure)


MOMENTS = (0.2, 1.15, 2.6)
"""Of the demo's picture [s], from the moment the box is let go: it has landed, one robot tips, it lies."""

SCENE_ALONE = """<style>
body { overflow: hidden; }
#stage { position: fixed; inset: 0; height: 100vh; border: 0; border-radius: 0; z-index: 9; }
#stage .label { font-size: 17px; }
#stage .label strong { font-size: 15px; }
</style>"""


def demo(path: Path) -> None:
    """The demo's scene at three moments."""
    result, width, height = run_demo(), 640, 520
    root = ["--no-sandbox"] if os.geteuid() == 0 else []
    software = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    figure, axes = plt.subplots(1, len(MOMENTS), figsize=(13.5, 4.0), layout="constrained")
    with tempfile.TemporaryDirectory() as folder:
        page, shot = Path(folder) / "page.html", Path(folder) / "shot.png"
        page.write_text(demo_html(result).replace("</body>", f"{SCENE_ALONE}</body>"), encoding="utf-8")
        for moment, axis in zip(MOMENTS, axes, strict=True):
            place = f"{page.as_uri()}#t={result.settings.load_at + moment}"
            how = ["--headless", *root, *software, "--virtual-time-budget=4000", f"--window-size={width},{height}"]
            subprocess.run([find_browser(path), *how, f"--screenshot={shot}", place], check=True, capture_output=True)
            axis.imshow(plt.imread(shot))
            axis.set_title(f"{moment:.1f} s after the box was let go", fontsize=10, loc="left")
            axis.set_axis_off()
    figure.savefig(path, dpi=130)
    plt.close(figure)


def main() -> None:
    """Identifies, weighs, draws, writes."""
    if len(sys.argv) > 2:
        sys.exit(__doc__)
    FOLDER.mkdir(exist_ok=True)
    demo(FOLDER / "demo.png")
    payload_at_a_trot(FOLDER / "payload_trot.png")
    if len(sys.argv) == 2:
        np.seterr(all="raise", under="ignore")
        result = identify(load_robot("go2"), [sys.argv[1]])
        go2_leg(result.legs[0], FOLDER / "go2_leg.png")


if __name__ == "__main__":
    main()
