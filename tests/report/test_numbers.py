"""Numbers as text."""

from __future__ import annotations

from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stadera.report.numbers import compared, number, with_scale, with_std
from stadera.report.trust import fit_figure
from stadera.trust import Trust

_EXPONENTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")


def _read(text: str) -> float:
    mantissa, _, power = text.partition("·10")
    return float(Decimal(mantissa.translate(_EXPONENTS)).scaleb(int(power.translate(_EXPONENTS) or 0)))


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [(0.0, 4, "0"), (2.93, 4, "2.930"), (-0.0426, 3, "−0.0426"), (1e-4, 3, "1.00·10⁻⁴"), (9.9999e-5, 3, "1.00·10⁻⁴")],
)
def test_number(value, digits, text):
    assert number(value, digits) == text


@given(st.floats(1e-12, 1e9) | st.floats(-1e9, -1e-12), st.integers(2, 6))
def test_number_keeps_its_digits(value, digits):
    assert _read(number(value, digits)) == pytest.approx(value, rel=0.51 * 10.0 ** (1 - digits))


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.071234, 0.00032, "0.07123 ± 0.00032"),
        (-1.5, 0.11, "−1.50 ± 0.11"),
        (123.0, 20.0, "123 ± 20"),
        (-3.64e-5, 6.1e-5, "(−3.6 ± 6.1)·10⁻⁵"),
        (1.0, 0.0, "1.000"),
    ],
)
def test_with_std(value, std, text):
    assert with_std(value, std) == text


def test_compared():
    assert compared(0.8, 1.0) == "20 % better"
    assert compared(1.1, 1.0) == "10 % worse"
    assert compared(1.1, 1.0, ("below", "above", "the same as")) == "10 % above"
    assert compared(1.001, 1.0) == "the same"
    assert compared(1.0, 0.0) == "none"


def test_with_scale():
    assert with_scale(1.5, 0.11, 0.074) == "1.500 ± 0.074 kg, and ± 5.4 % of it for the torques' scale"
    assert with_scale(0.01, 0.25, 0.249) == "0.01 ± 0.25 kg", "a share of next to nothing says nothing"


def test_a_misfit_that_was_not_evaluated():
    assert fit_figure(Trust("doubtful", float("nan"))) == "not evaluated"
