"""What data can tell: ranks by Pinocchio's regressor, combinations by perturbing what they leave open."""

from __future__ import annotations

import numpy as np
import pytest

from body.reference import leg_regressor as pinocchio_regressor
from identify.leg_runs import hyq, leg_regressor, parameters_of, rich_motion, told
from stadera.body import JointMotion
from stadera.identify.observability import Combination, Identifiability, Observability, observability
from stadera.identify.prior import robot_prior
from stadera.information import Information

UP = np.array([0.0, 0.0, 1.0])


def seen(friction: bool = False, noise: float = 0.0, motion: JointMotion | None = None) -> Observability:
    regressor = leg_regressor(hyq(), friction)
    truth = parameters_of(hyq(), regressor.columns)
    information = told(truth, regressor, noise=noise, motion=motion)
    return observability(information, robot_prior(hyq(), regressor.columns))


def scaled_regressor(motion: JointMotion) -> np.ndarray:
    """Pinocchio's (samples · joints, 30), each column in units of its prior width."""
    tree = hyq().leg_tree("RH")
    return pinocchio_regressor(tree, motion, UP).reshape(-1, 30) * seen().widths


def test_held_leg_has_rank_17_of_30() -> None:
    found = seen()
    assert len(found.columns) == 30
    assert found.rank == 17
    assert np.linalg.matrix_rank(scaled_regressor(rich_motion()), tol=1e-9) == 17


def test_rank_with_friction() -> None:
    """Each joint brings four columns; two of the twelve are not new: the HAA's and the KFE's rotor inertia, say."""
    tree, motion = hyq().leg_tree("RH"), rich_motion()
    dense = pinocchio_regressor(tree, motion, UP)
    columns = []
    for k in range(3):
        q̇, q̈ = motion.velocity[:, k], motion.acceleration[:, k]
        for column in (q̈, q̇, np.tanh(q̇ / 0.03), np.ones(len(q̇))):
            columns.append(np.zeros((len(q̇), 3)))
            columns[-1][:, k] = column
    dense = np.concatenate((dense, np.stack(columns, axis=-1)), axis=-1).reshape(-1, 42)
    dense /= np.where((norm := np.linalg.norm(dense, axis=0)) > 0, norm, 1.0)
    assert np.linalg.matrix_rank(dense, tol=1e-9) == seen(friction=True).rank == 27


def test_row_space_is_pinocchios() -> None:
    found = seen()
    _, s, Vt = np.linalg.svd(scaled_regressor(rich_motion()))
    np.testing.assert_allclose(found.directions[:17].T @ found.directions[:17], Vt[:17].T @ Vt[:17], atol=1e-9)
    np.testing.assert_allclose(found.singular_values[:17] * 1e-9, s[:17], rtol=1e-8)


def test_only_silent_columns_are_unobservable() -> None:
    found = seen()
    silent = np.linalg.norm(scaled_regressor(rich_motion()), axis=0) < 1e-12
    verdicts = np.array(found.verdicts())
    np.testing.assert_array_equal(verdicts == Identifiability.UNOBSERVABLE, silent)
    assert 0 < silent.sum() < 30


def test_observable_is_what_the_null_space_leaves_alone() -> None:
    _, _, Vt = np.linalg.svd(scaled_regressor(rich_motion()))
    untouched = np.linalg.norm(Vt[17:], axis=0) < 1e-9
    found = seen()
    np.testing.assert_array_equal(np.array(found.verdicts()) == Identifiability.OBSERVABLE, untouched)
    assert not any(
        v is Identifiability.OBSERVABLE
        for v, c in zip(found.verdicts(), found.columns, strict=True)
        if c.endswith(".m")
    )


def test_combinations_are_what_the_data_determine() -> None:
    """No change of the parameters along Pinocchio's null space moves them, and there are as many as the rank."""
    found = seen()
    _, _, Vt = np.linalg.svd(scaled_regressor(rich_motion()))
    base = parameters_of(hyq(), found.columns)
    combinations = found.combinations()
    assert len(combinations) == 17
    rng = np.random.default_rng(0)
    for _ in range(5):
        shift = found.widths * (rng.normal(size=13) @ Vt[17:])
        moved = {c: v + d for (c, v), d in zip(base.items(), shift, strict=True)}
        for combination in combinations:
            size = sum(abs(f) * found.widths[found.columns.index(n)] for n, f in combination.terms)
            assert abs(combination.of(moved) - combination.of(base)) < 1e-8 * size
    gradients = np.array([[dict(c.terms).get(n, 0.0) for n in found.columns] for c in combinations])
    assert np.linalg.matrix_rank(gradients * found.widths, tol=1e-9) == 17
    assert set(found.verdicts(gradients)) == {Identifiability.OBSERVABLE}


