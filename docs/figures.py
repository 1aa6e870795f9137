"""Draws the figures of the documentation: python docs/figures.py GO2_LOG (needs pip install 'stadera[docs,models]').

GO2_LOG is a flat table of a Go2 whose legs swing in the air, trunk on a stand.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np

from stadera.identify.legs import identify
from stadera.identify.result import LegIdentification
from stadera.robot import load_robot

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


def main() -> None:
    """Identifies, draws, writes."""
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    FOLDER.mkdir(exist_ok=True)
    np.seterr(all="raise", under="ignore")
    result = identify(load_robot("go2"), [sys.argv[1]])
    go2_leg(result.legs[0], FOLDER / "go2_leg.png")


if __name__ == "__main__":
    main()
