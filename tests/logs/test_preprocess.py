"""Preprocessing: known motions come out right, chunks give what the whole gives, nothing is lost unreported."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stadera.errors import RecordingError, UnknownNameError
from stadera.logs import (
    Preprocessing,
    Processed,
    Recording,
    preprocess,
    preprocess_stream,
    read,
    suggest_cutoff,
    take,
)
from stadera.logs.filters import highest_cutoff

RATE = 500.0
JOINTS = ("LF_HAA", "LF_HFE", "LF_KFE")
FREQUENCIES = np.array([0.4, 0.9, 1.7])
SIGNALS = ("time", "position", "velocity", "acceleration", "effort")


def motion(time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Three sines and their first two derivatives, (samples, 3)."""
    omega, angle = 2 * np.pi * FREQUENCIES, 2 * np.pi * np.outer(time, FREQUENCIES)
    return 0.5 + np.sin(angle), omega * np.cos(angle), -(omega**2) * np.sin(angle)


def recording_at(time: np.ndarray, *, noise: float = 0.0, recorded: bool = False) -> Recording:
    rng = np.random.default_rng(3)
    q, dq, ddq = motion(time)
    position = q + noise * rng.normal(size=q.shape)
    effort = 2.0 * ddq + 0.3 * dq + noise * rng.normal(size=q.shape)
    return Recording(time, JOINTS, position, dq if recorded else None, ddq if recorded else None, effort)


def even(samples: int) -> np.ndarray:
    return 3.0 + np.arange(samples) / RATE


def uneven(samples: int) -> np.ndarray:
    return 3.0 + (np.arange(samples) + np.random.default_rng(5).uniform(-0.3, 0.3, samples)) / RATE


def joined(parts: list[Processed], name: str) -> np.ndarray:
    return np.concatenate([getattr(part, name) for part in parts])


def chunked(recording: Recording, rows: int) -> Iterator[Recording]:
    for first in range(0, len(recording), rows):
        yield take(recording, slice(first, first + rows))


def test_derivatives_of_positions_are_those_of_the_motion() -> None:
    result = preprocess(recording_at(even(3000)), Preprocessing(cutoff_hz=10.0))
    q, dq, ddq = motion(result.time)
    np.testing.assert_allclose(result.position, q, atol=1e-3)
    np.testing.assert_allclose(result.velocity, dq, atol=1e-3 * np.abs(dq).max())
    np.testing.assert_allclose(result.acceleration, ddq, atol=1e-3 * np.abs(ddq).max())
    assert result.effort is not None
    np.testing.assert_allclose(result.effort, 2 * ddq + 0.3 * dq, atol=2e-3 * np.abs(ddq).max())


def test_a_linear_law_between_noisy_signals_survives_filtering() -> None:
    # the effort is linear in the recorded, noisy motion, so it is in the filtered one, to the differences' accuracy
    noisy = recording_at(even(3000), noise=1e-3)
    result = preprocess(replace(noisy, effort=3.0 * noisy.position), Preprocessing(cutoff_hz=20.0))
    assert result.effort is not None
    np.testing.assert_allclose(result.effort, 3.0 * result.position, atol=1e-12)
    slopes = np.gradient(result.position, result.time, axis=0)
    assert np.abs(result.velocity - slopes)[5:-5].max() < 0.02 * np.abs(slopes).max()


def test_without_a_cutoff_recorded_derivatives_are_taken_as_they_are() -> None:
    recording = recording_at(even(500), recorded=True)
    result = preprocess(recording, Preprocessing(cutoff_hz=None))
    for name in SIGNALS:
        np.testing.assert_array_equal(getattr(result, name), getattr(recording, name))
    assert result.notes == ("not filtered", "500 of 500 samples at 500 Hz are left")


def test_without_a_cutoff_missing_derivatives_are_differences() -> None:
    full = recording_at(even(500), recorded=True)
    for missing in ({"acceleration": None}, {"velocity": None, "acceleration": None}):
        result = preprocess(replace(full, **missing), Preprocessing(cutoff_hz=None))
        _, dq, ddq = motion(result.time)
        np.testing.assert_allclose(result.velocity, dq, rtol=0, atol=1e-9)
        np.testing.assert_allclose(result.acceleration, ddq, rtol=0, atol=1e-7)
        assert result.report.samples_out == 492


