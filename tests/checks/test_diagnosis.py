"""Logs made wrong in one way each: the finding names that way. Logs that are right: no finding.

What is right is worked out by Pinocchio (poses held at rest), and by the test-bed with its sensors' errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stadera.checks import CheckLimits, contradictions
from stadera.checks.instants import Instants
from stadera.checks.residual import Footing, Gain
from stadera.checks.signals import dropouts, gravity_findings
from stadera.checks.statics import Consistency, Tilts
from stadera.checks.windows import window_faults
from stadera.errors import RecordingError, UntrustedError
from stadera.inertia import skew
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs import Imu, Recording
from stadera.logs.mend import GYRO, Mend
from stadera.logs.recording import take
from stadera.logs.sampling import sampling_of
from stadera.robot import Robot, load_robot
from stadera.robot.imu import ImuMount
from stadera.weigh import diagnose, weigh
from stadera.weigh.reading import CheckedLog
from stadera.weigh.settings import WeighSettings
from standing import GRAVITY, StandingRobot, static_log


@pytest.fixture(scope="module")
def hyq() -> Robot:
    return load_robot("hyq")


@pytest.fixture(scope="module")
def clean(hyq: Robot) -> Recording:
    return static_log(hyq)


def with_imu(log: Recording, **changes: object) -> Recording:
    assert log.imu is not None
    return replace(log, imu=replace(log.imu, **changes))


def turned(log: Recording, turn: Rotation) -> Recording:
    assert log.imu is not None
    imu = log.imu
    return replace(log, imu=Imu(turn.apply(imu.angular_velocity), turn.apply(imu.linear_acceleration), None, imu.frame))


def kinds_swapped(log: Recording, robot: Robot, first: int, second: int, *channels: str) -> Recording:
    order = list(range(12))
    for leg in robot.legs:
        a, b = log.joints.index(leg.joints[first]), log.joints.index(leg.joints[second])
        order[a], order[b] = b, a
    return replace(log, **{channel: getattr(log, channel)[:, order] for channel in channels})


def legs_swapped(log: Recording, robot: Robot, pairs: tuple[tuple[str, str], ...], *channels: str) -> Recording:
    order = list(range(12))
    for one, other in pairs:
        for a, b in zip(robot.leg(one).joints, robot.leg(other).joints, strict=True):
            i, j = log.joints.index(a), log.joints.index(b)
            order[i], order[j] = j, i
    return replace(log, **{channel: getattr(log, channel)[:, order] for channel in channels})


def flipped(log: Recording, joints: tuple[str, ...]) -> Recording:
    assert log.effort is not None
    return replace(log, effort=log.effort * np.where(np.isin(log.joints, joints), -1.0, 1.0))


# -- what is right --------------------------------------------------------------------------------------------------


def test_nothing_is_found_in_a_clean_log(hyq: Robot, clean: Recording) -> None:
    assert diagnose(clean, hyq) == ()


@pytest.mark.parametrize("load", [0.1, 0.6])
def test_nothing_is_found_under_a_load(hyq: Robot, load: float) -> None:
    assert diagnose(static_log(hyq, load * hyq.mass), hyq) == ()


def test_nothing_is_found_in_another_robots_clean_log() -> None:
    pytest.importorskip("cmeel", reason="example-robot-data is not installed")
    go2 = load_robot("go2")
    assert diagnose(static_log(go2), go2) == ()
    wrong = legs_swapped(static_log(go2), go2, (("LF", "LH"), ("RF", "RH")), "position", "velocity", "effort")
    assert [f.cause for f in diagnose(wrong, go2)] == ["joint_order"]


@pytest.mark.parametrize(("name", "scenario", "seconds"), [("hyq", "stand", 0.6), ("hyq", "trot", 2.0)])
def test_nothing_is_found_in_a_simulated_log(name: str, scenario: str, seconds: float) -> None:
    robot = load_robot(name)
    run = simulate(robot, scenario, SimulateSettings(errors="harsh", duration=seconds, seed=2, hold=2))
    log = take(run.recording, run.recording.time > 0.2)
    assert diagnose(log, robot) == ()
    assert log.effort is not None
    assert [f.cause for f in diagnose(replace(log, effort=-log.effort), robot)] == ["torque_signs"]


def test_forces_are_those_of_the_weight(hyq: Robot, clean: Recording) -> None:
    """Against Pinocchio's statics: what the feet carry, and where the centre of mass is."""
    assert clean.effort is not None
    assert clean.imu is not None
    limits = CheckLimits()
    blocks = Instants.of(clean, hyq.tree.joints, ImuMount.of(hyq, clean.imu.frame), limits)
    footing = Footing(hyq, blocks, limits)
    found = Consistency.of(footing)
    assert found.weighs == pytest.approx(StandingRobot(hyq).mass, rel=5e-3)
    assert Tilts.of(footing).similarity > 0.99
    total, up = (x.mean(axis=0) for x in (footing.force.sum(axis=1), footing.specific_force))
    assert np.linalg.norm(np.cross(total, up)) < np.sin(np.radians(0.5)) * np.linalg.norm(total) * np.linalg.norm(up)
    assert not found.faults


