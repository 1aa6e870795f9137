"""The payload by difference: the same robot weighed without and with it, the constant errors being the same.

Every pose p of the tare and q with the load gives six equations (`stadera.estimate.equilibrium`), linear in mass and
first moment, θ_t of the trunk at the tare and θ_l = θ_p + θ_t of payload and trunk, with constant errors n:

    A_p θ_t + B_p n = b_p,        A_q (θ_t + θ_p) + B_q n = b_q

Least squares for (θ_t, θ_p) at n = 0. The errors move θ_p by S_p n, in which what both poses feel alike cancels; their
covariance C adds S_p C S_pᵀ. A weak prior, the plausible box, stands for what no pose shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stadera.errors import IdentificationError
from stadera.estimate.equilibrium import ERRORS, TRUNK, ConstantErrors, equilibrium_rows, error_names
from stadera.estimate.forces import ContactForceEstimator
from stadera.estimate.pose_means import PoseMean
from stadera.estimate.protocol import TrunkEstimate
from stadera.estimate.trunk import TrunkBounds, TrunkModel
from stadera.identify.information import Information
from stadera.regressors.rows import Rows

Array = NDArray[np.float64]

_PAYLOAD = ("payload.m", "payload.mcx", "payload.mcy", "payload.mcz")
_OBSERVED = 0.2  # share of the plausible range's standard deviation under which a component counts as observed
_TOLD = 3.0  # standard deviations from zero that a payload's mass needs for a centre of mass


@dataclass(frozen=True, eq=False)
class PayloadEstimate:
    """What was added to the trunk since the tare; trunk frame.

    Attributes:
        mass, mass_std: [kg].
        com, covariance: (3,) [m], (3, 3) [m²]; NaN where not observed.
    """

    mass: float
    mass_std: float
    com: Array
    covariance: Array

    @property
    def com_std(self) -> Array:
        """(3,) [m], NaN where not observed."""
        return np.sqrt(np.diag(self.covariance))


def payload_between(
    tare: Sequence[PoseMean], loaded: Sequence[PoseMean], forces: ContactForceEstimator, errors: ConstantErrors
) -> PayloadEstimate:
    """Mass and centre of mass of what the poses `loaded` carry more than those of the tare.

    Raises:
        IdentificationError: no pose on one side.
    """
    for poses, which in ((tare, "the tare"), (loaded, "the load")):
        if not poses:
            raise IdentificationError(f"no pose at rest to weigh {which} by")
    names = error_names(forces.robot)
    columns = (*TRUNK, *_PAYLOAD, *names)
    rows = [_rows(pose, forces, names, columns, loaded=False) for pose in tare]
    rows += [_rows(pose, forces, names, columns, loaded=True) for pose in loaded]
    bare = Information.of(rows, columns)
    # the payload's first moment in units of its mass, which the vertical forces alone tell well
    mass = float(_solved(bare.merge(_prior(forces, columns, 1.0)), errors)[0][4])
    scale = max(abs(mass), 1e-3 * forces.robot.mass)
    theta, covariance = _solved(bare.merge(_prior(forces, columns, scale)), errors)
    return _estimate(theta[4:8], covariance[4:8, 4:8], _spread(forces))


def payload_of_difference(tare: TrunkModel, loaded: TrunkEstimate) -> PayloadEstimate:
    """What a trunk carries more than at a tare that is taken as exact: first moments subtract.

        m_p = m - m_t,     c_p = (m c - m_t c_t) / m_p,     dc_p = (m dc + (c - c_p) dm) / m_p

    Args:
        tare: the trunk without the payload.
        loaded: the trunk with it; what it has not observed is not told of the payload either.
    """
    m, c, covariance = loaded.trunk.mass, loaded.trunk.com_trunk, loaded.covariance
    mass, mass_std = m - tare.mass, float(np.sqrt(covariance[0, 0]))
    com, com_covariance = np.full(3, np.nan), np.full((3, 3), np.nan)
    if abs(mass) > _TOLD * mass_std:
        found = (m * c - tare.mass * tare.com_trunk) / mass
        slope = np.hstack([(c - found)[:, None], m * np.eye(3)]) / mass
        hidden = ~loaded.observed
        known = np.where(hidden[:, None] | hidden, 0.0, covariance)
        com = np.where(hidden[1:], np.nan, found)
        com_covariance = slope @ known @ slope.T
        com_covariance[hidden[1:], :] = com_covariance[:, hidden[1:]] = np.nan
    return PayloadEstimate(mass, mass_std, com, com_covariance)


def _rows(
    pose: PoseMean, forces: ContactForceEstimator, names: tuple[str, ...], columns: tuple[str, ...], *, loaded: bool
) -> Rows:
    own = equilibrium_rows(
        forces, pose.measurement, pose.count, np.zeros(ERRORS), names, pose.foot_variance, pose.effort_covariance
    )
    trunk, sensed = own.matrix[:, :4], own.matrix[:, 4:]
    return Rows(columns, np.hstack([trunk, trunk if loaded else np.zeros_like(trunk), sensed]), own.target)


def _spread(forces: ContactForceEstimator) -> Array:
    """Standard deviations (3,) [m] of a place spread evenly over the plausible box."""
    bounds = TrunkBounds.of(forces.robot)
    return np.asarray((np.asarray(bounds.high) - np.asarray(bounds.low)) / np.sqrt(12.0))


def _prior(forces: ContactForceEstimator, columns: tuple[str, ...], mass: float) -> Information:
    """First moments of trunk and payload (of about `mass`) about the box's middle, as wide as the box."""
    bounds, spread = TrunkBounds.of(forces.robot), _spread(forces)
    middle = 0.5 * (np.asarray(bounds.low) + np.asarray(bounds.high))
    trunk_mass = forces.robot.inertias[forces.robot.trunk].mass
    matrix = np.zeros((6, len(columns)))
    for k, (at, weight) in enumerate(((0, trunk_mass), (4, mass))):
        rows = slice(3 * k, 3 * k + 3)
        matrix[rows, at] = -middle / (weight * spread)
        matrix[rows, at + 1 : at + 4] = np.diag(1.0 / (weight * spread))
    return Information.of([Rows(columns, matrix, np.zeros(6))], columns)


def _solved(information: Information, errors: ConstantErrors) -> tuple[Array, Array]:
    """(8,) of trunk and payload at n = 0, and their covariance with the errors' share."""
    root = np.linalg.inv(information.R[:8, :8])
    felt = root @ information.R[:8, 8:]
    return root @ information.z[:8], root @ root.T + felt @ errors.covariance @ felt.T


def _estimate(theta: Array, covariance: Array, spread: Array) -> PayloadEstimate:
    mass, mass_std = float(theta[0]), float(np.sqrt(covariance[0, 0]))
    com, com_covariance = np.full(3, np.nan), np.full((3, 3), np.nan)
    if abs(mass) > _TOLD * mass_std:
        found = theta[1:] / mass
        slope = np.hstack([-found[:, None], np.eye(3)]) / mass
        com_covariance = slope @ covariance @ slope.T
        hidden = ~(np.sqrt(np.diag(com_covariance)) < _OBSERVED * spread)
        com = np.where(hidden, np.nan, found)
        com_covariance[hidden, :] = com_covariance[:, hidden] = np.nan
    return PayloadEstimate(mass, mass_std, com, com_covariance)
