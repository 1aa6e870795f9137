"""What a reader must know before trusting an identification: bad news first, in sentences, from the result alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import sqrt
from typing import Literal

import numpy as np

from stadera.identify.observability import Verdict
from stadera.identify.result import MODELS, Identification, LegIdentification

Level = Literal["bad", "warning", "note"]
_LEVELS: tuple[Level, ...] = ("bad", "warning", "note")


@dataclass(frozen=True)
class Finding:
    """One sentence, and how much it should worry."""

    level: Level
    text: str


def judged_part(result: Identification) -> str:
    """The part that errors are judged on: "validation" where there is one, else "training"."""
    parts = [part for leg in result.legs for part in leg.rmse]
    return "validation" if "validation" in parts else "training"


def overall_rmse(result: Identification, part: str, legs: tuple[str, ...] | None = None) -> dict[str, float]:
    """By model, the root of the mean over joints of the squared torque RMSE [N·m].

    Args:
        part: "training" or "validation".
        legs: the legs to take; None for all.
    """
    chosen = [leg for leg in result.legs if legs is None or leg.leg.name in legs]
    overall = {}
    for model in MODELS:
        errors = [rmse for leg in chosen for rmse in leg.rmse.get(part, {}).get(model, {}).values()]
        if errors:
            overall[model] = sqrt(sum(error**2 for error in errors) / len(errors))
    return overall


def torque_rms(leg: LegIdentification, part: str) -> dict[str, float]:
    """By joint, the root mean square of the measured torque [N·m], from the leg's traces; empty where there is none."""
    for trace in leg.traces:
        if trace.part == part and len(trace.time):
            rms = np.sqrt(np.mean(np.asarray(trace.measured) ** 2, axis=0))
            return dict(zip(leg.leg.joints, rms.tolist(), strict=True))
    return {}


def findings(result: Identification) -> tuple[Finding, ...]:
    """Everything a reader must know, the worst first. A sentence that holds for several legs names them all."""
    found = [*_on_validation(result), *_on_masses(result), *(Finding("warning", text) for text in result.warnings)]
    legs: dict[str, list[str]] = {}
    for leg in result.legs:
        for sentence in leg.warnings:
            legs.setdefault(sentence, []).append(leg.leg.name)
    for sentence, names in legs.items():
        found.append(
            Finding("warning", sentence if _names_its_joint(result, sentence) else f"{', '.join(names)}: {sentence}")
        )
    return tuple(sorted(dict.fromkeys(found), key=lambda finding: _LEVELS.index(finding.level)))


def is_alarming(result: Identification) -> bool:
    """Whether the numbers should not be used as they are: not physical, not validated, or no better than CAD."""
    part = judged_part(result)
    return not result.is_physical or part == "training" or any(_is_no_better(leg, part) for leg in result.legs)


def _is_no_better(leg: LegIdentification, part: str) -> bool:
    """Whether the leg's links brought nothing: no direction measured, or torque errors above CAD's with friction."""
    found, cad = (
        sum(e**2 for e in leg.rmse.get(part, {}).get(m, {}).values()) for m in ("identified", "prior_friction")
    )
    return leg.estimate.observability.rank == 0 or found > cad > 0


def _names_its_joint(result: Identification, sentence: str) -> bool:
    return sentence.startswith(tuple(name for leg in result.legs for name in (*leg.leg.joints, *leg.leg.links)))


def _on_validation(result: Identification) -> Iterator[Finding]:
    if judged_part(result) == "training":
        yield Finding(
            "bad", "nothing was held out: the errors shown are on the training data and say little of the model"
        )


def _on_masses(result: Identification) -> Iterator[Finding]:
    masses = {link: leg.parameters[f"{link}.m"].verdict for leg in result.legs for link in leg.leg.links}
    unknown = [link for link, verdict in masses.items() if verdict is not Verdict.OBSERVABLE]
    if unknown:
        which = "no link's mass was" if len(unknown) == len(masses) else f"the masses of {', '.join(unknown)} were not"
        yield Finding(
            "note",
            f"{which} measured: this motion moves no torque with mass alone, so the masses are CAD's, "
            "and centres of mass hold for these masses",
        )
