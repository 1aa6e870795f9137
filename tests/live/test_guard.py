"""Streams with wrong units, signs or legs: nothing is weighed, and the state names the option that corrects it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from checks.test_diagnosis import legs_swapped
from stadera.errors import UntrustedError
from stadera.live import LiveSession, LiveState, Worker
from stadera.live.run import replay
from stadera.logs import Recording, take, write_table
from stadera.logs.topics import ReadOptions
from stadera.robot import Robot
from stadera.trust import Trust


def scaled(log: Recording, **factors: float) -> Recording:
    return replace(log, **{name: factor * getattr(log, name) for name, factor in factors.items()})


def in_other_imu_units(log: Recording, gyro: float = 1.0, force: float = 1.0) -> Recording:
    imu = log.imu
    assert imu is not None
    omega, a = gyro * imu.angular_velocity, force * imu.linear_acceleration
    return replace(log, imu=replace(imu, angular_velocity=omega, linear_acceleration=a))


def passed(session: LiveSession, log: Recording, until: float = np.inf) -> Recording:
    """Adds a log's samples in pieces of 0.1 s, up to a time; returns the rest."""
    end = int(np.searchsorted(log.time, until))
    for start in range(0, end, 25):
        session.add(take(log, slice(start, min(start + 25, end))), 0.0)
    return take(log, slice(end, len(log)))


@pytest.fixture(scope="module")
def right(walk: Recording, robot: Robot) -> LiveState:
    """After the walk as it is."""
    session = LiveSession(robot)
    passed(session, walk)
    return session.state()


SIDES = (("LF", "RF"), ("LH", "RH"))
WRONG: dict[str, tuple[Callable[[Recording, Robot], Recording], str, str]] = {
    "degrees": (lambda log, r: scaled(log, position=180 / np.pi), "in degrees", "--units deg"),
    "g": (lambda log, r: in_other_imu_units(log, force=1 / 9.80665), "units of g", "--units g"),
    "gyro in deg/s": (lambda log, r: in_other_imu_units(log, gyro=180 / np.pi), "deg/s", "--units gyro=deg/s"),
    "velocities in deg/s": (lambda log, r: scaled(log, velocity=180 / np.pi), "deg/s", "--units velocity=deg/s"),
    "signs": (lambda log, r: scaled(log, effort=-1.0), "signs of all torques", "where the messages are sent"),
    "torques of motors": (lambda log, r: scaled(log, effort=1 / 9.0), "too small", "--gear RATIO"),
    "legs swapped": (lambda log, r: legs_swapped(log, r, SIDES, "effort"), "left and right legs are swapped", "--fix"),
}


@pytest.mark.parametrize("name", WRONG)
def test_nothing_is_weighed_by_a_wrong_stream(name: str, walk: Recording, robot: Robot) -> None:
    corrupt, words, option = WRONG[name]
    session = LiveSession(robot)
    passed(session, corrupt(walk, robot), 2.5)
    state = session.state()
    assert state.trust.verdict == "bad"
    assert session.estimator is None
    (said,) = state.waiting_for
    assert words in said
    assert option in said
    assert not session.tare().success


@pytest.mark.parametrize("name", ["degrees", "gyro in deg/s"])
def test_what_is_certain_is_corrected(name: str, walk: Recording, robot: Robot, right: LiveState) -> None:
    session = LiveSession(robot, fix=True)
    passed(session, WRONG[name][0](walk, robot))
    state = session.state()
    assert state.trust.verdict != "bad"
    assert state.waiting_for == ()
    assert state.notes
    assert state.trunk.inertial.mass == pytest.approx(right.trunk.inertial.mass, rel=0.02)


def test_gears_are_applied_to_all_samples(walk: Recording, robot: Robot, right: LiveState) -> None:
    session = LiveSession(robot, reading=ReadOptions.of(gear="9"))
    passed(session, scaled(walk, effort=1 / 9.0))
    np.testing.assert_allclose(session.state().trunk.inertial.vector, right.trunk.inertial.vector, rtol=1e-6)


def test_a_stream_that_becomes_sound_is_weighed_from_then_on(walk: Recording, robot: Robot) -> None:
    session = LiveSession(robot)
    wrong = take(scaled(walk, effort=-1.0), walk.time < 2.019)
    passed(session, wrong)
    assert session.state().trust.verdict == "bad"
    later = replace(walk, time=walk.time + 2.02)
    passed(session, later)
    state = session.state()
    assert state.waiting_for == ()
    assert state.trust.verdict != "bad"


def test_a_replay_of_wrong_units_is_refused(walk: Recording, robot: Robot, tmp_path: Path) -> None:
    log = write_table(scaled(walk, position=180 / np.pi), tmp_path / "log.parquet")
    with pytest.raises(UntrustedError, match="--units deg or --fix"):
        replay(log, robot, Worker(LiveSession(robot)), threading.Event())


def test_a_clean_stream_is_the_same_with_the_guard(right: LiveState) -> None:
    assert isinstance(right.trust, Trust)
    assert right.notes == ()
    assert right.waiting_for == ()
