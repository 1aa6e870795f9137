"""The square-root information holds what dense least squares holds, whichever way it was put together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from body.reference import stack
from stadera.body import Rows
from stadera.errors import IdentificationError, UnknownNameError
from stadera.information import Information, Unknowns

NAMES = ("a", "b", "c", "d")
SEEDS = st.integers(0, 2**32 - 1)


def random_rows(seed: int, count: int = 5, least: int = 0) -> list[Rows]:
    """Sets of rows over some of the columns, in any order, with noise by set or by row; some have no row at all."""
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(count):
        columns = tuple(rng.permutation(NAMES)[: rng.integers(1, 5)].tolist())
        n = int(rng.integers(least, 9))
        std = float(rng.uniform(0.1, 2.0)) if rng.random() < 0.5 else rng.uniform(0.1, 2.0, n)
        out.append(Rows(columns, rng.normal(size=(n, len(columns))), rng.normal(size=n), std))
    return out


def dense(rows: list[Rows]) -> tuple[np.ndarray, np.ndarray]:
    """Whitened matrix and target over all names."""
    whole = stack(rows, NAMES)
    return whole.matrix / whole.std[:, None], whole.target / whole.std


def check(information: Information, A: np.ndarray, b: np.ndarray) -> None:
    """Gram matrix, right-hand side and the sum of squares at two places: all that least squares can ask."""
    R, z = information.R, information.z
    np.testing.assert_allclose(R.T @ R, A.T @ A, atol=1e-9)
    np.testing.assert_allclose(R.T @ z, A.T @ b, atol=1e-9)
    for at in (np.zeros(A.shape[1]), np.linspace(-1.0, 2.0, A.shape[1])):
        expected = np.sum((A @ at - b) ** 2)
        assert information.residual_squared(at) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    np.testing.assert_array_equal(np.tril(R, -1), 0.0)


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_is_the_dense_problem(seed: int) -> None:
    rows = random_rows(seed)
    information = Information.of(rows, NAMES)
    check(information, *dense(rows))
    assert information.count == sum(map(len, rows))


@given(SEEDS, st.integers(0, 5))
@settings(max_examples=60, deadline=None)
def test_merged_halves_are_the_whole(seed: int, at: int) -> None:
    rows = random_rows(seed)
    A, b = dense(rows)
    first, second = Information.of(rows[:at], NAMES), Information.of(rows[at:], NAMES)
    check(first.merge(second), A, b)
    check(second.merge(first), A, b)
    one_by_one = Information.empty(NAMES)
    for r in rows:
        one_by_one = one_by_one.merge(Information.of([r], NAMES))
    check(one_by_one, A, b)
    assert one_by_one.count == len(b)


def test_a_long_stream_is_its_rows() -> None:
    rows = [r for seed in range(40) for r in random_rows(seed)]
    check(Information.of(iter(rows), NAMES), *dense(rows))


@given(SEEDS)
@settings(max_examples=30, deadline=None)
def test_order_of_columns_does_not_matter(seed: int) -> None:
    rows = random_rows(seed, 8, least=4)
    there, turned = Information.of(rows, NAMES), Information.of(rows, NAMES[::-1])
    check(there.merge(turned), *dense([*rows, *rows]))
    if np.linalg.cond(there.R) < 1e6:
        found, again = there.least_squares(), turned.least_squares()
        np.testing.assert_allclose([again[n] for n in NAMES], [found[n] for n in NAMES], rtol=1e-7, atol=1e-9)


def test_merge_of_fewer_parameters() -> None:
    some = Rows(("c", "a"), np.array([[1.0, 2.0], [0.5, 1.0]]), np.array([3.0, 1.0]))
    all_rows = random_rows(1)
    merged = Information.of(all_rows, NAMES).merge(Information.of([some], ("c", "a")))
    check(merged, *dense([*all_rows, some]))


@given(SEEDS, st.floats(0.0, 1.0))
@settings(max_examples=40, deadline=None)
def test_forgetting_is_weighting(seed: int, factor: float) -> None:
    old, new = random_rows(seed), random_rows(seed + 1)
    (A, b), (A2, b2) = dense(old), dense(new)
    weight = np.sqrt(factor)
    remembered = Information.of(old, NAMES).forget(factor).merge(Information.of(new, NAMES))
    check(remembered, np.vstack((weight * A, A2)), np.concatenate((weight * b, b2)))
    assert remembered.count == pytest.approx(factor * len(b) + len(b2))


def test_forgetting_nothing_changes_nothing() -> None:
    information = Information.of(random_rows(0), NAMES)
    same = information.forget(1.0)
    np.testing.assert_array_equal(same.R, information.R)
    np.testing.assert_array_equal(same.z, information.z)
    assert (same.cost, same.count) == (information.cost, information.count)


@given(SEEDS)
@settings(max_examples=40, deadline=None)
def test_fixing_is_eq_6(seed: int) -> None:
    """Y_id φ_id = τ - Y_f φ_f, on the dense rows."""
    rows = random_rows(seed)
    A, b = dense(rows)
    fixed = {"d": 1.7, "b": -0.4}
    check(Information.of(rows, NAMES).fix(fixed), A[:, [0, 2]], b - A[:, 3] * 1.7 + A[:, 1] * 0.4)
    assert Information.of(rows, NAMES).fix(fixed).names == ("a", "c")
    check(Information.of(rows, NAMES).fix({}), A, b)


@given(SEEDS, st.booleans())
@settings(max_examples=40, deadline=None)
def test_marginal_is_the_schur_complement(seed: int, deficient: bool) -> None:
    """What is left when the others take the values that suit best, whether or not these are unique."""
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(12, 4)), rng.normal(size=12)
    if deficient:
        A[:, 3] = 2.0 * A[:, 1]
    information = Information.of([Rows(NAMES, A, b)], NAMES).marginal(("c", "a"))
    keep, away = A[:, [2, 0]], A[:, [1, 3]]
    gram = keep.T @ keep - keep.T @ away @ np.linalg.pinv(away.T @ away) @ away.T @ keep
    np.testing.assert_allclose(information.R.T @ information.R, gram, atol=1e-8)
    for at in (np.zeros(2), np.array([1.0, -2.0])):
        rest = b - keep @ at
        left = rest - away @ np.linalg.lstsq(away, rest, rcond=1e-10)[0]
        assert information.residual_squared(at) == pytest.approx(left @ left, rel=1e-8)
    assert information.names == ("c", "a")


def test_marginal_on_all_and_beside_the_unseen() -> None:
    rows = [Rows(("a", "b"), np.random.default_rng(0).normal(size=(6, 2)), np.arange(6.0))]
    information = Information.of(rows, NAMES)
    check(information.marginal(NAMES), *dense(rows))
    A, b = dense(rows)
    check(information.marginal(("a", "b")), A[:, :2], b)


@given(SEEDS, st.lists(st.integers(-9, 9), min_size=4, max_size=4))
@settings(max_examples=40, deadline=None)
def test_units_of_columns_do_not_matter(seed: int, exponents: list[int]) -> None:
    """Also where the solution is not unique, the one chosen is the same body of numbers in other units."""
    unit = 10.0 ** np.array(exponents)
    A, b = np.random.default_rng(seed).normal(size=(9, 4)), np.arange(9.0)
    A[:, 2] = A[:, 0] - A[:, 1]
    plain = Information.of([Rows(NAMES, A, b)], NAMES).least_squares()
    scaled = Information.of([Rows(NAMES, A * unit, b)], NAMES).least_squares()
    np.testing.assert_allclose([scaled[n] for n in NAMES] * unit, [plain[n] for n in NAMES], rtol=1e-6, atol=1e-8)


def test_recovers_what_made_the_rows() -> None:
    truth, rng = np.array([1.0, -2.0, 3.0, 1e-6]), np.random.default_rng(0)
    A = rng.normal(size=(50, 4)) * [1.0, 1e3, 1e-3, 1e6]
    information = Information.of([Rows(NAMES, A, A @ truth, 0.3)], NAMES)
    np.testing.assert_allclose(list(information.least_squares().values()), truth, rtol=1e-10)
    assert information.residual_squared(truth) < 1e-18 * np.sum((A @ truth / 0.3) ** 2)


def test_noise_found_afterwards() -> None:
    rng = np.random.default_rng(0)
    A, b = rng.normal(size=(9, 4)), rng.normal(size=9)
    later = Information.of([Rows(NAMES, A, b)], NAMES).scaled_noise(0.25)
    check(later, A / 0.25, b / 0.25)
    for std in (0.0, -1.0, np.nan):
        with pytest.raises(IdentificationError, match="noise"):
            later.scaled_noise(std)


def test_column_scales() -> None:
    rows = random_rows(2)
    A, _ = dense(rows)
    np.testing.assert_allclose(Information.of(rows, NAMES).column_scales(), np.linalg.norm(A, axis=0))
    np.testing.assert_array_equal(Information.empty(NAMES).column_scales(), 1.0)


def test_unknown_names() -> None:
    information = Information.of(random_rows(0), NAMES)
    stranger = Rows(("e",), np.ones((1, 1)), np.ones(1))
    for act in (
        lambda: Information.of([stranger], NAMES),
        lambda: information.merge(Information.empty(("e",))),
        lambda: information.fix({"e": 1.0}),
        lambda: information.marginal(("e",)),
    ):
        with pytest.raises(UnknownNameError, match="unknown parameter 'e'; valid: a, b, c, d"):
            act()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("sample", "column"), [(0, 0), (7, 0), (0, 1), (3, 1), (7, 1)])
@pytest.mark.parametrize("samples", [1, 2, 9])
def test_rows_that_are_not_finite(value: float, sample: int, column: int, samples: int) -> None:
    block = np.random.default_rng(0).normal(size=(samples, 2))
    block[min(sample, samples - 1), column] = value
    with pytest.raises(IdentificationError, match="not finite"):
        Information.of([Rows(("a",), block[:, :1], block[:, 1])], NAMES)


def test_refusals() -> None:
    with pytest.raises(IdentificationError, match=r"needs R \(4, 4\)"):
        Information(Unknowns.scalars(NAMES), np.zeros((3, 3)), np.zeros(4), np.zeros((4, 0)))
    for factor in (-0.1, 1.1, np.nan):
        with pytest.raises(IdentificationError, match="between 0 and 1"):
            Information.empty(NAMES).forget(factor)


def test_mixed_columns_say_what_the_whole_matrix_says() -> None:
    rng = np.random.default_rng(4)
    mixing, reduced, b = rng.normal(size=(2, 4)), rng.normal(size=(50, 2)), rng.normal(size=50)
    mixed = Information.of([Rows(NAMES, reduced, b, 0.3, mixing), Rows(NAMES, np.eye(4), np.ones(4))], NAMES)
    whole = Information.of([Rows(NAMES, reduced @ mixing, b, 0.3), Rows(NAMES, np.eye(4), np.ones(4))], NAMES)
    np.testing.assert_allclose(mixed.R.T @ mixed.R, whole.R.T @ whole.R, rtol=1e-12)
    assert mixed.residual_squared(np.ones(4)) == pytest.approx(whole.residual_squared(np.ones(4)))
    assert mixed.count == whole.count == 54


# -- blocks of unknowns, step by step, against the covariance form of the Kalman filter ------------------------------
BLOCKS = Unknowns.of(place=1, motion=2, rest=2)
RNG = np.random.default_rng(0)
MEAN, STD = RNG.standard_normal(5), RNG.uniform(0.5, 2.0, 5)


def some_rows(rows: int = 3, unknowns: int = 5) -> tuple[np.ndarray, np.ndarray]:
    return RNG.standard_normal((rows, unknowns)), RNG.standard_normal(rows)


def prior(mean: np.ndarray = MEAN, std: np.ndarray = STD, considered: int = 0) -> Information:
    return Information(BLOCKS, np.diag(1.0 / std), mean / std, np.zeros((len(mean), considered)))


def kalman(x: np.ndarray, P: np.ndarray, H: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    gain = P @ H.T @ np.linalg.inv(np.eye(len(y)) + H @ P @ H.T)
    return x + gain @ (y - H @ x), P - gain @ H @ P


def test_adding_is_the_kalman_filter() -> None:
    known, x, P = prior(), MEAN, np.diag(STD**2)
    for _ in range(4):
        H, y = some_rows()
        known = known.add(H, y)
        x, P = kalman(x, P, H, y)
    np.testing.assert_allclose(known.mean, x, atol=1e-12)
    np.testing.assert_allclose(known.covariance(), P, atol=1e-12)
    np.testing.assert_allclose(known.covariance("rest"), P[3:, 3:], atol=1e-12)
    assert known.count == 12
    assert known["rest"] == slice(3, 5)


@pytest.mark.parametrize("rows", [1, 3, 20])
def test_any_number_of_rows_at_once(rows: int) -> None:
    H, y = some_rows(rows)
    x, P = kalman(MEAN, np.diag(STD**2), H, y)
    known = prior().add(H, y)
    np.testing.assert_allclose(known.mean, x, atol=1e-12)
    np.testing.assert_allclose(known.covariance(), P, atol=1e-12)


def test_recursive_is_batch() -> None:
    """Row by row, forgetting nothing, from no information at all."""
    H, y = some_rows(12)
    known = Information.empty(BLOCKS)
    for row, target in zip(H, y, strict=True):
        known = known.forget(1.0).add(row[None], np.array([target]))
    check(known, H, y)
    np.testing.assert_allclose(known.mean, np.linalg.lstsq(H, y)[0], rtol=1e-10)


@given(SEEDS, st.sampled_from([("rest",), ("motion", "place"), ("rest", "place")]))
@settings(max_examples=20, deadline=None)
def test_marginal_of_blocks_is_the_dense_formula(seed: int, names: tuple[str, ...]) -> None:
    rng = np.random.default_rng(seed)
    H, y, B = rng.normal(size=(9, 5)), rng.normal(size=9), rng.normal(size=(9, 2))
    known = prior(considered=2).add(H, y, B)
    some, at = known.marginal(names), BLOCKS.index(names)
    np.testing.assert_allclose(some.mean, known.mean[at], atol=1e-9)
    np.testing.assert_allclose(some.covariance(), known.covariance()[np.ix_(at, at)], atol=1e-9)


def sandwich(H: np.ndarray, y: np.ndarray, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimate and covariance of x when rows are H x + B p = y and p is taken for zero, by normal equations."""
    P = np.linalg.inv(H.T @ H)
    off = P @ H.T @ B
    return P @ H.T @ y, P + off @ off.T


