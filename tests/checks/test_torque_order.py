"""Torques of single pairs of legs swapped, on robots that sway and stand, with the errors of real ones."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stadera.checks import CheckLimits, torques
from stadera.checks.diagnosis import late_imu
from stadera.checks.hypotheses import Hypothesis
from stadera.checks.instants import Instants
from stadera.checks.residual import Footing
from stadera.checks.torques import TrunkRows, _landed, _spans, misread_in_motion, torque_step
from stadera.inertia import InertialParameters
from stadera.lab.experiments.fault_kinds import FORCES
from stadera.lab.plant.sensors import STANDARD
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs import Imu, Recording
from stadera.robot import load_robot
from stadera.robot.imu import ImuMount
from stadera.weigh import diagnose
from stadera.weigh.weigh import weigh
from walking import Walk, recorded, walked

PAIRS = [("LF", "RF"), ("LH", "RH"), ("LF", "LH"), ("RF", "RH"), ("LF", "RH"), ("RF", "LH")]


@cache
def log_of(name: str, scenario: str, seed: int) -> Recording:
    """With a load of a tenth of the robot from 3 s on."""
    robot = load_robot(name)
    load = Load(0.1 * robot.mass, "kg", (0.05, 0.06, 0.15))
    settings = SimulateSettings("real", load, duration=6.0, rate=250.0, seed=seed, hold=2, load_time=3.0)
    return simulate(robot, scenario, settings).recording


def swapped(log: Recording, name: str, pair: tuple[str, str]) -> Recording:
    robot, order = load_robot(name), list(range(len(log.joints)))
    for one, other in zip(*(robot.leg(leg).joints for leg in pair), strict=True):
        i, j = log.index(one), log.index(other)
        order[i], order[j] = j, i
    assert log.effort is not None
    return replace(log, effort=log.effort[:, order])


def footing_of(log: Recording, name: str, limits: CheckLimits) -> Footing:
    robot = load_robot(name)
    return Footing(robot, Instants.of(log, robot.tree.joints, ImuMount.of(robot), limits), limits)


def order_of(log: Recording, name: str, limits: CheckLimits) -> tuple[list[Hypothesis], float] | None:
    return misread_in_motion(footing_of(log, name, limits))


SOUND = [
    ("go2", "shake", 12),
    ("hyq", "shake", 12),
    ("b1", "stand", 14),
    ("anymal_c", "crawl", 13),
    ("hyq", "crawl", 13),
    ("hyq", "trot", 17),
]
"""The logs of all tests below."""


@pytest.mark.parametrize(("name", "scenario", "seed"), SOUND)
def test_nothing_is_found_in_a_clean_log(name: str, scenario: str, seed: int) -> None:
    assert diagnose(log_of(name, scenario, seed), load_robot(name)) == ()


@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize("name", ["go2", "hyq"])
def test_on_a_robot_that_sways_two_legs_with_swapped_torques_are_named(name: str, pair: tuple[str, str]) -> None:
    log, robot = swapped(log_of(name, "shake", 12), name, pair), load_robot(name)
    (finding,) = diagnose(log, robot)
    if finding.cause in ("joint_order", "torque_order"):
        assert f"the torques of legs {pair[0]} and {pair[1]} are swapped" in finding.message
        assert finding.option.startswith("--columns MAP.toml")
    else:
        assert finding.cause == "contradiction"


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize(
    ("name", "scenario", "seed", "joint"),
    [
        ("hyq", "trot", 17, "lf_haa_joint"),
        ("hyq", "trot", 17, "rh_hfe_joint"),
        ("anymal_c", "crawl", 13, "RH_HAA"),
    ],
)
def test_a_joint_with_the_other_sign_is_named(name: str, scenario: str, seed: int, joint: str, *, whole: bool) -> None:
    """Its torque alone, or all of its values: statics of a trot do not show the one, nor kinematics the other."""
    log = log_of(name, scenario, seed)
    sign = np.where(np.array(log.joints) == joint, -1.0, 1.0)
    assert log.effort is not None
    assert log.velocity is not None
    moved = {"position": log.position * sign, "velocity": log.velocity * sign} if whole else {}
    (finding,) = diagnose(replace(log, effort=log.effort * sign, **moved), load_robot(name))
    assert f"{'all values' if whole else 'the torque'} of {joint!r}" in finding.message
    assert finding.cause in (("joint_signs" if whole else "torque_signs"), "torque_order")
    assert finding.option == "--columns MAP.toml with factor = -1"


def test_a_torque_that_friction_may_turn_has_no_sign() -> None:
    """A hip's torque in a sway scatters by 3 % of its limit."""
    log = log_of("go2", "shake", 12)
    assert log.effort is not None
    turned = replace(log, effort=log.effort * np.where(np.array(log.joints) == "FR_hip_joint", -1.0, 1.0))
    assert order_of(turned, "go2", CheckLimits()) is None
    found = order_of(turned, "go2", CheckLimits(sign_torque=0.001))
    assert found is not None
    assert "'FR_hip_joint'" in found[0][0].text


