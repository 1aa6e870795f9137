"""Draws the figures of the runs in docs/results: python docs/result_figures.py (needs pip install '.[figures]').

Each figure names the file it is made of and that file's hash, which the tests compare.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from hashlib import sha256
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter
from themed import BLUE, CYCLE, GREEN, INK, ORANGE, RED, STEEL, panels, save

RESULTS = Path(__file__).parent / "results"
Record = dict[str, Any]
PAPER = {"marker": "D", "mfc": "none", "mec": INK, "ls": "", "label": "the paper"}


def values(records: Iterable[Record], metric: str, of: str = "value") -> list[float]:
    """Values, or the paper's, of one metric, in the order of the run."""
    return [float("nan") if r[of] is None else float(r[of]) for r in records if r["metric"] == metric]


def logarithmic(axis: Axes) -> None:
    """A logarithmic x axis with a label at each decade only."""
    axis.set_xscale("log")
    axis.xaxis.set_minor_formatter(NullFormatter())


def grouped(axis: Axes, names: list[str], series: dict[str, list[float]], colours: Iterable[str] = CYCLE) -> None:
    """Horizontal bars, one group a name."""
    thick = 0.8 / len(series)
    for k, ((label, found), colour) in enumerate(zip(series.items(), colours, strict=False)):
        at = np.arange(len(names)) + thick * (k + 0.5) - 0.4
        axis.barh(at, found, 0.9 * thick, color=colour, label=label)
    axis.set_yticks(range(len(names)), names)
    axis.invert_yaxis()


def table1(records: list[Record]) -> plt.Figure:
    """Rank of the leg, and worst errors against the paper's."""
    figure, (left, right) = panels(2, height=2.6, width_ratios=(1, 2))
    rank = next(r for r in records if r["metric"] == "rank, of 30")
    left.bar(["here", "paper"], [rank["value"], rank["paper"]], color=[BLUE, STEEL])
    left.axhline(17, color=GREEN, ls="--", lw=1)
    left.set(ylabel="rank, of 30", title="directions found, 17 exist")
    exact = [r for r in records if r["case"].get("sensor errors") == "none" and r["metric"].startswith("worst")]
    names = [f"{r['case']['method']}: {r['metric'].removeprefix('worst ')}" for r in exact]
    right.barh(names, [max(r["value"], 1e-17) for r in exact], color=BLUE)
    right.set(xscale="log", xlim=(1e-17, 1e-2), title="errors without noise")
    right.axvline(1e-3, color=INK, ls="--", lw=1)
    right.annotate(
        "the paper's CoM, 1 mm", (1e-3, 1.98), fontsize=8, ha="right", xytext=(-4, 0), textcoords="offset points"
    )
    right.invert_yaxis()
    return figure


def fig4(records: list[Record]) -> plt.Figure:
    """Torque RMSE on the second motion with sensor errors."""
    own = [r for r in records if r["case"]["sensor errors"] == "standard"]
    figure, (axis,) = panels(height=2.2)
    models = ("CAD", "CAD with friction", "identified")
    series = {name: values(own, f"torque RMSE, {name}") for name in models}
    grouped(axis, ["HAA", "HFE", "KFE"], series, (STEEL, ORANGE, BLUE))
    axis.set(xlabel="torque RMSE on the second motion [N·m]")
    axis.legend()
    return figure


def fig5(records: list[Record]) -> plt.Figure:
    """All 24 joints of the two real robots, in the order of what is left."""
    own = [r for r in records if "joint" in r["case"]]
    figure, axes = panels(2, height=3.9)
    for axis, robot, name in zip(axes, ("go2", "aliengo"), ("Go2", "Aliengo"), strict=True):
        mine = [r for r in own if r["case"]["robot"] == robot]
        joints = list(dict.fromkeys(r["case"]["joint"].removesuffix("_joint") for r in mine))
        for label, colour in (("CAD", STEEL), ("CAD with friction", ORANGE), ("identified", BLUE)):
            axis.plot(values(mine, f"torque RMSE, {label}"), joints, "o", color=colour, label=label, ms=5)
        logarithmic(axis)
        axis.set(xlabel="torque RMSE, held-out half [N·m]", title=name)
        axis.grid(axis="y")
        axis.invert_yaxis()
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    return figure


