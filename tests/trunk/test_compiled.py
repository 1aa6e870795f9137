"""What is compiled gives what the numpy code gives: random motions, robots of other geometry, blocks of all lengths."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import stadera.compiled
from arm import with_arm
from stadera.lab.plant import STANDARD, RigidMass
from stadera.legs.base_wrench import BaseWrenchRegressor
from stadera.robot import JointDynamics, Robot, load_robot
from stadera.robot.imu import ImuMount
from stadera.robot.stance import standing_configuration
from stadera.trunk import Samples, SwingDetection, TrunkEstimator
from stadera.trunk.changes import ChangeDetector
from stadera.trunk.compiled_changes import CompiledDetector
from stadera.trunk.compiled_front import CompiledFront, front
from stadera.trunk.error_model import ERRORS, PLACES, ErrorModel
from stadera.trunk.front import BLIND, Front
from stadera.trunk.joint_errors import Errors
from stadera.trunk.measurement import Measurement
from stadera.trunk.row_sums import RowSums
from stadera.trunk.segment import Segment, WeightedRows
from stadera.trunk.settings import ChangeSettings, ModelErrors
from stadera.trunk.swing import SwingJoints
from walking import Walk, recorded, walked

pytest.importorskip("numba")

MOUNT = ImuMount(np.eye(3), np.array([0.1, -0.05, 0.07]), "imu")
MOUNT.translation.setflags(write=False)


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
    """Over thirty blocks of n samples, with spikes, and an interruption and a restart between."""
    reference, compiled = Front(made, MOUNT, SwingDetection()), front(made, MOUNT, SwingDetection())
    assert isinstance(compiled, CompiledFront)
    trunk, table = made.inertias[made.trunk], data.table
    rng = np.random.default_rng(0)
    table[rng.integers(len(table), size=20), rng.integers(1, table.shape[1], size=20)] += 3.0
    for block, start in enumerate(range(0, min(len(data) - n - 2, 30 * n), n)):
        if block == 12:
            reference.interrupt()
            compiled.interrupt()
        if block == 20:
            reference.forget()
            compiled.forget()
        a, b = (maker.block(table[start : start + n + 2], trunk) for maker in (reference, compiled))
        assert a.refused == b.refused
        assert_near(compiled.torque_noise, reference.torque_noise, "noise")
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
    assert compiled.spikes == reference.spikes
    assert (compiled.spikes > 0) == (n > 1)  # of three samples none can be judged


def test_refusals_are_alike() -> None:
    made, data = robot("hyq"), samples("hyq", 500.0, 0)
    position, force = data.position.copy(), data.specific_force.copy()
    position[10:, BaseWrenchRegressor(made).columns[2]] = 0.0
    force[5] = 0.0
    table = replace(data, position=position, specific_force=force).table
    for maker in (Front(made, MOUNT, SwingDetection()), front(made, MOUNT, SwingDetection())):
        noise = maker.torque_noise
        assert maker.block(table[:12], made.inertias[made.trunk]).refused == BLIND
        assert maker.block(table[10:22], made.inertias[made.trunk]).refused == 2
        np.testing.assert_array_equal(maker.torque_noise, noise)


def test_legs_in_the_air_are_found_alike() -> None:
    """In a walk, whose legs do swing."""
    made = robot("hyq", dry=False)
    data = Samples.of_recording(recorded(made, walked(made, Walk(seconds=2.0, rate_hz=500.0)), STANDARD), made)
    seen, fronts = np.zeros(4, dtype=bool), (Front(made, MOUNT, SwingDetection()), front(made, MOUNT, SwingDetection()))
    for start in range(0, len(data) - 12, 10):
        a, b = (maker.block(data.table[start : start + 12], made.inertias[made.trunk]).rows for maker in fronts)
        if a is not None and b is not None:
            np.testing.assert_array_equal(a.swing.air, b.swing.air)
            seen |= a.swing.air
    assert seen.sum() >= 3


@pytest.fixture
def without_numba(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], None]]:
    """Returns a function after which numba counts as not installed, until the test ends."""

    def remove() -> None:
        monkeypatch.setattr(stadera.compiled, "available", lambda: False)
        stadera.compiled.kernel.cache_clear()

    yield remove
    stadera.compiled.kernel.cache_clear()


def test_without_numba_the_numpy_code_runs(without_numba: Callable[[], None]) -> None:
    without_numba()
    estimator = TrunkEstimator(robot("hyq"))
    assert type(estimator._front) is Front
    assert type(estimator._detector) is ChangeDetector


def weighed(name: str, rate: float) -> list[np.ndarray]:
    """All that an estimator says of a walk in which a load is put on, before and after, with spikes and a gap."""
    made = robot(name, dry=False)
    load = RigidMass.box(0.08 * made.mass, (0.2, 0.2, 0.1), (-0.1, 0.05, 0.1)).parameters
    motion = walked(made, Walk(seconds=4.5, rate_hz=rate, load=load, loaded_at=2.5))
    data, estimator = Samples.of_recording(recorded(made, motion, STANDARD, 3), made), TrunkEstimator(made)
    velocity = data.velocity.copy()
    velocity[200::97, 3] += 4.0
    data = replace(data, velocity=velocity)
    out: list[np.ndarray] = []
    for begin, end in ((0.0, 1.2), (1.25, 2.2), (2.2, 3.2), (3.2, 4.5)):
        estimator.add(data[(data.time >= begin) & (data.time < end)])
        found, known = estimator.trunk, estimator.evidence.known
        changes = [[c.time, c.noticed, c.mass, c.mass_std] for c in estimator.changes]
        out += [found.inertial.vector, found.covariance, found.inertia_std, known.mean, known.covariance()]
        out += [np.array(estimator.torque_lag), np.array(list(estimator.trust.by_leg.values())), np.array(changes)]
        if estimator.payload is not None:
            out += [estimator.payload.com, np.array([estimator.payload.mass, estimator.payload.mass_std])]
        if end == 2.2:
            estimator.tare()
    assert len(estimator.changes) == 1
    return out


@pytest.mark.parametrize(("name", "rate"), [("hyq", 500.0), ("go2", 500.0), ("go2", 200.0), ("anymal_c", 1000.0)])
def test_estimates_are_those_of_numpy(name: str, rate: float, without_numba: Callable[[], None]) -> None:
    found = weighed(name, rate)
    without_numba()
    for compiled, reference in zip(found, weighed(name, rate), strict=True):
        np.testing.assert_allclose(compiled, reference, rtol=1e-8, atol=1e-9 * np.nanmax(np.abs(reference), initial=0))


def test_a_sum_of_rows_is_lapacks(without_numba: Callable[[], None]) -> None:
    rng = np.random.default_rng(4)
    blocks = [WeightedRows(0.0, rng.standard_normal((6, 11 + ERRORS)), 1.0) for _ in range(30)]
    blocks[5].columns[:, :3] = 0.0  # a column without rows

    def summed() -> Segment:
        segment = Segment.prior(rng.standard_normal(10), np.full(10, 5.0))
        for k, rows in enumerate(blocks):
            segment = segment.add(rows, 0.99 if k % 2 else 1.0)
        return segment

    rng = np.random.default_rng(5)
    compiled = summed()
    inverse, solution = compiled.inverse, compiled.solution
    without_numba()
    rng = np.random.default_rng(5)
    reference = summed()
    assert_near(compiled.triangle, reference.triangle, "triangle")
    assert_near(inverse, reference.inverse, "inverse")
    assert_near(solution, reference.solution, "solution")
    assert compiled.cost == pytest.approx(reference.cost, rel=1e-12)
    assert compiled.count == reference.count


def test_errors_from_rows_and_swinging_legs_are_those_of_numpy(without_numba: Callable[[], None]) -> None:
    """Also of a model without rotors' errors, whose covariance is singular."""
    rng = np.random.default_rng(8)
    columns = rng.standard_normal((300, 1 + ERRORS))
    products = columns.T @ columns
    rows = RowSums(products, products, 50.0, 5.0)

    def estimated(sizes: ModelErrors) -> list[np.ndarray]:
        rng = np.random.default_rng(9)
        model = ErrorModel(robot("hyq"), sizes, 0.7)
        swing = SwingJoints(ErrorModel(robot("hyq"), ModelErrors(), 0.7), SwingDetection())
        for _ in range(60):
            air, terms = rng.uniform(size=4) < 0.4, rng.standard_normal((4, 12))
            swing.add(air, terms, *rng.standard_normal((2, 12)), np.full(12, 0.5))
        found = Errors(model, swing, 0.7, rows)
        return [found.mean, found.covariance, found.std, *swing.posterior(1.0), *swing.posterior(0.4)]

    both = (ModelErrors(), ModelErrors(rotor=0.0))
    compiled = [estimated(sizes) for sizes in both]
    without_numba()
    for sizes, found in zip(both, compiled, strict=True):
        for k, (a, b) in enumerate(zip(found, estimated(sizes), strict=True)):
            assert_near(a, b, f"part {k}")