def test_a_correction_by_which_the_robot_would_stand_is_not_better_for_that(hyq: Robot) -> None:
    """With its gyro divided away a robot that sways a little does not move, and its feet slide all the more."""
    log, limits = (
        simulate(hyq, "shake", SimulateSettings(duration=3.0, seed=1, amplitude=0.2, hold=2)).recording,
        CheckLimits(),
    )
    assert log.imu is not None
    footing = Footing(hyq, Instants.of(log, hyq.tree.joints, ImuMount.of(hyq, log.imu.frame), limits), limits)
    still = footing.after(Mend("", factors={GYRO: 1e-9}))
    assert still.lively == 0.0 < footing.lively
    assert Gain.of(footing, still).mean < -0.1
    assert Gain.of(still, footing).mean == pytest.approx(-Gain.of(footing, still).mean, abs=1e-12)


def wild_blocks(robot: Robot, group: list[int]) -> Instants:
    """Instants of a robot whose joints are anywhere, under a specific force that hardly turns."""
    rng, n = np.random.default_rng(1), len(group)
    q, rate, effort = rng.uniform(-1.0, 1.0, (3, n, 12))
    force, omega = np.array([0.3, -0.2, 9.8]) + 1e-3 * rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    time, joints = 0.04 * np.arange(n), robot.tree.joints
    return Instants(joints, time, np.array(group), q, rate, 20.0 * effort, None, force, omega)


@cache
def of_go2(scenario: str, seconds: float) -> Recording:
    settings = SimulateSettings("standard", duration=seconds, rate=250.0, seed=1, hold=2)
    return simulate(load_robot("go2"), scenario, settings).recording


@pytest.mark.parametrize("fits", [True, False])
def test_a_hypothesis_must_itself_fit(fits: bool) -> None:
    """Reversed gyro: undone, the motion fits, to a share of the cost that the limit says; if it is not plain anyway."""
    robot, log = load_robot("go2"), of_go2("shake", 6.0)
    assert log.imu is not None
    log = replace(log, imu=replace(log.imu, angular_velocity=-log.imu.angular_velocity, orientation=None))
    found = diagnose(log, robot, limits=CheckLimits(better=0.75 if fits else 1e-6, plain_gain=1e3))
    assert [finding.cause for finding in found] == ["gyro_unit"] * fits


@pytest.mark.parametrize("clock", [0.995, 1.005])
def test_a_log_at_50_hz_shows_its_feet_whatever_its_clock(clock: float) -> None:
    robot, log = load_robot("go2"), of_go2("shake", 6.0)
    slow = log.mapped(lambda name, values: (clock if name == "time" else 1.0) * values[::5])
    assert not diagnose(slow, robot)
    assert slow.imu is not None
    wrong = with_imu(slow, angular_velocity=-slow.imu.angular_velocity, orientation=None)
    assert [finding.cause for finding in diagnose(wrong, robot)] == ["gyro_unit"]


@pytest.mark.parametrize("every", [9, 11])
def test_what_a_slow_log_does_not_resolve_is_no_fault(every: int) -> None:
    """At 23 and 28 Hz a trot's torques seem to be noise, and knees turn by more than their velocities say."""
    robot, log = load_robot("go2"), of_go2("trot", 4.0)
    for begin in (1, 2, 3):
        assert not window_faults(log.mapped(lambda _, values, k=begin: values[k::every]), robot)


def test_balance_leaves_what_least_squares_leave() -> None:
    """Against `lstsq`, group by group; groups of few instants have no balance."""
    robot, limits = load_robot("go2"), CheckLimits()
    blocks = wild_blocks(robot, [0] * 25 + [1] * 3 + [2] * 25 + [3] * 4)
    footing, group, a = Footing(robot, blocks, limits), blocks.group, blocks.specific_force
    assert a is not None
    cost, length = footing.unbalance, robot.leg_length
    assert np.isnan(cost[(group == 1) | (group == 3)]).all()
    for at in (np.flatnonzero(group == 0), np.flatnonzero(group == 2)):
        rows = np.zeros((len(at), 6, 4))
        rows[:, :3, 0], rows[:, 3:, 1:] = a[at], [-skew(a[k]) / length for k in at]
        A, b = rows.reshape(-1, 4), (footing.target[at] / np.array([1.0, 1.0, 1.0, *[length] * 3])).ravel()
        left = (b - A @ np.linalg.lstsq(A, b)[0]).reshape(-1, 6) / (robot.mass * GRAVITY)
        np.testing.assert_allclose(cost[at], np.log1p((left**2).sum(axis=1) / limits.unbalance**2), rtol=1e-7)


