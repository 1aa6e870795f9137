"""What is compiled gives what the numpy code gives: random motions, robots of other geometry, blocks of all lengths."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import stadera.compiled
from arm import with_arm
from stadera.robot import JointDynamics, Robot, load_robot
from stadera.robot.imu import ImuMount
from stadera.robot.stance import standing_configuration
from stadera.trunk import Samples, SwingDetection, TrunkEstimator
from stadera.trunk.compiled_rows import CompiledRowMaker, row_maker
from stadera.trunk.error_model import PLACES
from stadera.trunk.rows import RowMaker

pytest.importorskip("numba")

NORMAL = np.array([0.1, 0.2, 1.0]) / np.sqrt(1.05)
MOUNT = ImuMount(np.eye(3), np.array([0.1, -0.05, 0.07]), "imu")


@cache
def robot(name: str, dry: bool = True) -> Robot:
    plain = load_robot(name)
    if not dry:
        return plain
    return plain.with_dynamics({joint: JointDynamics(0.02, 0.3, 0.5, 0.1) for joint in plain.tree.joints})


@cache
def samples(name: str, rate: float, seed: int) -> Samples:
    """Random waves of all channels, with noise and a stamp that jitters."""
    made, rng = robot(name), np.random.default_rng(seed)
    n = 600
    time = (np.arange(n) + 0.1 * rng.uniform(size=n)) / rate

    def waves(channels: int, size: float) -> np.ndarray:
        phase = 2.0 * np.pi * time[:, None] * rng.uniform(0.5, 3.0, channels) + rng.uniform(0.0, 6.0, channels)
        return size * np.sin(phase)

    position = standing_configuration(made) + waves(len(made.tree.joints), 0.2)
    velocity = np.gradient(position, time, axis=0) + 0.02 * rng.standard_normal(position.shape)
    effort = waves(len(made.tree.joints), 0.4 * made.mass) + 0.3 * rng.standard_normal(position.shape)
    force = np.array([0.0, 0.0, 9.81]) + waves(3, 1.0) + 0.05 * rng.standard_normal((n, 3))
    return Samples(time, position, velocity, effort, waves(3, 0.5) + 0.003 * rng.standard_normal((n, 3)), force)


def assert_near(found: np.ndarray, expected: np.ndarray, what: str) -> None:
    """To 1e-9 of the largest entry."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * max(np.abs(expected).max(), 1e-300), err_msg=what)


@pytest.mark.parametrize(
    ("name", "dry"), [("hyq", True), ("hyq", False), ("go2", True), ("anymal_c", True), ("spot", True)]
)
@pytest.mark.parametrize("n", [1, 2, 4, 10, 20, 37])
def test_rows_are_those_of_numpy(name: str, dry: bool, n: int) -> None:
    assert_same_rows(robot(name, dry), samples(name, 500.0, n), n)


def test_rows_with_a_moving_arm_are_those_of_numpy(tmp_path: Path) -> None:
    data, rng = samples("go2", 500.0, 1), np.random.default_rng(7)
    assert_same_rows(with_arm("go2", tmp_path), replace(data, extra=rng.standard_normal((len(data), 6))), 10)


def assert_same_rows(made: Robot, data: Samples, n: int) -> None:
    """Over thirty blocks of n samples, with a gap and a restart between."""
    reference, compiled = RowMaker(made, MOUNT, SwingDetection()), row_maker(made, MOUNT, SwingDetection())
    assert isinstance(compiled, CompiledRowMaker)
    trunk = made.inertias[made.trunk]
    for block, start in enumerate(range(0, min(len(data) - n - 2, 30 * n), n)):
        if block == 12:
            reference.restart()
            compiled.restart()
        if block == 20:
            reference.forget()
            compiled.forget()
        a, b = (maker.block(data[start : start + n + 2], NORMAL, trunk) for maker in (reference, compiled))
        assert a.singular == b.singular
        assert_near(b.feet, a.feet, "feet")
        assert_near(b.force, a.force, "force")
        assert_near(compiled.noise.variance, reference.noise.variance, "noise")
        assert (a.rows is None) == (b.rows is None)
        if a.rows is None or b.rows is None:
            continue
        assert a.rows.time == b.rows.time
        assert a.rows.elapsed == pytest.approx(b.rows.elapsed, rel=1e-9)
        assert_near(b.rows.matrix, a.rows.matrix, "A")
        assert_near(b.rows.target, a.rows.target, "b")
        assert_near(b.rows.white, a.rows.white, "white")
        for error, place in PLACES.items():
            assert_near(b.rows.errors[:, place], a.rows.errors[:, place], error)
        for field in ("air", "terms", "rate", "residual"):
            assert_near(getattr(b.rows.swing, field), getattr(a.rows.swing, field), field)


def test_a_stretched_leg_is_named_alike() -> None:
    made, data = robot("hyq"), samples("hyq", 500.0, 0)
    position = data.position.copy()
    position[:, RowMaker(made, MOUNT, SwingDetection()).regressor.columns[2]] = 0.0
    flat = replace(data, position=position)
    for maker in (RowMaker(made, MOUNT, SwingDetection()), row_maker(made, MOUNT, SwingDetection())):
        noise = maker.noise.variance.copy()
        assert maker.block(flat[:12], NORMAL, made.inertias[made.trunk]).singular == 2
        np.testing.assert_array_equal(maker.noise.variance, noise)


def test_without_numba_the_numpy_code_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stadera.compiled, "available", lambda: False)
    stadera.compiled.kernel.cache_clear()
    try:
        maker = TrunkEstimator(robot("hyq"))._maker
        assert type(maker) is RowMaker
    finally:
        stadera.compiled.kernel.cache_clear()
