"""Terminal output of an identification, with a symbol in addition to each of Table I's colours."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import RenderableType
from rich.text import Text

from stadera.identify.result import Identification
from stadera.report.identify.remarks import level, remarks, verdict
from stadera.report.identify.tables import LINK_FRAMES, joint_table, link_table, rmse_table
from stadera.report.terminal import legend, rich_table
from stadera.report.trust import STYLES, marked

_WORDS = {"bad": "problem", "warning": "warning", "note": "note"}


def identification_tables(result: Identification) -> Iterator[RenderableType]:
    """Links and joints of each leg, torque errors, then remarks and verdict.

    The verdict comes last, since a terminal shows the end of the output.
    """
    for leg in result.legs:
        yield rich_table(marked(link_table(leg), result.trust))
        if any(name.split(".")[0] in leg.leg.joints for name in leg.estimate.columns):
            yield rich_table(marked(joint_table(leg), result.trust))
    yield legend(f"({LINK_FRAMES}; in square brackets: the prior)")
    yield rich_table(rmse_table(result))
    for remark in reversed(remarks(result)):
        yield Text(f"{_WORDS[remark.level]}: {remark.text}", style=STYLES[remark.level])
    yield Text(verdict(result), style="bold" if result.trust.verdict == "good" else STYLES[level(result)])
