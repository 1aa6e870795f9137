"""Static poses: means of similar samples, and the least-squares problems that they form.

Every pose gives the equations of `standing.equilibrium`, linear in mass and first moment of the trunk, θ, and in the
constant errors n (torque offsets, feet, vertical, the legs' masses). The same matrix multiplies the trunk and a payload
on it, so a tare and a load form one problem with the same errors::

    A_p θ_trunk + B_p n = b_p  (tare),        A_q (θ_trunk + θ_payload) + B_q n = b_q  (loaded)

The errors n are either unknowns with a prior of covariance C, or considered: set to zero, with their covariance added
to the estimate's (`stadera.information`). Either way, effects common to tare and load cancel in the payload. A weak
prior, the plausible box of the centre of mass, covers the components that no pose shows.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from stadera.constants import GRAVITY
from stadera.errors import IdentificationError, ModelError
from stadera.information import Information, Unknowns
from stadera.trunk.load import Payload
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkBounds
from stadera.trunk.standing.equilibrium import ConstantErrors, constant_errors_of, equilibrium_rows
from stadera.trunk.standing.forces import ContactForceEstimator
from stadera.types import Array


@dataclass(frozen=True)
class Alike:
    """Largest difference between a sample and the mean of its pose.

    Attributes:
        joint: of any joint [rad].
        tilt: of the vertical [rad]; ignored if the vertical comes from the feet's forces, whose noise exceeds the tilt
            between poses.
    """

    joint: float = 0.02
    tilt: float = 0.01

    def __post_init__(self) -> None:
        if not (self.joint > 0 and self.tilt > 0):
            raise ModelError(f"samples of a pose need positive tolerances, got {self.joint} rad, {self.tilt} rad")


class PoseMean:
    """Running mean of similar samples, of which there are `count`."""

    def __init__(self, first: Measurement) -> None:
        self._first, self._mean = first, {name: value.copy() for name, value in _averaged(first).items()}
        self._foot_squares, self._effort_squares = 0.0, np.zeros((len(first.effort), len(first.effort)))
        self.count = 1

    def takes(self, m: Measurement, alike: Alike) -> bool:
        """Adds a sample if it is similar and the same legs are in stance; returns whether it was added."""
        values, k = _averaged(m), len(m.extra) // 3
        if _meant(m) != _meant(self._first) or values.keys() != self._mean.keys():
            return False
        away = {name: value - self._mean[name] for name, value in values.items()}
        joints = np.append(away["joint_position"], away["extra"][:k])
        if float(np.abs(joints).max()) > alike.joint:
            return False
        if not m.vertical_by_forces and float(np.abs(away["up"]).max()) > alike.tilt:
            return False
        self.count += 1
        share = 1.0 / self.count
        for name, value in away.items():
            self._mean[name] += share * value
        self._effort_squares += (1.0 - share) * np.outer(away["effort"], away["effort"])
        if "foot_position" in away:
            self._foot_squares += (1.0 - share) * float((away["foot_position"] ** 2).sum())
        return True

    @property
    def effort_covariance(self) -> Array:
        """Covariance (n, n) of the mean efforts [N²·m²] from their scatter; 0 for a single sample."""
        return np.asarray(self._effort_squares / (max(self.count - 1, 1) * self.count))

    @property
    def foot_variance(self) -> float:
        """Variance of each component of the feet's mean positions [m²] from their scatter; 0 if not measured."""
        values = self._mean["foot_position"].size if "foot_position" in self._mean else 1
        return self._foot_squares / (values * max(self.count - 1, 1) * self.count)

    @property
    def measurement(self) -> Measurement:
        """The mean, as a measurement at rest."""
        mean: dict[str, Any] = {name: value.copy() for name, value in self._mean.items()}
        up, still = mean.pop("up"), np.zeros_like(mean["effort"])
        force = GRAVITY * up / np.linalg.norm(up)
        at_rest: dict[str, Any] = {"joint_velocity": still, "angular_velocity": np.zeros(3), "rotation": None}
        return replace(self._first, specific_force=force, **mean, **at_rest)


def _averaged(m: Measurement) -> dict[str, Array]:
    """What is averaged over a pose."""
    values = {"joint_position": m.joint_position, "effort": m.effort, "up": m.up, "extra": m.extra}
    return values if m.foot_position is None else values | {"foot_position": m.foot_position}


def gather(poses: list[PoseMean], m: Measurement, alike: Alike, most: int) -> None:
    """Adds a sample at rest to the last of some poses, or as a new one; only the latest `most` are kept."""
    if not (poses and poses[-1].takes(m, alike)):
        poses.append(PoseMean(m))
        del poses[:-most]


def _meant(m: Measurement) -> list[bool]:
    """Legs meant to be in stance; none are known, none are named."""
    return [] if m.stance is None else m.stance.tolist()


