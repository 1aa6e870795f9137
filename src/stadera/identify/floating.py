"""Links and drives from the log of a robot that stands, sways or walks: what the floating base's equations tell.

With the contact forces eliminated from the six equations of the base (`stadera.body.tree`), these contain the links'
parameters and the drives beside the trunk's. The walking estimator sums them up with everything else that a real robot
has: gains and lag of the torques, zeros of the encoders, contact points and the IMU's mount (`stadera.trunk.rows`). Its
posterior of the differences p from the model, N(p̂, Σ), holds its prior N(0, P) too, which is divided out:

    R p = z,      RᵀR = Σ⁻¹ - P⁻¹,      Rᵀz = Σ⁻¹ p̂

so that only what the log itself tells is merged with other logs. Directions that the log leaves as they were are left
out. Of a link, p has the mass and the centre of mass (m c = h), and no change of the inertia about it; so a rotor is
known no better than the links' inertia about its axis, and an offset no better than their weight
(`stadera.trunk.drives`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from stadera.body import Rows
from stadera.body.rows import discounted
from stadera.identify.log import Log
from stadera.identify.prior import Prior
from stadera.inertia import ORDER
from stadera.information import Information, Places
from stadera.logs.reader import stream
from stadera.robot.model import Leg, Robot
from stadera.trunk.drives import TERMS
from stadera.trunk.error_model import ErrorLayout, ErrorModel
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.memory import OF_ROBOT, Memory, MemorySettings, days_of
from stadera.trunk.result import TrunkParameters
from stadera.trunk.samples import Samples
from stadera.trunk.settings import ModelErrors, TrunkSettings
from stadera.trust import Trust
from stadera.types import Array, Progress


@dataclass(frozen=True, eq=False)
class KnownLegs:
    """What a log of a robot on its feet, or the robot's memory, tells of its legs."""

    source: str  # the log's name
    # information on mass and first moment of each leg's links, and on its drives, offsets included
    by_leg: Mapping[str, Information]

    def of_leg(self, name: str, fixed: Mapping[str, float], *, offsets: bool) -> Information:
        """A leg's information with some parameters fixed, with or without the torque offsets, which change daily."""
        found = self.by_leg[name]
        if not offsets:
            found = found.marginal(c for c in found.names if not c.endswith(".offset"))
        return found.fix({name: value for name, value in fixed.items() if name in found.names})

    @classmethod
    def by(cls, memory: Memory, robot: Robot) -> KnownLegs:
        """What a memory of the robot tells."""
        errors, n = ErrorModel(robot, ModelErrors()), len(memory.known) - 1
        places, std = errors.layout.at(*OF_ROBOT)[:n], np.sqrt(errors.variance)
        within = np.ix_(places, places)
        covariance, mean = np.diag(errors.variance), np.zeros(errors.layout.count)
        known = memory.known.R[:n, :n]
        prior = errors.covariance[within] / np.outer(std[places], std[places])
        after = np.linalg.inv(known.T @ known + np.linalg.inv(prior))
        covariance[within] = after * np.outer(std[places], std[places])
        mean[places] = std[places] * (after @ (known.T @ memory.known.z[:n]))
        return cls("the robot's memory", _Columns.of(robot).of_legs(mean, covariance, errors.covariance))


@dataclass(frozen=True, eq=False)
class FloatingLog(KnownLegs):
    """One log of a robot on its feet."""

    trunk: TrunkParameters  # with its uncertainty, payload included
    torque_lag: float  # how much later than its stamp a torque acted [s], as of `stadera.identify.lag`
    trust: Trust  # fit of the log
    memory: Memory | None = None  # the robot's memory with the log, None without one or if they contradict each other
    said: str = ""  # of it


def floating_log(
    robot: Robot, log: Log, progress: Progress, link_mass: float, memory: Memory | None = None
) -> FloatingLog:
    """Processes one log. `link_mass` is the relative standard deviation of the links' masses; a memory counts in its
    own. Raises RecordingError: it lacks a joint's velocity or effort, or the IMU.
    """
    settings = TrunkSettings(model=ModelErrors(link_mass=link_mass)) if memory is None else None
    estimator, done, days = TrunkEstimator(robot, settings=settings), 0, np.nan
    for chunk in stream(log, joints=robot.tree.joints, require=("effort", "velocity", "imu")):
        if not done and memory is not None:
            days = days_of(float(chunk.time[0]))
            estimator.recall(memory, days)
        samples = Samples.of_recording(chunk, robot)
        estimator.add(samples)
        done += len(samples)
        progress("links and drives of a robot on its feet", done, 0)
    kept, said = (None, "") if memory is None else estimator.remembered(memory, days)
    lag, trust = -estimator.torque_lag[0], estimator.trust
    return FloatingLog(log.source, learnt(estimator), estimator.trunk, lag, trust, kept, said)


def _columns(leg: Leg) -> tuple[str, ...]:
    links = [f"{link}.{name}" for link in leg.links for name in ORDER[:4]]
    return (*links, *(f"{joint}.{term}" for joint in leg.joints for term in TERMS))


