"""Look of all drawn figures of the documentation: SVG without a background, colours that read on white and on black."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

FOLDER = Path(__file__).parent / "figures"
INK, SOFT = "#77818f", "#9aa3af"
BLUE, ORANGE, GREEN, RED, PURPLE, STEEL = "#2f86de", "#d9822b", "#2a9d5c", "#d9534f", "#a06cd5", "#98a1ae"
CYCLE = (BLUE, ORANGE, GREEN, PURPLE, STEEL, RED)

plt.rcParams.update(
    {
        "svg.fonttype": "none",  # text stays text: small files, found by a search
        "svg.hashsalt": "stadera",
        "font.family": "sans-serif",
        "font.size": 10,
        "figure.facecolor": "none",
        "axes.facecolor": "none",
        "savefig.facecolor": "none",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.titlesize": 10,
        "axes.titlelocation": "left",
        "axes.prop_cycle": matplotlib.cycler(color=CYCLE),
        "legend.frameon": False,
        "grid.color": SOFT,
        "grid.alpha": 0.3,
    }
    | dict.fromkeys(
        ("text.color", "axes.labelcolor", "axes.edgecolor", "axes.titlecolor", "xtick.color", "ytick.color"), INK
    )
)


def panels(
    columns: int = 1, width: float = 7.2, height: float = 3.0, **options: object
) -> tuple[plt.Figure, list[Axes]]:
    """A figure of `columns` panels side by side; sizes in inches."""
    figure, axes = plt.subplots(1, columns, figsize=(width, height), layout="constrained", squeeze=False, **options)
    return figure, list(axes[0])


def save(figure: plt.Figure, name: str, source: str = "") -> None:
    """Writes `figures/NAME.svg`, the same bytes each time; `source` says in the file what it was made from."""
    metadata = {"Date": None, "Description": source} if source else {"Date": None}
    figure.savefig(FOLDER / f"{name}.svg", metadata=metadata)
    plt.close(figure)
