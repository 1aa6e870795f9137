"""The square-root information holds what dense least squares holds, whichever way it was put together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stadera.errors import IdentificationError, UnknownNameError
from stadera.identify.compress import triangularize
from stadera.identify.information import Information
from stadera.regressors import Rows, stack

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
    check(first.add(rows[at:]), A, b)
    one_by_one = Information.empty(NAMES)
    for r in rows:
        one_by_one = one_by_one.add(r)
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
    remembered = Information.of(old, NAMES).forget(factor).add(new)
    check(remembered, np.vstack((weight * A, A2)), np.concatenate((weight * b, b2)))
    assert remembered.count == pytest.approx(factor * len(b) + len(b2))


def test_forgetting_nothing_changes_nothing() -> None:
    information = Information.of(random_rows(0), NAMES)
    same = information.forget(1.0)
    np.testing.assert_array_equal(same.R, information.R)
    np.testing.assert_array_equal(same.z, information.z)
    assert (same.rho_squared, same.count) == (information.rho_squared, information.count)


@given(SEEDS)
@settings(max_examples=40, deadline=None)
def test_fixing_is_eq_6(seed: int) -> None:
    """Y_id φ_id = τ - Y_f φ_f, on the dense rows."""
    rows = random_rows(seed)
    A, b = dense(rows)
    fixed = {"d": 1.7, "b": -0.4}
    check(Information.of(rows, NAMES).fix(fixed), A[:, [0, 2]], b - A[:, 3] * 1.7 + A[:, 1] * 0.4)
    assert Information.of(rows, NAMES).fix(fixed).columns == ("a", "c")
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
    assert information.columns == ("c", "a")


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


@pytest.mark.parametrize("shape", [(0, 3), (1, 3), (2, 3), (3, 3), (40, 3)])
def test_triangle(shape: tuple[int, int]) -> None:
    matrix = np.random.default_rng(0).normal(size=shape)
    triangle = triangularize(matrix)
    np.testing.assert_allclose(triangle.T @ triangle, matrix.T @ matrix, atol=1e-12)


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
        Information(NAMES, np.zeros((3, 3)), np.zeros(4))
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