@dataclass(frozen=True, eq=False)
class _Columns:
    """Parameters of all legs, by leg, and the errors p of the model that change them: θ = model + slope p."""

    robot: Robot  # the model
    columns: tuple[str, ...]  # names
    at: Places  # (n,), places of their errors
    slope: Array  # (n, n)
    model: Array  # (n,)

    @classmethod
    def of(cls, robot: Robot) -> _Columns:
        """Of a robot. A link has a share of its mass, and a displacement of its centre."""
        layout, joints = ErrorLayout.of(robot), [joint for leg in robot.legs for joint in leg.joints]
        columns = tuple(name for leg in robot.legs for name in _columns(leg))
        slope, at, model = np.eye(len(columns)), np.zeros(len(columns), dtype=np.intp), np.zeros(len(columns))
        for n in range(0, len(columns), 4):
            owner, own = columns[n].rsplit(".", 1)[0], slice(n, n + 4)
            if owner in robot.inertias:
                k, body = robot.tree.links.index(owner) - 1, robot.inertias[owner].vector[:4]
                slope[own, own], model[own] = body[0] * np.eye(4), body
                slope[own, n] = body
                at[own] = layout.places["link_com"].start + k + layout.links * (np.arange(4) - 1)
                at[n] = layout.places["link_mass"].start + k
            else:
                at[own] = [layout.places[name].start + joints.index(owner) for name in TERMS.values()]
                model[own] = [getattr(robot.dynamics[owner], term) for term in TERMS]
        return cls(robot, columns, at, slope, model)

    def of_legs(
        self, mean: Array, covariance: Array, start: Array, hidden: Array | None = None
    ) -> dict[str, Information]:
        """Information on each leg from N(`mean`, `covariance`) of all errors, which were N(0, `start`), of rows that
        tell each error together with another one of the standard deviation `hidden` (errors,), None for none.

        The prior has drives of one kind alike. That is divided out of all legs together; then each leg's part is what
        is known of it with the other legs at the prior that they have each by itself, which is divided out in turn.
        """
        among = np.ix_(self.at, self.at)
        every = Information.of_posterior(self.columns, mean[self.at], covariance[among], start[among])
        sizes = [len(_columns(leg)) for leg in self.robot.legs]
        owns = [slice(stop - size, stop) for stop, size in zip(np.cumsum(sizes), sizes, strict=True)]
        apart = np.zeros_like(self.slope)
        for own in owns:
            apart[own, own] = start[among][own, own]
        after = np.linalg.inv(every.R.T @ every.R + np.linalg.inv(apart))
        middle, out = after @ (every.R.T @ every.z), {}
        for leg, own in zip(self.robot.legs, owns, strict=True):
            alone = Information.of_posterior(self.columns[own], middle[own], after[own, own], apart[own, own])
            evidence = np.column_stack((alone.R, alone.z))
            if hidden is not None:
                evidence = discounted(evidence, alone.R * hidden[self.at[own]])
            matrix = np.asarray(np.linalg.solve(self.slope[own, own].T, evidence[:, :-1].T).T, dtype=float)
            rows = Rows(self.columns[own], matrix, np.asarray(evidence[:, -1] + matrix @ self.model[own]))
            out[leg.name] = Information.of([rows], self.columns[own])
        return out


def learnt(estimator: TrunkEstimator) -> dict[str, Information]:
    """What the estimator learnt about links and drives, by leg."""
    drives = estimator.drives
    errors, std = drives.errors, drives.std
    hidden = np.zeros(errors.layout.count)
    for k, name in enumerate(TERMS.values()):
        place = errors.layout.places[name]
        hidden[place] = np.sqrt(np.maximum(std[:, k] ** 2 - errors.std[place] ** 2, 0.0))
    return _Columns.of(estimator.robot).of_legs(errors.mean, errors.covariance, errors.start, hidden)


def remembered(
    robot: Robot, memory: Memory, days: float, legs: Iterable[tuple[Prior, Information]]
) -> tuple[Memory | None, str]:
    """A memory with logs of legs in the air, None where they contradict it, and what to say of it.

    Args:
        days: time of the logs, days since 1970; NaN if unknown.
        legs: prior and information of each leg, in units of its noise.
    """
    errors, every, total = ErrorModel(robot, ModelErrors()), _Columns.of(robot), Memory.none(robot).known
    names = dict(zip(errors.layout.at(*OF_ROBOT).tolist(), total.names, strict=True))
    for prior, known in legs:
        kept = [k for k, name in enumerate(every.columns) if name in prior.columns]
        own = [prior.columns.index(every.columns[k]) for k in kept]
        P = prior.root @ prior.root.T
        after = np.linalg.inv(known.R.T @ known.R + np.linalg.inv(P))
        mean = after @ (known.R.T @ (known.z - known.R @ prior.values))
        alone = Information.of_posterior(map(str, own), mean[own], after[np.ix_(own, own)], P[np.ix_(own, own)])
        of_errors = alone.R @ every.slope[np.ix_(kept, kept)] * np.sqrt(errors.variance[every.at[kept]])
        columns = tuple(names[place] for place in every.at[kept].tolist())
        total = total.merge(Information.of([Rows(columns, of_errors, alone.z)], columns))
    checksum = crc32(np.round(total.z, 6).tobytes())
    return memory.after(lambda: memory.with_log(total, days, MemorySettings(), checksum))
