"""A robot's memory: what earlier logs told about its drives, sensors, links and the scale of its torques.

Of each error p_i, whose standard deviation was σ_i before any log, a log that began with s_0i and ends with
p̂_i ± s_i alone told

    λ_i = σ_i² / s_i² - σ_i² / s_0i²,      η_i = p̂_i σ_i / s_i²

in units of σ_i: a share of what was unknown of a robot in general. Logs add up, and fade: between two of them friction,
offsets and lag drift by a share q_i, everything by more with the days,

    λ ← λ / (1 + q² λ),      η ← η / (1 + q² λ)

The next log gets each error that is known as `Knowledge`: η / λ, of variance 1/λ. Covariances between errors are left
out; what all logs may have wrong alike bounds each from below. The scale that all torques have in common is known only
to a robot that was on a scale, or had a test weight on it, in one of the logs (`Knowledge.of_logs`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Any

import numpy as np

from stadera.errors import IdentificationError, require_positive
from stadera.robot.model import Robot
from stadera.trunk.error_model import ErrorLayout, ErrorModel
from stadera.trunk.joint_errors import Errors
from stadera.trunk.outside import Knowledge
from stadera.types import Array

OF_ROBOT = {
    "rotor": "rotor inertia",
    "viscous": "viscous friction",
    "coulomb": "Coulomb friction",
    "torque_lag": "torque lag",
    "offset": "torque offset",
    "gain": "torque gain",
    "encoder": "encoder zero",
    "contact": "contact point",
    "link_mass": "mass of a link",
    "link_com": "centre of mass of a link",
    "imu_lever": "place of the IMU",
    "imu_rotation": "axes of the IMU",
    "velocity_lag": "velocity lag",
    "common_gain": "scale of all torques",
}
"""Errors that belong to the robot, by their names in `ErrorLayout.places`, and in words; the others belong to a log."""

_ROUNDING = 1e-6  # of information
_BY_JOINT = ("rotor", "viscous", "coulomb", "offset", "gain", "encoder")


@dataclass(frozen=True)
class MemorySettings:
    """How a memory fades. Shares are of the prior's standard deviations [1].

    Attributes:
        friction, offset, lag: drift from one log to the next. Friction of a gear changes by a third with its
            temperature (`ModelErrors.friction_drift`), offsets by 0.2 % of the limit of the 0.5 that are unknown.
        daily: drift of everything, times the square root of the days. Assumed: a tenth in a hundred days.
        surest: least standard deviation of what is recalled: errors of the model's laws return in every log.
        worth: least λ of an error that is recalled.
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
    """What earlier logs of one robot told.

    Attributes:
        robot: its name. mass: of its model [kg]. model: digest of all that the errors are differences from, by which
            another model is noticed; empty if unknown.
        joints: of its legs, by leg and outwards.
        information, right: λ and η (n,) of the errors `OF_ROBOT`, in the prior's standard deviations.
        logs: number of logs. days: time of the last one, days since 1970; NaN if unknown.
        seen: checksums of the logs' samples.
    """

    robot: str
    mass: float
    joints: tuple[str, ...]
    information: Array
    right: Array
    logs: int = 0
    days: float = float("nan")
    model: str = ""
    seen: tuple[int, ...] = ()

    @classmethod
    def none(cls, robot: Robot) -> Memory:
        """Of a robot of which nothing is known yet."""
        count = len(_places(ErrorLayout.of(robot)))
        joints = tuple(joint for leg in robot.legs for joint in leg.joints)
        return cls(robot.name, robot.mass, joints, np.zeros(count), np.zeros(count), model=_digest(robot))

    def check(self, robot: Robot) -> Memory:
        """Returns itself. Raises IdentificationError: it is of another robot or another model."""
        joints = tuple(joint for leg in robot.legs for joint in leg.joints)
        if (
            len(self.information) != len(_places(ErrorLayout.of(robot)))
            or joints != self.joints
            or not np.isclose(robot.mass, self.mass, rtol=1e-6)
        ):
            raise IdentificationError(
                f"a memory of {self.robot} with {self.mass:.6g} kg is of another model than {robot.name} with "
                f"{robot.mass:.6g} kg; begin a new one"
            )
        if self.model not in ("", _digest(robot)):
            raise IdentificationError(
                f"a memory of {self.robot} is of other drives, links or feet than the model has now, which its errors "
                "are differences from; begin a new one"
            )
        return self

    def faded(self, layout: ErrorLayout, days: float, settings: MemorySettings) -> Memory:
        """As it is worth for a log at a time [days since 1970]."""
        drift = np.zeros(layout.count)
        for name, size in (("viscous", settings.friction), ("coulomb", settings.friction)):
            drift[layout.places[name]] = size
        drift[layout.places["offset"]], drift[layout.places["torque_lag"]] = settings.offset, settings.lag
        apart = abs(days - self.days)
        square = drift[_places(layout)] ** 2 + settings.daily**2 * (apart if np.isfinite(apart) else 0.0)
        less = 1.0 / (1.0 + square * self.information)
        return replace(self, information=less * self.information, right=less * self.right)

    def plus(
        self, layout: ErrorLayout, prior: Array, start: Array, mean: Array, variance: Array, days: float
    ) -> Memory:
        """With what one more log told: the prior variances, those that the log began with (less where its residuals are
        small), p̂ and its variances, (errors,) each.
        """
        places = _places(layout)
        ratio = prior[places] / np.maximum(variance[places], 1e-300)
        information = np.maximum(ratio - prior[places] / start[places], 0.0)
        information[information < _ROUNDING] = 0.0
        right = np.where(information > 0.0, mean[places] * ratio / np.sqrt(prior[places]), 0.0)
        total = self.information + information
        return replace(self, information=total, right=self.right + right, logs=self.logs + 1, days=days)

    def learnt(
        self,
        model: ErrorModel,
        errors: Errors,
        found: tuple[Array, Array],
        days: float,
        settings: MemorySettings,
        checksum: int,
    ) -> Memory:
        """With one more log, faded to its time.

        Args:
            model, errors: of the log. found: p̂ and its covariance with what was known of the load.
            checksum: of its samples.

        Raises:
            IdentificationError: it is in the memory already, or contradicts it.
        """
        layout, (mean, covariance) = model.layout, found
        if checksum in self.seen:
            raise IdentificationError("these samples are in the memory already")
        variance = np.diag(covariance)
        what, apart = self.contradiction(layout, model.variance, mean, variance, settings)
        if apart > settings.contradicted:
            raise IdentificationError(
                f"this log contradicts the memory of {self.logs} log{'s' * (self.logs != 1)} in the {what}, by "
                f"{apart:.1f} standard deviations: a part that was changed, or another robot; it is not remembered"
            )
        start, gain, scale = np.diag(errors.start).copy(), layout.places["gain"], layout.places["common_gain"]
        start[gain] -= start[gain].mean() / layout.joints  # the gains' mean is zero
        start[scale] = model.variance[scale]
        told = self.plus(layout, model.variance, start, mean, variance, days)
        return replace(told, seen=(*self.seen, checksum))

    def knowledge(self, layout: ErrorLayout, prior: Array, settings: MemorySettings) -> Knowledge | None:
        """What it tells a log whose errors have these variances (errors,) before it; None if next to nothing."""
        kept = self.information > settings.worth
        if not kept.any():
            return None
        places = _places(layout)[kept]
        A = np.zeros((len(places), layout.count))
        A[np.arange(len(places)), places] = 1.0 / np.sqrt(prior[places])
        noise = np.diag(1.0 / self.information[kept] + settings.surest**2)
        return Knowledge("the memory", self.right[kept] / self.information[kept], noise, A, of_logs=True)

    def contradiction(
        self, layout: ErrorLayout, prior: Array, mean: Array, variance: Array, settings: MemorySettings
    ) -> tuple[str, float]:
        """The error in which a log, p̂ and its variances (errors,), is furthest from the memory, in words, and by how
        many standard deviations [1].
        """
        kept = (self.information > settings.worth) & (variance[_places(layout)] < 0.5 * prior[_places(layout)])
        if not kept.any():
            return "", 0.0
        places, λ = _places(layout)[kept], self.information[kept]
        apart = mean[places] / np.sqrt(prior[places]) - self.right[kept] / λ
        apart /= np.sqrt(1.0 / λ + settings.surest**2 + variance[places] / prior[places])
        k = int(np.argmax(np.abs(apart)))
        name = next(name for name in OF_ROBOT if layout.places[name].start <= places[k] < layout.places[name].stop)
        of = f" of {self.joints[places[k] - layout.places[name].start]}" if name in _BY_JOINT else ""
        return f"{OF_ROBOT[name]}{of}", float(np.abs(apart[k]))

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "robot": self.robot,
            "mass": self.mass,
            "joints": list(self.joints),
            "logs": self.logs,
            "days": self.days if np.isfinite(self.days) else None,
            "information": self.information.tolist(),
            "right": self.right.tolist(),
            "model": self.model,
            "seen": list(self.seen),
        }

    @classmethod
    def from_dict(cls, values: Any) -> Memory:
        """The reverse of `to_dict`. Raises IdentificationError: not the values of a memory."""
        try:
            information, right = (np.array(values[name], dtype=float) for name in ("information", "right"))
            days, joints = values["days"], tuple(map(str, values["joints"]))
            when = float("nan") if days is None else float(days)
            name, mass, logs = str(values["robot"]), float(values["mass"]), int(values["logs"])
            model, seen = str(values.get("model", "")), tuple(map(int, values.get("seen", ())))
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise IdentificationError(f"not a robot's memory: {error!r}") from None
        if information.ndim != 1 or information.shape != right.shape or not np.isfinite([information, right]).all():
            raise IdentificationError("not a robot's memory: its information has another shape or is not finite")
        return cls(name, mass, joints, information, right, logs, when, model, seen)


def _digest(robot: Robot) -> str:
    """Of the joints' terms, the links and the contact points of a model."""
    joints = [joint for leg in robot.legs for joint in leg.joints]
    terms = [(d.armature, d.viscous, d.coulomb, d.offset) for d in (robot.dynamics[joint] for joint in joints)]
    links = [robot.inertias[link].vector for link in robot.tree.links[1:]]
    feet = [leg.foot_position for leg in robot.legs]
    values = np.concatenate([np.ravel(part) for part in (terms, links, feet)])
    return sha256(np.round(values, 9).tobytes()).hexdigest()[:16]


def _places(layout: ErrorLayout) -> Array:
    """Places of `OF_ROBOT` in p."""
    return np.concatenate([np.arange(layout.places[name].start, layout.places[name].stop) for name in OF_ROBOT])