def fig6(records: list[Record]) -> plt.Figure:
    """Time until the centre of mass stays within 2 mm."""
    figure, (axis,) = panels(height=1.6)
    axis.barh(["settling time 0.6 s", "settling time 1.5 s"], values(records, "time to stay under 2 mm"), color=BLUE)
    axis.axvline(2.0, color=INK, ls="--", lw=1)
    axis.set(xlabel="time to stay under 2 mm [s]", title="dashed: the paper, 2 s")
    return figure


def table2(records: list[Record]) -> plt.Figure:
    """Three methods at three loads beside the paper's."""
    own = [r for r in records if r["case"]["robot"] == "hyq" and r["metric"] == "‖δ‖ in x-y"]
    figure, (axis,) = panels(height=2.8)
    methods = list(dict.fromkeys(r["case"]["method"] for r in own))
    for k, (method, colour) in enumerate(zip(methods, CYCLE, strict=False)):
        mine = [r for r in own if r["case"]["method"] == method]
        at = np.arange(3) + 0.2 * (k - 1)
        axis.plot(at, [r["value"] for r in mine], "o", color=colour, label=method)
        axis.plot(at, [r["paper"] for r in mine], **PAPER | {"mec": colour, "label": "the paper" if k == 0 else ""})
    axis.axhline(0.1, color=RED, ls="--", lw=1, label="bound")
    axis.set(yscale="log", ylabel="error in x-y [cm]", xlabel="load [N]")
    axis.set_xticks(range(3), ["0", "50", "100"])
    axis.legend(fontsize=8, ncols=2, loc="center left", bbox_to_anchor=(1, 0.5))
    return figure


def table3(records: list[Record]) -> plt.Figure:
    """Ramps: one pose and two, beside the paper's."""
    figure, axes = panels(3, height=2.6, sharey=True)
    for axis, slope in zip(axes, (0.0, 10.0, 15.0), strict=True):
        own = [r for r in records if r["case"]["slope [deg]"] == slope]
        for poses, colour in (("one pose", BLUE), ("two poses", GREEN)):
            axis.plot([0, 50, 100], values(own, f"‖δ‖ in the trunk's x-y, {poses}"), "o-", color=colour, label=poses)
        axis.plot([0, 50, 100], values(own, "‖δ‖ in the trunk's x-y, one pose", "paper"), **PAPER)
        axis.axhline(0.3, color=RED, ls="--", lw=1, label="bound")
        axis.set(yscale="log", title=f"{slope:g}°", xlabel="load [N]")
    axes[0].set_ylabel("error in the trunk's x-y [cm]")
    axes[0].legend(fontsize=8, loc="center")
    return figure


