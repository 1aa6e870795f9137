"""Draws the figures that need a simulation: python docs/figures.py (needs pip install '.[docs,lab]', and Chromium).

A leg of the real Go2's log, a box that comes onto a trotting HyQ, a Go2 weighed in three motions, the most informative
motions, the leg of Table I in the paper's colours, and the demo's scene at three moments.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from themed import BLUE, FOLDER, GREEN, INK, ORANGE, RED, SOFT, STEEL, panels, save

import stadera
from stadera.excite.trunk.design import weighing_routine
from stadera.identify.result import LegIdentification
from stadera.lab.demo import run_demo
from stadera.lab.experiments import ReproduceSettings, experiments_named, run_experiments
from stadera.lab.report.demo import demo_html
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.lab.truth import TruthAt
from stadera.report.page import find_browser
from stadera.report.table import Cell
from stadera.robot import load_robot
from stadera.trunk import Samples, TrunkEstimator

COLOURS = {"prior": STEEL, "prior_friction": ORANGE, "identified": BLUE}
NAMES = {"prior": "CAD", "prior_friction": "CAD + friction", "identified": "identified"}


def go2_leg(leg: LegIdentification) -> None:
    """Torques of one leg on the part that was kept back, and how far each model is off."""
    trace = next(t for t in leg.traces if t.part == "validation")
    shown = slice(0, 1000, 2)  # five seconds
    time = trace.time[shown] - trace.time[0]
    figure, axes = plt.subplots(3, 2, figsize=(11, 6), sharex="col", width_ratios=(3, 1), layout="constrained")
    for row, joint in enumerate(leg.leg.joints):
        left, right = axes[row]
        left.plot(time, trace.measured[shown, row], color=INK, lw=1.6, label="measured")
        for model in ("prior", "prior_friction", "identified"):
            left.plot(time, trace.predicted[model][shown, row], color=COLOURS[model], lw=1.1, label=NAMES[model])
        left.set_ylabel(f"{joint.removesuffix('_joint')}\ntorque [N·m]")
        left.margins(x=0)
        rmse = [leg.rmse["validation"][model][joint] for model in NAMES]
        bars = right.barh(list(NAMES.values()), rmse, color=[COLOURS[m] for m in NAMES])
        right.bar_label(bars, fmt=" %.2f", fontsize=9)
        right.set_xlim(0, max(rmse) * 1.25)
    axes[0][0].legend(ncols=4, frameon=False, loc="lower left", bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
    axes[-1][0].set_xlabel("time on data that was not used to identify [s]")
    axes[-1][1].set_xlabel("RMSE [N·m]")
    save(figure, "go2_leg")


def payload_at_a_trot() -> None:
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
    draw_payload(np.array(rows), log.truth.moments[-1], estimator.changes[0].noticed - loaded_at)


def draw_payload(rows: np.ndarray, truth: TruthAt, noticed: float) -> None:
    """Rows of time since the load [s], mass and its deviation [kg], place (3) and its deviations [m]."""
    assert truth.payload_com is not None
    time, mass, mass_std = rows[:, :3].T
    place, place_std = rows[:, 3:6], rows[:, 6:9]
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 3.6), layout="constrained")
    left.fill_between(time, mass - 2 * mass_std, mass + 2 * mass_std, color=BLUE, alpha=0.25, lw=0)
    left.plot(time, mass, color=BLUE, lw=1.8)
    left.axhline(truth.payload_mass, color=INK, lw=1, ls="--")
    left.axvline(noticed, color=ORANGE, lw=1.2)
    left.annotate(f"noticed after {1e3 * noticed:.0f} ms", (noticed, 2), xytext=(6, 0), textcoords="offset points")
    left.set(xlim=(-0.05, 1.0), ylim=(-1, 10), xlabel="time since the box came on [s]", ylabel="payload's mass [kg]")
    for axis, colour in enumerate((BLUE, ORANGE, GREEN)):
        low, high = place[:, axis] - 2 * place_std[:, axis], place[:, axis] + 2 * place_std[:, axis]
        right.fill_between(time, low, high, color=colour, alpha=0.25, lw=0)
        right.plot(time, place[:, axis], color=colour, lw=1.8, label="xyz"[axis])
        right.axhline(truth.payload_com[axis], color=INK, lw=1, ls="--")
    right.set(xlim=(-0.05, 3.0), ylim=(-0.6, 0.6), xlabel="time since the box came on [s]")
    right.set_ylabel("payload's place, trunk frame [m]")
    right.legend(ncols=3, frameon=False, loc="upper right")
    left.set_title("bands: two standard deviations; dashed: the truth", fontsize=9, loc="left")
    save(figure, "payload_trot")


def motions() -> None:
    """What a Go2 that stands, sways and trots says of a load of 1.6 kg, two standard deviations wide."""
    robot, loaded_at, load = load_robot("go2"), 10.0, 1.6
    figure, axes = panels(3, height=2.6, sharey=True)
    for axis, scenario, name in zip(axes, ("stand", "shake", "trot"), ("standing", "swaying", "trotting"), strict=True):
        settings = SimulateSettings("real-unit-gain", Load(load), duration=20.0, rate=500.0, load_time=loaded_at)
        found = stadera.weigh(robot, simulate(robot, f"{scenario}-load", settings).recording, tare=(0.0, 9.5))
        line = found.timeline.columns
        keep = slice(None, None, max(1, len(line["time"]) // 200))
        time, mass, std = (np.asarray(line[key])[keep] for key in ("time", "payload_mass", "payload_mass_std"))
        axis.fill_between(time, mass - 2 * std, mass + 2 * std, color=BLUE, alpha=0.25, lw=0)
        axis.plot(time, mass, color=BLUE)
        axis.plot([0, loaded_at, loaded_at, 20], [0, 0, load, load], color=INK, ls="--", lw=1)
        axis.set(title=name, xlabel="time [s]", ylim=(-2, 6), xlim=(8, 20))
    axes[0].set_ylabel("payload [kg]")
    save(figure, "motions")


def excitation() -> None:
    """The motion of a leg by which most is known."""
    found = stadera.excite("go2", "RF")
    figure, (axis,) = panels(height=2.4)
    sampled = found.chosen.motion.sample(50.0)
    shown = sampled.time <= 10.0
    for k, part in enumerate(("HAA", "HFE", "KFE")):
        axis.plot(sampled.time[shown], sampled.position[shown, k], label=part)
    axis.set(xlabel="time [s]", ylabel="position [rad]")
    axis.legend(fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    save(figure, "excitation")


def routine() -> None:
    """The five seconds by which a standing Go2's payload is weighed best."""
    planted = weighing_routine("go2").planted
    figure, (axis,) = panels(height=2.0)
    for k, name in enumerate(("roll", "pitch")):
        axis.plot(planted.time, np.degrees(planted.pose[:, k]), label=name)
    axis.set(xlabel="time [s]", ylabel="trunk [°]")
    axis.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))
    save(figure, "routine")


