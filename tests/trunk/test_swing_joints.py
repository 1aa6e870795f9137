"""What legs in the air tell of their joints, and single wild samples."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from layout import LAYOUT, PLACES
from stadera.constants import GRAVITY
from stadera.lab.control.legs import LegDynamics
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.robot import Robot, load_robot
from stadera.robot.imu import ImuMount
from stadera.robot.stance import standing_configuration
from stadera.trunk import TrunkEstimator, TrunkSettings
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.front import Front
from stadera.trunk.samples import Samples
from stadera.trunk.settings import ModelErrors, SwingDetection
from stadera.trunk.spikes import SpikeFilter
from stadera.trunk.swing import SwingJoints

ROTOR, VISCOUS, COULOMB, BY_LOAD, OFFSET, LAG = 0.04, 0.4, 1.5, 0.08, 0.6, 4e-3
IN_THE_AIR = np.array([True, True, False, False])


@cache
def robot() -> Robot:
    return load_robot("hyq")


def swung(blocks: int, noise: float, wild: float = 0.0, seed: int = 0) -> SwingJoints:
    """Two legs that swing, friction and rotors alike, torques late."""
    rng = np.random.default_rng(seed)
    swing = SwingJoints(ErrorModel(robot(), ModelErrors()), SwingDetection())
    for k in range(blocks):
        phase = 0.4 * k + np.arange(12)
        velocity, acceleration = 3.0 * np.cos(phase), 60.0 * np.sin(1.7 * phase)
        sign, rate = np.tanh(velocity / 0.02), 400.0 * np.cos(0.9 * phase)
        terms = np.stack([acceleration, velocity, sign, sign * np.abs(20.0 * np.sin(2.3 * phase)), np.ones(12)])
        asked = np.array([ROTOR, VISCOUS, COULOMB, BY_LOAD, OFFSET]) @ terms
        # h + asked = τ = τ_measured + d τ̇, so h - τ_measured = d τ̇ - asked
        residual = LAG * rate - asked + noise * rng.standard_normal(12)
        if wild and k % 20 == 7:
            residual[4] += wild
        swing.add(IN_THE_AIR, terms, rate, residual, np.full(12, noise), np.zeros(12))
    return swing


@pytest.mark.parametrize("wild", [0.0, 60.0])
def test_joints_are_found_and_wild_rows_left_out(wild: float) -> None:
    mean, covariance = swung(200, 0.1, wild).posterior()
    std = np.sqrt(np.diag(covariance))
    truth = {"rotor": ROTOR, "viscous": VISCOUS, "coulomb": COULOMB, "load_friction": BY_LOAD, "offset": OFFSET}
    for name, value in truth.items():
        seen = slice(PLACES[name].start, PLACES[name].start + 6)
        assert (np.abs(mean[seen] - value) < 3.0 * std[seen]).all(), name
        # beyond a twentieth of the limit's prior everything is learnt, but for a friction law's error over a swing
        assert (std[seen] < 0.3 * value + 0.05).all() or wild, name
    assert mean[PLACES["torque_lag"]][0] == pytest.approx(LAG, abs=5e-4)


def test_more_strides_tell_no_more_of_a_law_that_errs_in_each() -> None:
    """Of fifty rows of a joint the noise still counts, then what repeats."""
    swings = [swung(blocks, 0.1) for blocks in (60, 240, 480)]
    few, many, more = (np.sqrt(np.diag(swing.posterior(strides_alike=True)[1])) for swing in swings)
    seen = slice(PLACES["viscous"].start, PLACES["viscous"].start + 6)
    assert (many[seen] < 0.9 * few[seen]).all()
    assert more[seen] == pytest.approx(many[seen], rel=0.05)


def test_legs_that_never_swung_share_what_others_showed() -> None:
    """Drives of one kind are alike: a hind knee's friction moves towards that of the front ones, its bar stays wide."""
    mean, covariance = swung(200, 0.1).posterior()
    for name, value in (("coulomb", COULOMB), ("load_friction", BY_LOAD)):
        hind, front = PLACES[name].start + 8, PLACES[name].start + 2
        assert 0.4 * value < mean[hind] < 1.1 * value
        assert covariance[hind, hind] > 4.0 * covariance[front, front]
    assert abs(mean[PLACES["offset"].start + 8]) < 0.05  # an offset is each joint's own


