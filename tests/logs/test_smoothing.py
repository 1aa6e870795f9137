"""Filtered and thinned rows: the equation holds, chunks give what the whole gives, gaps are not crossed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stadera.errors import RecordingError
from stadera.logs import smooth_rows
from stadera.logs.filters import low_pass

RATE = 500.0


def rows_at(time: np.ndarray) -> np.ndarray:
    return np.random.default_rng(11).normal(size=(len(time), 4))


def gathered(chunks: object) -> tuple[np.ndarray, np.ndarray]:
    times, values = zip(*chunks, strict=True)  # type: ignore[call-overload]
    return np.concatenate(times), np.concatenate(values)


def test_rows_are_numpys_correlation_with_the_low_pass() -> None:
    time = np.arange(2000) / RATE
    rows, kernel = rows_at(time), low_pass(RATE, 20.0)
    at, smooth = gathered(smooth_rows([(time, rows)], RATE, 20.0))
    expected = np.correlate(rows[:, 2], kernel, mode="valid")[::12]  # 500 Hz over twice 20 Hz
    np.testing.assert_allclose(smooth[:, 2], expected, atol=1e-13)
    np.testing.assert_array_equal(at, time[len(kernel) // 2 : len(time) - len(kernel) // 2 : 12])


def test_a_linear_equation_stays_true_and_thinned_noise_is_nearly_white() -> None:
    time = np.arange(60000) / RATE
    rows = rows_at(time)
    theta, noise = np.array([1.0, -2.0, 0.5]), rows[..., 3]
    joint = np.concatenate([rows[..., :3], (rows[..., :3] @ theta)[..., None], noise[..., None]], axis=-1)
    _, smooth = gathered(smooth_rows([(time, joint)], RATE, 10.0))
    np.testing.assert_allclose(smooth[..., :3] @ theta, smooth[..., 3], atol=1e-13)
    residual = smooth[:, 4]
    assert abs(np.corrcoef(residual[1:], residual[:-1])[0, 1]) < 0.1
    assert len(residual) == pytest.approx(len(time) / 25, rel=0.02)


@settings(max_examples=25, deadline=None)
@given(size=st.integers(1, 900), cutoff=st.sampled_from([12.0, 25.0, 60.0]), cut=st.integers(1, 899))
def test_chunks_give_what_the_whole_gives_and_gaps_are_not_crossed(size: int, cutoff: float, cut: int) -> None:
    time = np.arange(900) / RATE
    time[cut:] += 0.1
    rows = rows_at(time)
    chunks = ((time[a : a + size], rows[a : a + size]) for a in range(0, 900, size))
    at, smooth = gathered(smooth_rows(chunks, RATE, cutoff))
    parts = (slice(0, cut), slice(cut, None))
    separate = [part for p in parts for part in smooth_rows([(time[p], rows[p])], RATE, cutoff)]
    expected_at, expected = gathered(separate)
    np.testing.assert_array_equal(at, expected_at)
    np.testing.assert_allclose(smooth, expected, atol=1e-13)


def test_settings_out_of_range_are_named() -> None:
    time = np.arange(100) / RATE
    with pytest.raises(RecordingError, match=r"at most 62\.5 Hz"):
        list(smooth_rows([(time, rows_at(time))], RATE, 100.0))
