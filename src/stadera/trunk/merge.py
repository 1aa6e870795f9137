"""Merges trunk estimates of one robot from several logs, with the model errors that all logs share.

Each log provides ``R θ_k + G p = z`` (`stadera.trunk.segment`), with p̂_k and Σ_k of the model errors p. Those of the
robot (scale of the torques, zeros of the encoders, positions of feet and IMU) are the same in all logs, p_s; others
vary from day to day (rotor inertia and friction, sticking joints, biases). Before any log p_s has the covariance P.
Each log sharpens its estimate by rows of its own, so the error e_k of p̂_k follows p_s only in part,

    e_k = Φ_k p_s + o_k,      Φ_k = cov(e_k, p_s) P⁻¹,      cov o_k = Σ_k - Φ_k P Φ_kᵀ

with o_k independent of all others. (For Σ = (P⁻¹ + N)⁻¹ it is Σ P⁻¹ of the prior's error that remains.) Merged,

    [R_1        ] [θ_1]   [G_1 Φ_1 S  G_1 O_1        ]         [z_1 - G_1 p̂_1]
    [      R_2  ] [θ_2] + [G_2 Φ_2 S          G_2 O_2] e   =   [z_2 - G_2 p̂_2],      e of unit covariance

with S and O_k square roots of P and cov o_k. Each trunk's estimate is the same as from its log alone. Merging adds the
correlation of their errors: a common error of all torques moves all trunks alike and cancels in the difference between
two logs, which is therefore much more accurate than independent error bars suggest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stadera.errors import IdentificationError
from stadera.information import Information, Unknowns
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.load import Payload
from stadera.trunk.result import ObservedLimits
from stadera.types import Array, Bools

SHARED = (
    "gain",
    "encoder",
    "contact",
    "link_mass",
    "link_com",
    "imu_lever",
    "imu_rotation",
    "velocity_lag",
    "common_gain",
)
"""Errors that belong to the robot, by their names in `ErrorLayout.places`; all others belong to a log."""


@dataclass(frozen=True, eq=False)
class TrunkEvidence:
    """One log's information on its trunk.

    Attributes:
        known: information on `theta`, the ten parameters, with considered model errors, in units of the rows' scatter.
        mean: (errors,), p̂. covariance: (errors, errors), Σ.
        prior: (errors, errors), the covariance before the log. remaining: (errors, errors), that of p̂'s errors with the
            errors before the log.
        length: of the robot's legs [m]. layout: places of the errors.
    """

    known: Information
    mean: Array
    covariance: Array
    prior: Array
    remaining: Array
    length: float
    layout: ErrorLayout


@dataclass(frozen=True, eq=False)
class MergedTrunks:
    """The trunks of all logs, jointly.

    Attributes:
        known: information with one block of ten parameters for each log, under considered errors of unit covariance.
        length: of the robot's legs [m].
    """

    known: Information
    length: float

    def trunk(self, log: str) -> tuple[Array, Array]:
        """Ten parameters (10,) of a log's trunk and their covariance (10, 10).

        Raises:
            UnknownNameError: no such log.
        """
        return self.known.mean[self.known[log]], self.known.covariance(log)

    def difference(self, log: str, since: str) -> Payload:
        """Difference between two logs' trunks: mass, centre of mass and their uncertainty.

        Raises:
            UnknownNameError: no such log.
        """
        a, b = self.known[log], self.known[since]
        root = self.known.root[a] - self.known.root[b]
        step = self.known.mean[a] - self.known.mean[b]
        return Payload.of_parameters(step, root @ root.T, ObservedLimits().com * self.length)


def merge_trunks(logs: Mapping[str, TrunkEvidence]) -> MergedTrunks:
    """Merges the trunks of one robot from its logs, given by name.

    Raises:
        IdentificationError: no logs.
    """
    if not logs:
        raise IdentificationError("no log was weighed in motion, so there is nothing to merge")
    layout = next(iter(logs.values())).layout
    shared, count = np.zeros(layout.count, dtype=bool), layout.count
    for name in SHARED:
        shared[layout.places[name]] = True
    root = _root(np.mean([log.prior[np.ix_(shared, shared)] for log in logs.values()], axis=0))
    considered = len(root) + count * len(logs)
    total = Information.empty(Unknowns(tuple(logs), (10,) * len(logs)), considered)
    for k, (name, log) in enumerate(logs.items()):
        G, start = np.zeros((10, considered)), len(root) + count * k
        by_shared, rest = _given(log, shared)
        G[:, : len(root)] = log.known.G @ by_shared @ root
        G[:, start : start + count] = log.known.G @ _root(rest)
        z = log.known.z - log.known.G @ log.mean
        total = total.merge(Information(Unknowns((name,), (10,)), log.known.R, z, G, log.known.cost, log.known.count))
    return MergedTrunks(total, next(iter(logs.values())).length)


def _given(log: TrunkEvidence, shared: Bools) -> tuple[Array, Array]:
    """Splits the errors of p̂ into Φ times the shared errors and a rest; returns Φ (errors, shared) and the rest's
    covariance.
    """
    inside, across = log.prior[np.ix_(shared, shared)], log.remaining[:, shared]
    std = np.sqrt(np.maximum(np.diag(inside), 1e-300))
    by_shared = (across / std) @ np.linalg.pinv(inside / np.outer(std, std), hermitian=True) / std
    return by_shared, log.covariance - by_shared @ inside @ by_shared.T


def _root(covariance: Array) -> Array:
    """Square root of a covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