def test_effort_is_moved_to_when_it_acts() -> None:
    time, delay = even(3000), 0.0137
    recording = replace(recording_at(time), effort=motion(time + delay)[0])  # commanded early
    for cutoff in (None, 10.0):
        result = preprocess(recording, Preprocessing(cutoff, effort_delay=delay))
        assert result.effort is not None
        np.testing.assert_allclose(result.effort, motion(result.time)[0], atol=1e-3)
        assert "moved the effort by +13.7 ms" in result.notes


def test_joints_are_chosen_and_ordered() -> None:
    recording = recording_at(even(3000))
    chosen = preprocess(recording, Preprocessing(10.0), ("LF_KFE", "LF_HAA"))
    everything = preprocess(recording, Preprocessing(10.0))
    np.testing.assert_array_equal(chosen.acceleration, everything.acceleration[:, [2, 0]])
    with pytest.raises(UnknownNameError, match="valid: LF_HAA, LF_HFE, LF_KFE"):
        preprocess(recording, Preprocessing(10.0), ("RF_HAA",))


@pytest.mark.parametrize("cutoff", [None, 15.0])
@pytest.mark.parametrize("stamps", [even, uneven])
@pytest.mark.parametrize("rows", [17, 61, 1000, 4096, 9999])
def test_chunks_give_what_the_whole_gives(cutoff: float | None, stamps, rows: int) -> None:  # type: ignore[no-untyped-def]
    time = stamps(6000)
    time[2500:] += 0.4
    time[5100:] += 1.0
    recording, settings = recording_at(time, noise=1e-3), Preprocessing(cutoff)
    whole, parts = preprocess(recording, settings), list(preprocess_stream(chunked(recording, rows), settings))
    for name in SIGNALS:
        a, b = joined(parts, name), getattr(whole, name)
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * np.abs(b).max(), err_msg=name)
    assert parts[-1].report == whole.report
    assert parts[-1].notes == whole.notes
    assert whole.report.segments == 3
    assert whole.report.resampled == (stamps is uneven)


def test_nothing_is_filtered_across_a_gap() -> None:
    time = even(4000)
    time[2000:] += 2.0
    recording, settings = recording_at(time, noise=1e-3), Preprocessing(10.0)
    first, second = (preprocess(take(recording, part), settings) for part in (slice(0, 2000), slice(2000, None)))
    whole = preprocess(recording, settings)
    for name in SIGNALS:
        expected = np.concatenate([getattr(first, name), getattr(second, name)])
        np.testing.assert_allclose(getattr(whole, name), expected, atol=1e-10 * np.abs(expected).max())
    assert "split at 1 gap into 2 segments" in whole.notes