def test_combinations_read_well() -> None:
    """Each leads with a parameter of its own, in that parameter's unit; an observable parameter stands alone."""
    found = seen()
    combinations = found.combinations()
    leaders = [c.terms[0] for c in combinations]
    assert all(factor == 1.0 for _, factor in leaders)
    assert len({name for name, _ in leaders}) == 17
    assert not any(name.endswith(".m") for name, _ in leaders)
    for c in combinations:
        assert all(name not in {n for n, _ in leaders} for name, _ in c.terms[1:])
    alone = {c.terms[0][0] for c in combinations if len(c.terms) == 1}
    assert alone == {c for c, v in zip(found.columns, found.verdicts(), strict=True) if v is Identifiability.OBSERVABLE}
    assert str(Combination((("a.m", 1.0), ("b.mcx", -0.25), ("c.mcy", 1.0)))) == "a.m - 0.25·b.mcx + c.mcy"


def test_rank_is_that_of_the_units_at_hand() -> None:
    """Mass in tonnes and lengths in millimetres change neither rank nor verdicts."""
    regressor = leg_regressor(hyq())
    prior = robot_prior(hyq(), regressor.columns)
    information = told(parameters_of(hyq(), regressor.columns), regressor)
    unit = np.tile(1e-3 * 1e3 ** np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2.0]), 3)
    from dataclasses import replace

    other = replace(prior, values=prior.values * unit, root=prior.root * unit[:, None])
    there = observability(information, prior)
    again = observability(Information(information.unknowns, information.R / unit, information.z, information.G), other)
    assert again.rank == there.rank
    assert again.verdicts() == there.verdicts()


def test_more_noise_tells_less() -> None:
    ranks = [seen(noise=noise).rank for noise in (1e-6, 1e-2, 1.0, 10.0, 1e4, 1e9)]
    assert ranks == sorted(ranks, reverse=True)
    assert ranks[0] == 17
    assert 0 < ranks[3] < 17
    assert ranks[-1] == 0
    nothing = seen(noise=1e9)
    assert set(nothing.verdicts()) == {Identifiability.UNOBSERVABLE}
    np.testing.assert_allclose(nothing.std(), nothing.widths, rtol=1e-6)
    assert nothing.combinations() == ()


def test_rank_counts_what_is_known_better_than_before() -> None:
    """By the covariances themselves: directions in which data alone are surer than the prior."""
    found = seen(noise=3.0)
    A = scaled_regressor(rich_motion()) / 3.0
    assert found.rank == int(np.sum(np.linalg.eigvalsh(A.T @ A) > 1.0))
    posterior = np.linalg.inv(A.T @ A + np.eye(30))
    np.testing.assert_allclose(found.std(), np.sqrt(np.diag(posterior)) * found.widths, rtol=1e-8)


def test_joints_that_never_move_tell_less() -> None:
    rich = rich_motion()
    still = JointMotion(*(a * np.array([1.0, 0.0, 0.0]) for a in (rich.position, rich.velocity, rich.acceleration)))
    _, s, _ = np.linalg.svd(scaled_regressor(still))
    assert seen(motion=still).rank == int(np.sum(s > 1e-9 * s[0])) < 17


def test_gradients_of_other_quantities() -> None:
    """A centre of mass is not known where its mass is not, unless it lies on the axis."""
    found = seen()
    row = np.zeros((1, 30))
    k = found.columns.index("rh_lowerleg.m")
    row[0, k : k + 2] = [-0.1, 1.0]
    assert found.verdicts(row) == (Identifiability.PARTIAL,)
    row[0, k] = 0.0
    assert found.verdicts(row)[0] is found.verdicts()[k + 1]
    assert found.std(row)[0] == pytest.approx(found.std()[k + 1])


def test_nothing_known() -> None:
    columns = leg_regressor(hyq()).columns
    empty = observability(Information.empty(columns), robot_prior(hyq(), columns))
    assert empty.rank == 0
    assert set(empty.verdicts()) == {Identifiability.UNOBSERVABLE}
    np.testing.assert_allclose(empty.std(), empty.widths)
