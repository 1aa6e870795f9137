"""The models of a replay: a model file or the JSON of an identification, and the model that it is compared with."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from stadera.boundary import foreign
from stadera.errors import ModelError
from stadera.identify.schema import with_identified_legs
from stadera.lab.replay import Drive, JointLaw
from stadera.limits import DEFAULTS, Limits
from stadera.robot.load import load_robot
from stadera.robot.model import JointDynamics, Robot

TERMS = ("armature", "viscous", "coulomb", "offset")


def replayed_models(
    tested: str, against: str, *, force: bool = False, limits: Limits = DEFAULTS
) -> tuple[tuple[Drive, ...], float | None]:
    """The models by name, the tested one first, and the torques' lag [s] that the tested one states, if it does.

    Args:
        tested: a model file, a robot's name, or the JSON of `identify --json`, whose values are put into `against`. Of
            a JSON there are also what its exported file says (constant friction), and the other model with the friction
            that was fitted to it.
        against: a model file or a robot's name.
        force: take an identification that is not to be trusted.
        limits: for reading the model files.

    Raises:
        ModelError: no such file, or no model. UntrustedError: a bad identification, without `force`. LimitError:
            a model file exceeds the limits.
    """
    cad = load_robot(against, limits)
    if Path(tested).suffix.lower() != ".json":
        return (Drive("identified", load_robot(tested, limits)), Drive("CAD", cad)), None
    identified = with_identified_legs(cad, tested, force)
    with foreign(Path(tested), "not the JSON of an identification (--json)", ModelError):
        value = json.loads(Path(tested).read_text(encoding="utf-8"))
        laws = {joint: law for joint, entry in value["joints"].items() if (law := _law(entry)) != JointLaw()}
        fitted = {joint: _with_friction(cad, joint, terms) for joint, terms in value["cad_friction"].items()}
        lag = float(value["torque_lag"])
    exported = (Drive("identified, constant friction", identified),) if laws else ()
    return (
        Drive("identified", identified, laws),
        *exported,
        Drive("CAD with friction", cad.with_dynamics(fitted)),
        Drive("CAD", cad),
    ), lag


def _law(entry: dict[str, Any]) -> JointLaw:
    def term(name: str) -> tuple[float, float]:
        found = entry.get(name)
        return (float(found["value"]), float(found["centre"])) if found else (0.0, 0.0)

    travel = float(entry["presliding"]["value"]) if "presliding" in entry else 0.0
    return JointLaw(term("coulomb_cos"), term("coulomb_sin"), term("coulomb_load"), travel)


def _with_friction(robot: Robot, joint: str, terms: dict[str, float]) -> JointDynamics:
    known = {name: value if name == "offset" else max(value, 0.0) for name, value in terms.items() if name in TERMS}
    return replace(robot.dynamics[joint], **known)
