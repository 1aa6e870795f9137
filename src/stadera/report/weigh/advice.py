"""Recommended next steps after a weighing: sentences, with commands between backquotes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stadera.weigh.result import Weighing


def next_steps(result: Weighing) -> tuple[str, ...]:
    """Next steps for this result, the most urgent first."""
    return tuple(_steps(result))


def _steps(result: Weighing) -> Iterator[str]:
    command = f"stadera weigh LOG --robot {result.robot.name}"
    if not result.is_trusted:
        yield "Do not use these figures: the model does not explain the log, and the likeliest cause is named above."
        yield (
            f"Check the log with `stadera inspect LOG --robot {result.robot.name}`: reversed torques, swapped joints, "
            "another IMU frame. Then weigh it again."
        )
        return
    if result.trust.verdict == "doubtful":
        yield (
            "Use the error bars as they are, for they are widened to the fit. Friction and rotor inertia from "
            "`stadera identify` make them narrower: `--legs legs.json`."
        )
    if result.payload is None:
        yield (
            f"For the payload alone, give a time or a log without it: `{command} --tare {_tare(result)}`. Errors that "
            "both have in common cancel."
        )
    if (hidden := _hidden(result)) is not None:
        yield hidden
    yield f"Write it into the model file: `{command} --export weighed.urdf`."


def _tare(result: Weighing) -> str:
    """The time before the first change of the load, if there is one."""
    first = next((change.time for change in result.changes), np.nan)
    known = first - result.begin > 1.0
    return f"{result.begin + 0.5:.1f}:{first - 0.2:.1f}" if known else "T0:T1"


def _hidden(result: Weighing) -> str | None:
    """How to observe the height of the centre of mass; None if it is known."""
    std = result.com_std if result.payload is None else result.payload.com_std
    if not np.isnan(std[2]):
        return None
    if result.torque_lag is None:
        return "A level robot at rest does not show how high a centre of mass is: hold a second pose, pitched by 10°."
    return "The height of the centre of mass was not observed: let the trunk pitch and roll, on the spot will do."
