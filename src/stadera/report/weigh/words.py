"""A weighing in words: how heavy, where, how sure, and whether the figures may be used."""

from __future__ import annotations

from math import isfinite

from stadera.report.numbers import listed, number, with_scale, with_std
from stadera.report.trust import UNTRUSTED, trust_reasons
from stadera.trunk.load import scale_of
from stadera.types import Array
from stadera.weigh.next_steps import NextStep
from stadera.weigh.result import Weighing

_AXES = ("place along the trunk", "place across the trunk", "height")
_MOST = 0.8  # share of a variance from which it counts as all of it
_SIDES = (("ahead of", "behind"), ("left of", "right of"), ("above", "below"))


def headline(result: Weighing) -> str:
    """The answer: the payload if there was a tare, else the trunk."""
    if (payload := result.payload) is not None:
        if not result.determined()["payload"]:
            most = max(payload.mass, 0.0) + 2.0 * payload.mass_std
            return f"Payload not determined: below {number(most, 2)} kg (95 %)"
        mass = with_scale(payload.mass, payload.mass_std, payload.mass_std_without_scale)
        answer = f"Payload{payload.at and f' at {payload.at}'} {mass}"
    elif result.mass == result.mass:
        mass = with_scale(result.mass, result.mass_std, result.trunk.mass_std_without_scale)
        answer = f"Trunk with all that is on it {mass}"
    else:
        answer = "The trunk's mass was not observed"
    return answer if result.is_trusted else f"{answer}, {UNTRUSTED}"


def where(result: Weighing) -> str:
    """Where the centre of mass of the payload, or without a tare of the trunk, is, one sentence."""
    body, payload = result if result.payload is None else result.payload, result.payload
    std = body.com_std
    seen = [k for k in range(3) if isfinite(std[k])]
    if not seen:
        return f"At {payload.at}; its centre was not observed." if payload and payload.at else "Not observed."
    if payload is not None and payload.at:
        along = ", ".join(f"{'xyz'[k]} {_millimetres(body.com, std, k)}" for k in seen)
        return f"At {along} mm in the frame of {payload.at}."
    said = [f"{_millimetres(abs(body.com), std, k)} mm {_SIDES[k][int(body.com[k] < 0.0)]}" for k in seen]
    lacking = [_AXES[k] for k in range(3) if k not in seen]
    hidden = f"; its {listed(lacking)} {'was' if len(lacking) == 1 else 'were'} not observed" if lacking else ""
    return f"{listed(said)} the trunk's origin{hidden}."


def _millimetres(com: Array, std: Array, k: int) -> str:
    return with_std(1e3 * float(com[k]), 1e3 * float(std[k]))


def how_sure(result: Weighing) -> str:
    """How well the mass is known, and what most of its error bar is, in a sentence or two."""
    payload = result.payload
    mass, std = (result.mass, result.mass_std) if payload is None else (payload.mass, payload.mass_std)
    alone = result.trunk.mass_std_without_scale if payload is None else payload.mass_std_without_scale
    if not (isfinite(std) and mass):
        return "The mass is not known."
    low, high = (max(mass + sign * 2.0 * std, 0.0) for sign in (-1.0, 1.0))
    between = f"By 95 % it is between {number(low, 3)} and {number(high, 3)} kg"
    if std > 0.5 * abs(mass):
        return f"{between}, which tells next to nothing."
    if not std:
        return f"Good to 0 %. {between}."
    share = (scale_of(mass, std, alone) or 0.0) ** 2 / (std / mass) ** 2
    words = ("hardly any", "part", "all")[(share > 1.0 - _MOST) + (share > _MOST)]
    of = "" if alone is None else f", {words} of it the torques' scale"
    return f"Good to {number(100.0 * std / abs(mass), 2)} %{of}. {between}."


def may_be_used(result: Weighing) -> str:
    """Whether the figures may be used, and what the verdict rests on."""
    determined = result.determined()["trunk" if result.payload is None else "payload"]
    if result.trust.verdict == "good" and not determined:
        return f"Not yet: the figures are right, and too wide to act on. {trust_reasons(result.trust)}"
    said = {"good": "Yes.", "doubtful": "With care; the bars are as wide as the doubts ask for.", "bad": "No."}
    return f"{said[result.trust.verdict]} {trust_reasons(result.trust)}"


def step_text(step: NextStep) -> str:
    """A next step, as a sentence."""
    std = step.payload_std if isfinite(step.payload_std) else step.trunk_std
    return f"{step.do[:1].upper()}{step.do[1:]}: then ± {number(std, 2)} kg."