def table1_leg() -> None:
    """Our Table I: simulated, identified and CAD's parameters of a leg, in the colours of the paper's."""
    (result,) = run_experiments(experiments_named("table1"), ReproduceSettings(), lambda *_: None)
    colours = {"observable": GREEN, "partial": STEEL, "unobservable": RED}
    tables = result.to_tables()  # masses and centres; inertias; the paper's
    sizes = [1 + sum(bool(heading) + len(rows) for heading, rows in table.groups) for table in tables]
    figure, axes = plt.subplots(
        len(tables), 1, figsize=(7.2, 0.2 * sum(sizes)), height_ratios=sizes, layout="constrained"
    )
    for axis, table in zip(axes, tables, strict=True):
        head = [name.split(" [")[0] for name in table.head]
        rows = [row for heading, group in table.groups for row in ([Cell(heading)] * bool(heading), *group) if row]
        texts = [[cell.marked for cell in row] + [""] * (len(head) - len(row)) for row in rows]
        shown = axis.table(texts, colLabels=head, edges="horizontal", loc="upper center")
        shown.auto_set_font_size(False)
        shown.set_fontsize(8)
        shown.auto_set_column_width(range(len(head)))
        for (row, column), drawn in shown.get_celld().items():
            mark = rows[row - 1][column].mark if row and column < len(rows[row - 1]) else None
            drawn.set(edgecolor=SOFT, facecolor="none", linewidth=0.3)
            drawn.get_text().set_color(colours[mark.word] if mark else INK)
        axis.set_title(table.title)
        axis.set_axis_off()
    save(figure, "table1_leg")


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
    np.seterr(all="raise", under="ignore")
    go2_leg(stadera.identify("go2", "go2_legs_in_air").legs[0])
    payload_at_a_trot()
    motions()
    excitation()
    routine()
    table1_leg()
    demo(FOLDER / "demo.png")


if __name__ == "__main__":
    main()