def test_what_holds_a_joint_that_sticks_is_neither_its_offset_nor_its_friction() -> None:
    """Of joints that slide half of the time and else tremble, held by friction against the same push."""
    rng = np.random.default_rng(0)
    swing = SwingJoints(ErrorModel(robot(), ModelErrors()), SwingDetection())
    for k in range(400):
        phase = 0.4 * k + np.arange(12)
        slides = k % 20 < 10
        velocity = 3.0 * np.cos(phase) if slides else 0.01 * rng.standard_normal(12)
        acceleration = 60.0 * np.sin(1.7 * phase) if slides else rng.standard_normal(12)
        sign = np.tanh(velocity / 0.02)
        terms = np.stack([acceleration, velocity, sign, np.zeros(12), np.ones(12)])
        acts = COULOMB * sign if slides else np.full(12, 0.7 * COULOMB)
        moved = (ROTOR * acceleration + VISCOUS * velocity) * slides
        residual = -(moved + acts) + 0.05 * rng.standard_normal(12)
        swing.add(IN_THE_AIR, terms, np.zeros(12), residual, np.full(12, 0.05), 1.0 - np.tanh(velocity / 0.04) ** 2)
        swing.posterior()
    mean, covariance = swing.posterior()
    for name, truth in (("coulomb", COULOMB), ("offset", 0.0), ("viscous", VISCOUS), ("rotor", ROTOR)):
        seen = slice(PLACES[name].start, PLACES[name].start + 6)
        assert (np.abs(mean[seen] - truth) < 3.0 * np.sqrt(np.diag(covariance)[seen])).all(), name
    assert mean[PLACES["offset"]][:6] == pytest.approx(0.0, abs=0.2 * COULOMB)
    assert mean[PLACES["coulomb"]][:6] == pytest.approx(COULOMB, rel=0.1)
    assert not swing.stepped.any()


def test_a_torque_that_is_off_from_the_beginning_does_not_hide_by_what_it_leaves_of_all_rows() -> None:
    rng, none, off = np.random.default_rng(0), np.zeros(12), 30.0
    swing = SwingJoints(ErrorModel(robot(), ModelErrors()), SwingDetection())
    for k in range(120):
        phase = 0.4 * k + np.arange(12)
        velocity = 3.0 * np.cos(phase)
        terms = np.stack([60.0 * np.sin(1.7 * phase), velocity, np.tanh(velocity / 0.02), none, none + 1.0])
        acts = np.array([ROTOR, VISCOUS, COULOMB, 0.0, OFFSET]) @ terms + off * (np.arange(12) == 4)
        swing.add(IN_THE_AIR, terms, none, 0.1 * rng.standard_normal(12) - acts, none + 0.1, none)
        swing.posterior()
    assert list(np.flatnonzero(swing.stepped)) == [4]
    assert swing.stepped[4] == pytest.approx(off, abs=2.0)


def test_what_a_log_s_beginning_does_not_tell_is_no_torque_that_changed() -> None:
    """Joints that swing evenly at first do not show the inertia of their rotors."""
    rng = np.random.default_rng(0)
    model, none = ErrorModel(robot(), ModelErrors()), np.zeros(12)
    rotor = np.sqrt(np.diag(model.covariance)[PLACES["rotor"]])
    swing = SwingJoints(model, SwingDetection())
    for k in range(120):
        velocity = 3.0 * np.cos(0.4 * k + np.arange(12))
        acceleration = np.full(12, 10.0 / rotor) if k > 60 else none
        terms = np.stack([acceleration, velocity, np.sign(velocity), none, none + 1.0])
        acts = rotor * acceleration + np.array([0.0, VISCOUS, COULOMB, 0.0, OFFSET]) @ terms
        swing.add(IN_THE_AIR, terms, none, 0.05 * rng.standard_normal(12) - acts, none + 0.05, none)
        swing.posterior()
    assert not swing.stepped.any()


