"""A robot's memory: what earlier logs showed about its drives, sensors, links and the scale of its torques.

Errors p of the robot's model are counted in their standard deviations before any log. A log that began with N(0, S) and
ends with N(p̂, Σ) showed

    R p = z,      RᵀR = Σ⁻¹ - S⁻¹,      Rᵀz = Σ⁻¹ p̂

as an `Information`: all errors together, with what the log knows of them only in common. Logs add up, and fade: between
two of them friction, offsets and lag drift by a share q of what was unknown, everything by more with the days, so that
the rows of R have the noise 1 + R Q Rᵀ instead of 1, Q = diag q².

The next log gets the directions that are known as `Knowledge`; what all logs may have wrong alike bounds each from
below. The scale g that all torques have in common is in the error of every log's p̂ alike, so p and Σ are those without
it. It is known, by an unknown of its own, only to a robot that was on a scale, or had a test weight on it, in one of
the logs (`Knowledge.of_logs`).
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from hashlib import sha256
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from stadera.constants import DAY, EPOCH
from stadera.errors import IdentificationError, require_positive
from stadera.files import save_text
from stadera.information import Information
from stadera.results import json_text
from stadera.robot.model import Robot
from stadera.trunk.error_model import ErrorLayout, ErrorModel
from stadera.trunk.outside import Knowledge
from stadera.types import Array

OF_ROBOT = {
    "rotor": "rotor inertia",
    "viscous": "viscous friction",
    "coulomb": "Coulomb friction",
    "torque_lag": "torque lag",
    "offset": "torque offset",
    "gain": "torque gain",
    "load_friction": "friction by load",
    "encoder": "encoder zero",
    "contact": "contact point",
    "link_mass": "mass",
    "link_com": "centre of mass",
    "imu_lever": "place of the IMU",
    "imu_rotation": "axes of the IMU",
    "velocity_lag": "velocity lag",
    "common_gain": "scale of all torques",
}
"""Errors that belong to the robot, by their names in `ErrorLayout.places`, and in words; the others belong to a log."""

UNCHANGED = "the robot's memory stays as it was"
"""How a sentence about a log begins that is not merged."""

_ROUNDING = 1e-9  # of a variance: what errors have in common may be known exactly
_SCALE = "common_gain"


@dataclass(frozen=True)
class MemorySettings:
    """How a memory fades. Shares are of the prior's standard deviations [1].

    Attributes:
        friction, offset, lag: drift from one log to the next. Friction of a gear changes by a third with its
            temperature (`ModelErrors.friction_drift`), offsets by 0.2 % of the limit of the 0.5 that are unknown.
        daily: drift of everything, times the square root of the days. Assumed: a tenth in a hundred days.
        surest: least standard deviation of what is recalled: errors of the model's laws return in every log.
        worth: least information, in units of the prior's, of what is recalled.
        contradicted: standard deviations between memory and log beyond which the log is not merged.
    """

    friction: float = 0.3
    offset: float = 0.4
    lag: float = 0.1
    daily: float = 0.01
    surest: float = 0.1
    worth: float = 0.2
    contradicted: float = 4.0

    def __post_init__(self) -> None:
        require_positive("setting of a memory", self, tuple(vars(self)), ("friction", "offset", "lag", "daily"))


@dataclass(frozen=True, eq=False)
class Memory:
    """What earlier logs of one robot showed.

    Attributes:
        robot: its name. mass: of its model [kg]. model: digest of all that the errors are differences from, by which
            another model is noticed.
        known: of the errors `OF_ROBOT`, each in its prior standard deviation; named like "coulomb.LF_KFE".
        logs: number of logs. days: time of the last one, days since 1970; NaN if unknown.
        seen: checksums of the logs' samples.
    """

    robot: str
    mass: float
    model: str
    known: Information
    logs: int = 0
    days: float = float("nan")
    seen: tuple[int, ...] = ()

    @classmethod
    def none(cls, robot: Robot) -> Memory:
        """Of a robot of which nothing is known yet."""
        return cls(robot.name, robot.mass, _digest(robot), Information.empty(names_of(robot)))

    @classmethod
    def read(cls, path: str | PathLike[str], robot: Robot) -> Memory:
        """The memory in a file, a new one if there is no such file. Raises IdentificationError: it holds none of the
        robot's.
        """
        if not Path(path).exists():
            return cls.none(robot)
        try:
            return cls.from_dict(json.loads(Path(path).read_text(encoding="utf-8"))).check(robot)
        except (ValueError, IdentificationError) as error:
            raise IdentificationError(f"--memory {path}: {error}") from None

    def save_json(self, path: str | PathLike[str]) -> None:
        """Writes it, whole or not at all. Raises StaderaError: the file cannot be written."""
        save_text(path, json_text(self.to_dict()))

    def check(self, robot: Robot) -> Memory:
        """Returns itself. Raises IdentificationError: it is of another robot or another model."""
        if self.known.names != names_of(robot) or not np.isclose(robot.mass, self.mass, rtol=1e-6):
            raise IdentificationError(
                f"a memory of {self.robot} with {self.mass:.6g} kg is of another model than {robot.name} with "
                f"{robot.mass:.6g} kg; begin a new one"
            )
        if self.model != _digest(robot):
            raise IdentificationError(
                f"a memory of {self.robot} is of other drives, links or feet than the model has now, which its errors "
                "are differences from; begin a new one"
            )
        return self

    def faded(self, days: float, settings: MemorySettings) -> Memory:
        """As it is worth for a log at a time [days since 1970]."""
        drifts = {"viscous": settings.friction, "coulomb": settings.friction, "load_friction": settings.friction}
        drifts |= {"offset": settings.offset, "torque_lag": settings.lag}
        apart = abs(days - self.days)
        drift = np.array([drifts.get(name.partition(".")[0], 0.0) for name in self.known.names])
        drift = np.hypot(drift, settings.daily * np.sqrt(apart if np.isfinite(apart) else 0.0))
        moved = self.known.R * drift
        root = np.linalg.cholesky(np.eye(len(moved)) + moved @ moved.T)
        R, z = (np.asarray(np.linalg.solve(root, x), dtype=float) for x in (self.known.R, self.known.z))
        return replace(self, known=Information.empty(self.known.unknowns).add(R, z))

    def with_log(self, evidence: Information, days: float, settings: MemorySettings, checksum: int) -> Memory:
        """With what one more log showed, after fading to its time.

        Args:
            evidence: see `evidence_of`. checksum: of the log's samples.

        Raises:
            IdentificationError: it is in the memory already, or contradicts it.
        """
        if checksum in self.seen:
            known, had = (of.R[-1, -1] ** 2 > settings.worth for of in (evidence, self.known))
            keep = "; to keep what a scale or test weight tells now, begin a new memory with this log"
            raise IdentificationError(f"these samples are in the memory already{keep if known and not had else ''}")
        faded = self.faded(days, settings)
        what, apart = faded.contradiction(evidence, settings)
        if apart > settings.contradicted:
            raise IdentificationError(
                f"this log contradicts the memory of {self.logs} log{'s' * (self.logs != 1)} in the {what}, by "
                f"{apart:.1f} standard deviations: a part that was changed, or another robot; it is not remembered"
            )
        seen, days = (*self.seen, checksum), self.days if np.isnan(days) else days
        return replace(faded, known=faded.known.merge(evidence), logs=self.logs + 1, days=days, seen=seen)

    def after(self, learn: Callable[[], Memory]) -> tuple[Memory | None, str]:
        """The memory that `learn` returns, None where it raises IdentificationError, and what to say of it."""
        try:
            found = learn()
        except IdentificationError as error:
            return None, f"{UNCHANGED}: {error}"
        return found, f"the robot's memory is of {self.logs} earlier log{'s' * (self.logs != 1)}, and of this one"

    def knowledge(self, layout: ErrorLayout, prior: Array, settings: MemorySettings) -> Knowledge | None:
        """What it tells a log whose errors have these variances (errors,) before it; None if next to nothing."""
        places, last = layout.at(*OF_ROBOT), len(self.known) - 1
        U, known, V = np.linalg.svd(self.known.R[:last, :last])
        kept = known**2 > settings.worth
        A = np.zeros((np.count_nonzero(kept) + 1, layout.count))
        A[:-1, places[:last]] = V[kept] / np.sqrt(prior[places[:last]])
        A[-1, places[last]] = 1.0 / np.sqrt(prior[places[last]])
        known = np.append(known[kept], self.known.R[last, last])
        value = np.append(U.T[kept] @ self.known.z[:last], self.known.z[last])
        ready = known**2 > settings.worth
        if not ready.any():
            return None
        value, known = value[ready] / known[ready], known[ready]
        noise = np.diag(known**-2.0 + settings.surest**2)
        return Knowledge("the memory", value, noise, A[ready], of_logs=True)

    def marginals(self) -> dict[str, tuple[float, float]]:
        """Mean and standard deviation of each error by its name, in those before any log [1]."""
        mean, variance = _posterior(self.known)
        return dict(zip(self.known.names, zip(mean.tolist(), np.sqrt(variance).tolist(), strict=True), strict=True))

    def contradiction(self, evidence: Information, settings: MemorySettings) -> tuple[str, float]:
        """The error in which a log is furthest from the memory, in words, and by how many standard deviations [1]."""
        (mean, variance), (of_log, left) = _posterior(self.known), _posterior(evidence)
        kept = (1.0 / variance - 1.0 > settings.worth) & (left < 0.5)
        if not kept.any():
            return "", 0.0
        known, own = (1.0 / x[kept] - 1.0 for x in (variance, left))
        apart = mean[kept] / (1.0 - variance[kept]) - of_log[kept] / (1.0 - left[kept])
        apart = np.abs(apart) / np.sqrt(1.0 / known + 1.0 / own + settings.surest**2)
        k = int(np.argmax(apart))
        kind, *owner = self.known.names[np.flatnonzero(kept)[k]].split(".", 1)
        return OF_ROBOT[kind] + "".join(f" of {name.partition(':')[0]}" for name in owner), float(apart[k])

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; R by rows from the diagonal on."""
        return {
            "robot": self.robot,
            "mass": self.mass,
            "model": self.model,
            "logs": self.logs,
            "days": self.days if np.isfinite(self.days) else None,
            "errors": list(self.known.names),
            "R": [row[k:].tolist() for k, row in enumerate(self.known.R)],
            "z": self.known.z.tolist(),
            "seen": list(self.seen),
        }

    @classmethod
    def from_dict(cls, values: Any) -> Memory:
        """The reverse of `to_dict`. Raises IdentificationError: not the values of a memory."""
        if not isinstance(values, dict) or not {"errors", "R", "z"} <= values.keys():
            raise IdentificationError("not a robot's memory, which `--memory` itself writes; name another file")
        try:
            names, days = tuple(map(str, values["errors"])), values["days"]
            rows = [np.array(row, dtype=float) for row in values["R"]]
            R = np.array([np.pad(row, (len(names) - len(row), 0)) for row in rows])
            known = Information(
                Information.empty(names).unknowns, R, np.array(values["z"], dtype=float), np.zeros((len(names), 0))
            )
            if not np.isfinite([*known.z, *R.ravel()]).all():
                raise ValueError("values that are not finite")
            return cls(
                str(values["robot"]),
                float(values["mass"]),
                str(values["model"]),
                known,
                int(values["logs"]),
                float("nan") if days is None else float(days),
                tuple(map(int, values["seen"])),
            )
        except (AttributeError, IdentificationError, KeyError, TypeError, ValueError) as error:
            raise IdentificationError(f"not a robot's memory: {error!r}") from None