def table4(records: list[Record], error: str) -> plt.Figure:
    """Three readings of one kind of error, three methods, beside the paper's."""
    own = [
        r
        for r in records
        if r["case"]["error"] == error and r["metric"].startswith("‖δ‖ in x-y") and "worst" not in r["metric"]
    ]
    μ, σ = (next(key for key in own[0]["case"] if key.startswith(letter)) for letter in "μσ")
    figure, axes = panels(3, height=2.9, sharey=True)
    for axis, reading in zip(axes, dict.fromkeys(r["case"]["reading"] for r in own), strict=True):
        mine = [r for r in own if r["case"]["reading"] == reading]
        sizes = list(dict.fromkeys(f"{r['case'][μ]:g}, {r['case'][σ]:g}" for r in mine))
        for method, colour in zip(dict.fromkeys(r["case"]["method"] for r in mine), (ORANGE, BLUE, GREEN), strict=True):
            found = [r for r in mine if r["case"]["method"] == method]
            axis.plot(sizes, [r["value"] for r in found], "o-", color=colour, label=method)
            paper = [np.nan if r["paper"] is None else r["paper"] for r in found]
            axis.plot(sizes, paper, **PAPER | {"mec": colour, "label": ""})
        axis.set(yscale="log", xlabel=f"{μ.split()[0]}, {σ}")
        axis.set_title(reading.replace(", and ", ",\n"), fontsize=8)
    axes[0].set_ylabel("error in x-y [cm]\n(diamonds: the paper)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    return figure


def table4_torques(records: list[Record]) -> plt.Figure:
    """Torque offsets."""
    return table4(records, "torque offset")


def table4_feet(records: list[Record]) -> plt.Figure:
    """Wrong foot positions."""
    return table4(records, "foot position")


def table5(records: list[Record]) -> plt.Figure:
    """Weighed on the way: errors to the truth and to method (a)."""
    figure, (axis,) = panels(height=2.8)
    shown = {
        "(c) to the truth": "(c) to the truth, ‖δ‖, median",
        "(c) to (a)": "(c) to (a), ‖δ‖, median",
        "(c), torques as measured": "(c) on torques as measured to the truth, ‖δ‖, median",
    }
    grouped(axis, ["0 N", "50 N", "100 N"], {name: values(records, metric) for name, metric in shown.items()})
    axis.plot(
        values(records, "(c) to (a), ‖δ‖, median", "paper"), range(3), **PAPER | {"label": "the paper, (c) to (a)"}
    )
    axis.axvline(0.45, color=RED, ls="--", lw=1, label="bound of (c) to the truth")
    axis.set(xlabel="error in x-y, median of five seeds [cm]", ylabel="load")
    axis.legend(fontsize=8, loc="center left", bbox_to_anchor=(1, 0.5))
    return figure


def inertial_share(records: list[Record]) -> plt.Figure:
    """Share of inertial forces over the speed."""
    figure, (axis,) = panels(height=2.4)
    own = [r for r in records if r["paper"] is not None]
    speed = [r["case"]["speed [cm/s]"] for r in own]
    axis.plot(speed, [r["value"] for r in own], "o-", color=BLUE, label="here")
    axis.plot(speed, [r["paper"] for r in own], **PAPER)
    axis.set(xlabel="speed [cm/s]", ylabel="share of inertial forces [%]", ylim=(0, None))
    axis.legend()
    return figure


def demo_margin(runs: list[Record]) -> plt.Figure:
    """Least margin and way of both walks, one point a seed."""
    figure, (left, right) = panels(2, height=2.7)
    for way, colour in (("without", RED), ("with", BLUE)):
        name = f"{way} identification"
        margin = [100.0 * run[way]["least_margin"] for run in runs]
        left.plot([run["seed"] for run in runs], margin, "o", color=colour, label=name)
        right.plot([run["seed"] for run in runs], [run[way]["distance"] for run in runs], "o", color=colour)
    left.axhline(0, color=INK, lw=1, ls="--")
    left.set(xlabel="seed", ylabel="least margin of the\ncentre of mass [cm]")
    right.set(xlabel="seed", ylabel="way walked [m]", ylim=(0, 0.8))
    figure.legend(loc="outside upper left", ncols=2)
    return figure


def demo_weight(runs: list[Record]) -> plt.Figure:
    """The box as weighed while walking, one bar a seed."""
    figure, (axis,) = panels(height=2.4)
    payload = [run["with"]["payload"]["mass"] for run in runs]
    bars = [p["std"] for p in payload]
    axis.errorbar([run["seed"] for run in runs], [p["value"] for p in payload], bars, fmt="o", color=BLUE, capsize=3)
    axis.axhline(30, color=GREEN, ls="--", lw=1)
    axis.set(xlabel="seed", ylabel="box [kg], ± 1 σ", title="dashed: the truth")
    return figure


def mini_cheetah(records: list[Record]) -> plt.Figure:
    """What the straight walks say beside the bounds that were set."""
    figure, (axis,) = panels(height=1.8)
    shown = [r for r in records if r["bound"] is not None and r["unit"] not in ("1",) and r["bound"] > 0]
    names = [f"{r['metric'].removeprefix('straight walks: ')} [{r['unit']}]" for r in shown]
    axis.barh(names, [r["value"] / r["bound"] for r in shown], color=[BLUE if r["met"] else ORANGE for r in shown])
    axis.axvline(1.0, color=RED, ls="--", lw=1)
    axis.set(xlabel="value over the bound aimed at")
    axis.invert_yaxis()
    return figure


def humanoids(records: list[Record]) -> plt.Figure:
    """Errors of the payload's mass with exact sensors and real ones."""
    own = [r for r in records if r["metric"].startswith("payload's mass")]
    names = list(dict.fromkeys(", ".join(r["case"].values()) for r in own))
    figure, (axis,) = panels(height=0.8 + 0.27 * len(names))
    metrics = {"median": "payload's mass, median", "95th percentile": "payload's mass, 95th percentile"}
    grouped(axis, names, {name: values(own, metric) for name, metric in metrics.items()})
    logarithmic(axis)
    axis.set(xlabel="error of the payload's mass [% of the robot]")
    axis.legend(fontsize=8)
    return figure


def identified(records: list[Record]) -> plt.Figure:
    """Drives: median errors with their bounds, and how many joints were determined."""
    figure, (left, right) = panels(2, height=2.2, sharey=True)
    names = ["armature", "viscous", "coulomb"]
    logs = list(dict.fromkeys(r["case"]["logs"] for r in records))
    for axis, what in ((left, "median error, relative"), (right, "determined")):
        metrics = [f"{name}: {what}" for name in names]
        of = {log: [r for r in records if r["case"]["logs"] == log] for log in logs}
        grouped(axis, names, {log: [values(own, metric)[0] for metric in metrics] for log, own in of.items()})
        axis.set(xlabel=f"{what} [%]")
        for k, own in enumerate(of.values()):
            bounds = [values(own, metric, "bound")[0] for metric in metrics]
            axis.plot(bounds, np.arange(3) + 0.4 * (k + 0.5) - 0.4, "|", ms=14, color=INK, label="bound" * (k == 0))
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper left", ncols=3, fontsize=8)
    return figure


def replay(record: Record) -> plt.Figure:
    """Errors of the joints' paths over the time of a rollout, by model."""
    figure, (axis,) = panels(width=4.6, height=2.6)
    for model, colour in zip(record["models"], (BLUE, GREEN, ORANGE, STEEL), strict=True):
        windows = [float(window) for window in record["rmse"]]
        axis.plot(
            windows, [errors[model]["all"] for errors in record["rmse"].values()], "o-", color=colour, label=model
        )
    axis.set(yscale="log", xlabel="time without correction [s]", ylabel="error [rad]", xticks=windows)
    figure.legend(loc="outside upper left", ncols=2, fontsize=8)
    return figure


def peer_legs(record: dict[str, Any]) -> plt.Figure:
    """Held-out error, error to the truth, and processor time of each tool on one leg."""
    figure, axes = panels(3, height=2.6, sharey=True)
    own = [
        row
        for row in record["legs"]
        if row["case"] == "hyq" and "skipped" not in row and row["contender"] != "the true parameters"
    ]
    columns = {"rmse": "held-out RMSE [N·m]", "error": "error to the truth [N·m]", "seconds": "processor time [s]"}
    for axis, (key, label) in zip(axes, columns.items(), strict=True):
        colours = [BLUE if row["contender"] == "stadera" else STEEL for row in own]
        axis.barh([row["contender"] for row in own], [row[key] for row in own], color=colours)
        axis.set(xlabel=label, xscale="log" if key == "seconds" else "linear")
    axes[0].invert_yaxis()
    return figure


def peer_trunks(record: dict[str, Any]) -> plt.Figure:
    """Error of the payload's mass in each run of a trot with real errors."""
    figure, axes = panels(2, height=2.8, sharey=True)
    for axis, key, label in zip(axes, ("mass", "latency"), ("mass error [% of the robot]", "latency [s]"), strict=True):
        for case, colour in zip(dict.fromkeys(row["case"] for row in record["trunks"]), CYCLE, strict=False):
            own = [row for row in record["trunks"] if row["case"] == case]
            found = [np.nan if row.get(key) is None else row[key] for row in own]
            axis.plot(found, [row["contender"] for row in own], "o", color=colour, label=case.replace("-", " "))
        logarithmic(axis)
        axis.set(xlabel=label)
        axis.grid(axis="y")
    axes[0].invert_yaxis()
    axes[1].legend(fontsize=8)
    return figure


def ablation(record: dict[str, Any]) -> plt.Figure:
    """Change of score and of the payload's error without each mechanism."""
    rows = record["kept"]
    base, rest = rows[0], rows[1:]
    figure, axes = panels(2, height=4.6, sharey=True)
    names = [row["without"] for row in rest]
    for axis, key, label in zip(
        axes, ("score", "payload_95"), ("score (lower is better)", "payload's error, 95 % [%]"), strict=True
    ):
        found = [row[key] - base[key] for row in rest]
        axis.barh(names, found, color=[RED if value > 0 else GREEN for value in found])
        axis.set(xlabel=f"change of {label}")
        axis.tick_params(axis="y", labelsize=7)
    axes[0].invert_yaxis()
    return figure


def sizes_by_kind(record: dict[str, Any]) -> plt.Figure:
    """Bars of the centre with one scale and with a size for each kind of error."""
    rows = record["sizes"]
    figure, (left, right) = panels(2, height=2.2, sharey=True)
    names = [row["logs"] for row in rows]
    for axis, key, label in (
        (left, "centre_bar", "bar of the centre [mm]"),
        (right, "score", "score (lower is better)"),
    ):
        axis.plot([row[key][0] for row in rows], names, "o", color=STEEL, label="one scale")
        axis.plot([row[key][1] for row in rows], names, "o", color=BLUE, label="by kind")
        axis.set(xlabel=label)
        axis.grid(axis="y")
    left.invert_yaxis()
    right.legend(fontsize=8)
    return figure


def reality(record: dict[str, Any]) -> plt.Figure:
    """Medians and 95th percentiles by motion, plain least squares beside."""
    figure, axes = panels(3, height=2.5, sharey=True)
    rows = record["rows"]
    motions = list(dict.fromkeys(row["motion"] for row in rows))
    columns = {"payload": "payload's mass [%]", "place": "its place, x-y [mm]", "trunk": "trunk's mass [%]"}
    for axis, (key, label) in zip(axes, columns.items(), strict=True):
        for method, colour, shift in (("stadera", BLUE, -0.15), ("plain least squares", STEEL, 0.15)):
            for row in (row for row in rows if row["method"] == method and row[key] is not None):
                at = motions.index(row["motion"]) + shift
                axis.plot(row[key], [at, at], color=colour, lw=2.5)
                axis.plot(row[key][:1], [at], "o", color=colour)
        logarithmic(axis)
        axis.set(xlabel=label)
    axes[0].set_yticks(range(len(motions)), motions)
    axes[0].invert_yaxis()
    for method, colour in (("stadera", BLUE), ("plain least squares", STEEL)):
        axes[-1].plot([], [], "o-", color=colour, label=f"{method}: median to 95 %")
    figure.legend(loc="outside upper left", ncols=2, fontsize=8)
    return figure


FIGURES: dict[str, tuple[str, Callable[[Any], plt.Figure]]] = {
    "table1": ("table1", table1),
    "fig4": ("fig4", fig4),
    "fig5": ("fig5", fig5),
    "fig6": ("fig6", fig6),
    "table2": ("table2", table2),
    "table3": ("table3", table3),
    "table4_torques": ("table4", table4_torques),
    "table4_feet": ("table4", table4_feet),
    "table5": ("table5", table5),
    "inertial_share": ("inertial_share", inertial_share),
    "demo_margin": ("demo", demo_margin),
    "demo_weight": ("demo", demo_weight),
    "mini_cheetah": ("mini_cheetah", mini_cheetah),
    "humanoids": ("humanoids", humanoids),
    "identified": ("identified", identified),
    "replay_go2": ("replay_go2", replay),
    "replay_aliengo": ("replay_aliengo", replay),
    "peer_legs": ("peers", peer_legs),
    "peer_trunks": ("peers", peer_trunks),
    "ablation": ("ablation", ablation),
    "sizes_by_kind": ("ablation", sizes_by_kind),
    "reality": ("reality_table", reality),
}
"""By file: the run, and what draws it."""


def source(name: str) -> str:
    """What the figure says it is made of."""
    run = FIGURES[name][0]
    return f"docs/results/{run}.json sha256 {sha256((RESULTS / f'{run}.json').read_bytes()).hexdigest()}"


if __name__ == "__main__":
    for name, (run, draw) in FIGURES.items():
        save(draw(json.loads((RESULTS / f"{run}.json").read_text(encoding="utf-8"))), name, source(name))
