"""Links and drives from the log of a robot that stands, sways or walks: what the floating base's equations tell.

With the contact forces eliminated from the six equations of the base (`stadera.body.tree`), these contain the links'
parameters and the drives beside the trunk's. The walking estimator sums them up with everything else that a real robot
has: gains and lag of the torques, zeros of the encoders, contact points and the IMU's mount (`stadera.trunk.rows`). Its
posterior of the differences p from the model, N(p̂, Σ), holds its prior N(0, P) too, which is divided out:

    R p = z,      RᵀR = Σ⁻¹ - P⁻¹,      Rᵀz = Σ⁻¹ p̂

so that only what the log itself tells is merged with other logs. Directions that the log leaves as they were are left
out. Of a link, p has the mass and the centre of mass (m c = h), and no change of the inertia about it; so a rotor is
known no better than the links' inertia about its axis (`stadera.trunk.drives`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stadera.body import Rows
from stadera.identify.log import Log
from stadera.inertia import ORDER
from stadera.information import Information
from stadera.logs.reader import stream
from stadera.robot.model import Leg, Robot
from stadera.trunk.drives import TERMS
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.result import TrunkParameters
from stadera.trunk.samples import Samples
from stadera.trust import Trust
from stadera.types import Array, Progress


@dataclass(frozen=True, eq=False)
class FloatingLog:
    """What one log of a robot on its feet tells.

    Attributes:
        source: the log's name.
        by_leg: information on mass and first moment of each leg's links, and on its drives, offsets included.
        trunk: with its uncertainty, payload included.
        torque_lag: how much later than its stamp a torque acted [s], as of `stadera.identify.lag`.
        trust: fit of the log.
    """

    source: str
    by_leg: Mapping[str, Information]
    trunk: TrunkParameters
    torque_lag: float
    trust: Trust

    def of_leg(self, name: str, fixed: Mapping[str, float], *, offsets: bool) -> Information:
        """A leg's information with some parameters fixed, with or without the torque offsets, which change daily."""
        found = self.by_leg[name]
        if not offsets:
            found = found.marginal(c for c in found.names if not c.endswith(".offset"))
        return found.fix({name: value for name, value in fixed.items() if name in found.names})


def floating_log(robot: Robot, log: Log, progress: Progress) -> FloatingLog:
    """Processes one log. Raises RecordingError: it lacks a joint's velocity or effort, or the IMU."""
    estimator, done = TrunkEstimator(robot), 0
    for chunk in stream(log, joints=robot.tree.joints, require=("effort", "velocity", "imu")):
        samples = Samples.of_recording(chunk, robot)
        estimator.add(samples)
        done += len(samples)
        progress("links and drives of a robot on its feet", done, 0)
    return FloatingLog(log.source, learnt(estimator), estimator.trunk, -estimator.torque_lag[0], estimator.trust)


def _columns(leg: Leg) -> tuple[str, ...]:
    links = [f"{link}.{name}" for link in leg.links for name in ORDER[:4]]
    return (*links, *(f"{joint}.{term}" for joint in leg.joints for term in TERMS))


def learnt(estimator: TrunkEstimator) -> dict[str, Information]:
    """What the estimator learnt about links and drives, by leg.

    Its prior has drives of one kind alike. That is divided out of all legs together; then each leg's part is what is
    told of it with the other legs at the prior that they have each by itself, which is divided out in turn.
    """
    robot, errors = estimator.robot, estimator.errors
    places, joints = errors.layout.places, estimator.drives.joints
    columns = tuple(name for leg in robot.legs for name in _columns(leg))
    slope, at, model = np.eye(len(columns)), np.zeros(len(columns), dtype=np.int64), np.zeros(len(columns))
    wider = np.zeros(len(columns))
    for n in range(0, len(columns), 4):
        owner, own = columns[n].rsplit(".", 1)[0], slice(n, n + 4)
        if owner in robot.inertias:  # a share of the mass, and a displacement of the centre
            k, body = robot.tree.links.index(owner) - 1, robot.inertias[owner].vector[:4]
            slope[own, own], model[own] = body[0] * np.eye(4), body
            slope[own, n] = body
            at[own] = places["link_com"].start + k + errors.layout.links * (np.arange(4) - 1)
            at[n] = places["link_mass"].start + k
        else:
            j, dynamics = joints.index(owner), robot.dynamics[owner]
            at[own] = [places[name].start + j for name in TERMS.values()]
            model[own] = [getattr(dynamics, term) for term in TERMS]
            wider[n] = max(estimator.drives.std[j, 0] ** 2 - errors.covariance[at[n], at[n]], 0.0)
    prior = errors.start[np.ix_(at, at)]
    R, z = _without_prior(errors.mean[at], errors.covariance[np.ix_(at, at)] + np.diag(wider), prior)
    sizes = [len(_columns(leg)) for leg in robot.legs]
    owns = [slice(stop - size, stop) for stop, size in zip(np.cumsum(sizes), sizes, strict=True)]
    out: dict[str, Information] = {}
    apart = np.zeros_like(prior)
    for own in owns:
        apart[own, own] = prior[own, own]
    covariance = np.linalg.inv(R.T @ R + np.linalg.inv(apart))
    mean = covariance @ (R.T @ z)
    for leg, own in zip(robot.legs, owns, strict=True):
        R, z = _without_prior(mean[own], covariance[own, own], apart[own, own])
        matrix = np.asarray(np.linalg.solve(slope[own, own].T, R.T).T, dtype=float)
        out[leg.name] = Information.of([Rows(columns[own], matrix, np.asarray(z + matrix @ model[own]))], columns[own])
    return out


def _without_prior(mean: Array, covariance: Array, prior: Array, least: float = 0.1) -> tuple[Array, Array]:
    """R and z, given the posterior of errors whose prior mean is zero; `least` is the information of a direction, in
    units of the prior's, below which it is left out.
    """
    root = np.linalg.cholesky(prior)
    inside = np.linalg.solve(root, np.linalg.solve(root, covariance).T)
    sizes, axes = np.linalg.eigh(0.5 * (inside + inside.T))
    told = 1.0 / sizes - 1.0
    kept = told > least
    told, axes = told[kept], axes[:, kept]
    along = axes.T @ np.linalg.solve(root, mean)
    return np.sqrt(told)[:, None] * np.linalg.solve(root.T, axes).T, (1.0 + told) / np.sqrt(told) * along