# -- the least-squares problem ---------------------------------------------------------------------------------------


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
        known: on trunk and errors, and with a payload on that and the torques of static friction without and with it,
            `held` and `held_loaded`.
        forces: estimator of contact forces, with the noise that weights the rows.
        errors: (k,), values of n at which the equations are linearised; None for zero.
        loaded: True if the trunk carries the payload in these poses.
    """
    places, held = constant_errors_of(forces.robot), "held_loaded" if loaded else "held"
    at = np.zeros(len(places)) if errors is None else errors
    for pose in poses:
        rows, target = equilibrium_rows(
            forces, pose.measurement, pose.count, at, pose.foot_variance, pose.effort_covariance
        )
        matrix = np.zeros((len(rows), len(known)))
        matrix[:, known["trunk"]], matrix[:, known["errors"]] = rows[:, :4], rows[:, 4:]
        if loaded:
            matrix[:, known["payload"]] = rows[:, :4]
        if held in known.names:
            matrix[:, known[held]] = rows[:, 4:][:, places["torque"]]
        known = known.add(matrix, target)
    return known


def with_box(known: Information, body: str, bounds: TrunkBounds, mass: float, com: Array | None = None) -> Information:
    """Adds the weak prior on the first moment of a body of about this mass [kg]: com (3,) [m], None for the box's
    middle, as wide as the box.
    """
    com = 0.5 * (np.asarray(bounds.low) + np.asarray(bounds.high)) if com is None else com
    place, scale = known[body], 1.0 / (mass * bounds.spread[1:])
    matrix = np.zeros((3, len(known)))
    matrix[:, place.start] = -com * scale
    matrix[:, place.start + 1 : place.stop] = np.diag(scale)
    return known.add(matrix, np.zeros(3))


# -- the payload, by difference ---------------------------------------------------------------------------------------


def payload_between(
    tare: Sequence[PoseMean],
    loaded: Sequence[PoseMean],
    forces: ContactForceEstimator,
    errors: ConstantErrors,
    least: float = 1e-3,
    observed: float = 0.5,
) -> Payload:
    """Mass and centre of mass that the `loaded` poses carry in addition to the tare's.

    Args:
        least: unit of the first moment if there is hardly a payload, as a share of the robot's mass [1].
        observed: share of the plausible range's standard deviation below which a payload's place counts as observed
            [1]: a few centimetres help.

    Raises:
        IdentificationError: there is no pose on one side.
    """
    for poses, which in ((tare, "the tare"), (loaded, "the load")):
        if not poses:
            raise IdentificationError(f"no pose at rest to weigh {which} by")
    bounds = TrunkBounds.of(forces.robot)
    known = _gathered(tare, loaded, forces)
    root = _root(block_diag(errors.lasting, errors.sticking, errors.sticking))

    def solved(mass: float) -> Information:
        return with_box(known, "payload", bounds, mass).consider(root, ("errors", "held", "held_loaded"))

    # the payload's first moment in units of its mass, which the vertical forces determine well
    rough = solved(1.0)
    found = solved(max(abs(float(rough.mean[rough["payload"]][0])), least * forces.robot.mass))
    moments, covariance = found.mean[found["payload"]], found.covariance("payload")
    return Payload.of_moments(moments, covariance, observed * bounds.spread[1:])


def sized_by_poses(
    tare: Sequence[PoseMean],
    loaded: Sequence[PoseMean],
    forces: ContactForceEstimator,
    errors: ConstantErrors,
    spread: float = 1.0,
) -> ConstantErrors:
    """The constant errors with the sizes that the longest pose of each side shows; the tare may be empty.

    Six equations of a pose determine four parameters and leave the rest: forces that do not add up to a vertical one
    show offsets and friction, and if they do so otherwise under a load, friction. With everything else eliminated,
    z = R n remains of the errors n = (s L u, t H v), u, v ~ N(0, 1), and unit noise, so

        z ~ N(0, 1 + s² R L Lᵀ Rᵀ + t² R H Hᵀ Rᵀ)

    and s and t are the roots of the means of s² and t² given z. Static friction is never taken to be smaller than
    usual: if all knees hold alike, no equation shows it.

    Args:
        spread: standard deviation of ln s and ln t before any pose; s² and t² have mean one. Friction of drives differs
            between robots by a factor of seven (95 %).
    """
    widest, count = 3.5, 29  # standard deviations of ln s and number of its values, in sums over it
    before, after = ([max(p, key=lambda pose: pose.count)] if p else [] for p in (tare, loaded))
    known = with_box(_gathered(before, after, forces), "payload", TrunkBounds.of(forces.robot), forces.robot.mass)
    left = known.marginal(("errors", "held", "held_loaded"))
    k = len(errors.places)
    lasting = left.R[:, :k] @ _root(errors.lasting)
    held = left.R[:, k:] @ _root(block_diag(errors.sticking, errors.sticking))
    U, size, _ = np.linalg.svd(np.hstack([lasting, held]), full_matrices=False)
    U = U[:, size > 1e-6 * size[0]]
    z, M, N = U.T @ left.z, *(U.T @ x @ x.T @ U for x in (lasting, held))
    tried = np.linspace(-widest * spread, widest * spread, count)
    square = np.exp(2.0 * (tried - spread**2))
    C = np.eye(len(z)) + square[:, None, None, None] * M + square[:, None, None] * N
    value, vector = np.linalg.eigh(C)
    cost = ((vector.swapaxes(-1, -2) @ z) ** 2 / value + np.log(value)).sum(axis=-1)
    cost += (tried[:, None] ** 2 + tried**2) / spread**2
    weight = np.exp(-0.5 * (cost - cost.min()))
    weight /= weight.sum()
    s, t = np.sqrt(weight.sum(axis=1) @ square), np.sqrt(weight.sum(axis=0) @ square)
    return errors.scaled(float(s), max(float(t), 1.0))


def _gathered(tare: Sequence[PoseMean], loaded: Sequence[PoseMean], forces: ContactForceEstimator) -> Information:
    """The poses of both sides, on the trunk, the payload and the errors."""
    robot, places, joints = forces.robot, constant_errors_of(forces.robot), len(forces.body.in_legs)
    sizes = Unknowns.of(trunk=4, payload=4, errors=len(places), held=joints, held_loaded=joints)
    bounds, mass = TrunkBounds.of(robot), robot.inertias[robot.trunk].mass
    known = with_box(Information.empty(sizes), "trunk", bounds, mass)
    return with_poses(with_poses(known, forces, tare), forces, loaded, loaded=True)


def _root(covariance: Array) -> Array:
    value, vector = np.linalg.eigh(covariance)
    return np.asarray(vector * np.sqrt(np.maximum(value, 0.0)))