def test_past_averages_are_those_of_numpy() -> None:
    """Random rows over more blocks than the buffer holds; a restart; errors that change on the way."""
    settings, rng = ChangeSettings(memory=4.0), np.random.default_rng(6)
    scale = np.array([80.0, 50.0, 50.0, 50.0])
    detectors = [kind(settings, scale, 0.02) for kind in (ChangeDetector, CompiledDetector)]
    segment = Segment.prior(rng.standard_normal(10), np.full(10, 5.0))
    history = [segment]
    for k in range(700):
        columns = 0.1 * rng.standard_normal((6, 11 + ERRORS))
        columns[:3, 4:10] = columns[3:, 0] = 0.0
        columns[:3, 0], columns[[4, 5, 3], [3, 1, 2]] = (0.3, 0.1, 9.8), (0.2, -0.4, 9.7)
        rows = WeightedRows(0.02 * k, columns, 1.0)
        segment = segment.add(rows)
        history.append(segment)
        if k % 10 == 0:
            mean = np.zeros(ERRORS)
            mean[:40] = 0.1 * rng.standard_normal(40)
            errors = SimpleNamespace(mean=mean, std=rng.uniform(0.1, 1.0, ERRORS))
        if k % 10 == 5:
            for detector in detectors:
                detector.learn(history[max(k - 50, 0)], errors)
        if k == 300:
            for detector in detectors:
                detector.restart(30)
        near, far = history[max(k - 50, 0)], history[max(k - 106, 0)]
        jumps = [detector.look(rows, near, far, errors, 1.3, held=True) for detector in detectors]
        assert jumps == [None, None]
        assert_near(detectors[1].suspected, detectors[0].suspected, "suspected")
        assert detectors[1]._likely == detectors[0]._likely
    for found, expected in zip(detectors[1]._spreads, detectors[0]._spreads, strict=True):
        assert_near(found, expected, "spreads")
    assert_near(detectors[1]._scatter, detectors[0]._scatter, "scatter")


def test_measurements_of_any_layout_count_alike() -> None:
    """Also strided and read-only ones, which the compiled function does not take."""
    made, data = robot("hyq"), samples("hyq", 500.0, 2)

    def learnt(extra: Callable[[np.ndarray], np.ndarray]) -> TrunkEstimator:
        estimator = TrunkEstimator(made)
        for k in range(60):
            channels = (data.position, data.velocity, data.effort, data.angular_velocity, data.specific_force)
            estimator.update(Measurement(float(data.time[k]), *(extra(channel[k]) for channel in channels)))
        return estimator

    def read_only(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values.setflags(write=False)
        return values

    expected = learnt(np.copy)._current.triangle
    for change in (lambda values: np.repeat(values, 2)[::2], read_only):
        np.testing.assert_array_equal(learnt(change)._current.triangle, expected)


def test_a_measurement_of_another_size_is_refused() -> None:
    estimator, data = TrunkEstimator(robot("hyq")), samples("hyq", 500.0, 2)
    short = Measurement(0.0, data.position[0], data.velocity[0, :-1], data.effort[0], np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match=r"\w"):
        estimator.update(short)
