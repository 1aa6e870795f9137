"""The trunk's rows against Pinocchio's floating-base dynamics, and their parts against finite differences."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stadera.inertia import InertialParameters
from stadera.legs.base_wrench import BaseWrenchRegressor, LegMotions, cross
from stadera.robot import JointDynamics, Robot, load_robot
from stadera.trunk.wrench import (
    trunk_matrix,
    trunk_signals,
    wrench_of_angular_acceleration,
    wrench_of_specific_force,
)
from walking import Motion, Walk, walked


@cache
def robot() -> Robot:
    plain = load_robot("hyq")
    dynamics = {joint: JointDynamics(0.02, 0.3, 0.5, 0.0) for joint in plain.tree.joints}
    return plain.with_dynamics(dynamics)


@cache
def motion() -> Motion:
    return walked(robot(), Walk(seconds=0.8, rate_hz=100.0, slope=0.2))


def legs_of(regressor: BaseWrenchRegressor, m: Motion) -> LegMotions:
    by_leg = (x[:, regressor.columns] for x in (m.position, m.velocity, m.acceleration))
    return LegMotions(*by_leg, m.angular_velocity.T, m.angular_acceleration.T, m.specific_force.T, m.normal.T)


def matrices(m: Motion) -> np.ndarray:
    signals = trunk_signals(m.specific_force.T, m.angular_velocity.T, m.angular_acceleration.T)
    return np.array([trunk_matrix(s) for s in signals.T])


def test_the_true_trunk_solves_the_rows_of_a_walk_on_a_slope() -> None:
    m, regressor = motion(), BaseWrenchRegressor(robot())
    target = regressor.at(legs_of(regressor, m)).target(m.effort[:, regressor.columns]).sum(axis=2)
    explained = matrices(m) @ robot().inertias[robot().trunk].vector
    np.testing.assert_allclose(explained, target.T, atol=1e-9)


def test_forces_are_those_that_act_and_a_foot_in_the_air_has_none() -> None:
    m, regressor = motion(), BaseWrenchRegressor(robot())
    force = regressor.at(legs_of(regressor, m)).forces(m.effort[:, regressor.columns])
    np.testing.assert_allclose(force.transpose(1, 2, 0), m.force, atol=1e-9)
    in_air = np.linalg.norm(m.force, axis=2) == 0.0
    assert in_air.any()
    assert np.abs(force.transpose(1, 2, 0)[in_air]).max() < 1e-9


def test_a_torque_error_acts_by_the_map_that_is_told() -> None:
    m, regressor = motion(), BaseWrenchRegressor(robot())
    wrenches, effort = regressor.at(legs_of(regressor, m)), m.effort[:, regressor.columns]
    wrong = np.random.default_rng(0).standard_normal((4, 3))
    change = (wrenches.target(effort + wrong) - wrenches.target(effort)).sum(axis=2)
    np.testing.assert_allclose(change, -(wrenches.to_wrench * wrong).sum(axis=(2, 3)), atol=1e-8)


@pytest.mark.parametrize("which", ["specific_force", "angular_acceleration"])
def test_the_trunks_slopes_are_its_matrix_by_finite_differences(which: str) -> None:
    rng = np.random.default_rng(1)
    a, omega, alpha = rng.standard_normal((3, 3, 1))
    trunk = robot().inertias[robot().trunk]
    made = {
        "specific_force": lambda d: trunk_signals(a + d, omega, alpha),
        "angular_acceleration": lambda d: trunk_signals(a, omega, alpha + d),
    }[which]
    slope = np.column_stack(
        [(trunk_matrix((made(e[:, None]) - made(np.zeros((3, 1))))[:, 0])) @ trunk.vector for e in np.eye(3)]
    )
    told = (
        wrench_of_specific_force(trunk.mass, trunk.first_moment)
        if which == "specific_force"
        else wrench_of_angular_acceleration(trunk.first_moment, trunk.inertia)
    )
    np.testing.assert_allclose(slope, told, atol=1e-12)


@pytest.mark.parametrize(("leg", "link"), [(0, 0), (1, 1), (3, 2)])
def test_wrong_links_act_as_told(leg: int, link: int) -> None:
    """One by one, by finite differences of the rows of a robot whose link is heavier or displaced."""
    step, m = 1e-6, motion()
    plain = BaseWrenchRegressor(robot())
    legs, effort = legs_of(plain, m), m.effort[:, plain.columns]
    wrenches = plain.at(legs)
    told = plain.by_links(wrenches, np.eye(30))
    name = robot().legs[leg].links[link]
    body = robot().inertias[name]
    changed = [InertialParameters((1.0 + step) * body.vector), *(body.shifted(step * axis) for axis in np.eye(3))]
    for kind, wrong in enumerate(changed):
        there = BaseWrenchRegressor(robot().with_inertias({**robot().inertias, name: wrong})).at(legs)
        change = (there.target(effort) - wrenches.target(effort)).sum(axis=2)[:, :30] / step
        np.testing.assert_allclose(told[:, :, 12 * kind + 3 * leg + link], change.T, atol=2e-3, rtol=1e-4)


def test_cross_is_the_cross_product() -> None:
    a, b = np.random.default_rng(2).standard_normal((2, 3, 5, 4))
    np.testing.assert_allclose(cross(a, b), np.cross(a, b, axis=0), atol=1e-15)


def test_a_stretched_leg_shows_by_its_volume() -> None:
    regressor = BaseWrenchRegressor(robot())
    position = np.zeros((1, 4, 3))
    still = np.zeros((3, 1))
    up = np.array([[0.0], [0.0], [1.0]])
    flat = regressor.at(LegMotions(position, position, position, still, still, 9.81 * up, up))
    assert np.abs(flat.volume).max() < 1e-3 * regressor.length**3
