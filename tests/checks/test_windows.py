"""Faults that only part of a log or part of its channels shows: named with channel, joint and time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.checks import diagnose
from stadera.checks.limits import WindowLimits
from stadera.checks.windows import Windows, window_faults, with_verdicts
from stadera.errors import UntrustedError
from stadera.lab.experiments.fault_kinds import SIGNAL_FAULTS
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs import Recording, take
from stadera.robot import Robot, load_robot
from stadera.weigh.result import Weighing
from stadera.weigh.weigh import weigh


@pytest.fixture(scope="module")
def hyq() -> Robot:
    return load_robot("hyq")


@pytest.fixture(scope="module")
def shake(hyq: Robot) -> Recording:
    return simulate(hyq, "shake", SimulateSettings("standard", duration=2.5, seed=3, hold=2)).recording


@pytest.fixture(scope="module")
def trot(hyq: Robot) -> Recording:
    return simulate(hyq, "trot", SimulateSettings("standard", duration=4.0, seed=1, hold=2)).recording


@pytest.mark.parametrize("factor", [1.0, 1e6, 1e9])
def test_time_in_other_units_makes_no_more_windows_than_samples(shake: Recording, factor: float) -> None:
    time = factor * shake.time
    windows = Windows.of(time, WindowLimits().length)
    assert 1 <= len(windows) <= len(time)
    assert windows.edges[0] == time[0]
    assert windows.edges[-1] == time[-1]


@pytest.fixture(scope="module")
def go2() -> tuple[Robot, Recording, Weighing]:
    """A Go2 that sways, its log and what it weighs."""
    robot = load_robot("go2")
    log = simulate(robot, "shake", SimulateSettings("standard", duration=5.0, seed=3, hold=2)).recording
    return robot, log, weigh(robot, log)


def spoilt(log: Recording, robot: Robot, name: str, seed: int = 0) -> Recording:
    return SIGNAL_FAULTS[name].spoil(log, robot, np.random.default_rng(seed))


def test_nothing_is_found_in_a_clean_log(hyq: Robot, trot: Recording, shake: Recording) -> None:
    real = simulate(hyq, "trot", SimulateSettings("real", duration=2.5, seed=3, hold=2)).recording
    for log in (trot, shake, real):
        assert window_faults(log, hyq) == ()


@pytest.mark.parametrize(
    ("name", "channel", "words"),
    [
        ("velocities' sign", "velocity", " and 5 more are not the change of position, from 0.00"),
        ("velocities x2", "velocity", "times the change of position"),
        ("one velocity zero", "velocity", "is not the change"),
        ("one encoder jumps by 5°", "position", "jumps by"),
        ("five samples of 1e4 N·m", "effort", "1e+04 N·m in 5 samples"),
        ("five samples of three times the limit", "effort", "N·m in 5 samples, more than any drive of it gives"),
        ("a knee clipped at 80 %", "effort", "it is clipped"),
        ("a leg's torques only noise", "effort", "is only noise"),
    ],
)
def test_a_fault_has_channel_joint_and_time(hyq: Robot, trot: Recording, name: str, channel: str, words: str) -> None:
    found = window_faults(spoilt(trot, hyq, name), hyq)
    first = next(fault for fault in found if fault.cause == channel)
    assert words in first.said()
    assert first.said().endswith(" s")
    assert any(joint in first.message for joint in hyq.tree.joints)


def test_missing_samples_are_worth_a_note_and_change_no_encoder(hyq: Robot, trot: Recording) -> None:
    """A tenth of a second is lost in the middle, without a gap in the stamps: the joints jump together."""
    middle, lost = len(trot) // 2, round(0.1 / np.median(np.diff(trot.time)))
    kept = np.delete(np.arange(len(trot)), np.arange(middle, middle + lost))
    shorter = replace(take(trot, kept), time=trot.time[: len(kept)])
    (found,) = window_faults(shorter, hyq)
    assert "several joints jump at once: samples are missing" in found.message
    assert not found.spans
    assert found.at == pytest.approx(trot.time[middle], abs=0.05)


def test_a_leg_whose_encoders_jump_together_is_no_gap(hyq: Robot, trot: Recording) -> None:
    """As after a reset of its bus: no joint of another leg jumps."""
    position = trot.position.copy()
    position[len(trot) // 2 :, [trot.index(joint) for joint in hyq.leg("RF").joints]] += 0.1
    found = window_faults(replace(trot, position=position), hyq)
    assert len(found) == 3
    assert all(fault.lasting and "jumps by" in fault.message for fault in found)


def test_velocities_taken_for_another_unit_are_named(hyq: Robot, trot: Recording) -> None:
    """In rad/s, and read as deg/s."""
    assert trot.velocity is not None
    (found,) = diagnose(replace(trot, velocity=np.radians(trot.velocity)), hyq)
    assert found.message.startswith("joint velocities seem to be in rad/s, and to be taken for deg/s: 0.017")
    assert found.remedy == "; add --units velocity=rad/s or --fix"
    assert found.mend is not None
    assert found.mend.factors["velocity"] == pytest.approx(180.0 / np.pi)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("gyro's sign", "the gyro's sign is reversed"),
        ("gyro in deg/s", "the gyro seems to be in deg/s"),
        ("IMU yawed 90°", "the IMU is turned by 90° about the vertical"),  # HyQ's is mounted upside down
        ("IMU yawed 180°", "the IMU is turned by 180° about the vertical"),
        ("whole left and right legs swapped", "left and right legs are swapped"),
    ],
)
def test_a_gyro_is_held_against_the_feet(hyq: Robot, shake: Recording, name: str, words: str) -> None:
    (fault,) = diagnose(spoilt(shake, hyq, name), hyq)
    assert words in fault.message
    assert "feet that carry slide at" in fault.message
    assert fault.fatal


@pytest.mark.parametrize("name", ["efforts of left and right legs swapped", "legs' positions and velocities swapped"])
def test_loads_are_held_against_raised_feet(hyq: Robot, trot: Recording, name: str) -> None:
    (fault,) = diagnose(spoilt(trot, hyq, name), hyq)
    assert fault.cause == "joint_order"
    assert "left and right legs" in fault.message


def test_a_fixed_log_has_the_turn_of_its_imu_in_the_axes_of_the_imu(hyq: Robot, shake: Recording) -> None:
    (fault,) = diagnose(spoilt(shake, hyq, "IMU yawed 90°"), hyq)
    assert fault.mend is not None
    assert diagnose(fault.mend(spoilt(shake, hyq, "IMU yawed 90°")), hyq) == ()


def test_a_knee_whose_torque_counts_twice_is_not_trusted(hyq: Robot, trot: Recording) -> None:
    assert trot.effort is not None
    effort = trot.effort * np.where(np.array(trot.joints) == hyq.legs[1].joints[2], 2.0, 1.0)
    with pytest.raises(UntrustedError, match="not to be trusted"):
        weigh(hyq, replace(trot, effort=effort))


PINNED = (
    "efforts of left and right legs swapped",
    "IMU yawed 90°",
    "velocities' sign",
    "a knee clipped at 80 %",
    "a leg's torques only noise",
)


@pytest.mark.parametrize("name", PINNED)
def test_no_fault_gives_a_tight_number_without_a_word(hyq: Robot, trot: Recording, name: str) -> None:
    try:
        found = weigh(hyq, spoilt(trot, hyq, name))
    except UntrustedError:
        return
    assert found.trust.verdict != "good"
    assert found.trust.reasons


def test_what_a_few_samples_spoil_is_left_out_and_the_rest_is_weighed(hyq: Robot, trot: Recording) -> None:
    clean, bad = weigh(hyq, trot), weigh(hyq, spoilt(trot, hyq, "five samples of 1e4 N·m"))
    assert any("1e+04 N·m" in refusal.reason for refusal in bad.refusals)
    assert any(note.startswith("left out: the torque of") for note in bad.notes)
    assert bad.mass == pytest.approx(clean.mass, abs=clean.mass_std)


@pytest.mark.parametrize("name", ["five samples of 1e4 N·m", "five samples of three times the limit"])
def test_a_few_wild_samples_contradict_nothing(go2: tuple[Robot, Recording, Weighing], name: str) -> None:
    """Nor does the gap that they leave mean that sensors dropped out."""
    robot, log, clean = go2
    bad = weigh(robot, spoilt(log, robot, name))
    assert [note[:8] for note in bad.notes if note not in clean.notes] == ["left out"]
    assert bad.mass == pytest.approx(clean.mass, abs=0.5 * clean.mass_std)


def test_a_gap_is_reported_of_a_log_from_which_samples_are_left_out_too(go2: tuple[Robot, Recording, Weighing]) -> None:
    robot, log, _ = go2
    bad = spoilt(log, robot, "five samples of 1e4 N·m")
    lost = np.ones(len(bad), dtype=bool)
    lost[len(bad) // 10 : len(bad) // 8] = False
    notes = weigh(robot, take(bad, lost)).notes
    assert any(note.startswith("left out") for note in notes)
    assert [note[:14] for note in notes if note.startswith("dropout")] == ["dropout: 1 gap"]


def test_a_drive_at_its_own_limit_is_not_clipped(hyq: Robot, trot: Recording) -> None:
    assert trot.effort is not None
    joint = trot.joints[2]
    most = float(0.8 * np.abs(trot.effort[:, 2]).max())
    log = replace(trot, effort=np.clip(trot.effort, -most, most))
    weak = replace(hyq, limits={**hyq.limits, joint: replace(hyq.limits[joint], effort=most)})
    named = [fault.message for fault in window_faults(log, weak) if "clipped" in fault.message]
    assert not any(joint in what for what in named)


def test_windows_are_left_out_only_while_they_are_few(hyq: Robot, trot: Recording) -> None:
    limits = WindowLimits()
    for name, share in (("five samples of 1e4 N·m", None), ("a leg's torques only noise", "bad")):
        faults = window_faults(spoilt(trot, hyq, name), hyq)
        verdicts = {verdict for _, verdict in with_verdicts(faults, 4.0, limits)}
        assert share in verdicts


def test_a_signal_that_is_stuck_is_left_out_or_refused(hyq: Robot, shake: Recording) -> None:
    assert shake.effort is not None
    for share, refused in ((0.1, False), (0.6, True)):
        effort, end = shake.effort.copy(), round((0.2 + share) * len(shake))
        effort[len(shake) // 5 : end, 4] = effort[len(shake) // 5, 4]
        log = replace(shake, effort=effort)
        if refused:
            with pytest.raises(UntrustedError, match="stands still bit for bit"):
                weigh(hyq, log)
        else:
            result = weigh(hyq, log)
            assert any("left out" in note and "stands still" in note for note in result.notes)
            assert any("stands still" in refusal.reason for refusal in result.refusals)
