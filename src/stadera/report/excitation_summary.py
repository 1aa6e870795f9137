"""An excitation in the terminal and as JSON: what it uses of the leg's limits, and what it would tell."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from stadera.identify.excite import Appraisal, Excitation
from stadera.report.numbers import number
from stadera.report.terminal import titled_table

_UNITS = {
    "duration": "s",
    "rate": "Hz",
    "stand_height": "m",
    "torque_noise": "N·m",
    "position": "rad",
    "velocity": "rad/s",
    "acceleration": "rad/s²",
    "torque": "N·m",
    "least_distance": "m",
    "gain": "nat",
    "gained": "nat",
    "std": "of the prior's",
    "sinusoids": "rad, Hz, s",
}


def excitation_tables(result: Excitation) -> Iterator[RenderableType]:
    """The motion's extremes joint by joint, then what it would tell, then how much better that is than random draws."""
    yield limits_table(result)
    yield worth_table(result)
    yield from (Text(f"note: {note}", style="dim") for note in result.experiment.bounds.clearance.notes)
    yield Text(verdict(result))


def limits_table(result: Excitation) -> Table:
    """What the motion uses of each joint, and what there is with the margins taken off."""
    bounds, peaks = result.experiment.bounds, result.peaks
    headings = ("joint", "position [rad]", "velocity [rad/s]", "acceleration [rad/s²]", "torque [N·m]")
    table = titled_table(f"{bounds.leg}: extremes, of what is allowed", headings, "lllll")
    for k, joint in enumerate(bounds.joints):
        table.add_row(
            Text(joint),
            f"{number(peaks.lower[k], 3)} to {number(peaks.upper[k], 3)} of "
            f"{number(bounds.lower[k], 3)} to {number(bounds.upper[k], 3)}",
            f"{number(peaks.velocity[k], 3)} of {_bound(bounds.velocity[k])}",
            number(peaks.acceleration[k], 3),
            f"{number(peaks.torque[k], 3)} of {_bound(bounds.effort[k])}",
        )
    return table


def worth_table(result: Excitation) -> Table:
    """Information and rank of the motion and of the random draws."""
    names = [name for name, _ in appraisals(result)]
    table = titled_table("what a log of it would tell", ("", *names), "l" * (1 + len(names)))
    rows: dict[str, list[str]] = {}
    for _, motion in appraisals(result):
        rows.setdefault("information gain [nat]", []).append(f"{motion.gain:.1f}")
        rows.setdefault(f"combinations known, of {len(result.combinations)}", []).append(str(motion.rank))
        known = f"links' combinations known, joint terms given, of {result.rigid_rank}"
        rows.setdefault(known, []).append(str(motion.rigid_rank))
        rows.setdefault("std, of the prior's, median [%]", []).append(number(100.0 * float(np.median(motion.std)), 2))
        rows.setdefault("std, of the prior's, worst [%]", []).append(number(100.0 * float(motion.std.max()), 2))
    for name, cells in rows.items():
        table.add_row(Text(name), *cells)
    return table


def verdict(result: Excitation) -> str:
    """In one sentence, how much better the motion is than the paper's random draws."""
    if result.gained is None or result.ratios is None:
        return "This is a random draw; the optimised motion was not asked for."
    worse = int(np.sum(result.ratios < 1.0))
    tail = f", {worse} of {len(result.ratios)} known less well" if worse else ""
    return (
        f"Against the median of {len(result.draws)} random draws: {result.gained:+.1f} nat of information; standard "
        f"deviations {result.median_ratio:.1f} times smaller in the median, {result.ratios.max():.1f} at best{tail}."
    )


def appraisals(result: Excitation) -> list[tuple[str, Appraisal]]:
    """The motion and what it is compared with, by name."""
    if not result.draws:
        return [("random draw", result.chosen)]
    return [("optimised", result.chosen), *((f"draw {k + 1}", draw) for k, draw in enumerate(result.draws))]


def excitation_json(result: Excitation) -> dict[str, Any]:
    """The excitation as plain values: settings, extremes, worth of each motion, and the sinusoids themselves.

    Standard deviations are in shares of the prior's. Limits that the model does not state are null.
    """
    bounds, settings, ratios = result.experiment.bounds, result.settings, result.ratios
    return {
        "robot": bounds.robot.name,
        "leg": bounds.leg,
        "kind": "random" if settings.random else "optimised",
        "duration": settings.duration,
        "rate": settings.rate,
        "seed": settings.seed,
        "stand_height": settings.stand_height,
        "torque_noise": dict(zip(bounds.joints, result.experiment.noise.tolist(), strict=True)),
        "joints": {joint: _joint(result, k) for k, joint in enumerate(bounds.joints)},
        "least_distance": _finite(result.peaks.distance),
        "motions": [
            {"name": name, "gain": a.gain, "rank": a.rank, "rigid_rank": a.rigid_rank} for name, a in appraisals(result)
        ],
        "combinations": [
            {
                "text": str(combination),
                "std": float(result.chosen.std[k]),
                "random_std": float(np.median([draw.std[k] for draw in result.draws])) if result.draws else None,
                "ratio": None if ratios is None else float(ratios[k]),
            }
            for k, combination in enumerate(result.combinations)
        ],
        "gained": result.gained,
        "median_ratio": result.median_ratio,
        "rigid_rank": result.rigid_rank,
        "sinusoids": _sinusoids(result),
        "notes": list(bounds.clearance.notes),
        "units": dict(_UNITS),
    }


def _joint(result: Excitation, k: int) -> dict[str, Any]:
    bounds, peaks = result.experiment.bounds, result.peaks
    return {
        "position": [float(peaks.lower[k]), float(peaks.upper[k])],
        "position_bounds": [float(bounds.lower[k]), float(bounds.upper[k])],
        "velocity": float(peaks.velocity[k]),
        "velocity_bound": _finite(bounds.velocity[k]),
        "acceleration": float(peaks.acceleration[k]),
        "torque": float(peaks.torque[k]),
        "torque_bound": _finite(bounds.effort[k]),
    }


def _sinusoids(result: Excitation) -> dict[str, Any]:
    motion = result.chosen.motion
    arrays = ("rest", "origins", "amplitudes", "frequencies", "phases", "starts")
    return {name: getattr(motion, name).tolist() for name in arrays} | {"fade": motion.fade}


def _bound(value: float) -> str:
    return number(value, 3) if np.isfinite(value) else "no limit"


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
