"""Tables in the terminal, all alike.

Rich takes brackets in plain strings for markup, so that the [kg] of a heading would vanish: headings are texts here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from rich.box import HEAVY_HEAD, Box
from rich.table import Table
from rich.text import Text

_SIDES: dict[str, Literal["left", "right"]] = {"l": "left", "r": "right"}


def titled_table(
    title: str,
    headings: Sequence[str],
    sides: str = "",
    *,
    fold: bool = False,
    box: Box = HEAVY_HEAD,
    edge: bool = True,
) -> Table:
    """A table without rows, title and headings as they are given, brackets too.

    Args:
        title: above it.
        headings: of the columns.
        sides: "l" or "r" for each column; empty for names to the left in the first and figures to the right.
        fold: cells that are too long go on in the next line, rather than being cut.
        box: its lines.
        edge: whether there is room between its edge and the cells.
    """
    table = Table(title=Text(title), title_justify="left", title_style="bold", box=box, pad_edge=edge)
    for heading, side in zip(headings, sides or "l" + "r" * (len(headings) - 1), strict=True):
        table.add_column(Text(heading), justify=_SIDES[side], overflow="fold" if fold else "ellipsis")
    return table
