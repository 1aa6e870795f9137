"""Changes of the load, on rows made by hand: a trunk of constant specific force that turns a little."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from layout import ERRORS, JOINTS, LAYOUT, LEARNT, PLACES
from stadera.robot import load_robot
from stadera.trunk.changes import ChangeDetector, Jump
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.joint_errors import Errors
from stadera.trunk.segment import RowSums, Segment, WeightedRows
from stadera.trunk.settings import ChangeSettings, ModelErrors, SwingDetection
from stadera.trunk.swing import SwingJoints
from stadera.trunk.wrench import trunk_matrix, trunk_signals

BLOCK = 0.02
SCALE = np.array([50.0, 30.0, 30.0, 30.0])
TRUNK = np.array([40.0, 2.0, 1.0, 0.5, *np.zeros(6)])
ROBOT = load_robot("hyq")


def errors() -> Errors:
    model = ErrorModel(ROBOT, ModelErrors(), 0.7)
    return Errors(model, SwingJoints(model, SwingDetection()))


def rows(seconds: float, noise: float, load: np.ndarray, at: float, seed: int) -> list[WeightedRows]:
    """Rows of unit 1 N and 1 N·m; `load` comes on at a time."""
    rng, made = np.random.default_rng(seed), []
    for k in range(round(seconds / BLOCK)):
        time = k * BLOCK
        force = np.array([0.8 * np.sin(5.0 * time), 0.5 * np.cos(4.0 * time), 9.81])
        signals = trunk_signals(force[:, None], np.zeros((3, 1)), 0.5 * rng.standard_normal((3, 1)))[:, 0]
        matrix = trunk_matrix(signals)
        theta = TRUNK + (load if time >= at else 0.0)
        target = matrix @ theta + noise * rng.standard_normal(6)
        made.append(WeightedRows.of(time, matrix, np.zeros((6, ERRORS)), target, 6.0 * noise**2))
    return made


def looked(made: list[WeightedRows], settings: ChangeSettings, held: bool = False) -> list[tuple[float, Jump]]:
    """Every jump that is found, and when; nothing begins anew."""
    detector, known = ChangeDetector(settings, SCALE, BLOCK, LAYOUT), errors()
    before = Segment.prior(TRUNK, 50.0 * np.ones(10), LAYOUT)
    recent: deque[WeightedRows] = deque()
    found = []
    for k, r in enumerate(made):
        recent.append(r)
        if len(recent) > settings.pending:
            before = before.add(recent.popleft())
        if k % 10 == 0:
            detector.learn(before, known)
        jump = detector.look(r, before, known, held)
        if jump is not None:
            found.append((r.time, jump))
    return found


def test_a_load_is_found_soon_and_placed() -> None:
    load = np.array([2.5, -0.5, 0.2, 0.3, *np.zeros(6)])
    time, jump = looked(rows(6.0, 5.0, load, 4.0, 1), ChangeSettings())[0]
    assert 4.0 < time < 4.3
    assert jump.reported
    assert abs(time - jump.blocks * BLOCK - 4.0) < 0.15


def test_a_load_put_on_after_a_second_is_found_once_averages_can_be_compared() -> None:
    settings = ChangeSettings()
    load = np.array([5.0, -0.5, 0.2, 0.3, *np.zeros(6)])
    time, jump = looked(rows(5.0, 5.0, load, 1.0, 1), settings)[0]
    soonest = settings.history + settings.pending * BLOCK
    assert soonest <= time < soonest + 0.5
    assert abs(time - jump.blocks * BLOCK - 1.0) < 0.15


@pytest.mark.parametrize("noise", [1.0, 10.0, 60.0])
def test_noise_of_any_size_is_no_change(noise: float) -> None:
    """How much averages vary is learnt: nothing of the noise is stated."""
    assert not [j for _, j in looked(rows(30.0, noise, np.zeros(10), np.inf, 2), ChangeSettings()) if j.reported]


def test_a_change_below_the_least_begins_anew_without_a_report() -> None:
    light = np.array([0.6, 0.0, 0.0, 0.0, *np.zeros(6)])
    found = looked(rows(9.0, 0.5, light, 5.0, 3), ChangeSettings())
    assert found
    assert not found[0][1].reported


def struck(made: list[WeightedRows], every: float, seed: int) -> list[WeightedRows]:
    """With impacts: in single blocks a specific force of ten g, of which the target shows a part that varies."""
    rng, out = np.random.default_rng(seed), []
    for r in made:
        if rng.random() > BLOCK / every:
            out.append(r)
            continue
        wild = trunk_matrix(np.array([0.0, 0.0, 98.1, *np.zeros(9)]))
        target = wild @ TRUNK * rng.uniform(0.6, 0.7)
        out.append(WeightedRows.of(r.time, wild, np.zeros((6, ERRORS)), target, r.white))
    return out


def test_a_load_is_found_among_impacts_that_bias_the_estimate() -> None:
    """One block in ten is an impact with a hundred times the weight of others, and makes the trunk seem a third too
    light; loads of a twentieth of the robot's mass are found nonetheless, and nothing else.
    """
    load = np.array([2.5, -0.5, 0.2, 0.3, *np.zeros(6)])
    for seed in range(3):
        found = looked(struck(rows(8.0, 5.0, load, 6.0, seed), 0.2, seed), ChangeSettings())
        assert found
        assert 6.0 < found[0][0] < 6.5
    assert not looked(struck(rows(30.0, 5.0, np.zeros(10), np.inf, 3), 0.2, 3), ChangeSettings())


def test_nothing_is_reported_while_the_model_does_not_fit() -> None:
    load = np.array([5.0, 0.0, 0.0, 0.0, *np.zeros(6)])
    assert looked(rows(6.0, 5.0, load, 4.0, 1), ChangeSettings())
    assert not looked(rows(6.0, 5.0, load, 4.0, 1), ChangeSettings(), held=True)


def test_a_load_far_smaller_than_the_joints_disturbance_is_found_at_its_time() -> None:
    """Dry friction that the model lacks moves the vertical force by ten times the load, to and fro with the gait."""
    place, load, unit = PLACES["coulomb"].start, 1.0, np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    model = ErrorModel(ROBOT, ModelErrors(), 0.7)
    swing, settings = SwingJoints(model, SwingDetection()), ChangeSettings()
    friction = 1.5 * np.sqrt(model.covariance[place, place])
    made = []
    for r in rows(7.0, 1.0, np.array([load, 0.0, 0.0, 0.0, *np.zeros(6)]), 5.0, 4):
        column = np.sign(np.sin(9.0 * r.time)) * 10.0 * load * 9.81 / friction * unit
        errors = np.zeros((6, ERRORS))
        errors[:, place] = column
        made.append(WeightedRows.of(r.time, r.matrix, errors, r.target + column * friction, r.white))
    detector = ChangeDetector(settings, SCALE, BLOCK, LAYOUT)
    before, known, found = Segment.prior(TRUNK, 50.0 * np.ones(10), LAYOUT), Errors(model, swing), []
    for k, r in enumerate(made):
        if k > settings.pending:
            before = before.add(made[k - settings.pending - 1])
        if k % 10 == 0 and before.blocks:
            known = Errors(model, swing, None, RowSums.of((before,), 5.0))
            detector.learn(before, known)
        jump = detector.look(r, before, known, held=False)
        if jump is not None:
            found.append((r.time, jump))
    assert abs(known.mean[place] / friction - 1.0) < 0.1
    time, jump = found[0]
    assert 5.0 < time < 5.5
    assert abs(time - (jump.blocks - 1) * BLOCK - 5.0) < 1.5 * BLOCK
    assert jump.reported


def stepping(seconds: float, load: np.ndarray, at: float, seed: int) -> list[WeightedRows]:
    """Weight that shifts to and fro between the joints with a stride of 1.1 s, and torques with gains that differ.

    Forces of bent legs' joints are several times what they carry, up and down.
    """
    rng, gain, made = np.random.default_rng(seed), PLACES["gain"], []
    true = ModelErrors().gain * rng.standard_normal(12)
    true -= true.mean()
    size, turn = rng.uniform(0.3, 1.0, (2, 12)), rng.uniform(0.0, 2.0 * np.pi, (2, 12))
    for r in rows(seconds, 3.0, load, at, seed):
        phase = 2.0 * np.pi * r.time / 1.1
        carried = 1.0 + size[0] * np.sin(phase + turn[0]) + size[1] * np.sin(2.0 * phase + turn[1])
        errors = np.zeros((6, ERRORS))
        errors[2, gain] = 20.0 * carried / carried.sum() * 9.81 * TRUNK[0]
        made.append(WeightedRows.of(r.time, r.matrix, errors, r.target + errors[:, gain] @ true, r.white))
    return made


def found_with(learnt: slice, made: list[WeightedRows]) -> list[float]:
    """When changes are reported, with errors `learnt` that are estimated from the rows before."""
    model, settings = ErrorModel(ROBOT, ModelErrors(), 0.7), ChangeSettings()
    swing, detector = SwingJoints(model, SwingDetection()), ChangeDetector(settings, SCALE, BLOCK, LAYOUT)
    segments, known, out = (
        [Segment.prior(TRUNK, 50.0 * np.ones(10), LAYOUT)],
        Errors(model, swing, None, None, learnt),
        [],
    )
    for k, r in enumerate(made):
        segments.append(segments[-1].add(r))
        before = segments[max(k + 1 - settings.pending, 0)]
        if k % 10 == 0 and before.blocks:
            known = Errors(model, swing, None, RowSums.of((before,), 10.0), learnt)
            detector.learn(before, known)
        jump = detector.look(r, before, known, held=False)
        if jump is not None and jump.reported:
            out.append(r.time)
    return out


def test_a_load_is_found_within_half_a_stride_though_gains_differ() -> None:
    """Averages over a part of a stride vary by more than the load; not once the gains' effect is known."""
    load, soon = np.array([0.05 * SCALE[0], *np.zeros(9)]), []
    for seed, at in enumerate(np.linspace(6.0, 7.1, 6)):
        made = stepping(at + 0.6, load, at, seed)
        soon.append([any(time < at + 0.5 for time in found_with(learnt, made)) for learnt in (JOINTS, LEARNT)])
    without, found = np.sum(soon, axis=0)
    assert without <= 1
    assert found == 6
    assert not found_with(LEARNT, stepping(20.0, np.zeros(10), np.inf, 0))
