"""Torques made of a controller's commands: the law, where it is read, and that a result of it is doubtful."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv as pacsv

from stadera.errors import RecordingError
from stadera.identify.legs import identify
from stadera.identify.settings import IdentifySettings
from stadera.lab.plant.sensors import STANDARD
from stadera.logs import LogFile, Recording, Topics, read, stream
from stadera.logs.frames import columns_of
from stadera.logs.recording import with_velocity
from stadera.logs.topics import PdGains, ReadOptions
from stadera.robot import load_robot
from stadera.weigh import weigh
from walking import Walk, recorded, walked

KP, KD = 20.0, 0.5
JOINTS = ("FL_hip_joint", "FL_thigh_joint", "FL_calf_joint")


def commanded(recording: Recording, path: Path, *, velocity: bool = True) -> Path:
    """A log of a robot whose controller made the recorded efforts, which are left out."""
    assert recording.effort is not None
    moving = with_velocity(recording)
    assert moving.velocity is not None
    table = columns_of(recording if velocity else replace(recording, velocity=None))
    desired = moving.position + (recording.effort + KD * moving.velocity) / KP
    for k, joint in enumerate(recording.joints):
        del table[f"{joint}.effort"]
        table[f"{joint}.position_desired"] = desired[:, k]
    pacsv.write_csv(pa.table({name: np.ascontiguousarray(values) for name, values in table.items()}), path)
    return path


def log_of(path: Path, pd: str) -> LogFile:
    return LogFile(path, Topics(), ReadOptions.of(pd=pd))


@pytest.fixture(scope="module")
def swing() -> Recording:
    time = np.arange(1000) * 0.004
    angle = np.outer(time, [3.0, 4.0, 5.0]) + 1.0
    effort = np.random.default_rng(0).normal(size=angle.shape)
    return Recording(time, JOINTS, 0.3 * np.sin(angle), 0.3 * np.cos(angle) * [3, 4, 5], effort=effort)


@pytest.mark.parametrize("velocity", [True, False])
def test_the_law_gives_back_what_the_controller_asked_for(swing: Recording, tmp_path: Path, velocity: bool) -> None:
    given = swing if velocity else replace(swing, velocity=None)
    log = read(log_of(commanded(given, tmp_path / "log.csv", velocity=velocity), "20,0.5"))
    np.testing.assert_allclose(log.effort, given.effort, atol=1e-12)
    assert len(log.doubts) == 1
    assert any("kp,kd = 20,0.5" in note for note in log.notes)


def test_chunks_say_once_what_was_made(swing: Recording, tmp_path: Path) -> None:
    chunks = list(stream(log_of(commanded(swing, tmp_path / "log.csv"), "20,0.5"), rows=300))
    np.testing.assert_allclose(np.vstack([chunk.effort for chunk in chunks]), swing.effort, atol=1e-12)
    assert all(chunk.doubts for chunk in chunks)


def test_desired_velocities_and_feedforward_count_where_they_are_recorded() -> None:
    frame = {"time": [0.0, 0.1], "a.position": [1.0, 1.0], "a.velocity": [2.0, 2.0], "a.position_desired": [1.5, 1.5]}
    more = {"a.velocity_desired": [3.0, 3.0], "a.effort_desired": [7.0, 7.0]}
    for columns, expected in ((frame, 10 * 0.5 - 2 * 2.0), (frame | more, 10 * 0.5 + 2 * 1.0 + 7.0)):
        log = Recording.from_dataframe(columns, pd="10,2")
        assert log.effort is not None
        assert log.effort[0, 0] == pytest.approx(expected)


def test_gains_of_hip_thigh_and_calf() -> None:
    gains = PdGains.parse("10,1/20,2/30,3")
    zero = np.zeros((1, 3))
    order = ("FL_calf_joint", "FL_hip_joint", "FL_thigh_joint")
    effort = gains.effort(zero, zero + 1.0, order, {"position_desired": zero + 1.0})
    assert effort.tolist() == [[27.0, 9.0, 18.0]]
    with pytest.raises(RecordingError, match="name of joint 'a' says neither hip, thigh nor calf: give one pair"):
        gains.effort(zero, zero, ("a", "b", "c"), {})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("20", "'20' is not a pair of gains kp,kd"),
        ("20,x", "is not a pair of gains"),
        ("20,1/20,1", "one pair kp,kd or three"),
        ("0,1", "some kp above"),
        ("-1,1", "at least 0"),
    ],
)
def test_gains_that_are_none(text: str, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        PdGains.parse(text)


def test_what_is_missing_or_there_already_is_named(swing: Recording, tmp_path: Path) -> None:
    path = commanded(swing, tmp_path / "log.csv")
    with pytest.raises(
        RecordingError, match=r"no column 'FL_hip_joint\.effort'.*--pd KP,KD makes efforts of the desir"
    ):
        read(path, require=("effort",))
    plain = columns_of(replace(swing, effort=None))
    with pytest.raises(RecordingError, match=r"no column 'FL_hip_joint\.position_desired'"):
        Recording.from_dataframe(plain, pd="20,0.5")
    with pytest.raises(RecordingError, match="efforts are recorded: leave out --pd"):
        Recording.from_dataframe(columns_of(swing), pd="20,0.5")


def test_a_weighing_of_commands_is_doubtful(tmp_path: Path) -> None:
    robot = load_robot("go2")
    walk = recorded(robot, walked(robot, Walk(seconds=2.0, rate_hz=250.0)), STANDARD, 0)
    trust = weigh(robot, log_of(commanded(walk, tmp_path / "log.csv"), "20,0.5")).trust
    assert trust.verdict == "doubtful"
    assert any("made of the controller's commands (--pd)" in reason for reason in trust.reasons)


def test_an_identification_of_commands_is_doubtful(swing: Recording, tmp_path: Path) -> None:
    log = log_of(commanded(swing, tmp_path / "log.csv"), "20,0.5")
    found = identify("go2", [log], IdentifySettings(legs=("LF",), spread=None))
    assert any("made of the controller's commands (--pd)" in reason for reason in found.trust.reasons)
