"""Page of an excitation: its expected information compared with random draws, the motion, the settings."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stadera.excite.result import Excitation
from stadera.report.excite.plots import SHOWN, motion_figure, std_figure
from stadera.report.excite.tables import limits_table, verdict, worth_table
from stadera.report.numbers import number
from stadera.report.page import render

_TERMS = {
    "Information gain": "How much less uncertain all parameters together are after the log than before, by the prior "
    "model and the stated torque noise. One nat more is a standard deviation 2.7 times smaller in one direction.",
    "Combination": "A sum of parameters that the leg's torques depend on. A single parameter of a leg on a held trunk "
    "often cannot be separated from others; its combination can.",
    "Known": "Better after the log than before it, by the prior standard deviations of the model's parameters.",
    "Torque": "What the prior model predicts for the motion, friction included where the model states it.",
    "Distance": "Between the shapes of this leg and of all else, the other legs standing still. As true as they are.",
}


def excitation_html(result: Excitation) -> str:
    """The complete, self-contained page."""
    bounds, settings = result.experiment.bounds, result.settings
    return render(
        "excite.html.j2",
        title=f"Excitation: {bounds.robot.name} {bounds.leg}",
        headline=_answer(result),
        level="note",
        word="Within the limits",
        why=verdict(result),
        next=_next_steps(result),
        cards=list(_cards(result)),
        worth=worth_table(result),
        stds=std_figure(result),
        limits=limits_table(result),
        seconds=min(SHOWN, settings.duration),
        motion=motion_figure(result),
        facts=_facts(result),
        notes=bounds.clearance.notes,
        terms=_TERMS,
    )


def _answer(result: Excitation) -> str:
    best, known = result.chosen, len(result.combinations)
    leg = result.experiment.bounds.leg
    return (
        f"{number(result.settings.duration)} s of this motion of {leg} determine {best.rank} of {known} combinations "
        f"of its parameters better than CAD does."
    )


def _next_steps(result: Excitation) -> tuple[str, ...]:
    robot, leg = result.experiment.bounds.robot.name, result.experiment.bounds.leg
    play = f"`stadera excite --robot {robot} --leg {leg} --out motion.csv`"
    optimum = ("Leave `--random` out for the optimum of the same length.",) if result.settings.random else ()
    return (
        *optimum,
        f"Write the table that a controller plays, {play}, first slowly, with the trunk on a stand and the leg free.",
        f"Record joint positions and torques, and identify: `stadera identify LOG --robot {robot} --legs {leg}`.",
    )


def _cards(result: Excitation) -> Iterator[dict[str, object]]:
    """Yields arguments of the macro `card`."""
    best, median = result.chosen, number(100.0 * float(np.median(result.chosen.std)), 2)
    yield {"label": "Information gain", "figure": f"{best.gain:.1f}", "unit": "nat"}
    yield {"label": "Combinations known", "figure": best.rank, "unit": f"of {len(result.combinations)}"}
    yield {"label": "Standard deviation, median", "figure": median, "unit": "% of the prior's"}


def _facts(result: Excitation) -> dict[str, str]:
    settings, height = result.settings, result.settings.stand_height
    noise = ", ".join(number(value, 3) for value in result.experiment.noise.tolist())
    return {
        "Robot": result.experiment.bounds.robot.name,
        "Leg": f"{result.experiment.bounds.leg}, trunk held level",
        "Motion": "the paper's random draw" if settings.random else "Fourier series, optimised",
        "Duration": f"{number(settings.duration)} s, from rest to rest",
        "Table": f"{number(settings.rate)} Hz",
        "Torque noise": f"{noise} N·m for one sample",
        "Ground": "not given" if height is None else f"{number(height)} m below the trunk's origin",
        "Least distance": _distance(result.peaks.distance),
        "Seed": str(settings.seed),
    }


def _distance(value: float) -> str:
    if not np.isfinite(value):
        return "the model has no shapes"
    return f"{number(value, 2)} m" if value < 0.1 else "0.1 m or more"
