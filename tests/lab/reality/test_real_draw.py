"""Real errors: drawn from the seed alone, present in the log as drawn, and kept out of everything but the truth."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stadera.lab.plant.model import DryFriction
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.world import TrueState
from stadera.lab.reality.draw import REAL_SETS, DrawnRobot, RealSizes, drawn
from stadera.lab.reality.log import TrueMotion, measured_log
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import Run, simulate
from stadera.lab.truth import truth_json
from stadera.robot import load_robot
from stadera.robot.imu import ImuMount
from stadera.robot.model import Frame, Robot
from stadera.robot.stance import standing_configuration

GO2 = load_robot("go2")
EXACT = replace(
    RealSizes(),
    noise=(0.0, 0.0),
    lost=(0.0, 0.0),
    spikes=(0.0, 0.0),
    quantised=0.0,
    encoder_zero=0.0,
    delay=(0.003, 0.003),
    varying=None,
)


@cache
def shaken(seed: int) -> Run:
    return simulate(GO2, "shake", SimulateSettings(errors="real", seed=seed, duration=1.0))


def thrown(robot: Robot, steps: int = 60) -> tuple[list[TrueState], np.ndarray]:
    """True states of a plant that is pushed about, and what MuJoCo's own IMU reads."""
    plant = Plant(robot)
    plant.reset(standing_configuration(robot))
    states, imu, rng = [], [], np.random.default_rng(0)
    limit = np.array([robot.limits[joint].effort for joint in robot.tree.joints])
    for _ in range(steps):
        plant.step(0.5 * limit * rng.uniform(-1.0, 1.0, len(limit)))
        states.append(plant.state)
        imu.append(plant.imu_motion)
    return states, np.array(imu)


def test_the_seed_alone_makes_the_robot() -> None:
    one, same, other = (drawn(GO2, RealSizes(), seed).to_dict() for seed in (3, 3, 4))
    assert one == same
    assert one["joints"] != other["joints"]
    assert truth_json(shaken(3).truth)["drawn"]["links"] == one["links"]


def test_unit_gain_differs_by_the_common_gain_alone() -> None:
    real, unit = (drawn(GO2, REAL_SETS[name], 5) for name in ("real", "real-unit-gain"))
    assert unit.torque_gain.mean() == pytest.approx(1.0)
    assert real.torque_gain.mean() == pytest.approx(real.common_gain)
    np.testing.assert_allclose(real.torque_gain / real.common_gain, unit.torque_gain)
    np.testing.assert_array_equal(real.encoder_zero, unit.encoder_zero)


def test_sizes_over_many_draws() -> None:
    sizes, many = RealSizes(), [drawn(GO2, RealSizes(), seed) for seed in range(150)]
    assert np.std([d.common_gain for d in many]) == pytest.approx(0.03, rel=0.2)
    assert np.std([d.encoder_zero for d in many]) == pytest.approx(sizes.encoder_zero, rel=0.1)
    assert np.sqrt(np.mean([d.imu_rotation @ d.imu_rotation for d in many])) == pytest.approx(np.deg2rad(1.0), rel=0.2)
    assert np.mean([d.quantum is not None for d in many]) == pytest.approx(1 / 3, abs=0.12)
    assert {d.rate for d in many} == {200.0, 500.0, 1000.0}
    joint = GO2.legs[0].joints[2]
    limit = GO2.limits[joint].effort
    friction = np.array([d.robot.dynamics[joint].coulomb for d in many]) / limit
    assert friction.min() >= 0.003
    assert friction.max() <= 0.03
    link = GO2.trunk
    masses = np.array([d.robot.inertias[link].mass for d in many]) / GO2.inertias[link].mass
    assert masses.std() == pytest.approx(0.05, rel=0.25)
    assert all(d.robot.inertias[link].is_physical() for d in many)


def test_imu_off_its_place_is_what_mujoco_reads_there() -> None:
    """The plant's IMU, moved and turned to where the draw says, against the log made from the true motion."""
    draw = replace(drawn(GO2, EXACT, 1), gyro_offset=np.zeros(3), accelerometer_offset=np.zeros(3))
    mount = ImuMount.of(GO2)
    rotation = mount.rotation @ Rotation.from_rotvec(draw.imu_rotation).as_matrix()
    place = mount.translation + mount.rotation @ draw.imu_place
    moved = replace(GO2, frames={**GO2.frames, mount.name: Frame(GO2.trunk, rotation, place)})
    states, imu = thrown(moved)
    log = measured_log(TrueMotion.of(states, GO2), GO2, draw, 0, 1000.0)
    assert log.imu is not None
    np.testing.assert_allclose(log.imu.angular_velocity, imu[:, :3], atol=1e-9)
    np.testing.assert_allclose(log.imu.linear_acceleration, imu[:, 3:], atol=1e-7)


def test_torques_are_late_scaled_and_offset() -> None:
    draw = drawn(GO2, EXACT, 2)
    draw = replace(draw, torque_offset=np.arange(12.0))
    states, _ = thrown(GO2)
    log = measured_log(TrueMotion.of(states, GO2), GO2, draw, 0, 1000.0)
    true = np.array([state.effort for state in states])
    assert log.effort is not None
    np.testing.assert_allclose(log.effort[3:], true[:-3] * draw.torque_gain + np.arange(12.0), atol=1e-9)