# -- torques and joints ---------------------------------------------------------------------------------------------


def _legs(robot: Robot, *names: str) -> tuple[str, ...]:
    return tuple(joint for name in names for joint in robot.leg(name).joints)


@pytest.mark.parametrize("axes", ["(-x, y, -z)", "(-y, -x, -z)"])
def test_an_imu_upside_down_on_a_trot_is_turned_about_the_right_axis(axes: str) -> None:
    """On average a trunk that trots level tells the vertical only; its motion tells the axis."""
    robot, log = load_robot("go2"), of_go2("trot", 4.0)
    turn = {"(-x, y, -z)": np.diag([-1, 1, -1]), "(-y, -x, -z)": np.array([[0, -1, 0], [-1, 0, 0], [0, 0, -1]])}[axes]
    (found,) = diagnose(turned(log, Rotation.from_matrix(turn)), robot)
    assert f"its axes {axes} are what is taken for" in found.message
    assert found.mend is not None


WRONG: dict[str, tuple[str, str, Callable[[Recording, Robot], Recording]]] = {
    "all torques": ("torque_signs", "signs of all torques", lambda log, r: flipped(log, log.joints)),
    "left legs": ("torque_signs", "torques of LF and LH", lambda log, r: flipped(log, _legs(r, "LF", "LH"))),
    "one knee": ("torque_signs", "'rh_kfe_joint'", lambda log, r: flipped(log, ("rh_kfe_joint",))),
    "knees": ("torque_signs", "all KFE torques", lambda log, r: flipped(log, tuple(g.joints[2] for g in r.legs))),
    "HFE and KFE": (
        "joint_order",
        "joints HFE and KFE of all legs are swapped",
        lambda log, r: kinds_swapped(log, r, 1, 2, "position", "velocity", "effort"),
    ),
    "torques of HFE and KFE": (
        "joint_order",
        "the torques of joints HFE and KFE of all legs are swapped",
        lambda log, r: kinds_swapped(log, r, 1, 2, "effort"),
    ),
    "front and hind": (
        "joint_order",
        "front and hind legs are swapped",
        lambda log, r: legs_swapped(log, r, (("LF", "LH"), ("RF", "RH")), "position", "velocity", "effort"),
    ),
    "left and right": (
        "joint_order",
        "left and right legs are swapped",
        lambda log, r: legs_swapped(log, r, (("LF", "RF"), ("LH", "RH")), "position", "velocity", "effort"),
    ),
    "IMU upside down": (
        "imu_frame",
        "(x, -y, -z)",
        lambda log, r: turned(log, Rotation.from_euler("x", 180, degrees=True)),
    ),
    "IMU on its side": (
        "imu_frame",
        "IMU's frame",
        lambda log, r: turned(log, Rotation.from_euler("y", 90, degrees=True)),
    ),
    "IMU turned about the vertical": (
        "imu_frame",
        "IMU's frame",
        lambda log, r: turned(log, Rotation.from_euler("z", 90, degrees=True)),
    ),
    "IMU askew": (
        "contradiction",
        "the IMU's frame that seems wrong",
        lambda log, r: turned(log, Rotation.from_euler("x", 40, degrees=True)),
    ),
    "torques in another unit": (
        "torque_unit",
        "times too small",
        lambda log, r: replace(log, effort=0.4 * log.effort),  # type: ignore[operator]
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_named(hyq: Robot, clean: Recording, name: str) -> None:
    cause, words, corrupt = WRONG[name]
    (finding,) = diagnose(corrupt(clean, hyq), hyq)
    assert finding.cause == cause
    assert words in finding.message
    assert "\n" not in finding.message


def test_what_leaves_nothing_to_weigh_by_is_an_error_and_the_rest_a_note(hyq: Robot, clean: Recording) -> None:
    def notes(log: Recording) -> list[str]:
        read = CheckedLog(hyq, log, WeighSettings())
        assert sum(len(chunk) for chunk in read) == len(log)
        return list(read.notes)

    with pytest.raises(UntrustedError, match=r"signs of all torques are reversed.*would weigh -"):
        notes(flipped(clean, clean.joints))
    missing = "positions of several joints jump at once: samples are missing"  # from one pose to the next
    assert [note.split(",")[0] for note in notes(clean)] == [missing]
    gap = np.ones(len(clean), dtype=bool)
    gap[100:120] = False
    assert any("1 gap in time" in note for note in notes(take(clean, gap)))


@pytest.mark.parametrize(("share", "words"), [(1.0, "but in the air"), (0.1, "the motors seem to be off")])
def test_a_robot_that_hangs_is_not_on_its_feet(hyq: Robot, share: float, words: str) -> None:
    log, plant = static_log(hyq), StandingRobot(hyq)
    gravity = np.array([plant.holding(q, np.eye(3)) for q in log.position])
    upright = np.tile([0.0, 0.0, GRAVITY], (len(log), 1))
    assert log.imu is not None
    log = replace(log, effort=share * gravity, imu=Imu(log.imu.angular_velocity, upright, None, hyq.trunk))
    (finding,) = [f for f in diagnose(log, hyq) if f.cause != "stuck"]
    assert finding.cause == "not_on_feet"
    assert words in finding.message


# -- the IMU by itself ----------------------------------------------------------------------------------------------


def test_gravity_taken_out_or_in_other_units(hyq: Robot, clean: Recording) -> None:
    assert clean.imu is not None
    a = clean.imu.linear_acceleration
    rng = np.random.default_rng(1)
    for values, words in (
        (0.05 * rng.normal(size=a.shape), "gravity seems to have been taken out"),
        (a / GRAVITY, "units of g"),
        (2 * a, "unit or scale"),
    ):
        (finding,) = diagnose(with_imu(clean, linear_acceleration=values), hyq)
        assert finding.cause == "imu_gravity"
        assert words in finding.message
    (finding,) = diagnose(with_imu(clean, linear_acceleration=-a, orientation=None), hyq)
    assert finding.cause == "imu_frame"
    assert "sign is reversed" in finding.message


def test_a_lively_robot_shows_gravity_in_means_over_a_step(hyq: Robot, clean: Recording) -> None:
    """It lands, flies, and leans to both sides in turn: neither the usual norm nor the log's mean is gravity."""
    time = 0.002 * np.arange(8000)
    lean, bounce = 0.6 * np.sin(0.8 * time), np.where((4.0 * time) % 1.0 < 0.7, 2.4, -5.6)
    up = np.stack([np.sin(lean), np.zeros_like(lean), np.cos(lean)], axis=1)
    imu = Imu(np.zeros((len(time), 3)), (GRAVITY + bounce)[:, None] * up)
    assert abs(np.median(np.linalg.norm(imu.linear_acceleration, axis=1)) - GRAVITY) > 0.6
    assert abs(np.linalg.norm(imu.linear_acceleration.mean(axis=0)) - GRAVITY) > 0.6
    assert not list(gravity_findings(imu, CheckLimits()))
    assert list(gravity_findings(replace(imu, linear_acceleration=1.3 * imu.linear_acceleration), CheckLimits()))


# -- dropouts -------------------------------------------------------------------------------------------------------


def test_gaps_in_time(hyq: Robot, clean: Recording) -> None:
    kept = np.ones(len(clean), dtype=bool)
    kept[50:70] = kept[150:180] = False
    (finding,) = diagnose(take(clean, kept), hyq)
    assert finding.cause == "dropout"
    assert "2 gaps" in finding.message
    assert "0.31 s at 1.490 s" in finding.message


def test_samples_that_arrive_in_bursts_are_no_gaps() -> None:
    """A Go2's messages over a network: stamped as they arrive, 1 ms apart, then none for a while."""
    taken = 0.002 * np.arange(2000)
    stamps = 0.016 * np.floor(taken / 0.016) + 0.001 * (np.arange(2000) % 8)
    assert not list(dropouts(stamps))
    assert sampling_of(stamps).rate_hz == pytest.approx(500.0, rel=0.01)
    (finding,) = dropouts(np.delete(stamps, slice(800, 900)))
    assert finding.message.startswith("1 gap in time")


@pytest.mark.parametrize(("channel", "value"), [("effort", 0.0), ("position", None), ("velocity", None)])
def test_a_sensor_that_stands_still(hyq: Robot, clean: Recording, channel: str, value: float | None) -> None:
    values = getattr(clean, channel).copy()
    values[100:110, 4] = values[99, 4] if value is None else value
    moving = clean.velocity.copy()
    moving[100:110, 4] += 0.5
    found = diagnose(replace(clean, **{"velocity": moving, channel: values}), hyq)
    assert [f.cause for f in found] == ["stuck"]
    assert f"{clean.joints[4]}.{channel}" in found[0].message


def test_a_joint_that_rests_is_no_sensor_that_stands_still(hyq: Robot, clean: Recording) -> None:
    """Its drive reports a velocity of exactly zero; if its position moves meanwhile, the velocity is dead. Or friction
    holds it within a step of its encoder, while the noise of its velocity goes on.
    """
    rng = np.random.default_rng(1)
    velocity = 1e-3 * rng.standard_normal(clean.position.shape)
    position, later = clean.position.copy(), clean.time > clean.time.mean()
    velocity[later, 3], position[later, 3] = 0.0, position[later, 3][0]
    assert diagnose(replace(clean, position=position, velocity=velocity), hyq) == ()
    position[later, 3] += 0.02 * np.sin(3.0 * clean.time[later])
    found = diagnose(replace(clean, position=position, velocity=velocity), hyq)
    assert any(f.cause == "stuck" and f"'{clean.joints[3]}.velocity' stands still" in f.message for f in found)
    held = clean.position.copy()
    held[100:200, 3] = held[99, 3]
    assert diagnose(replace(clean, position=held), hyq) == ()


def test_torques_that_are_zero_throughout(hyq: Robot, clean: Recording) -> None:
    assert clean.effort is not None
    effort = clean.effort.copy()
    effort[:, 3] = 0.0
    found = diagnose(replace(clean, effort=effort), hyq)
    assert found[0].cause == "no_torque"
    assert repr(clean.joints[3]) in found[0].message


def test_a_gyro_that_is_zero_throughout_makes_the_figures_doubtful(hyq: Robot, clean: Recording) -> None:
    assert clean.imu is not None
    silent = replace(clean, imu=replace(clean.imu, angular_velocity=np.zeros((len(clean), 3))))
    found = diagnose(silent, hyq)
    assert [finding.cause for finding in found] == ["no_gyro"]
    trust = weigh(hyq, silent).trust
    assert trust.verdict == "doubtful"
    assert any("gyro is zero throughout" in reason for reason in trust.reasons)
    still = replace(silent, position=np.tile(silent.position[:1], (len(silent), 1)))
    assert not any(finding.cause == "no_gyro" for finding in diagnose(still, hyq))


@pytest.mark.parametrize("samples", [0, 1])
def test_a_log_of_no_or_one_sample_is_refused(hyq: Robot, clean: Recording, samples: int) -> None:
    short = take(clean, np.arange(len(clean)) < samples)
    with pytest.raises(RecordingError, match=f"too few samples: {samples}, at least 2 are needed$"):
        diagnose(short, hyq)


def test_a_log_without_imu_or_torques_is_looked_at_as_far_as_it_goes(hyq: Robot, clean: Recording) -> None:
    assert diagnose(replace(clean, imu=None), hyq) == ()
    assert diagnose(replace(clean, effort=None), hyq) == ()


def test_a_log_without_imu_is_told_of_no_accelerometer(hyq: Robot, clean: Recording) -> None:
    assert clean.effort is not None
    turned = np.where((np.arange(len(clean)) // (len(clean) // 10) % 3 > 0)[:, None], -1.0, 2.0) * clean.effort
    found = contradictions(replace(clean, imu=None, effort=turned), hyq)
    assert any("forces are" in clause and "off their mean direction" in clause for clause in found)
    assert not any("accelerometer" in clause for clause in found)


@cache
def slipping() -> Recording:
    return simulate(load_robot("a1"), "trot", SimulateSettings("real", duration=6.0, seed=1, hold=2)).recording


@pytest.mark.parametrize("cause", [None, "imu_frame", "joint_order"])
def test_what_a_trot_on_slipping_feet_shows_plainly_is_named(cause: str | None) -> None:
    """Feet slip and friction turns with the motion: most of the cost remains under the right hypothesis too."""
    log = wrong = slipping()
    assert log.imu is not None
    if cause == "imu_frame":
        half_turn = np.array([-1.0, -1.0, 1.0])
        turned = replace(
            log.imu,
            angular_velocity=log.imu.angular_velocity * half_turn,
            linear_acceleration=log.imu.linear_acceleration * half_turn,
            orientation=None,
        )
        wrong = replace(log, imu=turned)
    elif cause is not None:
        order = [*range(3, 6), *range(3), *range(9, 12), *range(6, 9)]
        wrong = replace(log, **{name: getattr(log, name)[:, order] for name in ("position", "velocity", "effort")})
    assert [finding.cause for finding in diagnose(wrong, load_robot("a1"))] == [cause] * (cause is not None)
