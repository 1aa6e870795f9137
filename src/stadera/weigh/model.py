"""A weighing as a robot model: the payload as a link of its own, or, without a tare, the trunk as it was weighed.

At rest and in motion alike. What was not observed stays the model's, and a sentence in the file says what that is.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stadera.errors import IdentificationError
from stadera.estimate.walking_result import Payload
from stadera.inertia import InertialParameters
from stadera.robot.model import Robot
from stadera.robot.payload_link import PayloadLink
from stadera.weigh.in_motion import MotionWeighing
from stadera.weigh.result import Weighing

Array = NDArray[np.float64]

_TOLD = 3.0  # standard deviations from zero that a payload's mass and moments of inertia need to be written


class WeighedPayload(Protocol):
    """Mass [kg] and centre of mass (3,) [m] in the trunk frame, with deviations; NaN where not observed."""

    @property
    def mass(self) -> float: ...
    @property
    def mass_std(self) -> float: ...
    @property
    def com(self) -> Array: ...
    @property
    def com_std(self) -> Array: ...


@dataclass(frozen=True, eq=False)
class WeighedModel:
    """What `stadera.robot.export.export_model` writes.

    Attributes:
        robot: with the trunk as weighed where there was no tare, else as believed.
        payload: None without a tare.
        note: what whoever reads the file should know of the trunk; empty where it is as believed.
    """

    robot: Robot
    payload: PayloadLink | None = None
    note: str = ""


def weighed_model(result: Weighing | MotionWeighing) -> WeighedModel:
    """The model of a robot as it was weighed.

    Raises:
        IdentificationError: with a tare, nothing was put on, or its centre of mass was not observed at all; without
            one, the trunk's mass was not observed.
    """
    robot, payload = result.robot, result.payload
    prior = robot.inertias[robot.trunk]
    if payload is not None:
        inertia = payload_inertia(payload) if isinstance(payload, Payload) else None
        return WeighedModel(robot, payload_link(payload, prior.com, inertia))
    if isinstance(result, Weighing):
        com = np.where(np.isnan(result.com), prior.com, result.com)
        trunk, std = (
            InertialParameters.from_com(result.mass, com, prior.inertia_com),
            [result.mass_std, *result.com_std],
        )
        inertia_seen = False
    else:
        trunk = result.trunk.inertial
        std, inertia_seen = np.sqrt(np.diag(result.trunk.covariance)).tolist(), bool(result.trunk.observed[4:].all())
    if not np.isfinite(std[0]):
        raise IdentificationError(f"{result.source}: no trunk to write: its mass was not observed")
    return WeighedModel(robot.with_inertias({robot.trunk: trunk}), note=_trunk_note(robot.trunk, std, inertia_seen))


def payload_link(payload: WeighedPayload, trunk_com: Array, inertia: Array | None = None) -> PayloadLink:
    """The payload as a link for a model file.

    Args:
        payload: as found.
        trunk_com: (3,) [m], that components which were not observed are put level with, so that they shift nothing.
        inertia: (3, 3) [kg·m²], about its centre of mass, trunk axes; None where not known, which makes a point mass.

    Raises:
        IdentificationError: nothing was put on, or its centre of mass was not observed at all.
    """
    hidden = np.isnan(payload.com)
    if not payload.mass > _TOLD * payload.mass_std or hidden.all():
        raise IdentificationError(
            f"no payload to write: {payload.mass:.3f} ± {payload.mass_std:.3f} kg were put on since the tare"
        )
    shape = "inertia as observed." if inertia is not None else "a point mass, for its inertia was not observed."
    note = f"Mass ± {payload.mass_std:.3g} kg, centre of mass {_known(payload.com_std)}; {shape}"
    if hidden.any():
        note += f" {_hidden(hidden)} was not observed, and is the trunk's own."
    com = np.where(hidden, trunk_com, payload.com)
    tensor = np.zeros((3, 3)) if inertia is None else inertia
    return PayloadLink(InertialParameters.from_com(payload.mass, com, tensor), note=note)


def payload_inertia(payload: Payload) -> Array | None:
    """A payload's inertia about its centre of mass, (3, 3) [kg·m²], trunk axes; None where it was not observed.

    With mass m, first moment m c and inertia I about the trunk's origin, about an axis v through c

        vᵀ J v = vᵀ I v - m (|c|² - (vᵀ c)²)

    Observed: the moments about the three principal axes, each by three deviations, and such as a body can have.
    """
    if not np.isfinite(payload.com).all():
        return None
    c, body = payload.com, payload.parameters
    moments, axes = np.linalg.eigh(body.inertia_com)
    x, y, z = axes
    along = c @ axes
    by_mass = c @ c - along**2  # of vᵀ J v by m, by m c and by I
    by_first = 2.0 * (axes * along - c[:, None])
    slope = np.array([by_mass, *by_first, x * x, 2.0 * x * y, 2.0 * x * z, y * y, 2.0 * y * z, z * z])
    std = np.sqrt(np.einsum("ik,ij,jk->k", slope, payload.covariance, slope))
    return body.inertia_com if (moments > _TOLD * std).all() and body.is_physical() else None


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


def _hidden(hidden: NDArray[np.bool_]) -> str:
    return ", ".join(axis for axis, lost in zip("xyz", hidden, strict=True) if lost)
