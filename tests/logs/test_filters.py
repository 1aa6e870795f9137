"""The low-pass filter and its derivatives against sines, whose derivatives are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stadera.errors import RecordingError
from stadera.logs.filters import apply, kernels, low_pass


def response(kernel: np.ndarray, rate: float, frequency: float) -> complex:
    """The kernel's answer to exp(2πi f t), from its definition as a correlation."""
    half = len(kernel) // 2
    return complex(kernel @ np.exp(2j * np.pi * frequency / rate * np.arange(-half, half + 1)))


designs = {"rate": st.floats(50.0, 5000.0), "share": st.floats(0.002, 0.125)}


@settings(max_examples=40, deadline=None)
@given(**designs)
def test_amplitude_is_down_to_0_707_at_the_cutoff(rate: float, share: float) -> None:
    assert response(low_pass(rate, share * rate), rate, share * rate) == pytest.approx(np.sqrt(0.5), abs=1e-6)


@settings(max_examples=40, deadline=None)
@given(**designs, part=st.floats(0.0, 0.5))
def test_pass_band_is_flat_to_a_thousandth(rate: float, share: float, part: float) -> None:
    assert response(low_pass(rate, share * rate), rate, part * share * rate) == pytest.approx(1.0, abs=1e-3)


@settings(max_examples=40, deadline=None)
@given(**designs, part=st.floats(1.6, 3.9))
def test_stop_band_is_below_a_thousandth(rate: float, share: float, part: float) -> None:
    assert abs(response(low_pass(rate, share * rate), rate, part * share * rate)) < 1e-3


@settings(max_examples=40, deadline=None)
@given(**designs, part=st.floats(0.01, 0.5))
def test_derivatives_of_a_sine_in_the_pass_band(rate: float, share: float, part: float) -> None:
    # real part of the odd kernel's response and imaginary part of the even one's are the phase errors
    omega = 2 * np.pi * part * share * rate
    window = kernels(rate, share * rate)
    value, first, second = (
        response(kernel, rate, part * share * rate) for kernel in (window.value, window.first, window.second)
    )
    assert first == pytest.approx(1j * omega * value, rel=1e-3)
    assert second == pytest.approx(-(omega**2) * value, rel=1e-3)
    assert first / (1j * omega) == pytest.approx(1.0, abs=1.1e-3)
    assert value.imag == pytest.approx(0.0, abs=1e-12)


def test_all_derivatives_go_through_the_same_filter_up_to_the_cutoff() -> None:
    rate, cutoff = 1000.0, 50.0
    window = kernels(rate, cutoff)
    for frequency in (5.0, 30.0, 50.0, 60.0):
        omega, low = 2 * np.pi * frequency, response(window.value, rate, frequency)
        assert response(window.first, rate, frequency) == pytest.approx(1j * omega * low, rel=1e-3)
        assert response(window.second, rate, frequency) == pytest.approx(-(omega**2) * low, rel=1e-3)


def test_differences_without_a_filter_are_exact_for_polynomials_of_degree_eight() -> None:
    time = np.arange(-6, 7) / 10.0
    polynomial = np.polynomial.Polynomial(np.random.default_rng(1).normal(size=9))
    window = kernels(10.0, None)
    inner = time[window.half : -window.half]
    for order, kernel in enumerate((window.value, window.first, window.second)):
        expected = polynomial.deriv(order)(inner) if order else polynomial(inner)
        np.testing.assert_allclose(apply(kernel, polynomial(time)[None])[0], expected, rtol=1e-10, atol=1e-10)


def test_applying_is_numpys_correlation() -> None:
    rng = np.random.default_rng(2)
    kernel, values = rng.normal(size=31), rng.normal(size=(3, 400))
    expected = [np.correlate(row, kernel, mode="valid") for row in values]
    np.testing.assert_allclose(apply(kernel, values), expected, atol=1e-12)


@pytest.mark.parametrize("cutoff", [0.0, -1.0, 125.1, 1e9, float("nan")])
def test_a_cutoff_out_of_range_names_the_range(cutoff: float) -> None:
    with pytest.raises(RecordingError, match="above 0 and at most 125 Hz"):
        kernels(1000.0, cutoff)


@settings(max_examples=40, deadline=None)
@given(**designs, part=st.floats(0.0, 1.0), periods=st.floats(-30.0, 30.0))
def test_the_late_kernel_looks_back_in_time(rate: float, share: float, part: float, periods: float) -> None:
    frequency, delay = part * share * rate, periods / rate
    window = kernels(rate, share * rate, delay=delay)
    expected = response(window.value, rate, frequency) * np.exp(-2j * np.pi * frequency * delay)
    assert response(window.late, rate, frequency) == pytest.approx(expected, abs=1e-3)


def test_without_a_delay_late_is_now() -> None:
    window = kernels(500.0, 10.0)
    np.testing.assert_array_equal(window.late, window.value)
