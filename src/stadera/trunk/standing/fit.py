"""Least-squares problem of weighing in static poses: approach (a), the combined estimator, and payloads.

Every pose gives the equations of `standing.equilibrium`, linear in mass and first moment of the trunk, θ, and in the
constant errors n (torque offsets, feet, vertical, the legs' masses). The same matrix multiplies the trunk and a payload
on it, so a tare and a load form one problem with the same errors::

    A_p θ_trunk + B_p n = b_p  (tare),        A_q (θ_trunk + θ_payload) + B_q n = b_q  (loaded)

The errors n are either unknowns with a prior of covariance C, or considered: set to zero, with their covariance added
to the estimate's (`stadera.information`). Either way, effects common to tare and load cancel in the payload. A weak
prior, the plausible box of the centre of mass, covers the components that no pose shows.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.linalg import block_diag

from stadera.information import Information, Unknowns
from stadera.trunk.load import centre_slope
from stadera.trunk.model import TrunkBounds
from stadera.trunk.standing.equilibrium import ERRORS, ConstantErrors, equilibrium_rows
from stadera.trunk.standing.forces import ContactForceEstimator
from stadera.trunk.standing.pose_means import PoseMean
from stadera.types import Array

_WIDEST, _TRIED = 3.5, 29  # standard deviations of ln s, and number of its values, in sums over it
TRUNK_ALONE = Unknowns.of(trunk=4, errors=ERRORS)
WITH_PAYLOAD = Unknowns.of(trunk=4, payload=4, errors=ERRORS, held=12, held_loaded=12)
"""`held` and `held_loaded` are the torques of static friction without and with the payload."""


def with_poses(
    known: Information,
    forces: ContactForceEstimator,
    poses: Iterable[PoseMean],
    errors: Array | None = None,
    *,
    loaded: bool = False,
) -> Information:
    """Adds the equations of some poses.

    Args:
        known: on `TRUNK_ALONE` or `WITH_PAYLOAD`.
        forces: estimator of contact forces, with the noise that weights the rows.
        errors: (39,), values of n at which the equations are linearised; None for zero.
        loaded: True if the trunk carries the payload in these poses.
    """
    at = np.zeros(ERRORS) if errors is None else errors
    for pose in poses:
        rows = equilibrium_rows(forces, pose.measurement, pose.count, at, pose.foot_variance, pose.effort_covariance)
        matrix = np.zeros((len(rows), len(known)))
        matrix[:, known["trunk"]], matrix[:, known["errors"]] = rows.matrix[:, :4], rows.matrix[:, 4:]
        if loaded:
            matrix[:, known["payload"]] = rows.matrix[:, :4]
        held = "held_loaded" if loaded else "held"
        if held in known.names:
            matrix[:, known[held]] = rows.matrix[:, 4:16]
        known = known.add(matrix, rows.target)
    return known


def with_box(known: Information, body: str, bounds: TrunkBounds, mass: float, com: Array) -> Information:
    """Adds the weak prior on the first moment of a body of about this mass [kg]: com (3,) [m], as wide as the box."""
    place, scale = known[body], 1.0 / (mass * bounds.spread[1:])
    matrix = np.zeros((3, len(known)))
    matrix[:, place.start] = -com * scale
    matrix[:, place.start + 1 : place.stop] = np.diag(scale)
    return known.add(matrix, np.zeros(3))


def with_mass(known: Information, mass: float, std: float) -> Information:
    """Adds a prior on the trunk's mass [kg]."""
    matrix = np.zeros((1, len(known)))
    matrix[0, known["trunk"].start] = 1.0 / std
    return known.add(matrix, np.array([mass / std]))


def with_errors(known: Information, errors: ConstantErrors, *, seek: bool) -> Information:
    """Treats the constant errors as unknowns with a prior, or as considered errors, which removes them from the
    unknowns.
    """
    if not seek:
        return known.consider(errors.root, ("errors",))
    matrix = np.zeros((ERRORS, len(known)))
    matrix[:, known["errors"]] = np.linalg.inv(errors.root)
    return known.add(matrix, np.zeros(ERRORS))


def square_root(errors: ConstantErrors) -> Array:
    """L (63, 63) of the covariance L Lᵀ of `errors`, `held` and `held_loaded` in `WITH_PAYLOAD`."""
    return _root(block_diag(errors.lasting, errors.sticking, errors.sticking))


def scales_of(known: Information, errors: ConstantErrors, spread: float) -> tuple[float, float]:
    """Sizes of the errors that last and of static friction, as factors on their standard deviations, by the poses.

    Six equations of a pose determine four parameters and leave the rest: forces that do not add up to a vertical one
    show offsets and friction, and if they do so otherwise under a load, friction. With everything else eliminated,
    z = R n remains of the errors n = (s L u, t H v), u, v ~ N(0, 1), and unit noise, so

        z ~ N(0, 1 + s² R L Lᵀ Rᵀ + t² R H Hᵀ Rᵀ)

    Args:
        known: on `WITH_PAYLOAD`, the poses.
        spread: standard deviation of ln s and ln t before any pose; s² and t² have mean one.

    Returns:
        Roots of the means of s² and t² given the poses.
    """
    left = known.marginal(("errors", "held", "held_loaded"))
    lasting = left.R[:, :ERRORS] @ _root(errors.lasting)
    held = left.R[:, ERRORS:] @ _root(block_diag(errors.sticking, errors.sticking))
    U, size, _ = np.linalg.svd(np.hstack([lasting, held]), full_matrices=False)
    U = U[:, size > 1e-6 * size[0]]
    z, M, N = U.T @ left.z, *(U.T @ x @ x.T @ U for x in (lasting, held))
    tried = np.linspace(-_WIDEST * spread, _WIDEST * spread, _TRIED)
    square = np.exp(2.0 * (tried - spread**2))
    C = np.eye(len(z)) + square[:, None, None, None] * M + square[:, None, None] * N
    value, vector = np.linalg.eigh(C)
    cost = ((vector.swapaxes(-1, -2) @ z) ** 2 / value + np.log(value)).sum(axis=-1)
    cost += (tried[:, None] ** 2 + tried**2) / spread**2
    weight = np.exp(-0.5 * (cost - cost.min()))
    weight /= weight.sum()
    return float(np.sqrt(weight.sum(axis=1) @ square)), float(np.sqrt(weight.sum(axis=0) @ square))


def _root(covariance: Array) -> Array:
    value, vector = np.linalg.eigh(covariance)
    return np.asarray(vector * np.sqrt(np.maximum(value, 0.0)))


def centre_of(known: Information, body: str = "trunk") -> tuple[Array, Array]:
    """Mass [kg] and centre of mass [m] of a body (4,), and their covariance (4, 4)."""
    moments = known.mean[known[body]]
    slope = centre_slope(moments)
    return np.array([moments[0], *moments[1:] / moments[0]]), slope @ known.covariance(body) @ slope.T