def test_nothing_in_the_air_leaves_the_prior() -> None:
    model = ErrorModel(robot(), ModelErrors())
    mean, covariance = SwingJoints(model, SwingDetection()).posterior(np.full(LAYOUT.by_swing.stop, 0.5))
    assert not mean.any()
    np.testing.assert_allclose(covariance, 0.25 * model.covariance[:61, :61], rtol=1e-6)


def test_single_wild_samples_are_replaced_and_impacts_stay() -> None:
    rng, n = np.random.default_rng(0), 12
    filtered = SpikeFilter()

    def block(k: int) -> Samples:
        t = 0.002 * (10 * k + np.arange(n))
        wave = np.sin(20.0 * t)[:, None]
        return Samples(
            t,
            0.2 * wave * np.ones(12) + 1e-4 * rng.standard_normal((n, 12)),
            4.0 * wave * np.ones(12) + 0.02 * rng.standard_normal((n, 12)),
            20.0 * wave * np.ones(12) + 0.2 * rng.standard_normal((n, 12)),
            0.5 * wave * np.ones(3) + 0.003 * rng.standard_normal((n, 3)),
            9.81 + 0.05 * rng.standard_normal((n, 3)),
        )

    def cleaned(samples: Samples) -> Samples:
        return Samples.of_table(filtered.clean(samples.table, (n - 2,), 12)[0], 12)

    for k in range(30):
        usual = block(k)
        np.testing.assert_array_equal(cleaned(usual).effort, usual.effort)
    wild = block(30)
    wild.effort[5, 3] += 60.0
    clean = cleaned(wild)
    assert (clean.effort != wild.effort).sum() == 1
    assert abs(clean.effort[5, 3] - 0.5 * (wild.effort[4, 3] + wild.effort[6, 3])) < 1e-9
    garbled = block(31)  # a message of zeros
    for channel in (garbled.position, garbled.velocity, garbled.effort, garbled.specific_force):
        channel[5] += 5.0 * np.sign(channel[4])
    np.testing.assert_allclose(
        cleaned(garbled).specific_force[5], garbled.specific_force[[4, 6]].mean(axis=0), atol=1e-9
    )
    step = block(32)
    step.effort[6:, 3] += 60.0  # a step is no single sample
    np.testing.assert_array_equal(cleaned(step).effort[:, 3], step.effort[:, 3])
    impact = block(33)  # trunk and joints within one sample
    impact.specific_force[5, 2] += 100.0
    impact.velocity[5, 1] -= 3.0
    np.testing.assert_array_equal(cleaned(impact).table, impact.table)
    assert filtered.replaced == 2
    edge = block(34)  # belongs to the block before, and is counted there
    edge.effort[0, 3] += 300.0
    assert cleaned(edge).effort[0, 3] != edge.effort[0, 3]
    assert filtered.replaced == 2


def test_the_impulse_of_a_hard_touchdown_is_kept() -> None:
    """Specific force and velocities of a trunk that falls and is stopped within a sample, five times a second: their
    means stay, of which the first is gravity.
    """
    rng, n, rate, dt = np.random.default_rng(1), 12, 5.0, 0.002
    filtered, force, kept = SpikeFilter(), [], []
    for k in range(200):
        t = dt * (10 * k + np.arange(n))
        struck = (np.round(t / dt).astype(int) % round(1.0 / (rate * dt)) == 7)[:, None]
        height = np.array([0.0, 0.0, 1.0])
        samples = Samples(
            t,
            1e-4 * rng.standard_normal((n, 12)),
            0.02 * rng.standard_normal((n, 12)) + 2.0 * struck * np.ones(12),
            0.2 * rng.standard_normal((n, 12)),
            0.003 * rng.standard_normal((n, 3)),
            9.81 * 0.9 * height + 0.05 * rng.standard_normal((n, 3)) + struck * height * 0.1 * 9.81 / (rate * dt),
        )
        force.append(samples.specific_force[1:-1])
        kept.append(filtered.clean(samples.table, (n - 2,), 12)[0][1:-1, -3:])
    assert abs(np.concatenate(force)[:, 2].mean() - 9.81) < 0.02
    np.testing.assert_array_equal(kept, force)