def test_quantised_positions_are_differenced() -> None:
    draw: DrawnRobot = replace(drawn(GO2, EXACT, 2), quantum=2 * np.pi / 2**14, differenced=0.005)
    states, _ = thrown(GO2)
    log = measured_log(TrueMotion.of(states, GO2), GO2, draw, 0, 500.0)
    whole = log.position / draw.quantum
    np.testing.assert_allclose(whole, np.round(whole), atol=1e-9)
    true = np.array([state.joint_position for state in states])
    expected = (true[10:] - true[5:-5])[0::2] / 0.005
    assert log.velocity is not None
    assert np.abs(log.velocity[5:] - expected).max() <= draw.quantum / 0.005 + 1e-9


def test_samples_are_lost_and_wild() -> None:
    draw = replace(drawn(GO2, EXACT, 2), lost=0.3, spikes=200.0)
    states, _ = thrown(GO2, 200)
    log = measured_log(TrueMotion.of(states, GO2), GO2, draw, 0, 1000.0)
    assert 100 < len(log) < 180
    clean = measured_log(TrueMotion.of(states, GO2), GO2, replace(draw, spikes=0.0, lost=0.0), 0, 1000.0)
    kept = np.isin(clean.time, log.time)
    assert log.imu is not None
    assert clean.imu is not None
    assert log.velocity is not None
    assert clean.velocity is not None
    wild = (log.velocity != clean.velocity[kept]).sum()
    assert 2 <= wild <= 20


def test_what_varies_is_drawn_beside_all_else_and_is_in_the_log() -> None:
    real = drawn(GO2, REAL_SETS["real"], 5)
    without, whole = drawn(GO2, replace(REAL_SETS["real"], varying=None), 5).to_dict(), real.to_dict()
    assert "varying" not in without
    assert without == {name: value for name, value in whole.items() if name != "varying"}
    v = real.varying
    assert v is not None
    assert 80.0 <= v.lowpass <= 260.0
    assert 0.0 <= v.jitter <= 0.002
    assert (np.abs(v.drift) <= 0.003 * GO2.effort_limits).all()
    draw = replace(real, noise=0.0, quantum=None, lost=0.0, spikes=0.0)
    motion = TrueMotion.of(thrown(GO2, 400)[0], GO2)
    plain = measured_log(motion, GO2, replace(draw, varying=None), 0, 1000.0)
    log = measured_log(motion, GO2, replace(draw, varying=replace(v, held={"joints": 4}, jitter=0.002)), 0, 1000.0)
    assert log.effort is not None
    assert plain.effort is not None
    np.testing.assert_array_equal(log.position, plain.position[np.arange(400) // 4 * 4])
    np.testing.assert_allclose(log.effort[-1] - plain.effort[396], v.drift, rtol=0.01)
    assert (np.diff(log.time) > 0.0).all()
    assert 3e-4 < np.std(log.time - plain.time) < 1e-3
    assert log.imu is not None
    assert plain.imu is not None
    np.testing.assert_array_equal(log.imu.angular_velocity, plain.imu.angular_velocity)
    spectra = [np.abs(np.fft.rfft(one.imu.linear_acceleration[:, 0])) for one in (plain, log)]  # type: ignore[union-attr]
    frequency = np.fft.rfftfreq(400, 1e-3)
    assert spectra[1][frequency > 400].mean() < 0.5 * spectra[0][frequency > 400].mean()


def test_friction_follows_position_and_load() -> None:
    law = DryFriction(np.ones(2), np.zeros(2), np.ones(2), np.array([[0.0, 0.3, -0.1]] * 2), np.array([0.0, 0.1]))
    np.testing.assert_allclose(law.at(np.array([0.25, 0.75]), np.array([9.0, -9.0])), [1.15, 2.0])
    np.testing.assert_allclose(law.at(np.array([-1.0, 2.0]), np.zeros(2)), [1.0, 0.9])
    plant = Plant(GO2, friction=replace(law, **_wide(12)))
    plant.reset(standing_configuration(GO2))
    plant.step(np.full(12, 5.0))
    plant.step(np.full(12, 5.0))
    np.testing.assert_allclose(plant._model.dof_frictionloss[6:], 0.7 + 0.5)


def _wide(n: int) -> dict[str, np.ndarray]:
    one = np.ones(n)
    return {"coulomb": one, "low": -9.0 * one, "high": 9.0 * one, "variation": np.full((n, 3), -0.3), "load": 0.1 * one}


def test_the_truth_is_in_the_truth_file_only() -> None:
    run = shaken(3)
    assert not run.recording.notes
    assert run.model is GO2
    trunk = run.truth.moments[0].mass
    assert trunk == pytest.approx(truth_json(run.truth)["drawn"]["links"][GO2.trunk][0])
    assert trunk != pytest.approx(GO2.inertias[GO2.trunk].mass, rel=1e-3)


def test_a_rate_asked_for_comes_before_the_drawn_one() -> None:
    settings = SimulateSettings(errors="real", seed=3, duration=0.2, rate=250.0)
    steps = np.diff(simulate(GO2, "stand", settings).recording.time)
    assert np.mean(steps) == pytest.approx(0.004, rel=0.03)  # stamps jitter, and samples are lost
