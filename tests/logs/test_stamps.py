"""Steps between samples from the joints' motion, where stamps are times of arrival."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stadera.errors import StaderaError
from stadera.logs import stream
from stadera.logs.recording import Recording, take
from stadera.logs.stamps import StampSettings, with_steps_of_motion
from stadera.types import Array

JOINTS = 12
SCATTER = 2e-4  # s, of a step


def steps(rng: np.random.Generator, count: int) -> Array:
    """Steps of 2 ms, every eighth of 8 ms, since samples are lost."""
    return np.where(rng.random(count) < 0.125, 0.008, 0.002)


def log(time: Array, seed: int = 0, noise: float = 1e-4) -> Recording:
    """Joints that swing, sampled at these times [s]."""
    rng = np.random.default_rng(seed)
    rate, phase = rng.uniform(1.0, 4.0, JOINTS) * 2.0 * np.pi, rng.uniform(0.0, 6.0, JOINTS)
    angle = rate * time[:, None] + phase
    position = 0.3 * np.sin(angle) + noise * rng.standard_normal(angle.shape)
    velocity = 0.3 * rate * np.cos(angle) + 1e2 * noise * rng.standard_normal(angle.shape)
    return Recording(time, tuple(f"j{k}" for k in range(JOINTS)), position, velocity)


def arrival(rng: np.random.Generator, true: Array) -> Array:
    """Stamps: samples wait for up to 6 ms, in the order in which they were sent."""
    waited = np.maximum.accumulate(true + rng.uniform(0.0, 0.006, len(true)))
    return waited + 1e-8 * np.arange(len(true))


@pytest.mark.parametrize("seed", range(3))
def test_steps_are_those_of_the_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    true = np.cumsum(steps(rng, 6000))
    stamped = replace(log(true, seed), time=arrival(rng, true))
    whole = next(with_steps_of_motion((stamped,)))
    assert np.std(np.diff(stamped.time) - np.diff(true)) > 5.0 * SCATTER
    assert np.std(np.diff(whole.time) - np.diff(true)) < SCATTER
    followed = true > 4.0  # the first seconds go to the mean delay
    assert np.std((whole.time - true)[followed]) < 0.5 * np.std((stamped.time - true)[followed])
    assert "stamped when they arrived" in whole.notes[-1]


def test_parts_of_a_log_follow_on() -> None:
    rng = np.random.default_rng(5)
    true = np.cumsum(steps(rng, 9000))
    stamped = replace(log(true), time=arrival(rng, true))
    parts = list(stream(stamped, rows=3000))
    whole = next(with_steps_of_motion((stamped,)))
    joined = np.concatenate([part.time for part in parts])
    assert (np.diff(joined) > 0.0).all()
    np.testing.assert_allclose(joined, whole.time, atol=5e-4)
    assert [len(part.notes) for part in parts] == [1, 0, 0]


@pytest.mark.parametrize("seed", range(20))
def test_time_goes_on_where_the_joints_stop(seed: int) -> None:
    rng = np.random.default_rng(seed)
    true = np.cumsum(steps(rng, 6000))
    moving = log(true, seed)
    assert moving.velocity is not None
    stops = np.minimum(np.arange(len(true)), 1999)  # and goes on to be sampled
    stopped = replace(
        moving,
        time=arrival(rng, true),
        position=moving.position[stops],
        velocity=np.where((np.arange(len(true)) < 2000)[:, None], moving.velocity, 0.0),
    )
    joined = np.concatenate([part.time for part in stream(stopped, rows=2000)])
    assert (np.diff(joined) > 0.0).all()
    assert np.abs(joined - true).max() < 0.02


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), jitter=st.sampled_from([0.0, 1e-5]), factor=st.sampled_from([1.0, 0.9, 57.3]))
def test_a_good_clock_stays(seed: int, jitter: float, factor: float) -> None:
    """Also with velocities that are scaled, and in degrees: what is wrong then is not the clock."""
    rng = np.random.default_rng(seed)
    true = np.cumsum(steps(rng, 2000))
    good = log(true, seed)
    assert good.velocity is not None
    good = replace(good, time=true + jitter * rng.standard_normal(len(true)), velocity=factor * good.velocity)
    assert next(with_steps_of_motion((good,))) is good


def test_a_robot_that_stands_tells_no_steps() -> None:
    rng = np.random.default_rng(1)
    true = np.cumsum(steps(rng, 2000))
    rest = replace(log(true), time=arrival(rng, true))
    still = 1e-4 * rng.standard_normal(rest.position.shape)
    rest = replace(rest, position=still, velocity=10.0 * still)
    assert next(with_steps_of_motion((rest,))) is rest


def test_a_long_gap_is_as_long_as_its_stamps_say() -> None:
    rng = np.random.default_rng(2)
    true = np.cumsum(steps(rng, 4000))
    true[2000:] += 0.7
    mended = next(with_steps_of_motion((replace(log(true), time=arrival(rng, true)),)))
    assert np.diff(mended.time)[1999] == pytest.approx(0.7, abs=0.01)


def test_a_stall_after_which_all_comes_at_once_is_no_gap() -> None:
    """As over Wi-Fi: the joints moved as little during the longest step as during any other."""
    rng = np.random.default_rng(4)
    true = np.cumsum(steps(rng, 6000))
    stamped = arrival(rng, true)
    for k in range(500, 6000, 500):
        stamped[k : k + 100] = np.maximum(stamped[k : k + 100], stamped[k + 100] - 1e-6 * np.arange(100, 0, -1))
    mended = next(with_steps_of_motion((replace(log(true), time=stamped),)))
    assert np.diff(stamped).max() > 20.0 * np.diff(true).max()
    assert np.std(np.diff(mended.time) - np.diff(true)) < SCATTER


@pytest.mark.parametrize("moving", ["always", "for a second of four", "never"])
@pytest.mark.parametrize("held_up", [0.02, 0.1])
def test_samples_that_arrive_in_bursts_are_even_or_as_the_motion_tells(moving: str, held_up: float) -> None:
    """Stamps of a burst are 10 µs apart, and a pause of 0.7 s is kept; one message in a hundred is lost. Some
    velocities of one joint are wrong.
    """
    rng = np.random.default_rng(6)
    true = np.flatnonzero(rng.random(8000) > 0.01) * 2e-3
    true[4000:] += 0.7
    burst = np.ceil(true / held_up)
    first = np.searchsorted(burst, burst)  # sample of each burst
    stamped = held_up * burst + 1e-5 * (np.arange(len(true)) - first)
    whole = log(true)
    assert whole.velocity is not None
    rests = {"always": np.zeros(len(true), dtype=bool), "never": np.ones(len(true), dtype=bool)}
    still = rests.get(moving, np.arange(len(true)) % 2000 >= 500)[:, None]
    stopped = np.maximum.accumulate(np.where(still[:, 0], 0, np.arange(len(true))))
    noise = 1e-4 * rng.standard_normal(whole.position.shape)
    position = np.where(still, whole.position[stopped] + noise, whole.position)
    velocity = np.where(still, 100.0 * noise, whole.velocity)
    velocity[700::500, 3] = -20.0
    arrived = replace(whole, time=stamped, position=position, velocity=velocity)
    parts = with_steps_of_motion(take(arrived, slice(k, k + 2000)) for k in range(0, 8000, 2000))
    found = np.concatenate([part.time for part in parts])
    off = np.abs(np.diff(found) - np.diff(true))
    assert np.std(np.diff(stamped) - np.diff(true)) > 5e-3
    assert np.quantile(off, 0.98) < 5e-4
    assert np.argmax(np.diff(found)) == 3999
    assert np.diff(found)[3999] == pytest.approx(0.7, abs=1.1 * held_up)
    assert np.abs(found - true).max() < 1.5 * held_up


def test_velocities_are_needed() -> None:
    rng = np.random.default_rng(3)
    true = np.cumsum(steps(rng, 500))
    bare = replace(log(true), velocity=None, time=arrival(rng, true))
    assert next(with_steps_of_motion((bare,))) is bare
    short = take(replace(log(true), time=arrival(rng, true)), slice(0, 100))
    assert next(with_steps_of_motion((short,))) is short


def test_settings_are_positive() -> None:
    with pytest.raises(StaderaError, match="memory"):
        StampSettings(memory=0.0)
