"""Sharing a wrench over four feet: the cones hold, the wrench comes out, and the answer is the programme's optimum."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stadera.lab.control.distribution import ForceDistribution
from stadera.lab.plant.terrain import Terrain

LEVERS = np.array([[0.37, 0.2, -0.6], [0.36, -0.22, -0.62], [-0.38, 0.21, -0.59], [-0.37, -0.2, -0.6]])
FRICTION, LEAST, WEIGHT, LENGTH = 0.6, 17.0, 850.0, 0.42


def distribution(smooth: float = 1e-4) -> ForceDistribution:
    return ForceDistribution(LEAST, LENGTH, small=1e-5, smooth=smooth)


def wrench(forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return forces.sum(axis=0), np.cross(LEVERS, forces).sum(axis=0)


def assert_within_cones(forces: np.ndarray, normal: np.ndarray, tolerance: float = 1e-4) -> None:
    along = forces @ normal
    across = np.linalg.norm(forces - np.outer(along, normal), axis=1)
    assert (along >= LEAST - tolerance).all()
    assert (across <= FRICTION * along + tolerance).all()


numbers = st.floats(-1.0, 1.0)


@settings(max_examples=60, deadline=None)
@given(st.tuples(*[numbers] * 6), st.floats(-0.2, 0.2), st.floats(0.0, 3.0))
def test_cones_hold_whatever_is_asked(asked: tuple[float, ...], slope: float, heading: float) -> None:
    normal = Terrain(slope=slope, heading=heading).normal
    sharing = distribution()
    sharing.set_ground(normal)
    force = np.array([0.0, 0.0, WEIGHT]) + WEIGHT * np.array(asked[:3])
    forces = sharing.solve(LEVERS, force, WEIGHT * np.array(asked[3:]))
    assert_within_cones(forces, normal)


@settings(max_examples=60, deadline=None)
@given(st.tuples(*[numbers] * 12))
def test_a_wrench_that_feet_can_make_comes_out(shares: tuple[float, ...]) -> None:
    inside = np.array(shares).reshape(4, 3) * [0.2, 0.2, 0.5] * WEIGHT / 4 + [0.0, 0.0, WEIGHT / 4]
    force, moment = wrench(inside)
    sharing = distribution()
    for _ in range(100):  # until the forces before are these ones
        forces = sharing.solve(LEVERS, force, moment)
    found = wrench(forces)
    np.testing.assert_allclose(found[0], force, atol=1e-3 * WEIGHT)
    np.testing.assert_allclose(found[1], moment, atol=1e-3 * WEIGHT * LENGTH)


@pytest.mark.parametrize("scale", [0.0, 0.2, 0.6])
def test_it_is_the_optimum(scale: float) -> None:
    rng = np.random.default_rng(3)
    normal = Terrain(slope=0.2, heading=1.0).normal
    for _ in range(5):
        force = np.array([0.0, 0.0, WEIGHT]) + scale * WEIGHT * rng.normal(0.0, 1.0, 3)
        moment = scale * WEIGHT * LENGTH * rng.normal(0.0, 1.0, 3)
        sharing = distribution()
        sharing.set_ground(normal)
        forces = sharing.solve(LEVERS, force, moment)

        f = cp.Variable((4, 3))
        made = sum(f[k] for k in range(4))
        turned = sum(np.cross(LEVERS[k], np.eye(3)).T @ f[k] for k in range(4))
        cost = cp.sum_squares(made - force) + cp.sum_squares(turned - moment) / LENGTH**2
        cost += (1e-5 + 1e-4) * cp.sum_squares(f)
        first = np.cross(normal, [1.0, 0.0, 0.0])
        first /= np.linalg.norm(first)
        tangents = np.array([first, np.cross(normal, first)])
        # the constraints turn about the normal with the tangents; take the ones the programme took
        rows = sharing._sides[2:6, :3]
        assert abs(np.abs(rows @ tangents.T).max() - 1.0) < 1.0
        constraints = [f @ normal >= LEAST, f @ rows.T <= 0]
        cp.Problem(cp.Minimize(cost), constraints).solve(solver=cp.CLARABEL)
        np.testing.assert_allclose(forces, f.value, atol=2e-3 * WEIGHT)
        assert np.isclose(_cost(forces, force, moment), _cost(f.value, force, moment), rtol=1e-4, atol=1e-2)


def _cost(forces: np.ndarray, force: np.ndarray, moment: np.ndarray) -> float:
    made, turned = wrench(forces)
    return float(((made - force) ** 2).sum() + ((turned - moment) ** 2).sum() / LENGTH**2 + 1.1e-4 * (forces**2).sum())


def test_a_foot_in_the_air_gets_nothing() -> None:
    sharing = distribution()
    sharing.set_most([np.inf, np.inf, 0.0, np.inf])
    forces = sharing.solve(LEVERS, np.array([0.0, 0.0, WEIGHT]), np.array([60.0, 70.0, 0.0]))
    np.testing.assert_allclose(forces[2], 0.0, atol=1e-3)
    assert_within_cones(forces[[0, 1, 3]], np.array([0.0, 0.0, 1.0]), 1e-3)


def test_smoothing_holds_the_forces_back() -> None:
    level = np.array([0.0, 0.0, WEIGHT])
    steady, free = distribution(smooth=10.0), distribution(smooth=0.0)
    for sharing in (steady, free):
        for _ in range(200):
            before = sharing.solve(LEVERS, level, np.zeros(3))
        after = sharing.solve(LEVERS, level, np.array([80.0, 0.0, 0.0]))
        change = np.abs(after - before).max()
        if sharing is steady:
            held = change
    assert held < 0.5 * change
