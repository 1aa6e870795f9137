"""Page of a weighing: answer and trust, next steps, evidence, and method."""

from collections.abc import Iterator
from dataclasses import replace
from math import degrees

import numpy as np

from stadera.report.numbers import number
from stadera.report.page import render
from stadera.report.table import SHOWN
from stadera.report.trust import LEVELS, fit_figure
from stadera.report.weigh import tables as words
from stadera.report.weigh.plots import figures
from stadera.report.weigh.tables import tables
from stadera.trunk.registry import method_of
from stadera.weigh.result import Weighing

__all__ = ["figures", "html", "tables"]


def next_steps(result: Weighing) -> Iterator[str]:
    """Yields next steps for this result, the most urgent first: sentences, with commands between backquotes."""
    robot = result.robot.argument
    command = f"stadera weigh LOG --robot {robot}"
    first = next((change.time for change in result.changes), np.nan)
    tare = f"{result.begin + 0.5:.1f}:{first - 0.2:.1f}" if first - result.begin > 1.0 else "T0:T1"
    if not result.is_trusted:
        yield "Do not use these figures: the model does not explain the log, and the likeliest cause is named above."
        yield (
            f"Check the log with `stadera inspect LOG --robot {robot}`: reversed torques, swapped joints, "
            "another IMU frame. Then weigh it again."
        )
        return
    yield from map(words.step_text, result.next)
    if result.trust.verdict == "doubtful":
        yield (
            "Look for a fault that is named above: the error bars do not cover one. "
            "Friction and rotor inertia from `stadera identify` make them narrower: `--legs legs.json`."
        )
    if result.payload is None:
        yield (
            f"For the payload alone, give a time or a log without it: `{command} --tare {tare}`. Errors that both have "
            "in common cancel."
        )
    if (hidden := _hidden(result)) is not None:
        yield hidden
    if result.trust.verdict != "good" or not result.determined()["trunk" if result.payload is None else "payload"]:
        return
    if result.payload is None or not result.payload.at:
        yield f"Write it into the model file: `{command} --export weighed.urdf`."
    else:
        link = result.payload.at
        yield f"Add it to link {link} of the controller's model; programs read it from `{command} --json F.json`."


def _hidden(result: Weighing) -> str | None:
    """How to observe the height of the centre of mass; None if it is known."""
    std = result.com_std if result.payload is None else result.payload.com_std
    if not np.isnan(std[2]):
        return None
    if result.torque_lag is None:
        return "A level robot at rest does not show how high a centre of mass is: hold a second pose, pitched by 10°."
    return "The height of the centre of mass was not observed: let the trunk pitch and roll, on the spot will do."


_VERTICAL = {"imu": "by the IMU", "forces": "by the direction of the feet's forces, for the log has no IMU"}


def html(result: Weighing) -> str:
    """The complete, self-contained page."""
    result = result.since_beginning()
    in_motion, drawn = result.torque_lag is not None, figures(result)
    return render(
        "weigh.html.j2",
        title=f"Weighing{' in motion' if in_motion else ''}: {result.robot.name}",
        level=LEVELS[result.trust.verdict],
        headline=f"{words.headline(result)}.",
        word=f"Trust: {result.trust.verdict}",
        why=words.may_be_used(result),
        summary={"Where": words.where(result), "How sure": words.how_sure(result)},
        robot=drawn.pop("balance", None),
        first=replace(drawn.pop(next(iter(drawn))), width=560.0),
        next=tuple(next_steps(result)),
        bodies=words.bodies_table(result),
        inertia=words.inertia_table(result),
        missing=words.inertia_missing(result),
        plots=list(drawn.values()),
        lists=list(_lists(result)),
        facts=_facts(result),
        notes=result.notes,
    )


def _lists(result: Weighing) -> Iterator[tuple[object, int]]:
    if result.changes:
        yield words.changes_table(result, SHOWN.rows), len(result.changes) - SHOWN.rows
    if (drives := words.drives_table(result)) is not None:
        yield drives, 0
    if result.refusals:
        yield words.refusals_table(result, SHOWN.rows), len(result.refusals) - SHOWN.rows


def _facts(result: Weighing) -> dict[str, str]:
    facts = {
        "Robot": f"{result.robot.name}, {number(result.robot.mass)} kg by its model",
        "Log": result.source,
        "Time": f"{result.begin:.2f} to {result.end:.2f} s, {result.refused:.1f} s of it not used",
        "As known at": f"{result.time:.2f} s",
        "Method": f"{result.method}: {method_of(result.method).summary}",
        "State": result.status,
        "Misfit": fit_figure(result.trust),
    }
    facts |= words.processing(result)
    if (vertical := result.vertical) is not None:
        facts["Vertical"] = f"{_VERTICAL[vertical.source]}, ±{degrees(vertical.tilt_std):.2g}°"
    return facts