def test_segments_too_short_for_the_filter_are_dropped_and_reported() -> None:
    time = even(4000)
    time[2000:] += 2.0
    time[2050:] += 2.0
    report = preprocess(recording_at(time), Preprocessing(10.0)).report
    assert (report.segments, report.short_segments) == (3, 1)
    assert report.samples_out == 4000 - 50 - 2 * 2 * (report.window // 2)
    assert any("dropped 1 segment shorter than the" in note for note in report.notes)


def test_uneven_stamps_are_resampled_and_the_motion_is_right() -> None:
    result = preprocess(recording_at(uneven(5000)), Preprocessing(10.0))
    assert result.report.resampled
    assert result.notes[0].startswith("resampled uneven time stamps to 500")
    q, dq, ddq = motion(result.time)
    np.testing.assert_allclose(result.position, q, atol=1e-3)
    np.testing.assert_allclose(result.velocity, dq, atol=2e-3 * np.abs(dq).max())
    np.testing.assert_allclose(result.acceleration, ddq, atol=2e-3 * np.abs(ddq).max())
    steps = np.diff(result.time)
    np.testing.assert_allclose(steps[steps < 1.5 * steps.min()], 1 / result.report.rate_hz, rtol=1e-9)


def test_interpolation_is_third_order_and_beats_straight_lines() -> None:
    time = uneven(4000)
    recording = recording_at(time)
    result = preprocess(recording, Preprocessing(None))
    error = np.abs(result.position - motion(result.time)[0]).max()
    straight = np.stack([np.interp(result.time, time, recording.position[:, j]) for j in range(3)], axis=1)
    assert error < 0.05 * np.abs(straight - motion(result.time)[0]).max()


def test_a_log_of_coarse_stamps_has_its_mean_rate() -> None:
    time = np.round(np.arange(3000) / 300.0, 3)  # steps of 3 and 4 ms
    report = preprocess(recording_at(time), Preprocessing(10.0)).report
    assert report.resampled
    assert report.rate_hz == pytest.approx(300.0, rel=1e-3)


def test_a_log_shorter_than_the_filter_says_how_long_it_must_be() -> None:
    with pytest.raises(RecordingError, match=r"too few samples: 100 in 1 stretch .* 227 samples \(0.454 s\)"):
        preprocess(recording_at(even(100)), Preprocessing(10.0))
    with pytest.raises(RecordingError, match="too few samples"):
        preprocess(recording_at(even(1)), Preprocessing(None))
    with pytest.raises(RecordingError, match="too few samples"):
        list(preprocess_stream([], Preprocessing(None)))


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"cutoff_hz": 0.0}, "above 0 Hz"),
        ({"cutoff_hz": float("inf")}, "above 0 Hz"),
        ({"effort_delay": 1.0}, "within 0.2 s"),
    ],
)
def test_settings_are_validated_where_made(setting: dict, message: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(RecordingError, match=message):
        Preprocessing(**{"cutoff_hz": 10.0, **setting})


def test_the_suggested_cutoff_lets_the_motion_pass_and_not_the_noise() -> None:
    quiet = suggest_cutoff(recording_at(even(10000), noise=1e-5))
    loud = suggest_cutoff(recording_at(even(10000), noise=1e-3))
    assert quiet == loud == 5.0  # the motion ends at 1.7 Hz
    time = even(10000)
    fast = Recording(time, ("a",), np.sin(2 * np.pi * 8.0 * time)[:, None] + 1e-4 * motion(time)[0][:, :1])
    cutoff = suggest_cutoff(fast)
    assert cutoff == pytest.approx(16.0, abs=1.0)
    assert suggest_cutoff(recording_at(even(1000), recorded=True)) is None
    assert suggest_cutoff(Recording(time, ("a",), np.zeros((len(time), 1)))) == 5.0


@pytest.mark.parametrize("every", [0.7, 1.5, 4.0])
def test_few_averaged_spectra_do_not_take_noise_for_motion(every: float) -> None:
    """A log at 1 kHz that loses a sample now and then: one spectrum of a short stretch scatters far above its floor."""
    time = np.arange(20_000) / 1000.0
    lost = np.isin(np.arange(len(time)) % round(1000.0 * every), (0, 1, 2))
    for seed in range(5):
        white = 1e-3 * np.random.default_rng(seed).standard_normal((len(time), 3))
        whole = Recording(time, JOINTS, 0.05 * motion(time)[0] + white)
        cutoff = suggest_cutoff(whole.mapped(lambda _, values: values[~lost]))
        assert cutoff == pytest.approx(5.0, abs=2.0)


def test_real_logs_are_processed(shared_data: Path) -> None:
    for name in ("go2", "aliengo"):
        recording = read(shared_data / "real" / f"{name}_legs_in_air.csv")
        cutoff = suggest_cutoff(recording)
        assert cutoff is not None
        assert 5.0 <= cutoff <= 15.0
        result = preprocess(recording, Preprocessing(cutoff))
        assert not result.report.resampled
        assert result.report.segments == 1
        assert result.report.rate_hz == pytest.approx(199.96, abs=0.01)
        assert result.report.samples_out > 0.9 * len(recording)
        # the recorded velocities, filtered alike, have the derived ones' shape; their scale is off by up to 9 %
        own = preprocess(replace(recording, position=recording.velocity), Preprocessing(cutoff)).position
        derived = preprocess(recording, Preprocessing(cutoff)).velocity
        assert all(np.corrcoef(own[:, j], derived[:, j])[0, 1] > 0.998 for j in range(12))


@pytest.mark.parametrize("rate", [50, 100, 200, 400, 500, 1000])
@pytest.mark.parametrize("start", [0.0, 12.345, 1.7e9])
@pytest.mark.parametrize("decimals", [3, 6, 12])
def test_the_highest_cutoff_is_accepted_for_every_part_of_the_log(rate: int, start: float, decimals: int) -> None:
    """Stamps of finite resolution give each part a rate that is slightly off the nominal one."""
    time = np.round(start + np.arange(6000) / rate, decimals)
    log = Recording(time, ("a",), np.random.default_rng(0).normal(size=(6000, 1)))
    highest = highest_cutoff(log)
    assert highest == pytest.approx(rate / 8, rel=1e-4)
    for part in (slice(0, 3000), slice(2000, 6000), slice(0, 6000)):
        assert len(preprocess(take(log, part), Preprocessing(highest)))
