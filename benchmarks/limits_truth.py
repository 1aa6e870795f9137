"""Simulated logs with the true values of their model errors, and the law they are drawn by, in the order of `PLACES`.

For `benchmarks/limits.py` only: no estimator is given the truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from stadera.body import Body
from stadera.inertia import InertialParameters
from stadera.lab.experiments.reality import RealityCase, case_settings, real_log
from stadera.lab.plant.sensors import STANDARD, effort_limits
from stadera.lab.reality.draw import Range, RealSizes
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.lab.truth import Truth
from stadera.logs import Recording
from stadera.robot import Robot
from stadera.robot.imu import ImuMount
from stadera.robot.kinematics import forward_kinematics
from stadera.trunk.error_model import ErrorLayout, ErrorModel
from stadera.trunk.samples import Samples
from stadera.trunk.settings import ModelErrors
from stadera.types import Array

WITHOUT: Mapping[str, Mapping[str, Any]] = {
    "coulomb": {"coulomb": (1e-9, 2e-9)},
    "noise": {"noise": (0.0, 0.0), "quantised": 0.0},
    "delay": {"delay": (0.0, 0.0)},
}
"""Sizes of errors that a run can be simulated without; noise and constant errors of its sensors are drawn by one."""

_AXES = np.eye(3)
_KINDS = np.tile(_AXES, (4, 1))  # (12, 3): joints of a kind

LAYOUT = ErrorLayout(joints=12, links=12, contacts=4, legs=(3, 3, 3, 3))
PLACES, ERRORS = LAYOUT.places, LAYOUT.count


def true_errors(robot: Robot, drawn: Mapping[str, Any], samples: Samples) -> Array:
    """p (ERRORS,) of a draw; contact points, which turn with the shanks, are averages over the log."""
    p, names = np.zeros(ERRORS), [joint for leg in robot.legs for joint in leg.joints]
    mount = ImuMount.of(robot)

    def by_joint(of: Mapping[str, float]) -> Array:
        return np.array([of[name] for name in names])

    gain = by_joint(drawn["torque_gain"])
    p[PLACES["gain"]] = 1.0 - 1.0 / gain
    p[PLACES["offset"]] = by_joint(drawn["torque_offset"]) / gain
    p[PLACES["encoder"]] = by_joint(drawn["encoder_zero"])
    for place, name in (("rotor", "armature"), ("viscous", "viscous"), ("coulomb", "coulomb")):
        p[PLACES[place]] = [drawn["joints"][j][name] - getattr(robot.dynamics[j], name) for j in names]
    p[PLACES["torque_lag"]] = drawn["delay"]
    p[PLACES["velocity_lag"]] = 0.0 if drawn["quantum"] is None else 0.5 * drawn["differenced"]
    p[PLACES["imu_lever"]] = mount.rotation @ np.array(drawn["imu_place"])
    p[PLACES["imu_rotation"]] = -mount.rotation @ np.array(drawn["imu_rotation"])
    p[PLACES["accelerometer"]] = mount.rotation @ np.array(drawn["accelerometer_offset"])
    links = [link for leg in robot.legs for link in leg.links]
    true = [InertialParameters(np.array(drawn["links"][link])) for link in links]
    p[PLACES["link_mass"]] = [t.mass / robot.inertias[link].mass - 1.0 for t, link in zip(true, links, strict=True)]
    moved = [t.com - robot.inertias[link].com for t, link in zip(true, links, strict=True)]
    p[PLACES["link_com"]] = np.array(moved).T.ravel()
    p[PLACES["contact"]] = _contact(robot, drawn, samples).ravel()
    return p


def _contact(robot: Robot, drawn: Mapping[str, Any], samples: Samples) -> Array:
    """(4, 3) [m], mean displacement of the contact points in trunk axes."""
    turn = forward_kinematics(robot.tree, samples.position)[0]  # (samples, link, 3, 3)
    up = samples.specific_force.mean(axis=0)
    out = np.empty((4, 3))
    for k, leg in enumerate(robot.legs):
        foot = drawn["feet"][leg.name]
        moved = np.array(foot["position"]) - np.array(leg.foot_position)
        foot_turn = turn[:, robot.tree.links.index(leg.links[-1])].mean(axis=0)
        out[k] = foot_turn @ moved - (foot["radius"] - leg.foot_radius) * up / np.linalg.norm(up)
    return out


@dataclass(frozen=True)
class Lacking(SimulateSettings):
    """Settings of a simulation without some kind of error of `WITHOUT`, the others as drawn."""

    without: str = ""

    @property
    def real_sizes(self) -> RealSizes | None:
        """Without that kind."""
        sizes = super().real_sizes
        return None if sizes is None else replace(sizes, **WITHOUT[self.without])


def log_of(
    case: RealityCase, robot: Robot, logs: Path | None, without: str, rate: float | None
) -> tuple[Recording, Truth, RealSizes]:
    """A case's log and truth, and the sizes of its errors.

    Args:
        logs: folder in which logs of the experiment are stored.
        without: kind of error of `WITHOUT` that is not simulated; empty for none. rate: of the log [Hz], None for that
            drawn. Logs with either are not stored.
    """
    how = case_settings(case, robot)
    if without:
        how = Lacking(**vars(how), without=without)
    how = replace(how, rate=rate)
    sizes = how.real_sizes
    assert sizes is not None
    if without or rate:
        run = simulate(robot, case.scenario, how)
        return run.recording, run.truth, sizes
    return *real_log(case, robot, logs), sizes


@dataclass(frozen=True, eq=False)
class Truths:
    """True trunk before the load (10,), load (10,), and model errors (ERRORS,)."""

    trunk: Array
    load: Array
    errors: Array

    @classmethod
    def of(cls, robot: Robot, truth: Truth, samples: Samples) -> Truths:
        """Of a log."""
        assert truth.drawn is not None
        before, after = true_trunks(truth)
        return cls(before, after - before, true_errors(robot, truth.drawn, samples))


@dataclass(frozen=True, eq=False)
class ErrorLaw:
    """p = mean + factor u + sticking v, with u and v of unit covariance.

    Attributes:
        mean: (ERRORS,). factor: (ERRORS, k), of errors that stay the same. sticking: (ERRORS, 12), of static friction.
    """

    mean: Array
    factor: Array
    sticking: Array


def law_of_errors(robot: Robot, sizes: RealSizes, drawn: Mapping[str, Any], errors: Array) -> ErrorLaw:
    """What the test-bed draws p from.

    Sizes that a run draws for itself (its noise, whether its velocities are differenced) count as known, and Coulomb
    friction in p (ERRORS,) as the size of static friction.
    """
    limit = effort_limits(robot)[Body.of(robot).in_legs]
    scaled, mean = STANDARD.times(drawn["noise"]), np.zeros(ERRORS)
    factors: list[Array] = []

    def put(name: str, factor: Array) -> None:
        factors.append(np.zeros((ERRORS, factor.shape[1])))
        factors[-1][PLACES[name]] = factor

    low, high = sizes.rotor
    mean[PLACES["rotor"]] = 0.5 * (low + high) * sizes.rotor_per_limit * limit
    put("rotor", (high - low) / np.sqrt(12.0) * sizes.rotor_per_limit * limit[:, None] * _KINDS)
    for name, drawn_from in (("viscous", sizes.viscous), ("coulomb", sizes.coulomb)):
        middle, square = _log_uniform(drawn_from)
        mean[PLACES[name]] = middle * limit
        own = sizes.alike / np.sqrt(3.0) * np.sqrt(square) * np.diag(limit)
        put(name, np.hstack([np.sqrt(square - middle**2) * limit[:, None] * _KINDS, own]))
    put("offset", scaled.torque_constant * np.diag(limit))
    shared = np.full((12, 12), 1.0 / 12.0)
    put("gain", sizes.joint_gain * (np.eye(12) - shared) + sizes.common_gain * shared * np.sqrt(12.0))
    put("encoder", sizes.encoder_zero * np.eye(12))
    put("contact", sizes.foot * np.hstack([np.eye(12), np.kron(np.eye(4), _AXES[:, 2:])]))  # the point, and the radius
    put("link_mass", sizes.link_mass * np.eye(12))
    put("link_com", sizes.link_com * np.eye(36))
    put("imu_lever", sizes.imu_place / np.sqrt(3.0) * _AXES)
    put("imu_rotation", sizes.imu_rotation / np.sqrt(3.0) * _AXES)
    put("accelerometer", scaled.accelerometer_constant * _AXES)
    low, high = sizes.delay
    mean[PLACES["torque_lag"]] = 0.5 * (low + high)
    put("torque_lag", np.array([[(high - low) / np.sqrt(12.0)]]))
    mean[PLACES["velocity_lag"]] = 0.0 if drawn["quantum"] is None else 0.5 * drawn["differenced"]
    joints = [joint for leg in robot.legs for joint in leg.joints]
    friction = np.abs([robot.dynamics[joint].coulomb for joint in joints]) + errors[PLACES["coulomb"]]
    sticking = np.zeros((ERRORS, 12))
    sticking[PLACES["stiction"]] = ModelErrors.held * np.diag(friction)
    return ErrorLaw(mean, np.hstack(factors), sticking)


def usual_errors(robot: Robot, sizes: RealSizes) -> ErrorLaw:
    """The law that the estimator assumes, of `ModelErrors`; the mean of all gains is zero unless `sizes` draws it."""
    usual = ModelErrors()
    covariance = ErrorModel(robot, usual, robot.leg_length).covariance
    gain, stiction = PLACES["gain"], PLACES["stiction"]
    covariance[gain, gain] -= usual.gain**2 / 12.0
    if sizes.common_gain:
        covariance[gain, gain] += usual.common_gain**2
    sticking = np.zeros((ERRORS, 12))
    sticking[stiction] = np.linalg.cholesky(covariance[stiction, stiction])
    constant = np.setdiff1d(np.arange(ERRORS), np.r_[stiction])
    factor = np.zeros((ERRORS, len(constant)))
    values, vectors = np.linalg.eigh(covariance[np.ix_(constant, constant)])
    factor[constant] = vectors * np.sqrt(np.maximum(values, 0.0))
    return ErrorLaw(np.zeros(ERRORS), factor, sticking)


def _log_uniform(limits: Range) -> tuple[float, float]:
    """Mean and mean square of a log-uniform distribution."""
    low, high = limits
    log = np.log(high / low)
    return (high - low) / log, (high**2 - low**2) / (2.0 * log)


def true_trunks(truth: Truth) -> tuple[Array, Array]:
    """θ (10,) before and after the load."""

    def vector(at: int) -> Array:
        moment = truth.moments[at]
        return np.array([moment.mass, *(moment.mass * np.array(moment.com)), *moment.inertia])

    return vector(0), vector(-1)