def test_considered_errors_do_what_they_do_to_least_squares() -> None:
    known = prior(considered=4)
    rows, errors, targets = [np.diag(1.0 / STD)], [np.zeros((5, 4))], [MEAN / STD]
    for _ in range(3):
        H, y = some_rows(4)
        B = RNG.standard_normal((4, 4))
        known = known.add(H, y, B)
        rows.append(H)
        errors.append(B)
        targets.append(y)
    mean, covariance = sandwich(np.vstack(rows), np.concatenate(targets), np.vstack(errors))
    np.testing.assert_allclose(known.mean, mean, atol=1e-12)
    np.testing.assert_allclose(known.covariance(), covariance, atol=1e-12)


def test_unknowns_become_considered_errors() -> None:
    """The same as rows in which they were considered from the start, whatever their covariance."""
    H, y = some_rows(20)
    B, root = H[:, 1:3], RNG.standard_normal((2, 2))
    known = Information.empty(BLOCKS).add(H, y).consider(root, ("motion",))
    mean, covariance = sandwich(H[:, [0, 3, 4]], y, B @ root)
    assert known.names == ("place", "rest")
    np.testing.assert_allclose(known.mean, mean, atol=1e-12)
    np.testing.assert_allclose(known.covariance(), covariance, atol=1e-12)


