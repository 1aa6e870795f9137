"""Rows of a walk, in which contacts change, and their parts against finite differences."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stadera.body import Body
from stadera.body import Motion as BodyMotion
from stadera.body.tree import State
from stadera.inertia import InertialParameters
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


def evaluated(body: Body, m: Motion, columns: bool = False) -> tuple[State, np.ndarray]:
    """State, and wrenches of the contacts."""
    trunk = m.angular_velocity, m.angular_acceleration, m.specific_force
    motion = BodyMotion(m.position, m.velocity, m.acceleration, *trunk, m.normal)
    state = body.at(motion, columns)
    return state, body.contacts(state, body.left(state, motion, m.effort))


def matrices(m: Motion) -> np.ndarray:
    signals = trunk_signals(m.specific_force.T, m.angular_velocity.T, m.angular_acceleration.T)
    return np.array([trunk_matrix(s) for s in signals.T])


def test_the_true_trunk_solves_the_rows_of_a_walk_on_a_slope() -> None:
    body = Body.of(robot())
    target = body.target(*evaluated(body, motion()))
    explained = matrices(motion()) @ robot().inertias[robot().trunk].vector
    np.testing.assert_allclose(explained, target, atol=1e-9)


def test_forces_are_those_that_act_and_a_foot_in_the_air_has_none() -> None:
    m, body = motion(), Body.of(robot())
    force = evaluated(body, m)[1][..., :3]
    np.testing.assert_allclose(force, m.force, atol=1e-9)
    in_air = np.linalg.norm(m.force, axis=2) == 0.0
    assert in_air.any()
    assert np.abs(force[in_air]).max() < 1e-9


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
def test_wrong_links_act_as_their_columns_say(leg: int, link: int) -> None:
    """One by one, by differences of the rows of a robot whose link is heavier or displaced."""
    m, plain, name = motion(), Body.of(robot()), robot().legs[leg].links[link]
    state, contacts = evaluated(plain, m, columns=True)
    at, before, body = robot().tree.links.index(name) - 1, plain.target(state, contacts), robot().inertias[name]
    for wrong in (InertialParameters(1.3 * body.vector), *(body.shifted(0.02 * axis) for axis in np.eye(3))):
        other = Body.of(robot().with_inertias({**robot().inertias, name: wrong}))
        change = other.target(*evaluated(other, m)) - before
        expected = state.columns[:, at] @ (wrong.vector - body.vector)
        np.testing.assert_allclose(expected, change, atol=1e-9 * np.abs(before).max())


def test_a_stretched_leg_shows_by_its_volume() -> None:
    still, rest, up = np.zeros((1, 12)), np.zeros((1, 3)), np.array([0.0, 0.0, 1.0])
    flat = Body.of(robot()).at(BodyMotion(still, still, still, rest, rest, 9.81 * up[None], up))
    assert np.abs(flat.volume).max() < 1e-3 * robot().leg_length ** 3
