"""Recommended next steps after an identification: sentences, with commands between backquotes."""

from __future__ import annotations

from collections.abc import Iterator

from stadera.identify.result import Identification
from stadera.report.identify.remarks import evaluated_part, is_alarming

_POOR = 0.6  # of the directions that rich motion determines; below this another motion is recommended


def next_steps(result: Identification) -> tuple[str, ...]:
    """Next steps for this result, the most urgent first."""
    return tuple(_steps(result))


def _steps(result: Identification) -> Iterator[str]:
    robot = result.robot.name
    if result.trust.verdict == "bad":
        yield (
            "Do not use these figures: the model does not explain the torques, and the likeliest cause is named below. "
            "Mend the log or the model file and identify again."
        )
        return
    if evaluated_part(result) == "training":
        yield "This fit is untested: hold back a part, `--split 0.5`, or give another log, `--validate LOG`."
    poor = [leg for leg in result.legs if leg.estimate.observability.rank < _POOR * leg.structural_rank]
    if poor:
        leg = min(poor, key=lambda leg: leg.estimate.observability.rank / leg.structural_rank)
        yield (
            f"Play a richer motion: {leg.leg.name} showed {leg.estimate.observability.rank} of {leg.structural_rank} "
            f"directions. `stadera excite --robot {robot} --leg {leg.leg.name} --out motion.csv` designs one."
        )
    if not is_alarming(result):
        yield (
            f"Weigh with these legs: `stadera identify LOG --robot {robot} --json legs.json`, then "
            f"`stadera weigh WALK --robot {robot} --legs legs.json`."
        )
        yield f"Write them into the model file: `stadera identify LOG --robot {robot} --export identified.urdf`."
