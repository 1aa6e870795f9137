"""Tables of an excitation, for terminal and page."""

from __future__ import annotations

import numpy as np

from stadera.excite.result import Excitation
from stadera.report.numbers import number
from stadera.report.table import TableData


def limits_table(result: Excitation) -> TableData:
    """Extremes of each joint's motion, and its bounds with margins subtracted."""
    bounds, peaks = result.experiment.bounds, result.peaks
    rows = (
        (
            joint,
            f"{_span(peaks.lower[k], peaks.upper[k])} of {_span(bounds.lower[k], bounds.upper[k])}",
            f"{number(peaks.velocity[k], 3)} of {_bound(bounds.velocity[k])}",
            number(peaks.acceleration[k], 3),
            f"{number(peaks.torque[k], 3)} of {_bound(bounds.effort[k])}",
        )
        for k, joint in enumerate(bounds.joints)
    )
    head = ("joint", "position [rad]", "velocity [rad/s]", "acceleration [rad/s²]", "torque [N·m]")
    return TableData.of(f"{bounds.leg}: extremes, of what is allowed", head, rows)


def worth_table(result: Excitation) -> TableData:
    """Information and rank of the motion and of the random draws, one row for each."""
    rows = (
        (
            name,
            f"{a.gain:.1f}",
            str(a.rank),
            str(a.rigid_rank),
            number(100.0 * float(np.median(a.std)), 2),
            number(100.0 * float(a.std.max()), 2),
        )
        for name, a in result.motions.items()
    )
    head = (
        "motion",
        "information gain [nat]",
        f"combinations known, of {len(result.combinations)}",
        f"links' alone, joint terms given, of {result.rigid_rank}",
        "median std [% of prior's]",
        "worst std [% of prior's]",
    )
    return TableData.of("Expected information in a log of this motion", head, rows)


def verdict(result: Excitation) -> str:
    """One sentence on how much better the motion is than the paper's random draws."""
    if result.gained is None or result.ratios is None:
        return "This is a random draw; the optimised motion was not asked for."
    worse = int(np.sum(result.ratios < 1.0))
    tail = f", {worse} of {len(result.ratios)} known less well" if worse else ""
    return (
        f"Against the median of {len(result.draws)} random draws: {result.gained:+.1f} nat of information; standard "
        f"deviations {result.median_ratio:.1f} times smaller in the median, {result.ratios.max():.1f} at best{tail}."
    )


def _span(low: float, high: float) -> str:
    return f"{number(low, 3)} to {number(high, 3)}"


def _bound(value: float) -> str:
    return number(value, 3, "no limit")