@pytest.mark.parametrize(("name", "scenario"), [("anymal_c", "crawl"), ("go2", "trot")])
def test_rotors_that_the_model_lacks_are_found_by_legs_in_the_air(name: str, scenario: str) -> None:
    """On four feet each carries a quarter of the weight, and a light leg's rotors seem to carry a third."""
    model = load_robot(name)
    limit = {joint: model.limits[joint].effort for joint in model.tree.joints}
    turned = {joint: replace(model.dynamics[joint], armature=3e-4 * limit[joint]) for joint in model.tree.joints}
    real = replace(model, dynamics=turned)
    run = simulate(real, scenario, SimulateSettings("standard", duration=5.0, seed=1, rate=500.0, hold=2))
    estimator = TrunkEstimator(model)
    estimator.add(Samples.of_recording(run.recording, model))
    place = PLACES["rotor"]
    joints = [joint for leg in model.legs for joint in leg.joints]
    found, std = estimator._fit.errors.mean[place], estimator._fit.errors.std[place]
    truth = np.array([turned[joint].armature for joint in joints])
    knees = slice(2, None, 3)
    assert estimator._fit.swing.rows > 50
    np.testing.assert_allclose(found[knees], truth[knees], rtol=0.2)
    assert (np.abs(found - truth) < 4.0 * std).all()


def airborne(share: float, bent: bool, moving: float = 0.0, noise: float = 1e-4, turn: float = 0.0) -> np.ndarray:
    """Legs in the air (windows, 4) of a robot on three feet, at 1 kHz, the fourth of which carries a share of the
    weight, stands higher where the knee is bent, and moves by the thigh [rad/s]; noise of the velocities [rad/s]. The
    trunk turns about the vertical [rad/s], and the feet stay where they are on the ground.
    """
    model = robot()
    legs, q, dq = LegDynamics(model), standing_configuration(model).copy(), np.zeros(12)
    first = legs.columns[0]
    if bent:
        q[first] += [0.0, np.sign(q[first[1]]) * 0.25, np.sign(q[first[2]]) * 0.5]  # the foot goes up
    up, omega = np.array([0.0, 0.0, GRAVITY]), np.array([0.0, 0.0, turn])
    still = legs.at(q, dq, omega, up)
    dq[legs.columns] = np.linalg.solve(still.jacobians(still.feet), -np.cross(omega, still.feet)[..., None])[..., 0]
    dq[first[1]] += moving
    state = legs.at(q, dq, omega, up)
    assert bool(state.feet[0, 2] - state.feet[1:, 2].max() > 0.1) == bent
    shares = np.array([share, *[(1.0 - share) / 3.0] * 3])
    soles = state.feet - [[0.0, 0.0, leg.foot_radius or 0.0] for leg in model.legs]
    force = shares[:, None] * model.mass * up
    effort = np.zeros(12)
    effort[legs.columns] = state.bias - np.einsum("lcj,lc->lj", state.jacobians(soles), force)
    effort += np.array([model.dynamics[joint].viscous for joint in model.tree.joints]) * dq
    n = 400
    rng = np.random.default_rng(0)
    white = 1e-4 * rng.standard_normal((n, 12))
    velocity = dq + noise * rng.standard_normal((n, 12))
    samples = Samples(
        0.001 * np.arange(n), q + 0 * white, velocity, effort + white, omega + 0 * white[:, :3], up + white[:, :3]
    )
    maker, air = Front(model, ImuMount.of(model), TrunkSettings()), []
    for k in range(0, n - 22, 20):
        made = maker.blocks(samples.table[k : k + 22], (20,))[0]
        if made.rows is not None:
            air.append(made.rows.swing.air)
    return np.array(air)


