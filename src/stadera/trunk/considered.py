"""Weighting rows, and reading the trunk from what they sum up to."""

from __future__ import annotations

import numpy as np

from stadera.constants import GRAVITY
from stadera.robot.model import Robot
from stadera.trunk.error_model import ERRORS, HELD, JOINTS, PLACES, ErrorModel
from stadera.trunk.rows import BlockRows
from stadera.trunk.segment import Segment, WeightedRows
from stadera.trunk.swing import SwingJoints
from stadera.types import Array

_UNIT = 0.01  # of weight, and weight times leg length: what rows are measured in


def weighted(rows: BlockRows, robot_weight: float, length: float) -> WeightedRows:
    """Rows in units of 1 % of the robot's weight, moments with the leg's length for lever: all blocks count alike.

    Weights that follow the noise from block to block would be better where noise is all that is wrong. They are worse
    on real robots: over whole steps the momentum that late torques, rotor inertia and friction seem to add and take
    cancels, but only if all parts of a step count alike.
    """
    unit = _UNIT * robot_weight * np.array([1.0, 1.0, 1.0, length, length, length])
    errors, white = rows.errors / unit[:, None], float(np.trace(rows.white / np.outer(unit, unit)))
    return WeightedRows(rows.time, rows.matrix / unit[:, None], errors, rows.target / unit, white)


class Errors:
    """Mean p̂ and covariance Σ of the model's errors, by their prior, by legs in the air, and by the fit's scale.

    Attributes:
        mean: (ERRORS,). covariance: (ERRORS, ERRORS). std: (ERRORS,).
        root: (ERRORS, ERRORS), a square root of the covariance.
    """

    def __init__(self, model: ErrorModel, swing: SwingJoints, scale: float) -> None:
        joints, learned = swing.posterior(scale)
        self.mean = np.zeros(ERRORS)
        self.mean[JOINTS] = joints
        factor = np.where(model.visible, scale, 1.0)
        self.covariance = model.covariance * np.outer(factor, factor)
        self.covariance[JOINTS, JOINTS] = learned
        place, coulomb = PLACES["stiction"], PLACES["coulomb"]
        known = self.covariance if swing.rows else model.covariance  # at rest no residual shows what friction holds
        dry = np.sqrt(self.mean[coulomb] ** 2 + np.diag(known)[coulomb])
        prior = np.sqrt(np.diag(model.covariance)[place])
        ratio = HELD * dry / np.maximum(prior, 1e-300)
        self.covariance[place, place] = model.covariance[place, place] * np.outer(ratio, ratio)
        self.std: Array = np.sqrt(np.diag(self.covariance))

    def trunk_covariance(self, segment: Segment, scatter: float) -> Array:
        """(10, 10), of the trunk of a segment; `scatter` is κ."""
        K = segment.sensitivity
        return np.asarray(scatter * (segment.inverse @ segment.inverse.T) + K @ self.covariance @ K.T)

    def difference_covariance(
        self, first: Segment, second: Segment, scatter: float, nested: bool, stiction: bool = True
    ) -> Array:
        """(10, 10), of the second's trunk less the first's.

        Errors that act on both alike cancel. What holds sticking joints may have changed with a load, even with one
        that it hides, so it does not.

        Args:
            nested: the first segment's rows are the second's first ones.
            stiction: whether what holds sticking joints may have changed.
        """
        a, b = first.inverse @ first.inverse.T, second.inverse @ second.inverse.T
        white = _positive(a - b) if nested else a + b
        difference = second.sensitivity - first.sensitivity
        total = scatter * white + difference @ self.covariance @ difference.T
        for name in ("stiction",) * stiction + ("regression",) * (not nested):
            place = PLACES[name]
            K1, K2, D = (x[:, place] for x in (first.sensitivity, second.sensitivity, difference))
            own = self.covariance[place, place]
            total += K1 @ own @ K1.T + K2 @ own @ K2.T - D @ own @ D.T
        return np.asarray(0.5 * (total + total.T))


def _positive(matrix: Array) -> Array:
    """The nearest symmetric matrix without negative eigenvalues, which forgetting may leave in a difference."""
    scale = np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-300))
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T) / np.outer(scale, scale))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(scale, scale))


def robot_weight(robot: Robot) -> float:
    """[N], of the model."""
    return GRAVITY * robot.mass
