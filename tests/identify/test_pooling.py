"""Drives pooled over legs: a weighted mean of the others, as wide as they differ, never a leg's own word for itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identify.leg_runs import hyq
from stadera.body import FrictionModel, JointTorqueRegressor
from stadera.errors import StaderaError
from stadera.identify.prior import Prior, robot_prior
from stadera.identify.solutions import Estimate, KindSpread, null_space_solution, pooled_prior
from stadera.information import Information
from stadera.robot.model import Leg

SPREAD = KindSpread(armature=0.1, viscous=0.2, coulomb=0.5)


def prior_of(leg: Leg, friction: FrictionModel | None = None) -> Prior:
    tree = hyq().leg_tree(leg.name)
    return robot_prior(hyq(), JointTorqueRegressor(tree, friction or FrictionModel.full()).columns)


def found(leg: Leg, values: dict[str, float], std: float = 1e-6) -> Estimate:
    """An estimate of a leg with these joint terms (`0.armature`, by joint from the trunk outwards), so well known."""
    prior = prior_of(leg)
    estimate = null_space_solution(Information.empty(prior.columns), prior)
    numbers, covariance = estimate.values.copy(), np.zeros_like(estimate.covariance)
    for name, value in values.items():
        position, term = name.split(".")
        k = prior.columns.index(f"{leg.joints[int(position)]}.{term}")
        numbers[k], covariance[k, k] = value, std**2
    return replace(estimate, values=numbers, covariance=covariance)


def term(prior: Prior, leg: Leg, position: int, name: str) -> tuple[float, float]:
    k = prior.columns.index(f"{leg.joints[position]}.{name}")
    return float(prior.values[k]), float(prior.scales[k])


def alike(spread: float, std: float = 1e-6) -> list[tuple[Leg, Estimate]]:
    """Three legs, of whose joints of each kind one has the mean rotor inertia and two are off by the spread."""
    return [
        (leg, found(leg, {f"{k}.armature": a * (1.0 + d * spread) for k, a in enumerate((0.05, 0.1, 0.1))}, std))
        for leg, d in zip(hyq().legs[1:], (-1.0, 0.0, 1.0), strict=True)
    ]


def test_centre_is_the_mean_of_the_others() -> None:
    first = hyq().legs[0]
    centre, width = term(pooled_prior(first, prior_of(first), alike(0.1), SPREAD), first, 2, "armature")
    assert centre == pytest.approx(0.10)
    assert width == pytest.approx(0.1 * 0.10 * np.sqrt(1 + 1 / 3), rel=0.2)  # a draw of its own about a mean of three


@pytest.mark.parametrize("spread", [0.1, 0.2, 0.4])
def test_drives_tell_how_alike_they_are(spread: float) -> None:
    first = hyq().legs[0]
    _, width = term(pooled_prior(first, prior_of(first), alike(spread), SPREAD), first, 2, "armature")
    assert width == pytest.approx(spread * 0.10 * np.sqrt(1 + 1 / 3), rel=0.3)


def test_the_one_that_differs_is_not_drawn_to_the_others() -> None:
    first = hyq().legs[0]
    own = [(first, found(first, {f"{k}.armature": 1.6 * a for k, a in enumerate((0.05, 0.1, 0.1))}))]
    prior = prior_of(first)
    centre, width = term(pooled_prior(first, prior, [*own, *alike(0.1)], SPREAD), first, 2, "armature")
    assert centre == pytest.approx(0.10)
    assert width > 2.0 * term(pooled_prior(first, prior, alike(0.1), SPREAD), first, 2, "armature")[1]


def test_errors_of_the_others_are_no_spread() -> None:
    first = hyq().legs[0]
    _, width = term(pooled_prior(first, prior_of(first), alike(0.3, std=0.3 * 0.1), SPREAD), first, 2, "armature")
    _, known = term(pooled_prior(first, prior_of(first), alike(0.3), SPREAD), first, 2, "armature")
    assert width < 0.75 * known


def test_who_knows_better_counts_more() -> None:
    first, *others = hyq().legs
    told = [
        (others[0], found(others[0], {"1.viscous": 1.0}, std=1e-6)),
        (others[1], found(others[1], {"1.viscous": 2.0}, std=50.0)),
    ]
    centre, _ = term(pooled_prior(first, prior_of(first), told, SPREAD), first, 1, "viscous")
    assert centre == pytest.approx(1.0, abs=0.01)


def test_never_wider_than_before_and_never_negative() -> None:
    first, *others = hyq().legs
    prior = prior_of(first)
    told = [(leg, found(leg, {"0.coulomb": -3.0}, std=1e4)) for leg in others]
    pooled = pooled_prior(first, prior, told, SPREAD)
    centre, width = term(pooled, first, 0, "coulomb")
    assert centre == 0.0
    assert width == pytest.approx(term(prior, first, 0, "coulomb")[1])
    assert np.linalg.cond(pooled.root) < np.inf


def test_drives_without_friction_leave_a_prior_that_can_be_used() -> None:
    first, *others = hyq().legs
    told = [(leg, found(leg, {"0.coulomb": 0.0}, std=0.0)) for leg in others]
    centre, width = term(pooled_prior(first, prior_of(first), told, SPREAD), first, 0, "coulomb")
    assert centre == 0.0
    assert width > 0.0


def test_the_rest_of_the_prior_stays() -> None:
    first, *others = hyq().legs
    prior = prior_of(first)
    told = [(leg, found(leg, {"2.armature": 0.1})) for leg in others]
    pooled = pooled_prior(first, prior, told, SPREAD)
    drives = [k for k, c in enumerate(prior.columns) if c.endswith((".armature", ".viscous", ".coulomb"))]
    rest = np.setdiff1d(np.arange(len(prior.columns)), drives)
    np.testing.assert_array_equal(pooled.values[rest], prior.values[rest])
    np.testing.assert_array_equal(pooled.root[rest], prior.root[rest])
    assert pooled.columns == prior.columns


def test_alone_or_without_the_term_it_is_the_prior_itself() -> None:
    first, *others = hyq().legs
    prior = prior_of(first)
    alone = pooled_prior(first, prior, [], SPREAD)
    np.testing.assert_array_equal(alone.values, prior.values)
    np.testing.assert_array_equal(alone.root, prior.root)
    bare = prior_of(first, FrictionModel())
    pooled = pooled_prior(first, bare, [(leg, found(leg, {"2.armature": 0.1})) for leg in others], SPREAD)
    np.testing.assert_array_equal(pooled.values, bare.values)


@pytest.mark.parametrize("name", ["armature", "viscous", "coulomb", "factor"])
def test_spread_is_positive(name: str) -> None:
    with pytest.raises(StaderaError, match=f"spread of '{name}' must be positive"):
        KindSpread(**{name: 0.0})
