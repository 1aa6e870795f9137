"""The prior: coordinates that do not see frames or units, and widths that are what they say."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from identify.leg_runs import hyq, leg_regressor, parameters_of
from stadera.errors import IdentificationError, StaderaError
from stadera.identify.prior import PriorWidth, positive_definite, robot_prior
from stadera.inertia import InertialParameters
from stadera.robot import JointDynamics

LINK = "rh_upperleg"


def random_body(rng: np.random.Generator) -> InertialParameters:
    return InertialParameters.from_pinocchio(
        pin.Inertia.FromLogCholeskyParameters(pin.LogCholeskyParameters(rng.uniform(-0.5, 0.5, 10)))
    )


def distance(body: InertialParameters, change: np.ndarray, width: PriorWidth | None = None) -> float:
    """‖x‖ of a change (10,) of a link's parameters, by that link's prior."""
    robot = hyq().with_inertias({LINK: body})
    prior = robot_prior(robot, tuple(f"{LINK}.{k}" for k in body.to_dict()), width)
    return float(np.linalg.norm(np.linalg.solve(prior.root, change)))


def test_distance_is_the_affine_invariant_metric() -> None:
    """‖x‖ width = sqrt(tr((J0⁻¹ dJ)²)), Lee, Wensing and Park 2019, from the pseudo-inertias alone."""
    rng = np.random.default_rng(0)
    body, change = random_body(rng), rng.normal(size=10)
    ratio = np.linalg.solve(body.pseudo_inertia, InertialParameters(change).pseudo_inertia)
    even = PriorWidth(shape=0.2, mass=0.2)
    assert 0.2 * distance(body, change, even) == pytest.approx(np.sqrt(np.trace(ratio @ ratio)), rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_distance_does_not_depend_on_the_frame_or_units(seed: int) -> None:
    rng = np.random.default_rng(seed)
    body, change = random_body(rng), rng.normal(size=10)
    expected = distance(body, change)
    rotation, translation = pin.Quaternion(rng.normal(size=4)).normalized().matrix(), rng.normal(size=3)
    moved = InertialParameters(change).transformed(rotation, translation)
    assert distance(body.transformed(rotation, translation), moved.vector) == pytest.approx(expected, rel=1e-7)
    unit = 7.0 * 3.0 ** np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
    assert distance(InertialParameters(body.vector * unit), change * unit) == pytest.approx(expected, rel=1e-7)


def test_coordinates_are_those_of_the_deformation() -> None:
    """J = U (1 + D) Uᵀ with U the factor of J0 and D = Σ x_k B_k."""
    columns = leg_regressor(hyq()).columns
    prior = robot_prior(hyq(), columns, PriorWidth(shape=0.3, mass=0.05))
    x = np.random.default_rng(1).normal(0.0, 0.2, len(columns))
    values = prior.values + prior.root @ x
    for link in prior.links:
        J0 = hyq().inertias[link].pseudo_inertia
        U = np.linalg.cholesky(J0[::-1, ::-1])[::-1, ::-1]
        D = np.tensordot(x[prior.block(link)], prior.coordinates[link], axes=1)
        found = InertialParameters(values[prior.block(link)])
        np.testing.assert_allclose(found.pseudo_inertia, U @ (np.eye(4) + D) @ U.T, atol=1e-12)
        relative = found.mass / hyq().inertias[link].mass - 1.0
        assert relative == pytest.approx(D[3, 3])
        assert relative == pytest.approx(0.05 * x[prior.mass_coordinates[link]])


def test_centre_is_the_model() -> None:
    robot = hyq().with_dynamics({j: JointDynamics(0.1, 0.2, 0.3, 0.4) for j in hyq().tree.joints})
    columns = leg_regressor(robot, friction=True).columns
    prior = robot_prior(robot, columns)
    assert dict(zip(columns, prior.values.tolist(), strict=True)) == parameters_of(robot, columns)
    np.testing.assert_allclose(prior.scales, np.sqrt(np.diag(prior.root @ prior.root.T)))
    for link in prior.links:
        assert prior.scales[prior.block(link).start] == pytest.approx(PriorWidth().mass * robot.inertias[link].mass)


def test_joint_widths() -> None:
    columns = leg_regressor(hyq(), friction=True).columns
    prior = robot_prior(hyq(), columns, PriorWidth(torque=0.4, armature=2.0))
    usual = robot_prior(hyq(), columns)
    width, before = dict(zip(columns, prior.scales, strict=True)), dict(zip(columns, usual.scales, strict=True))
    haa, _, kfe = hyq().leg("RH").joints
    assert width[f"{haa}.armature"] == pytest.approx(2.0 * before[f"{haa}.armature"])
    for term in ("viscous", "coulomb", "offset"):
        assert width[f"{haa}.{term}"] == pytest.approx(2.0 * before[f"{haa}.{term}"])
        assert width[f"{kfe}.{term}"] == pytest.approx(width[f"{haa}.{term}"])
    # a quarter of the weight at a leg's length: HyQ's is 0.08 + 0.35 + some 0.1 m of shank to its centre of mass
    assert 0.4 * hyq().mass * 9.81 / 4 * np.array([0.4, 0.8]) == pytest.approx(width[f"{haa}.offset"], rel=0.5)


def test_bodies_without_extent_get_some() -> None:
    for moments in ([0, 0, 0], [1, 1, 0], [1, 2, 3], [1, 1, 5]):
        body = InertialParameters.from_com(2.0, [0.1, -0.2, 0.3], np.diag(moments) * 0.01)
        lifted = positive_definite(body)
        assert lifted.mass == body.mass
        np.testing.assert_allclose(lifted.com, body.com, atol=1e-15)
        assert np.linalg.eigvalsh(lifted.pseudo_inertia).min() > 0
        assert lifted.is_physical()
        robot_prior(hyq().with_inertias({LINK: body}), tuple(f"{LINK}.{k}" for k in body.to_dict()))
    usual = hyq().inertias[LINK]
    assert positive_definite(usual) is usual


def test_refusals() -> None:
    columns = leg_regressor(hyq()).columns
    with pytest.raises(IdentificationError, match="all ten parameters of link"):
        robot_prior(hyq(), columns[:9])
    with pytest.raises(IdentificationError, match=r"no prior for parameter 'wheel\.m'"):
        robot_prior(hyq(), ("wheel.m",))
    for name in ("shape", "mass", "torque", "armature"):
        with pytest.raises(StaderaError, match=f"prior width '{name}' must be positive"):
            PriorWidth(**{name: 0.0})
