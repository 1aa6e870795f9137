"""Payload by difference: the same robot weighed without and with it, with the same constant errors.

The poses of tare and load form one least-squares problem, in which constant errors common to both cancel
(`stadera.trunk.standing.fit`). A weak prior, the plausible box, covers the components that no pose shows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stadera.errors import IdentificationError
from stadera.information import Information
from stadera.trunk.load import Payload
from stadera.trunk.model import TrunkBounds, TrunkModel
from stadera.trunk.protocol import TrunkEstimate
from stadera.trunk.standing.equilibrium import ConstantErrors
from stadera.trunk.standing.fit import WITH_PAYLOAD, scales_of, square_root, with_box, with_poses
from stadera.trunk.standing.forces import ContactForceEstimator
from stadera.trunk.standing.pose_means import PoseMean

OBSERVED = 0.5
"""Share of the plausible range's standard deviation below which a payload's place counts as observed: a few cm help."""

SCALE_SPREAD = 1.0
"""Standard deviation of ln s before any pose: friction of drives differs between robots by a factor of seven (95 %)."""


def payload_between(
    tare: Sequence[PoseMean],
    loaded: Sequence[PoseMean],
    forces: ContactForceEstimator,
    errors: ConstantErrors,
    least: float = 1e-3,
) -> Payload:
    """Mass and centre of mass that the `loaded` poses carry in addition to the tare's.

    Args:
        least: unit of the first moment if there is hardly a payload, as a share of the robot's mass [1].

    Raises:
        IdentificationError: there is no pose on one side.
    """
    for poses, which in ((tare, "the tare"), (loaded, "the load")):
        if not poses:
            raise IdentificationError(f"no pose at rest to weigh {which} by")
    bounds = TrunkBounds.of(forces.robot)
    middle = 0.5 * (np.asarray(bounds.low) + np.asarray(bounds.high))
    known = _gathered(tare, loaded, forces)
    root = square_root(errors)

    def solved(mass: float) -> Information:
        boxed = with_box(known, "payload", bounds, mass, middle)
        return boxed.consider(root, ("errors", "held", "held_loaded"))

    # the payload's first moment in units of its mass, which the vertical forces determine well
    rough = solved(1.0)
    found = solved(max(abs(float(rough.mean[rough["payload"]][0])), least * forces.robot.mass))
    moments, covariance = found.mean[found["payload"]], found.covariance("payload")
    return Payload.of_moments(moments, covariance, OBSERVED * bounds.spread[1:])


def sized_by_poses(
    tare: Sequence[PoseMean],
    loaded: Sequence[PoseMean],
    forces: ContactForceEstimator,
    errors: ConstantErrors,
    spread: float = SCALE_SPREAD,
) -> ConstantErrors:
    """The errors with the sizes that the longest pose of each side shows, see `standing.fit.scales_of`. The tare may be
    empty. Static friction is never taken to be smaller than usual: if all knees hold alike, no equation shows it.
    """
    bounds = TrunkBounds.of(forces.robot)
    middle = 0.5 * (np.asarray(bounds.low) + np.asarray(bounds.high))
    before, after = ([max(p, key=lambda pose: pose.count)] if p else [] for p in (tare, loaded))
    known = with_box(_gathered(before, after, forces), "payload", bounds, forces.robot.mass, middle)
    lasting, sticking = scales_of(known, errors, spread)
    return errors.scaled(lasting, max(sticking, 1.0))


def _gathered(tare: Sequence[PoseMean], loaded: Sequence[PoseMean], forces: ContactForceEstimator) -> Information:
    trunk, bounds = forces.robot.inertias[forces.robot.trunk], TrunkBounds.of(forces.robot)
    middle = 0.5 * (np.asarray(bounds.low) + np.asarray(bounds.high))
    known = with_box(Information.empty(WITH_PAYLOAD), "trunk", bounds, trunk.mass, middle)
    return with_poses(with_poses(known, forces, tare), forces, loaded, loaded=True)


def payload_of_difference(tare: TrunkModel, loaded: TrunkEstimate) -> Payload:
    """Payload as the difference from a tare that is taken as exact, in mass and first moment.

    Args:
        tare: the trunk without the payload.
        loaded: the trunk with it; components not observed here are not observed in the payload.
    """
    m, c = loaded.trunk.mass, loaded.trunk.com_trunk
    moments = np.array([m - tare.mass, *(m * c - tare.mass * tare.com_trunk)])
    hidden = ~loaded.observed
    known = np.where(hidden[:, None] | hidden, 0.0, loaded.covariance)
    slope = np.eye(4)  # derivative of mass and first moment with respect to mass and centre of mass
    slope[1:, 0], slope[1:, 1:] = c, m * np.eye(3)
    return Payload.of_moments(moments, slope @ known @ slope.T, np.where(hidden[1:], 0.0, np.inf))
