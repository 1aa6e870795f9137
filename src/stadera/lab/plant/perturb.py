"""Robots with a leg that differs from its CAD: ground truth for identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.linalg import expm

from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.lab.plant.model import least_leg_eigenvalue
from stadera.robot.model import Robot


def perturbed(
    robot: Robot,
    leg: str,
    rng: np.random.Generator,
    *,
    com_std: float = 0.02,
    inertia_std: float = 0.02,
    margin: float = 0.1,
    draws: int = 200,
) -> Robot:
    """The paper's perturbation (section IV.A): white noise on the leg links' centres of mass and inertia tensors.

    Masses are unchanged. Each component of a centre of mass is perturbed by an independent N(0, com_std²) [m], and each
    of the six entries of the tensor about the LINK ORIGIN, in link axes (the paper's footnote 5), by N(0, inertia_std²)
    [kg·m²]: the tensor does not follow the shifted centre. At the paper's sizes the links are usually not physically
    possible (Table I has negative moments). The whole set is drawn again, up to `draws` times, until the least
    eigenvalue of the joint-space mass matrix over the leg's workspace is at least `margin` times that of the given
    robot, which keeps the leg simulable.
    """
    if not margin > 0:
        raise ModelError(f"the margin on the mass matrix's least eigenvalue must be positive, got {margin}")
    least = margin * least_leg_eigenvalue(robot, leg)
    for _ in range(draws):
        candidate = _with_inertias(
            robot, {link: _noisy(robot.inertias[link], rng, com_std, inertia_std) for link in robot.leg(leg).links}
        )
        if least_leg_eigenvalue(candidate, leg) >= least:
            return candidate
    raise ModelError(
        f"robot {robot.name}, leg {leg}: none of {draws} perturbations (com {com_std} m, inertia {inertia_std} "
        "kg·m²) leaves the mass matrix positive definite; ask for smaller ones"
    )


def perturbed_physical(
    robot: Robot, leg: str, rng: np.random.Generator, *, com_std: float = 0.02, stretch_std: float = 0.3
) -> Robot:
    """A perturbation of the same size for which every link is physically possible, without redraws.

    The link's mass distribution is displaced by N(0, com_std²) [m] in each component, then deformed about its centre of
    mass by the linear map exp(E), with the nine entries of E independent N(0, stretch_std²). The pseudo-inertia is
    transformed by congruence, so it remains positive definite; to first order the second moments change by a share of 2
    stretch_std. Masses are unchanged.
    """
    changed = {}
    for link in robot.leg(leg).links:
        body = robot.inertias[link]
        if not body.is_physical():
            raise ModelError(f"robot {robot.name}: link {link!r} is not physical before it is perturbed")
        com = body.com
        shift = rng.normal(0.0, com_std, 3)
        deformation = expm(rng.normal(0.0, stretch_std, (3, 3)))
        # r' = c + s + D (r - c)
        changed[link] = body.transformed(deformation, com + shift - deformation @ com)
    return _with_inertias(robot, changed)


def _noisy(
    body: InertialParameters, rng: np.random.Generator, com_std: float, inertia_std: float
) -> InertialParameters:
    vector = body.vector.copy()
    vector[1:4] += body.mass * rng.normal(0.0, com_std, 3)
    vector[4:] += rng.normal(0.0, inertia_std, 6)
    return InertialParameters(vector)


def _with_inertias(robot: Robot, changed: Mapping[str, InertialParameters]) -> Robot:
    return replace(robot, inertias={**robot.inertias, **changed})