def test_merged_halves_are_the_whole_under_the_same_considered_errors() -> None:
    (H, y), B = some_rows(20), RNG.standard_normal((20, 3))
    start = Information.empty(BLOCKS, 3)
    whole = start.add(H, y, B)
    halves = start.add(H[:8], y[:8], B[:8]).merge(start.add(H[8:], y[8:], B[8:]))
    np.testing.assert_allclose(halves.mean, whole.mean, atol=1e-12)
    np.testing.assert_allclose(halves.covariance(), whole.covariance(), atol=1e-12)
    with_prior = whole.merge(prior())
    mean, covariance = sandwich(
        np.vstack([H, np.diag(1.0 / STD)]), np.append(y, MEAN / STD), np.vstack([B, np.zeros((5, 3))])
    )
    np.testing.assert_allclose(with_prior.mean, mean, atol=1e-12)
    np.testing.assert_allclose(with_prior.covariance(), covariance, atol=1e-12)
    with pytest.raises(IdentificationError, match="same considered errors, got 3 and 2"):
        whole.merge(Information.empty(BLOCKS, 2))


@given(SEEDS, st.lists(st.integers(-9, 9), min_size=5, max_size=5))
@settings(max_examples=30, deadline=None)
def test_units_of_unknowns_do_not_matter_to_any_step(seed: int, exponents: list[int]) -> None:
    unit = 10.0 ** np.array(exponents)
    rng = np.random.default_rng(seed)
    H, y, B = rng.normal(size=(9, 5)), rng.normal(size=9), rng.normal(size=(9, 2))

    def found(scale: np.ndarray) -> Information:
        known = prior(MEAN / scale, STD / scale, 2).add(H * scale, y, B)
        return known.marginal(("motion", "place"))

    here, there = found(np.ones(5)), found(unit)
    back = unit[[1, 2, 0]]
    np.testing.assert_allclose(there.mean * back, here.mean, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(there.covariance() * np.outer(back, back), here.covariance(), rtol=1e-6, atol=1e-9)


def test_fixing_blocks_and_bad_layouts() -> None:
    H, y = some_rows(9)
    known = Information.empty(BLOCKS).add(H, y).fix({"rest": np.array([1.0, -2.0]), "place": 0.5})
    check(known, H[:, 1:3], y - H[:, 3:] @ [1.0, -2.0] - 0.5 * H[:, 0])
    with pytest.raises(IdentificationError, match="names of their own"):
        Unknowns(("a", "a"), (1, 2))
    with pytest.raises(IdentificationError, match="as many sizes"):
        Unknowns(("a", "b"), (1,))
    with pytest.raises(IdentificationError, match="do not determine all of: place, motion, rest"):
        _ = Information.empty(BLOCKS).mean
