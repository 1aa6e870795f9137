"""Identified against simulated: the figures that judge an identification."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.identify.observability import Identifiability, Observability
from stadera.identify.prior import PriorWidth
from stadera.inertia import ORDER
from stadera.lab.experiments.legs import COM_STD, LEG, LegCase
from stadera.lab.experiments.table1 import Recovery, fixed_given


def seen_by(rows: np.ndarray) -> Observability:
    left, singular, directions = np.linalg.svd(np.vstack((1e6 * rows, np.zeros((3 - len(rows), 3)))))
    return Observability(("a", "b", "c"), np.ones(3), singular, directions, left)


def test_what_one_known_parameter_tells_of_the_others() -> None:
    seen = seen_by(np.array([[1.0, 1.0, 0.0]]))  # the data know a + b
    assert fixed_given(seen, ["a"]) == {"b"}
    assert fixed_given(seen, ["c"]) == frozenset()
    seen = seen_by(np.array([[1.0, 1.0, 1.0], [0.0, 0.0, 1.0]]))
    assert fixed_given(seen, ["a"]) == {"b", "c"}
    assert fixed_given(seen, ["c"]) == frozenset()


def test_masses_tell_the_first_moments_that_they_hide(exact: Recovery) -> None:
    """Against the algebra of a leg: all but the moment along an axis, and across two parallel ones, is told."""
    given = {c.name for c in exact.coms if c.verdict is Identifiability.OBSERVABLE}
    hip, upper, lower = exact.leg.leg.links
    assert given == {f"{hip}.cx", f"{upper}.cx", f"{upper}.cy", f"{lower}.cx", f"{lower}.cy"}


def test_observable_values_are_the_simulated_ones(exact: Recovery) -> None:
    assert exact.leg.estimate.observability.rank == len(exact.structure) == 17
    assert exact.worst(exact.parameters) < 1e-6
    assert exact.worst(exact.combinations) < 1e-6
    assert exact.largest_error(exact.coms) < 1e-3
    assert exact.drift == 0.0


def test_errors_are_those_of_the_parameters_themselves(exact: Recovery, runs: LegCase) -> None:
    """Spelled out once more from the bodies, by hand."""
    estimate = exact.leg.estimate
    for link in exact.leg.leg.links:
        found, simulated = estimate.inertia(link).vector, runs.paper_truth.inertias[link].vector
        by_hand = dict(zip(ORDER, zip(simulated, found, strict=True), strict=True))
        for name, (truth, value) in by_hand.items():
            compared = next(c for c in exact.parameters if c.name == f"{link}.{name}")
            assert (compared.truth, compared.value) == (truth, value)
    wrong = replace(estimate, values=estimate.values * (1.0 + 1e-3))
    moved = replace(exact, leg=replace(exact.leg, estimate=wrong))
    assert moved.worst(moved.parameters) == pytest.approx(1e-3, rel=1e-3)
    assert moved.worst(moved.combinations) == pytest.approx(1e-3, rel=1e-3)
    assert moved.drift > 0.0


def test_consistent_solution_recovers_a_possible_leg(possible: Recovery) -> None:
    assert possible.leg.estimate.is_physical
    assert possible.worst(possible.parameters) < 1e-6
    assert possible.worst(possible.combinations) < 1e-6


def test_consistent_solution_of_an_impossible_leg_is_possible_and_predicts_worse(runs: LegCase) -> None:
    """No real body has the simulated moments; then even what noiseless data fix has to give way."""
    log = runs.recorded(runs.paper_truth, runs.motion)
    found = Recovery.of(runs.identified_exact(log, "consistent"), runs.paper_truth)
    assert not all(runs.paper_truth.inertias[link].is_physical() for link in found.leg.leg.links)
    assert found.leg.estimate.is_physical
    assert found.worst(found.combinations) > 1e-3


def test_error_squared_is_one_on_average_where_the_covariance_is_right(runs: LegCase) -> None:
    """Monte Carlo over estimates drawn from the covariance that they state."""
    log = runs.sensed(runs.recorded(runs.physical_truth, runs.motion))
    found = Recovery.of(runs.identified_sensed(log), runs.physical_truth)
    estimate, rng = found.leg.estimate, np.random.default_rng(0)
    truth = [found.true_values.get(name, 0.0) for name in estimate.columns]
    draws = rng.multivariate_normal(truth, estimate.covariance, 400, method="svd")
    nees = [replace(found, leg=replace(found.leg, estimate=replace(estimate, values=v))).nees for v in draws]
    assert np.mean(nees) == pytest.approx(1.0, abs=0.1)
    assert np.mean(np.array(nees) > found.nees_limit()) == pytest.approx(0.025, abs=0.025)
    tighter = replace(estimate, covariance=estimate.covariance / 4.0)
    assert replace(found, leg=replace(found.leg, estimate=tighter)).nees == pytest.approx(4.0 * found.nees)


def test_draws_depend_on_the_seed_alone_and_differ_from_one_another(runs: LegCase) -> None:
    again, other = (replace(runs, seed=seed) for seed in (runs.seed, runs.seed + 1))
    for link in runs.cad.leg(LEG).links:
        assert runs.paper_truth.inertias[link] == again.paper_truth.inertias[link]
        assert runs.paper_truth.inertias[link] != other.paper_truth.inertias[link]
        assert runs.paper_truth.inertias[link] != runs.physical_truth.inertias[link]
        assert runs.paper_truth.inertias[link].mass == runs.cad.inertias[link].mass
    assert not np.array_equal(runs.motion.frequencies, runs.second_motion.frequencies)
    np.testing.assert_array_equal(runs.motion.frequencies, again.motion.frequencies)


def test_cad_is_trusted_no_more_than_the_perturbation_allows(runs: LegCase) -> None:
    """The width covers a displacement of COM_STD across the thinnest link, and is never below the usual one."""
    assert runs.width.shape >= PriorWidth().shape
    thinnest = COM_STD / runs.width.shape
    smallest = min(runs.cad.inertias[link].vector[4:].max() for link in runs.cad.leg(LEG).links)
    assert 0.0 < thinnest < np.sqrt(smallest / 0.5)
