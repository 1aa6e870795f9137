"""The JSON of results. Keys are only ever added; SI units; null where the data say nothing."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from stadera.identify.observability import Verdict
from stadera.identify.result import Identification, KnownCombination, LegIdentification, Quantity
from stadera.inertia import ORDER
from stadera.report.quantities import is_held

_INERTIA = tuple(name.removeprefix("I") for name in ORDER[4:])


def identification_json(result: Identification) -> dict[str, Any]:
    """What `identify` found, as plain values that `json.dumps` takes.

    Keys: robot, source, method, links, joints, rank, parameters, physical, rmse, legs, torque_lag [s], validated_on,
    notes, warnings, units. The inertia of a link is about its frame's origin, in its axes. A `std` is null where
    the data do not measure the value, which then rests on the prior: it is the prior's own, or where what was measured
    (on this leg or the others) moved it along.
    """
    return {
        "robot": result.robot.name,
        "source": result.source,
        "method": result.method,
        "links": {link: _link(leg, link) for leg in result.legs for link in leg.leg.links},
        "joints": {joint: _joint(leg, joint) for leg in result.legs for joint in leg.leg.joints},
        "rank": result.rank,
        "parameters": result.parameters,
        "physical": result.is_physical,
        "rmse": _rmse(result),
        "legs": {leg.leg.name: _leg(leg) for leg in result.legs},
        "torque_lag": result.torque_lag,
        "validated_on": result.validated_on,
        "notes": list(result.notes),
        "warnings": list(result.warnings),
        "units": {
            "mass": "kg",
            "com": "m",
            "inertia": "kg·m²",
            "armature": "kg·m²",
            "viscous": "N·m·s/rad",
            "coulomb": "N·m",
            "offset": "N·m",
            "rmse": "N·m",
            "torque_lag": "s",
        },
    }


def json_text(value: Any) -> str:
    """Indented JSON with a newline at the end.

    Raises:
        ValueError: a number that JSON does not have (NaN, infinity).
    """
    return json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _link(leg: LegIdentification, link: str) -> dict[str, Any]:
    found = leg.parameters
    return {
        "mass": _quantity(found[f"{link}.m"]),
        "com": [_quantity(q) for q in leg.coms[link]],
        "inertia": {name: _quantity(found[f"{link}.I{name}"]) for name in _INERTIA},
    }


def _joint(leg: LegIdentification, joint: str) -> dict[str, Any]:
    prefix = f"{joint}."
    return {name.removeprefix(prefix): _quantity(q) for name, q in leg.parameters.items() if name.startswith(prefix)}


def _quantity(quantity: Quantity) -> dict[str, Any]:
    return {
        "prior": quantity.prior,
        "value": quantity.value,
        "std": None if is_held(quantity) else quantity.std,
        "observability": str(quantity.verdict),
    }


def _leg(leg: LegIdentification) -> dict[str, Any]:
    return {
        "rank": leg.estimate.observability.rank,
        "parameters": len(leg.estimate.columns),
        "structural_rank": leg.structural_rank,
        "physical": leg.estimate.is_physical,
        "combinations": [_combination(c) for c in leg.combinations],
        "noise": dict(leg.noise),
        "warnings": list(leg.warnings),
    }


def _combination(combination: KnownCombination) -> dict[str, Any]:
    return {
        "text": combination.text,
        "unit": combination.unit,
        "prior": combination.prior,
        "value": combination.value,
        "std": None if combination.verdict is Verdict.UNOBSERVABLE else combination.std,
        "observability": str(combination.verdict),
    }


def _rmse(result: Identification) -> dict[str, dict[str, dict[str, float]]]:
    """By part, model and joint, over all legs [N·m]."""
    merged: dict[str, dict[str, dict[str, float]]] = {}
    for leg in result.legs:
        for part, models in leg.rmse.items():
            for model, joints in models.items():
                merged.setdefault(part, {}).setdefault(model, {}).update(_plain(joints))
    return merged


def _plain(values: Mapping[str, float]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items()}
