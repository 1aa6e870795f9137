"""Rows and friction models refuse what makes no sense, and stack as they say."""

from __future__ import annotations

import numpy as np
import pytest

from body.reference import stack
from stadera.body import FRICTION_TERMS, FRICTION_UNITS, FrictionModel, Rows
from stadera.errors import IdentificationError, UnknownNameError


def test_stack_spreads_columns_by_name() -> None:
    first = Rows(("b",), np.array([[2.0]]), np.array([1.0]), 0.5)
    second = Rows(("c", "a"), np.array([[3.0, 4.0], [5.0, 6.0]]), np.array([7.0, 8.0]), np.array([0.1, 0.2]))
    both = stack([first, second], ("a", "b", "c"))
    np.testing.assert_array_equal(both.matrix, [[0, 2, 0], [4, 0, 3], [6, 0, 5]])
    np.testing.assert_array_equal(both.target, [1, 7, 8])
    np.testing.assert_array_equal(both.std, [0.5, 0.1, 0.2])
    assert len(both) == 3
    np.testing.assert_array_equal(both.predict(np.array([1.0, 10.0, 100.0])), [20, 304, 506])


def test_columns_that_depend_on_others() -> None:
    mixing = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, -1.0]])
    rows = Rows(("a", "b", "c"), np.array([[3.0, 4.0], [5.0, 6.0]]), np.array([7.0, 8.0]), 0.5, mixing)
    np.testing.assert_array_equal(rows.matrix, [[3, 4, 2], [5, 6, 4]])
    np.testing.assert_array_equal(rows.predict(np.array([1.0, 10.0, 100.0])), [243, 465])
    half = rows.replaced(rows.reduced[1:], rows.target[1:])
    np.testing.assert_array_equal(half.matrix, [[5, 6, 4]])
    np.testing.assert_array_equal(stack([rows], ("c", "b", "a")).matrix, [[2, 4, 3], [4, 6, 5]])
    with pytest.raises(IdentificationError, match=r"mixing of shape \(2, 3\)"):
        Rows(("a", "b", "c"), np.zeros((2, 2)), np.zeros(2), mixing=np.zeros((2, 2)))


def test_rows_that_do_not_fit() -> None:
    with pytest.raises(IdentificationError, match=r"matrix of shape \(2, 1\)"):
        Rows(("a",), np.zeros((2, 2)), np.zeros(2))
    for std in (0.0, -1.0, np.nan, np.inf, np.array([1.0, 0.0])):
        with pytest.raises(IdentificationError, match="standard deviation"):
            Rows(("a",), np.zeros((2, 1)), np.zeros(2), std)
    with pytest.raises(IdentificationError, match="standard deviation"):
        Rows(("a",), np.zeros((2, 1)), np.zeros(2), np.ones(3))


def test_friction_model_orders_its_terms() -> None:
    assert FrictionModel(("offset", "armature")).terms == ("armature", "offset")
    assert FrictionModel.full().terms == FRICTION_TERMS == tuple(FRICTION_UNITS)
    assert FrictionModel(("viscous",)).columns("knee") == ("knee.viscous",)


def test_friction_model_refuses() -> None:
    with pytest.raises(UnknownNameError, match="'stribeck'; valid: armature, viscous, coulomb, offset"):
        FrictionModel(("stribeck",))