def days_of(begin: float) -> float:
    """Time of a log that begins at `begin` [s], days since 1970; NaN if its clock is not Unix time."""
    return begin / DAY if begin > EPOCH else float("nan")


def names_of(robot: Robot) -> tuple[str, ...]:
    """Names of the errors `OF_ROBOT` of a robot, in that order: of joints by leg and outwards,
    of contacts by leg, of links by the tree. What has axes ends like ":x".
    """
    joints = [joint for leg in robot.legs for joint in leg.joints]
    links, axes = robot.tree.links[1:], ("x", "y", "z")
    owners = dict.fromkeys(("rotor", "viscous", "coulomb", "offset", "gain", "load_friction", "encoder"), joints)
    owners["contact"] = [f"{leg.name}:{axis}" for leg in robot.legs for axis in axes]
    owners |= {"link_mass": list(links), "link_com": [f"{link}:{axis}" for axis in axes for link in links]}
    owners |= {"imu_lever": [*axes], "imu_rotation": [*axes]}
    return tuple(f"{kind}.{owner}" if owner else kind for kind in OF_ROBOT for owner in owners.get(kind, [""]))


def evidence_of(robot: Robot, model: ErrorModel, start: Array, mean: Array, covariance: Array) -> Information:
    """What a log shows of the errors `OF_ROBOT`, in their prior standard deviations.

    Args:
        model: of the errors before any log.
        start: (errors, errors), the covariance that the log began with, less where its residuals are small.
        mean, covariance: (errors,) and (errors, errors), after it, with what was known of its load.
    """
    layout, names = model.layout, names_of(robot)
    at, scale = layout.at(*OF_ROBOT)[:-1], layout.places[_SCALE].start
    std, by_scale = np.sqrt(np.maximum(model.variance[at], _ROUNDING)), covariance[at, scale] / covariance[scale, scale]
    start, gain = start.copy(), layout.places["gain"]
    start[gain, gain] -= np.diag(start)[gain].mean() / layout.joints  # the gains' mean is zero
    own = covariance[np.ix_(at, at)] - np.outer(by_scale, covariance[at, scale])
    prior, own = (x / np.outer(std, std) + _ROUNDING * np.eye(len(at)) for x in (start[np.ix_(at, at)], own))
    evidence = Information.of_posterior(names[:-1], (mean[at] - by_scale * mean[scale]) / std, own, prior)
    known = max(model.variance[scale] / covariance[scale, scale] - 1.0, 0.0)
    row = np.zeros((1, len(names)))
    row[0, -1], z = np.sqrt(known), np.zeros(1)
    if known > _ROUNDING:
        z[0] = mean[scale] * np.sqrt(model.variance[scale] / known) / covariance[scale, scale]
    return Information.empty(names).merge(evidence).add(row, z)


def _posterior(known: Information) -> tuple[Array, Array]:
    """Mean and variances of errors that were N(0, 1)."""
    covariance = np.linalg.inv(known.R.T @ known.R + np.eye(len(known)))
    return covariance @ (known.R.T @ known.z), np.diag(covariance)


def _digest(robot: Robot) -> str:
    """Of the joints' terms, the links and the contact points of a model."""
    joints = [joint for leg in robot.legs for joint in leg.joints]
    terms = [(d.armature, d.viscous, d.coulomb, d.offset) for d in (robot.dynamics[joint] for joint in joints)]
    links = [robot.inertias[link].vector for link in robot.tree.links[1:]]
    feet = [leg.foot_position for leg in robot.legs]
    values = np.concatenate([np.ravel(part) for part in (terms, links, feet)])
    return sha256(np.round(values, 9).tobytes()).hexdigest()[:16]