@pytest.mark.parametrize("share", [0.25, 0.0])
def test_a_foot_on_a_step_is_in_the_air_only_if_it_carries_nothing(share: float) -> None:
    air = airborne(share, bent=True)
    assert (air[:, 0] == (share == 0.0)).all()
    assert not air[:, 1:].any()


@pytest.mark.parametrize(
    ("share", "moving", "expected"), [(0.0, 1.0, True), (0.0, 0.0, False), (0.25, 1.0, False), (0.0, 0.2, False)]
)
def test_a_low_foot_is_in_the_air_only_if_it_moves_and_carries_nothing(
    share: float, moving: float, expected: bool
) -> None:
    """1 rad/s of the thigh are 0.7 m/s of the foot; a foot that slides carries weight."""
    air = airborne(share, bent=False, moving=moving)
    assert (air[:, 0] == expected).all()
    assert not air[:, 1:].any()


def test_feet_that_stand_under_a_turning_trunk_do_not_move() -> None:
    """With the wrong sign of ω x p a foot would seem to move by up to 1 m/s relative to the others."""
    assert not airborne(0.0, bent=False, turn=1.0).any()
    assert airborne(0.0, bent=False, moving=1.0, turn=1.0)[:, 0].all()


def test_noise_of_accelerations_is_no_force() -> None:
    """A velocity's noise of 0.06 rad/s at 1 kHz is one of 40 rad/s² of an acceleration, but not over 5 ms."""
    air = airborne(0.0, bent=True, noise=0.06)
    assert air[:, 0].mean() > 0.9
    assert not air[:, 1:].any()


def test_a_torque_that_jumps_or_is_off_all_the_time_is_named_by_the_leg_in_the_air() -> None:
    """By a knee that is off by more than that the foot seems to carry while it swings."""
    model = robot()
    run = simulate(model, "trot", SimulateSettings("standard", duration=6.0, seed=2, rate=500.0, hold=2))
    samples = Samples.of_recording(run.recording, model)
    at = [joint for leg in model.legs for joint in leg.joints].index(model.tree.joints[5])
    for since, off, leg in ((3.5, 0.0, False), (3.5, 10.0, False), (0.0, -15.0, False), (0.0, -30.0, True)):
        effort = samples.effort.copy()
        effort[samples.time > since, 5] += off
        estimator = TrunkEstimator(model)
        estimator.add(replace(samples, effort=effort))
        said = [reason for reason in estimator.trust.reasons if "swings" in reason]
        assert (estimator.trust.verdict == "good") == (off == 0.0)
        assert len(said) == (off != 0.0)
        assert all((f"leg {model.legs[1].name}" if leg else repr(model.tree.joints[5])) in reason for reason in said)
        assert estimator._fit.swing.stepped[at] == pytest.approx(0.0 if leg else off, abs=2.0 if since else 3.0)
        assert list(np.flatnonzero(estimator._fit.swing.heavy)) == [1] * leg


@pytest.mark.parametrize(
    ("swings", "air", "heavy"),
    [
        ([40, 61, 61, 60], [0, 26, 35, 36], [True, False, False, False]),  # a knee that is off, in a rough trot
        ([100, 102, 104, 134], [20, 37, 46, 68], [False] * 4),  # rough swings of a sound robot
        ([45, 44, 44, 53], [45, 42, 44, 16], [False, False, False, True]),
        ([45, 44, 44, 53], [45, 42, 44, 34], [False] * 4),
        ([73, 83, 90, 72], [19, 1, 0, 19], [False] * 4),  # of a real Mini Cheetah's gallop hardly any leg is in the air
        ([19, 61, 61, 60], [0, 50, 50, 50], [False] * 4),  # too few swings to tell
    ],
)
def test_the_rougher_the_swings_the_more_legs_differ(swings: list[int], air: list[int], heavy: list[bool]) -> None:
    joints = SwingJoints(ErrorModel(load_robot("anymal_b"), ModelErrors()), SwingDetection())
    joints.swings[:] = swings, air
    assert joints.heavy.tolist() == heavy