def test_another_order_that_a_push_explains_too_is_a_doubt() -> None:
    log = swapped(log_of("go2", "shake", 12), "go2", ("LF", "LH"))
    (finding,) = diagnose(log, load_robot("go2"), limits=CheckLimits(order_certain=1e6))
    assert finding.cause == "torque_order"
    assert not finding.fatal
    assert finding.mend is None
    assert "or something pushes" in finding.message


@pytest.mark.parametrize("pair", PAIRS[:2])
def test_on_a_robot_that_stands_feet_that_push_against_each_other_are_a_doubt(pair: tuple[str, str]) -> None:
    log = log_of("b1", "stand", 14)
    (finding,) = diagnose(swapped(log, "b1", pair), load_robot("b1"))
    assert finding.cause == "pushing"
    assert not finding.fatal
    assert f"feet {pair[0]} and {pair[1]} would push against each other" in finding.message


@pytest.mark.parametrize(
    ("name", "scenario", "seed", "joint", "share"),
    [
        ("hyq", "trot", 17, "lf_haa_joint", 0.2),
        ("hyq", "trot", 17, "rf_hfe_joint", 0.1),
        ("anymal_c", "crawl", 13, "RH_HFE", 0.1),
        ("go2", "shake", 12, "FL_thigh_joint", 0.1),
    ],
)
def test_a_torque_that_jumps_is_named_with_its_time(
    name: str, scenario: str, seed: int, joint: str, share: float
) -> None:
    """By a share of its limit, and with a load of a tenth of the robot at the same time. A push looks alike. In the
    hips of a trot, which stand still for two thirds of the time, a tenth may be static friction.
    """
    robot, log = load_robot(name), log_of(name, scenario, seed)
    assert log.effort is not None
    effort = log.effort.copy()
    effort[log.time > 3.0, log.index(joint)] += share * robot.limits[joint].effort
    (finding,) = diagnose(replace(log, effort=effort), robot)
    assert finding.cause == "torque_step"
    assert "or something pushes" in finding.message
    assert repr(joint) in finding.message
    when = re.search(r"at about ([\d.]+) s", finding.said(log.time[0]))
    assert when is not None
    assert float(when[1]) == pytest.approx(3.0, abs=0.5)
    if finding.message.startswith(f"the torque of {joint!r}"):  # another joint may explain it as well
        size = re.search(r"jumps by (-?[\d.]+) N", finding.message)
        assert size is not None
        assert 0.5 < float(size[1]) / (share * robot.limits[joint].effort) < 2.0
    found = weigh(robot, replace(log, time=log.time + 1.7e9, effort=effort), (0.0, 2.9), force=True)
    assert found.trust.verdict != "good"
    assert any(joint in reason for reason in found.trust.reasons)
    times = [float(each) for reason in found.trust.reasons for each in re.findall(r"at about ([\d.]+) s", reason)]
    assert times == [pytest.approx(3.0, abs=0.5)]


