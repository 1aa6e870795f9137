"""Writes a weighing into a robot model: the weighed trunk and, with a tare, the payload as a separate link.

With a tare the payload is subtracted from the trunk, so the total is the same. Links outside the legs keep their
values; what was found for the trunk with them is in the trunk's own link. Quantities that were not observed keep the
model's values, and a note in the file lists them.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from stadera.errors import IdentificationError
from stadera.inertia import InertialParameters
from stadera.robot.export import PayloadLink
from stadera.robot.model import Robot
from stadera.trunk.load import SIGNIFICANT, Payload
from stadera.types import Array, Bools
from stadera.weigh.result import Weighing


@dataclass(frozen=True, eq=False)
class WeighedModel:
    """Input of `stadera.robot.export.export_model`: the robot with the weighed trunk, less the payload if there was a
    tare; the payload, None without a tare; and a note for readers of the file on accuracy and what was not observed.
    """

    robot: Robot
    payload: PayloadLink | None = None
    note: str = ""


def weighed_model(result: Weighing) -> WeighedModel:
    """Makes the model of the weighed robot. Raises IdentificationError: the trunk's mass was not observed; or, with a
    tare, the payload was not observed, or no component of its centre of mass, or it is elsewhere than on the trunk.
    """
    robot, trunk, payload = result.robot, result.trunk, result.payload
    if payload is not None and payload.at:
        raise IdentificationError(
            f"{result.source}: the payload is at {payload.at}: only one on the trunk {robot.trunk!r} is written into a "
            "model file"
        )
    mark = "" if result.is_trusted else f" NOT TO BE TRUSTED: {'; '.join(result.trust.reasons)}."
    link = None if payload is None else payload_link(payload, trunk.inertial.com)
    if not np.isfinite(result.mass_std):
        raise IdentificationError(f"{result.source}: no trunk to write: its mass was not observed")
    body, seen = trunk.inertial, bool(trunk.observed[4:].all())
    if link is not None or robot.extra is not None:
        arms = InertialParameters.zero() if robot.extra is None else robot.extra.lumped  # whose links keep their values
        load = InertialParameters.zero() if link is None else link.body
        seen &= payload is None or payload.inertia is not None
        own, seen = _without(body - arms, load, robot.inertias[robot.trunk] - arms, seen)
        body = own + arms
    note = _trunk_note(robot.trunk, [result.mass_std, *result.com_std], seen)
    if link is not None:
        note = note.replace("with all that was on it", "less the payload; error bars of both together", 1)
    return WeighedModel(robot.with_inertias({robot.trunk: body}), link, note + mark)


def payload_link(payload: Payload, trunk_com: Array, cube: float = 0.1) -> PayloadLink:
    """Makes the payload's link for a model file. IdentificationError if its mass is not significantly above zero, or
    its centre of mass was not observed.

    An unobserved inertia is replaced by that of a cube with this edge [m], a lidar's size, and the note says so:
    simulators reject or diverge with a body that has mass and no inertia. Components of the centre of mass that were
    not observed are those of `trunk_com` (3,) [m].
    """
    hidden = np.isnan(payload.com)
    if not payload.mass > SIGNIFICANT * payload.mass_std or hidden.all():
        raise IdentificationError(
            f"no payload to write: {payload.mass:.3f} ± {payload.mass_std:.3f} kg were added since the tare"
        )
    tensor, shape = payload.inertia, "inertia as observed."
    if tensor is None:
        tensor = payload.mass * cube**2 / 6.0 * np.eye(3)
        shape = f"inertia NOT observed, and assumed to be that of a cube of {cube:g} m with this mass."
    note = f"Mass ± {payload.mass_std:.3g} kg, centre of mass {_known(payload.com_std)}; {shape}"
    if hidden.any():
        note += f" {_hidden(hidden)} was not observed, and is the trunk's own."
    com = np.where(hidden, trunk_com, payload.com)
    return PayloadLink(InertialParameters.from_com(payload.mass, com, tensor), note=note)


def _without(
    whole: InertialParameters, payload: InertialParameters, prior: InertialParameters, observed: bool
) -> tuple[InertialParameters, bool]:
    """The trunk's own link without the payload, and True if its inertia about its centre of mass is as observed. It is
    the prior's if either inertia was not observed or the difference is physically impossible.
    """
    rest = whole - payload
    if not rest.mass > 0.0:
        without = f"the payload, {payload.mass:.3g} kg, and the links outside the legs are"
        raise IdentificationError(f"no trunk to write: {without} heavier than all of it")
    if observed and rest.is_physical():
        return rest, True
    return InertialParameters.from_com(rest.mass, rest.com, prior.inertia_com), False


def _trunk_note(trunk: str, std: Iterable[float], inertia_seen: bool) -> str:
    mass_std, *com_std = std
    hidden = np.isnan(com_std)
    note = f"{trunk}: as weighed, with all that was on it. Mass ± {mass_std:.3g} kg"
    note += f", centre of mass {_known(com_std)}." if not hidden.all() else "."
    unseen = [_hidden(hidden)] if hidden.any() else []
    if unseen := unseen + ([] if inertia_seen else ["inertia about the centre of mass"]):
        note += f" Not observed, and the model's own: {', '.join(unseen)}."
    return note


def _known(com_std: Iterable[float]) -> str:
    return ", ".join(f"{axis} ± {std:.3g} m" for axis, std in zip("xyz", com_std, strict=True) if std == std)


def _hidden(hidden: Bools) -> str:
    return ", ".join(axis for axis, lost in zip("xyz", hidden, strict=True) if lost)
