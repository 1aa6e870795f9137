"""Verdict on an identification, and remarks for the reader, the most serious first."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from stadera.identify.observability import Identifiability
from stadera.identify.result import MODELS, Identification, LegIdentification
from stadera.report.numbers import compared, number
from stadera.report.trust import LEVELS, Level, trust_text

_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?![\w])")
_HEADLINES: dict[Level, str] = {
    "bad": "Do not use these numbers as they are",
    "warning": "Read the warnings below before using the numbers",
    "note": "Nothing stands against using the numbers",
}


@dataclass(frozen=True)
class Remark:
    """A sentence and its severity."""

    level: Level
    text: str


def evaluated_part(result: Identification) -> str:
    """The part used to evaluate errors: "validation" if there is one, else "training"."""
    return "validation" if any("validation" in leg.rmse for leg in result.legs) else "training"


def overall_rmse(result: Identification, part: str, legs: tuple[str, ...] | None = None) -> dict[str, float]:
    """By model, root of the mean over joints of the squared torque RMSE [N·m] on a part; None for all legs."""
    chosen = [leg.rmse.get(part, {}) for leg in result.legs if legs is None or leg.leg.name in legs]
    errors = {model: [rmse for leg in chosen for rmse in leg.get(model, {}).values()] for model in MODELS}
    return {model: _rms(found) for model, found in errors.items() if found}


def torque_rms(leg: LegIdentification, part: str) -> dict[str, float]:
    """By joint, the root mean square of the measured torque [N·m], from the leg's traces; empty without them."""
    for trace in leg.traces:
        if trace.part == part and len(trace.time):
            rms = np.sqrt(np.mean(np.asarray(trace.measured) ** 2, axis=0))
            return dict(zip(leg.leg.joints, rms.tolist(), strict=True))
    return {}


def answer(result: Identification) -> str:
    """One sentence with the legs and the accuracy of their predicted torques."""
    part = evaluated_part(result)
    names, errors = ", ".join(leg.leg.name for leg in result.legs), overall_rmse(result, part)
    where = "motion not used for fitting" if part == "validation" else "the training data"
    if not errors.get("identified"):
        return f"Links and drives of {names} by a robot on its feet, whose torques hold its weight too: no RMSE."
    said = f"Torques of {names} are predicted to {number(errors['identified'], 3)} N·m RMSE on {where}"
    torques = [rms for leg in result.legs for rms in torque_rms(leg, part).values()]
    if any(torques):
        said += f", {100.0 * errors['identified'] / _rms(torques):.0f} % of the measured torque"
    if errors.get("prior_friction"):
        said += f" and {compared(errors['identified'], errors['prior_friction'], ('below', 'above'))}"
        said += " CAD with fitted friction"
    return f"{said}."


def verdict(result: Identification) -> str:
    """Trust, followed by the answer."""
    return f"Trust: {trust_text(result.trust, reasons=False)}. {answer(result)}"


def badge(result: Identification) -> tuple[Level, str]:
    """Trust in a word, and its level; a result that should not be used is marked as bad in any case."""
    verdict = result.trust.verdict
    if verdict != "bad" and is_alarming(result):
        return "bad", "Do not use as it is"
    return LEVELS[verdict], f"Trust: {verdict}"


def level(result: Identification) -> Level:
    """Level of the whole result: that of its worst remark."""
    found = remarks(result)
    return "bad" if is_alarming(result) else found[0].level if found else "note"


def headline(result: Identification) -> str:
    """Half a sentence on whether the numbers can be used."""
    return _HEADLINES[level(result)]


def remarks(result: Identification) -> tuple[Remark, ...]:
    """All remarks, the most serious first. Sentences that apply to several legs are merged."""
    found = [Remark(LEVELS[result.trust.verdict], reason) for reason in result.trust.reasons]
    if evaluated_part(result) == "training":
        untested = "nothing was held out: the errors shown are on the training data and say little of the model"
        found.append(Remark("bad", untested))
    found += [Remark("note", text) for text in _on_masses(result)]
    found += [Remark("warning", text) for text in (*result.warnings, *_on_legs(result))]
    return tuple(sorted(dict.fromkeys(found), key=lambda remark: list(_HEADLINES).index(remark.level)))


def _on_legs(result: Identification) -> Iterator[str]:
    """Yields the warnings on legs, each once, with the legs' names unless it names a joint or link."""
    parts = tuple(name for leg in result.legs for name in (*leg.leg.joints, *leg.leg.links))
    legs: dict[str, list[str]] = {}
    sentences: dict[str, list[str]] = {}
    for leg in result.legs:
        for sentence in leg.warnings:
            alike = sentence if sentence.startswith(parts) else _NUMBER.sub("#", sentence)
            legs.setdefault(alike, []).append(leg.leg.name)
            sentences.setdefault(alike, []).append(sentence)
    for alike, names in legs.items():
        sentence = _ranged(sentences[alike])
        yield sentence if sentence.startswith(parts) else f"{', '.join(names)}: {sentence}"


def _ranged(sentences: Sequence[str]) -> str:
    """Sentences that differ in their numbers alone as one, with the range of each number."""
    numbers = zip(*(_NUMBER.findall(sentence) for sentence in sentences), strict=True)
    spans = ((min(found, key=float), max(found, key=float)) for found in numbers)
    texts = iter([low if low == high else f"{low} to {high}" for low, high in spans])
    return _NUMBER.sub(lambda _: next(texts), sentences[0])


def is_alarming(result: Identification) -> bool:
    """True if the numbers should not be used: a bad fit, not physical, not validated, nothing measured, or a leg whose
    torques CAD with friction predicts better by more than chance.
    """
    poor = evaluated_part(result) == "training" or result.trust.verdict == "bad" or not result.is_physical
    return poor or any(leg.estimate.observability.rank == 0 or "" in leg.worse for leg in result.legs)


def _on_masses(result: Identification) -> Iterator[str]:
    masses = {link: leg.parameters[f"{link}.m"].verdict for leg in result.legs for link in leg.leg.links}
    unknown = [link for link, verdict in masses.items() if verdict is not Identifiability.OBSERVABLE]
    if unknown:
        which = "no link's mass was" if len(unknown) == len(masses) else f"the masses of {', '.join(unknown)} were not"
        yield (
            f"{which} measured: this motion moves no torque with mass alone, so the masses are CAD's, "
            "and centres of mass hold for these masses"
        )


def _rms(values: Iterable[float]) -> float:
    return sqrt(float(np.mean(np.square(list(values)))))
