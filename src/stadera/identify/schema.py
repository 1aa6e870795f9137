"""Plain values of an identification: the JSON of `identify`, its table, and reading the JSON back into a robot.

Keys are only ever added; SI units; a link's inertia is about its frame's origin, in its axes. A `std` is null if the
data do not measure the value; the value then rests on the prior and on its correlation with quantities that were
measured on this leg or others.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isclose, isfinite, nan
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from stadera.body import FRICTION_TERMS, FRICTION_UNITS
from stadera.boundary import foreign, require_input
from stadera.errors import ModelError, UntrustedError
from stadera.identify.observability import Identifiability
from stadera.identify.result import Identification, LegIdentification, Quantity
from stadera.identify.varying import VARYING_UNITS
from stadera.inertia import ORDER, InertialParameters
from stadera.results import data_frame
from stadera.robot.model import JointDynamics, Robot
from stadera.trunk.result import TrunkParameters

_INERTIA = tuple(name.removeprefix("I") for name in ORDER[4:])
UNITS = {"mass": "kg", "com": "m", "inertia": "kg·m²"} | FRICTION_UNITS | {"rmse": "N·m", "torque_lag": "s"}


def identification_dict(result: Identification) -> dict[str, Any]:
    """The result as values for `json.dumps`; values of a bad result are marked as not trusted."""
    mark = {"trusted": False} if result.trust.verdict == "bad" else {}
    return {
        "robot": result.robot.name,
        "source": result.source,
        "method": result.method,
        "trust": result.trust.to_dict(),
        "links": links_dict(result.legs, mark),
        "joints": joints_dict(result.legs, mark),
        "cad_friction": {
            joint: {t: leg.friction_only[f"{joint}.{t}"] for t in FRICTION_TERMS if f"{joint}.{t}" in leg.friction_only}
            for leg in result.legs
            for joint in leg.leg.joints
        },
        "rank": result.rank,
        "parameters": result.parameters,
        "physical": result.is_physical,
        "rmse": _rmse(result),
        "legs": {leg.leg.name: _leg(leg) for leg in result.legs},
        "agreement": None if result.agreement is None else result.agreement.to_dict(),
        "trunk": result.trunk and _trunk(result.robot, result.trunk) | mark,
        "torque_lag": result.torque_lag,
        "validated_on": result.validated_on,
        "notes": list(result.notes),
        "warnings": list(result.warnings),
        "units": UNITS | VARYING_UNITS | {"presliding": "rad"},
        "frames": {"links": "each link's own", "inertia_about": "frame origin"},
    }


def identification_frame(result: Identification) -> Any:
    """See `Identification.to_dataframe`."""
    rows = [
        (leg.leg.name, *name.rsplit(".", 1), q.prior, q.value, nan if q.is_held else q.std, str(q.verdict), q.unit)
        for leg in result.legs
        for name, q in leg.parameters.items()
    ]
    names = ["leg", "of", "parameter", "prior", "value", "std", "observability", "unit"]
    return data_frame(dict(zip(names, zip(*rows, strict=True), strict=True)))


def with_identified_legs(robot: Robot, path: str | PathLike[str], force: bool = False) -> Robot:
    """Returns the robot with the links' inertias and the joints' rotor inertia, friction and torque offsets of an
    identification, and the latter's standard deviations; with the trunk too, if the robot walked.

    Legs that were not identified keep the model's values. Torque offsets change from day to day: weighing starts at
    those identified and estimates the difference. Negative friction or rotor inertia, which noise can cause, is set to
    zero.

    Args:
        path: JSON written by `identify --json`, or by `weigh --json`, of which the joints are taken.
        force: take an identification that is not to be trusted, with the reason as `Robot.distrust`.

    Raises:
        ModelError: no such file, a JSON of another kind or of another robot, or a physically impossible link.
        UntrustedError: an identification that is not to be trusted, without `force`.
        UnknownNameError: a link or joint that this robot lacks.
    """
    path = Path(path)
    require_input(path, ModelError)
    with foreign(path, "not the JSON of an identification or a weighing (--json)", ModelError):
        value = json.loads(path.read_text(encoding="utf-8"))
        links = {name: _body(entry) for name, entry in value["links"].items()}
        if isinstance(trunk := value.get("trunk"), dict) and "name" in trunk:
            links[trunk["name"]] = _body(trunk)
        joints = {name: _terms(entry) for name, entry in value["joints"].items()}
        stds = {name: _stds(entry) for name, entry in value["joints"].items()}
        distrust = _distrust(value.get("trust"))
        named, masses = value.get("robot"), {name: entry["mass"].get("prior") for name, entry in value["links"].items()}
    if named not in (None, robot.name) and not _masses_are(robot, masses):
        raise ModelError(f"{path}: of the robot {named!r}, whose links have other masses than those of {robot.name!r}")
    if distrust and not force:
        raise UntrustedError(
            f"{path}: legs not to be trusted ({distrust}); identify anew; `--force` takes them, the result is doubtful"
        )
    if (link := next((name for name, body in links.items() if not body.is_physical()), None)) is not None:
        raise ModelError(f"{path}: link {link!r} was identified as a body that cannot be")
    dynamics = {name: replace(robot.dynamics.get(name, JointDynamics()), **terms) for name, terms in joints.items()}
    return replace(robot.with_inertias(links), distrust=distrust).with_dynamics(dynamics, stds)


# -- writing ----------------------------------------------------------------------------------------------------------


def links_dict(legs: Sequence[LegIdentification], mark: dict[str, bool]) -> dict[str, Any]:
    """Mass, centre of mass and inertia by link; `mark` is added to every value."""
    return {
        link: {
            "mass": _quantity(leg.parameters[f"{link}.m"]) | mark,
            "com": [_quantity(q) | mark for q in leg.coms[link]],
            "inertia": {name: _quantity(leg.parameters[f"{link}.I{name}"]) | mark for name in _INERTIA},
        }
        for leg in legs
        for link in leg.leg.links
    }


def joints_dict(legs: Sequence[LegIdentification], mark: dict[str, bool]) -> dict[str, Any]:
    """Terms by joint; `mark` is added to every value."""
    return {joint: _joint(leg, joint, mark) for leg in legs for joint in leg.leg.joints}


def _joint(leg: LegIdentification, joint: str, mark: dict[str, bool]) -> dict[str, Any]:
    centres = leg.varying[joint].centres if joint in leg.varying else {}
    centred = {name: {"centre": centre} for name, centre in centres.items()}
    if centres:
        centred["coulomb_load"]["mean_load"] = leg.varying[joint].load
    return {name: _quantity(q) | centred.get(name, {}) | mark for name, q in leg.joint_terms.get(joint, {}).items()}


def _quantity(quantity: Quantity) -> dict[str, Any]:
    return {
        "prior": quantity.prior,
        "value": quantity.value,
        "std": None if quantity.is_held else quantity.std,
        "observability": str(quantity.verdict),
    }


def _leg(leg: LegIdentification) -> dict[str, Any]:
    return {
        "rank": leg.estimate.observability.rank,
        "parameters": len(leg.estimate.columns),
        "structural_rank": leg.structural_rank,
        "physical": leg.estimate.is_physical,
        "combinations": [{"text": c.text, "unit": c.unit} | _quantity(c) for c in leg.combinations],
        "noise": dict(leg.noise),
        "warnings": list(leg.warnings),
    }


def _trunk(robot: Robot, trunk: TrunkParameters) -> dict[str, Any]:
    before, found = (np.array([b.mass, *b.com, *b.vector[4:]]) for b in (robot.inertias[robot.trunk], trunk.inertial))
    stds = [trunk.mass_std, *trunk.com_std.tolist(), *trunk.inertia_std.tolist()]
    seen, unseen = Identifiability.OBSERVABLE, Identifiability.UNOBSERVABLE
    mass, x, y, z, *inertia = (
        _quantity(Quantity(prior, value, std, seen if isfinite(std) else unseen, ""))
        for prior, value, std in zip(before.tolist(), found.tolist(), stds, strict=True)
    )
    inertias = dict(zip(_INERTIA, inertia, strict=True))
    return {"name": robot.trunk, "mass": mass, "com": [x, y, z], "inertia": inertias}


def _rmse(result: Identification) -> dict[str, dict[str, dict[str, float]]]:
    merged: dict[str, dict[str, dict[str, float]]] = {}
    for leg in result.legs:
        for part, models in leg.rmse.items():
            for model, joints in models.items():
                merged.setdefault(part, {}).setdefault(model, {}).update(joints)
    return merged


# -- reading ----------------------------------------------------------------------------------------------------------


def _body(entry: dict[str, Any]) -> InertialParameters:
    mass = _number(entry["mass"])
    moment = [mass * _number(component) for component in entry["com"]]
    return InertialParameters(np.array([mass, *moment, *(_number(entry["inertia"][name]) for name in _INERTIA)]))


def _terms(entry: dict[str, Any]) -> dict[str, float]:
    found = {term: _number(entry[term]) for term in FRICTION_TERMS if term in entry}
    return {term: value if term == "offset" else max(value, 0.0) for term, value in found.items()}


def _stds(entry: dict[str, Any]) -> JointDynamics:
    stds = {term: entry.get(term, {}).get("std") for term in FRICTION_TERMS}
    return JointDynamics(**{term: nan if std is None else float(std) for term, std in stds.items()})


def _masses_are(robot: Robot, masses: Mapping[str, float | None]) -> bool:
    """True if links have these masses [kg] in the robot's model: it is another name of the same robot."""
    own = {name: robot.inertias[name].mass for name in masses if name in robot.inertias}
    return len(own) == len(masses) and all(
        mass is not None and isclose(mass, own[name], rel_tol=1e-6) for name, mass in masses.items()
    )


def _distrust(trust: dict[str, Any] | None) -> str:
    """Why the identification is not to be trusted; empty if it is, or if it does not say."""
    if trust is None or trust["verdict"] != "bad":
        return ""
    return str(next(iter(trust["reasons"]), "its fit is bad"))


def _number(entry: dict[str, Any]) -> float:
    value = float(entry["value"])
    if not isfinite(value):
        raise ValueError(f"{value} is no value")
    return value