def test_the_joint_that_is_off_all_the_time_is_named_not_one_that_is_for_a_while(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where the first shows least, another one seems to be further off, as it does nowhere else."""
    footing = footing_of(log_of("go2", "shake", 12), "go2", CheckLimits())
    starts = [span.start for span, _ in _spans(footing)]

    def stretch(_: object, __: object, ___: int, span: slice, ____: int) -> SimpleNamespace:
        squares = np.full((2, 12), -np.inf)
        squares[1, [0, 5]] = (50.0, 90.0) if span.start == starts[1] else (60.0, -np.inf)
        return SimpleNamespace(tested=(squares, np.full((2, 12), 0.2)), repeated=lambda *_: 1.0)

    monkeypatch.setattr(torques._Stretch, "of", stretch)
    found = torque_step(footing)
    assert found is not None
    assert f"the torque of {load_robot('go2').legs[0].joints[0]!r} is" in found[0].message


@pytest.mark.parametrize(("name", "scenario", "seed"), [("hyq", "trot", 17), ("go2", "shake", 12)])
def test_a_load_is_found_where_it_lands_beside_friction_and_other_errors(name: str, scenario: str, seed: int) -> None:
    footing = footing_of(log_of(name, scenario, seed), name, CheckLimits())
    rows = TrunkRows.of(footing)
    assert rows is not None
    landed = _landed(rows, rows.columns() @ rows.root, list(_spans(footing)))
    assert footing.blocks.time[landed] == pytest.approx(3.0, abs=0.2)


@pytest.mark.parametrize(("slides", "jumps"), [(0.1, False), (1e-9, True)])
def test_friction_that_holds_two_hips_otherwise_since_a_step_is_no_torque_that_jumps(
    slides: float, jumps: bool
) -> None:
    """In a crawl the hips of two legs that stand push against each other, by 6 % of their limit after it: three
    standard deviations of what friction is from rest to rest. It would be a jump if no joint ever stood still.
    """
    robot, log = load_robot("hyq"), log_of("hyq", "crawl", 13)
    assert log.effort is not None
    assert log.velocity is not None
    effort = log.effort.copy()
    for joint, sign in (("lh_haa_joint", 1.0), ("rh_haa_joint", -1.0)):
        k = log.index(joint)
        effort[(log.time > 3.0) & (np.abs(log.velocity[:, k]) < 0.1), k] += sign * 0.06 * robot.limits[joint].effort
    found = torque_step(footing_of(replace(log, effort=effort), "hyq", CheckLimits(step_slides=slides)))
    assert (found is not None) == jumps


@pytest.mark.parametrize(("away", "named"), [(0.1, True), (0.0, False)])
def test_a_joint_at_its_mechanical_stop_is_no_torque_that_jumps(away: float, named: bool) -> None:
    """What the stop carries is in no torque; [rad] between it and the joint's furthest position."""
    robot, log = load_robot("go2"), log_of("go2", "shake", 12)
    assert log.effort is not None
    joint, effort = "FL_thigh_joint", log.effort.copy()
    k = log.index(joint)
    effort[log.time > 3.0, k] += 0.1 * robot.limits[joint].effort
    reached = Instants.of(log, robot.tree.joints, None, CheckLimits()).position[:, robot.tree.joints.index(joint)].max()
    limits = {**robot.limits, joint: replace(robot.limits[joint], upper=float(reached) + away)}
    near = replace(robot, limits=limits)
    instants = Instants.of(replace(log, effort=effort), robot.tree.joints, ImuMount.of(near), CheckLimits())
    assert (torque_step(Footing(near, instants, CheckLimits())) is not None) == named


def test_a_load_is_no_torque_that_jumps_at_another_time() -> None:
    """15 % of a robot that sways slowly; half a second from it a knee seems to jump by 15 N·m."""
    robot = load_robot("hyq")
    load = InertialParameters.from_com(0.15 * robot.mass, np.array([0.1, 0.06, 0.15]), 0.13 * np.eye(3))
    walk = Walk(8.0, 250.0, 0.0, 0.0, tilt=0.1, sway=0.03, frequency=0.4, load=load, loaded_at=4.0, seed=1)
    log = recorded(robot, walked(robot, walk), STANDARD, 2)
    assert torque_step(footing_of(log, "hyq", CheckLimits())) is None


@pytest.mark.parametrize(("lasting", "repeated"), [(0.0, 1.0), (0.8, 9.0)])
def test_instants_share_an_error_as_long_as_the_rest_is_correlated(lasting: float, repeated: float) -> None:
    """Of a first-order process with the correlation ρ from instant to instant, (1 + ρ) / (1 - ρ)."""
    rng, noise = np.random.default_rng(0), np.zeros((4000, 6))
    for k in range(1, len(noise)):
        noise[k] = lasting * noise[k - 1] + rng.standard_normal(6)
    step = np.repeat(np.arange(len(noise)) >= 2000, 6).astype(float)
    left = np.column_stack([noise.ravel() + 5.0 * step, step, np.ones_like(step)])
    rows = SimpleNamespace(limit=np.ones(1), footing=SimpleNamespace(limits=CheckLimits()))
    found = torques._Stretch.repeated(SimpleNamespace(left=left, rows=rows), 0, 0)  # type: ignore[arg-type]
    assert found == pytest.approx(repeated, rel=0.1)


@pytest.mark.parametrize(("name", "scenario", "seed"), [("hyq", "crawl", 13), ("anymal_c", "crawl", 13)])
def test_a_torque_that_is_off_all_the_time_is_named(name: str, scenario: str, seed: int) -> None:
    """By a fifth of its limit."""
    robot, log = load_robot(name), log_of(name, scenario, seed)
    assert log.effort is not None
    joint = robot.legs[1].joints[1]
    effort = log.effort + np.where(np.array(log.joints) == joint, 0.2 * robot.limits[joint].effort, 0.0)
    (finding,) = diagnose(replace(log, effort=effort), robot)
    assert finding.cause == "torque_step"
    assert f"the torque of {joint!r} is " in finding.message
    assert "N·m off all the time" in finding.message
    assert weigh(robot, replace(log, effort=effort)).trust.verdict == "doubtful"


@pytest.mark.parametrize(("degrees", "verdict"), [(1.0, "good"), (3.0, "doubtful")])
def test_an_imu_that_is_turned_by_more_than_the_bars_allow_for_is_named(degrees: float, verdict: str) -> None:
    robot, log = load_robot("hyq"), log_of("hyq", "crawl", 13)
    assert log.imu is not None
    turn = Rotation.from_euler("x", degrees, degrees=True)
    gyro, force = turn.apply(log.imu.angular_velocity), turn.apply(log.imu.linear_acceleration)
    trust = weigh(robot, replace(log, imu=Imu(gyro, force, None, log.imu.frame))).trust
    assert trust.verdict == verdict
    assert any(reason.startswith("the IMU would be turned by 2.") for reason in trust.reasons) == (verdict != "good")


@pytest.mark.parametrize(("most", "named"), [(3, False), (12, True)])
def test_a_step_that_any_joint_explains_is_not_named(monkeypatch: pytest.MonkeyPatch, most: int, named: bool) -> None:
    """Four joints alike: what comes to the whole robot at once is no joint's sensor."""
    squares, sizes = np.tile(np.r_[np.full(4, 400.0), np.zeros(8)], (2, 1)), np.full((2, 12), 0.1)
    log = log_of("go2", "shake", 12)
    stretch = SimpleNamespace(tested=(squares, sizes), repeated=lambda *_: 1.0)
    monkeypatch.setattr(torques._Stretch, "of", lambda *_: stretch)
    found = torque_step(footing_of(log, "go2", CheckLimits(step_alike_most=most)))
    assert (found is not None) == named


def test_a_push_is_not_corrected_as_if_legs_were_swapped() -> None:
    robot = load_robot("go2")
    push = FORCES["a person pushes from the side"].make(robot, 2.5)
    settings = SimulateSettings("real", duration=5.0, rate=250.0, seed=18, hold=2, outside=push)
    for finding in diagnose(simulate(robot, "shake", settings).recording, robot):
        assert finding.mend is None
        assert "or something pushes or pulls the robot" in finding.message


def test_slopes_are_numpys_gradients_stretch_by_stretch() -> None:
    """With uneven steps, in stretches of 25, 1, 2, 3 and 25 instants; of one instant there is no slope."""
    rng, group = np.random.default_rng(0), np.repeat([0, 1, 2, 3, 4], [25, 1, 2, 3, 25])
    time, values = np.cumsum(rng.uniform(0.03, 0.05, len(group))), rng.normal(size=(len(group), 4, 3))
    flat = np.zeros((len(group), 12))
    found = Instants((), time, group, flat, flat, flat).slopes(values)
    for one in np.unique(group):
        at = group == one
        expected = np.gradient(values[at], time[at], axis=0) if at.sum() > 1 else np.zeros((1, 4, 3))
        np.testing.assert_allclose(found[at], expected, rtol=1e-12, atol=1e-12)
    none = Instants((), time, group, flat, flat, flat).at(np.zeros(0, dtype=int))
    assert none.slopes(values[:0]).shape == (0, 4, 3)


def test_hips_of_a_sound_robot_that_stands_are_not_accused() -> None:
    """Static friction of the hips holds what hips of the other sign would explain."""
    robot = load_robot("b1")
    load = Load(0.2 * robot.mass, "kg", (0.05, 0.04, 0.15))
    settings = SimulateSettings("real", load, duration=6.0, rate=500.0, seed=30, hold=2)
    assert diagnose(simulate(robot, "stand-load", settings).recording, robot) == ()


def test_an_order_that_does_not_explain_the_motion_itself_is_not_named() -> None:
    """Legs in the wrong order, and torques that lead the motion by 40 ms: neither order fits."""
    log = log_of("hyq", "trot", 17)
    assert log.effort is not None
    led = np.roll(log.effort, -10, axis=0)
    assert order_of(replace(log, effort=led), "hyq", CheckLimits()) is None
    wrong = swapped(replace(log, effort=led), "hyq", ("LF", "RF"))
    assert order_of(wrong, "hyq", CheckLimits(order_fits=1.0)) is not None
    assert order_of(wrong, "hyq", CheckLimits(order_fits=0.001)) is None


def test_an_order_that_gains_in_one_second_only_is_not_named() -> None:
    """Torques of two legs exchanged for a second are no order of the log's torques."""
    log = log_of("go2", "shake", 12)
    other = swapped(log, "go2", ("LF", "RF"))
    assert log.effort is not None
    assert other.effort is not None
    during = (log.time > 1.0) & (log.time < 2.0)
    mixed = replace(log, effort=np.where(during[:, None], other.effort, log.effort))
    assert order_of(mixed, "go2", CheckLimits()) is None


def test_a_restless_gyro_of_a_robot_that_moves_is_not_in_other_units() -> None:
    """By a gyro divided by 57 feet slide less, as by none; but a trunk that trots turns by more than 0.2 degrees/s."""
    log = log_of("hyq", "trot", 17)
    assert log.imu is not None
    noise = np.random.default_rng(1).standard_normal((3, len(log) + 59))
    slow = np.stack([np.convolve(row, np.full(60, 60.0**-0.5), "valid") for row in noise], axis=1)
    restless = replace(log.imu, angular_velocity=0.2 * slow, orientation=None)
    assert "gyro_unit" not in [finding.cause for finding in diagnose(replace(log, imu=restless), load_robot("hyq"))]


@pytest.mark.parametrize(("name", "scenario", "seed"), [("hyq", "trot", 17), ("anymal_c", "crawl", 13)])
def test_an_imu_that_is_late_is_named_as_that_or_not_at_all(name: str, scenario: str, seed: int) -> None:
    """By a tenth of a second; not as turned, in other units, or as torques of other legs."""
    log, robot = log_of(name, scenario, seed), load_robot(name)
    assert log.imu is not None
    by = round(0.1 * (len(log) - 1) / float(np.ptp(log.time)))
    late = replace(
        log.imu,
        angular_velocity=np.roll(log.imu.angular_velocity, by, axis=0),
        linear_acceleration=np.roll(log.imu.linear_acceleration, by, axis=0),
    )
    causes = [finding.cause for finding in diagnose(replace(log, imu=late), robot) if finding.fatal]
    assert causes in ([], ["imu_late"])
    if scenario == "trot":
        assert causes == ["imu_late"]


def test_torques_that_are_late_make_no_imu_early() -> None:
    """A sway balances better by an IMU of a moment before, as it does with friction; the feet tell that it is not."""
    log = log_of("g1", "shake", 3)
    assert log.effort is not None
    by = round(0.1 * (len(log) - 1) / float(np.ptp(log.time)))
    assert late_imu(footing_of(replace(log, effort=np.roll(log.effort, by, axis=0)), "g1", CheckLimits())) is None


def test_a_delay_by_which_feet_slide_as_before_is_none() -> None:
    """A trot balances better by another specific force; a gyro that is noise tells no delay."""
    log = log_of("hyq", "trot", 17)
    assert log.imu is not None
    noise = 0.05 * np.random.default_rng(1).standard_normal(log.imu.angular_velocity.shape)
    force = np.roll(log.imu.linear_acceleration, 10, axis=0)
    silent = replace(log.imu, angular_velocity=noise, linear_acceleration=force)
    assert late_imu(footing_of(replace(log, imu=silent), "hyq", CheckLimits())) is None


@pytest.mark.parametrize("period", [0.0, 0.8], ids=["sway", "walk"])
@pytest.mark.parametrize("name", ["hyq", "anymal_c"])
def test_an_imu_far_from_the_trunks_origin_is_no_torque_that_is_off(name: str, period: float) -> None:
    """0.29 and 0.25 m before it the IMU feels the trunk's rotation as 5 % of the weight, which front knees explain."""
    robot = load_robot(name)
    assert np.linalg.norm(ImuMount.of(robot).translation) > 0.2
    walk = Walk(seconds=6.0, rate_hz=250.0, period=period, speed=0.2 * (period > 0.0), seed=1)
    log = recorded(robot, walked(robot, walk), STANDARD, 2)
    assert diagnose(log, robot) == ()
    rows = torques.TrunkRows.of(footing_of(log, name, CheckLimits()))
    assert rows is not None
    columns = rows.columns()
    left = columns[:, 0] - rows.matrix @ np.linalg.lstsq(rows.matrix, columns[:, 0])[0]
    assert np.sqrt(np.mean(left**2)) < 2.5  # in rows of 1 % of the weight; 5 with the force at the IMU


def test_motion_decides_between_reversed_torques_and_swapped_diagonals() -> None:
    """An ANYmal's legs are mirror images to both sides: on average its torques, reversed, are those of the opposite."""
    robot = load_robot("anymal_c")
    log = recorded(robot, walked(robot, Walk(6.0, 250.0, 0.0, 0.0, tilt=0.05, sway=0.03, seed=1)), STANDARD, 2)
    assert log.effort is not None
    (finding,) = diagnose(replace(log, effort=-log.effort), robot)
    assert finding.message.startswith("the signs of all torques are reversed: ")
    assert finding.mend is not None
