"""The ten parameters: order and geometry by Pinocchio's account, physics by eigenvalues and point masses."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stadera.errors import ModelError
from stadera.inertia import ORDER, PSEUDO_BASIS, InertialParameters, order_from_pinocchio, skew

SEEDS = st.integers(0, 2**32 - 1)


def cloud(rng: np.random.Generator, points: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """Point masses: (points,) [kg] and where they are, (points, 3) [m]."""
    return rng.uniform(0.05, 2.0, points), rng.uniform(-0.5, 0.5, (points, 3))


def body_of(masses: np.ndarray, where: np.ndarray) -> InertialParameters:
    """The parameters of point masses, summed up one by one: I = Σ m (r·r 1 - r rᵀ)."""
    inertia = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, where, strict=True))
    return InertialParameters.from_moments(masses.sum(), masses @ where, inertia)


def random_body(seed: int) -> InertialParameters:
    return body_of(*cloud(np.random.default_rng(seed)))


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    return pin.Quaternion(*(q := rng.normal(size=4)) / np.linalg.norm(q)).normalized().matrix()


def test_order_is_eq_3() -> None:
    body = InertialParameters(np.arange(1.0, 11.0))
    assert ORDER == ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
    assert body.mass == 1.0
    np.testing.assert_array_equal(body.first_moment, [2, 3, 4])
    np.testing.assert_array_equal(body.inertia, [[5, 6, 7], [6, 8, 9], [7, 9, 10]])
    assert body.to_dict() == dict(zip(ORDER, np.arange(1.0, 11.0), strict=True))


def test_order_against_pinocchio() -> None:
    inertia = pin.Inertia.Random()
    body = InertialParameters.from_pinocchio(inertia)
    # the spatial inertia [[m 1, -m [c]x], [m [c]x, I_origin]] does not depend on any order of ten numbers
    spatial = inertia.matrix()
    assert body.mass == pytest.approx(spatial[0, 0])
    np.testing.assert_allclose(skew(body.first_moment), spatial[3:, :3], atol=1e-14)
    np.testing.assert_allclose(body.inertia, spatial[3:, 3:], atol=1e-14)
    np.testing.assert_allclose(body.to_pinocchio().matrix(), spatial, atol=1e-13)
    np.testing.assert_array_equal(order_from_pinocchio(inertia.toDynamicParameters()), body.vector)
    np.testing.assert_array_equal(order_from_pinocchio(order_from_pinocchio(np.arange(10))), np.arange(10))


def test_skew_is_the_cross_product() -> None:
    a, b = np.random.default_rng(1).normal(size=(2, 3))
    np.testing.assert_allclose(skew(a) @ b, np.cross(a, b))


@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_transforms_are_pinocchios(seed: int) -> None:
    rng = np.random.default_rng(seed)
    body, rotation, translation = random_body(seed), random_rotation(rng), rng.normal(size=3)
    expected = pin.SE3(rotation, translation).act(body.to_pinocchio())
    moved = body.transformed(rotation, translation)
    np.testing.assert_allclose(moved.to_pinocchio().matrix(), expected.matrix(), atol=1e-11)
    back = moved.transformed(rotation.T, -rotation.T @ translation)
    np.testing.assert_allclose(back.vector, body.vector, atol=1e-11)
    np.testing.assert_allclose(
        body.shifted(translation).vector, body.transformed(np.eye(3), translation).vector, atol=1e-13
    )


@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_point_masses(seed: int) -> None:
    """Every moment of a cloud of points, moved as points and moved as a body."""
    rng = np.random.default_rng(seed)
    masses, where = cloud(rng)
    rotation, translation = random_rotation(rng), rng.normal(size=3)
    body = body_of(masses, where)
    homogeneous = np.column_stack((where, np.ones(len(where))))
    np.testing.assert_allclose(body.pseudo_inertia, (homogeneous.T * masses) @ homogeneous, atol=1e-12)
    np.testing.assert_allclose(body.com, masses @ where / masses.sum(), atol=1e-13)
    central = body_of(masses, where - body.com)
    np.testing.assert_allclose(body.inertia_com, central.inertia, atol=1e-12)
    moved = body_of(masses, where @ rotation.T + translation)
    np.testing.assert_allclose(body.transformed(rotation, translation).vector, moved.vector, atol=1e-11)


@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_ways_in_and_out_agree(seed: int) -> None:
    body = random_body(seed)
    for same in (
        InertialParameters.from_com(body.mass, body.com, body.inertia_com),
        InertialParameters.from_moments(body.mass, body.first_moment, body.inertia),
        InertialParameters.from_pseudo_inertia(body.pseudo_inertia),
        InertialParameters.from_pinocchio(body.to_pinocchio()),
    ):
        np.testing.assert_allclose(same.vector, body.vector, atol=1e-12)
    np.testing.assert_allclose(np.tensordot(body.vector, PSEUDO_BASIS, 1), body.pseudo_inertia)


def test_sum_is_the_composite_body() -> None:
    rng = np.random.default_rng(3)
    (m1, r1), (m2, r2) = cloud(rng), cloud(rng)
    first, second = body_of(m1, r1), body_of(m2, r2)
    both = body_of(np.concatenate((m1, m2)), np.concatenate((r1, r2)))
    np.testing.assert_allclose((first + second).vector, both.vector, atol=1e-13)
    np.testing.assert_allclose((both - second).vector, first.vector, atol=1e-13)
    composite = first.to_pinocchio() + second.to_pinocchio()
    np.testing.assert_allclose((first + second).to_pinocchio().matrix(), composite.matrix(), atol=1e-12)
    assert (first + InertialParameters.zero()) == first


@given(SEEDS, st.floats(0.2, 3.0))
@settings(max_examples=100, deadline=None)
def test_physical_is_the_triangle_inequality(seed: int, stretch: float) -> None:
    """Mass above zero and, about the centre of mass, no principal moment above the sum of the others."""
    rng = np.random.default_rng(seed)
    moments = rng.uniform(0.1, 1.0, 3) * [1.0, 1.0, stretch]
    rotation = random_rotation(rng)
    body = InertialParameters.from_com(rng.uniform(0.1, 5.0), rng.normal(size=3), (rotation * moments) @ rotation.T)
    a, b, c = np.sort(moments)
    if abs(a + b - c) > 1e-6:
        assert body.is_physical() == (a + b > c)
        positive = np.linalg.eigvalsh(body.pseudo_inertia).min() > 0
        assert body.is_physical() == positive


@given(SEEDS, st.floats(-4.0, 4.0), st.floats(-4.0, 4.0))
@settings(max_examples=50, deadline=None)
def test_physical_does_not_depend_on_units(seed: int, length: float, mass: float) -> None:
    body = InertialParameters(np.random.default_rng(seed).normal(size=10) + random_body(seed).vector)
    scale = 10.0**mass * 10.0 ** (length * np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2]))
    if abs(np.linalg.eigvalsh(body.pseudo_inertia).min()) > 1e-6:
        assert InertialParameters(body.vector * scale).is_physical() == body.is_physical()


@given(SEEDS)
@settings(max_examples=100, deadline=None)
def test_bodies_without_extent_are_physical(seed: int) -> None:
    """Points, rods and plates lie on the border, wherever they are and however rounding falls."""
    rng = np.random.default_rng(seed)
    for points in (1, 2, 3):
        assert body_of(*cloud(rng, points)).is_physical()
    width, depth = rng.uniform(0.01, 1.0, 2)
    plate = rng.uniform(0.1, 9.0) / 12.0 * np.diag([width**2, depth**2, width**2 + depth**2])
    assert InertialParameters.from_com(1.0, np.zeros(3), plate).is_physical()


def test_impossible_bodies() -> None:
    assert not InertialParameters.from_com(-1.0, np.zeros(3), -np.eye(3)).is_physical()
    assert not InertialParameters.from_com(1.0, np.zeros(3), -1e-6 * np.eye(3)).is_physical()
    assert not InertialParameters.from_moments(1.0, [0.1, 0, 0], np.zeros((3, 3))).is_physical()
    assert not InertialParameters.from_moments(0.0, [0.1, 0, 0], np.eye(3)).is_physical()
    for absurd in (1e300, -1e160):  # products of these have no eigenvalues in floating point
        assert not InertialParameters(np.array([1.0, 0, 0, absurd, 1, absurd, 0, 1, 0, 1])).is_physical()
    assert InertialParameters.zero().is_physical()


def test_massless_bodies() -> None:
    assert np.isnan(InertialParameters.zero().com).all()
    assert InertialParameters.zero().to_pinocchio().mass == 0.0
    moments_only = InertialParameters.from_moments(0.0, [0.1, 0, 0], np.eye(3))
    np.testing.assert_array_equal(moments_only.inertia_com, np.eye(3))
    with pytest.raises(ModelError, match="zero mass"):
        moments_only.to_pinocchio()


def test_bad_vectors_are_named() -> None:
    with pytest.raises(ModelError, match="shape"):
        InertialParameters(np.zeros(9))
    with pytest.raises(ModelError, match="not finite: mcy, Izz"):
        InertialParameters(np.array([1, 0, np.nan, 0, 1, 0, 0, 1, 0, np.inf]))


def test_is_a_value() -> None:
    vector = np.arange(10.0)
    body = InertialParameters(vector)
    vector[0] = 5.0
    assert body.mass == 0.0
    with pytest.raises(ValueError, match="read-only"):
        body.vector[0] = 1.0
    signed = InertialParameters(np.r_[-0.0, np.arange(1.0, 10.0)])
    assert body == signed
    assert hash(body) == hash(signed)
    assert body != "a body"
