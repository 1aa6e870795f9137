"""Changes of the load, on rows made by hand: a trunk of constant specific force that turns a little."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf

import numpy as np
import pytest

from layout import ERRORS, JOINTS, LAYOUT, LEARNT, PLACES
from stadera.robot import load_robot
from stadera.trunk.block_rows import BlockRows, SwingRows
from stadera.trunk.changes import ChangeDetector, Jump
from stadera.trunk.error_model import ErrorLayout, ErrorModel
from stadera.trunk.history import History, wide_prior
from stadera.trunk.joint_errors import Errors
from stadera.trunk.segment import RowSums, Segment
from stadera.trunk.settings import ChangeSettings, ModelErrors, SwingDetection, TrunkSettings
from stadera.trunk.swing import SwingJoints
from stadera.trunk.wrench import trunk_matrix, trunk_signals

BLOCK = 0.02
ROBOT = load_robot("hyq")
SCALE = ROBOT.mass * np.array([1.0, *[ROBOT.leg_length] * 3])
TRUNK = np.array([40.0, 2.0, 1.0, 0.5, *np.zeros(6)])
SETTINGS = ChangeSettings()
SLIDING = SwingRows(np.zeros(12, dtype=bool), *[np.empty((0, 0))] * 4, np.ones((2, 12), dtype=bool), np.zeros(12))


def errors(rows: RowSums | None = None, learnt: slice | None = None) -> Errors:
    model = ErrorModel(ROBOT, ModelErrors())
    return Errors(model, SwingJoints(model, SwingDetection()), None, rows, learnt)


def block(time: float, matrix: np.ndarray, error: np.ndarray, target: np.ndarray, white: float = 0.0) -> BlockRows:
    columns = np.hstack([matrix, target[:, None], error])
    return BlockRows(time, BLOCK, columns, np.full(6, white), SLIDING)


def rows(seconds: float, noise: float, load: np.ndarray, at: float, seed: int) -> list[BlockRows]:
    """Rows with noise in N and N·m; `load` comes on at a time."""
    rng, made = np.random.default_rng(seed), []
    for k in range(round(seconds / BLOCK)):
        time = k * BLOCK
        force = np.array([0.8 * np.sin(5.0 * time), 0.5 * np.cos(4.0 * time), 9.81])
        signals = trunk_signals(force[:, None], np.zeros((3, 1)), 0.5 * rng.standard_normal((3, 1)))[:, 0]
        matrix = trunk_matrix(signals)
        theta = TRUNK + (load if time >= at else 0.0)
        target = matrix @ theta + noise * rng.standard_normal(6)
        made.append(block(time, matrix, np.zeros((6, ERRORS)), target, noise**2))
    return made


def looked(
    made: Sequence[BlockRows],
    misfit: float = 1.0,
    known: Callable[[History], Errors] = lambda _: errors(),
    settings: ChangeSettings = SETTINGS,
) -> list[tuple[float, Jump]]:
    """Every jump that is found, and when; nothing begins anew. Errors are `known` by the rows, every tenth block."""
    detector = ChangeDetector(settings, SCALE, 0.3 * wide_prior(ROBOT))
    history = History(ROBOT, TRUNK, LAYOUT, TrunkSettings())
    found, p = [], errors()
    for k, r in enumerate(made):
        history.add(r, p.mean)
        if k % 10 == 0 and history.aged.blocks:
            p = known(history)
        jump = detector.look(history, p, misfit)
        if jump is not None:
            found.append((r.time, jump))
    return found


def test_a_load_is_found_soon_and_placed() -> None:
    load = np.array([2.5, -0.5, 0.2, 0.3, *np.zeros(6)])
    time, jump = looked(rows(6.0, 5.0, load, 4.0, 1))[0]
    assert 4.0 < time < 4.3
    assert jump.reported
    assert abs(time - jump.blocks * BLOCK - 4.0) < 0.15


def test_the_difference_is_that_of_two_segments(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sums of the latest rows give what a segment of them alone gives, by QR: δ, and its deviation by errors too."""
    monkeypatch.setattr(History, "noise", 1.0)  # of a segment's rows
    rng, n = np.random.default_rng(0), SETTINGS.windows[2]
    made = [
        block(r.time, r.matrix, 3.0 * rng.standard_normal((6, ERRORS)), r.target, 4.0)
        for r in rows(4.0, 2.0, np.array([3.0, 0.5, -0.3, 0.2, *np.zeros(6)]), 3.5, 2)
    ]
    wide = 0.3 * wide_prior(ROBOT)
    detector, history, known = (
        ChangeDetector(SETTINGS, SCALE, wide),
        History(ROBOT, TRUNK, LAYOUT, TrunkSettings()),
        errors(),
    )
    for r in made:
        history.add(r, known.mean)
        detector.look(history, known)
    detector._moved = True
    which, found = detector._differences(history, known)
    assert which[2] == 2
    before = history.before_last(n)
    assert before is not None
    since = Segment.prior(before.mean(known.mean), wide, LAYOUT)
    for latest in list(history.recent)[-n:]:
        since = since.add(latest)
    std = np.sqrt(np.diag(known.difference_covariance(before, since)))[:4]
    np.testing.assert_allclose(found.size[2], since.mean(known.mean) - before.mean(known.mean), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.std[2], std, rtol=0.03)  # a segment's wide prior does not follow the one before


def test_a_load_put_on_early_is_found_once_there_are_enough_blocks_before_it() -> None:
    load = np.array([5.0, -0.5, 0.2, 0.3, *np.zeros(6)])
    time, jump = looked(rows(5.0, 5.0, load, 1.5, 1))[0]
    assert 1.5 < time < 1.8
    assert abs(time - jump.blocks * BLOCK - 1.5) < 0.1


def test_a_stride_has_to_be_known_before_a_change_in_a_walk() -> None:
    """After 1 s a stride may pass for a load; a robot that does not step is compared from then on."""
    made = rows(1.5, 5.0, np.array([5.0, -0.5, 0.2, 0.3, *np.zeros(6)]), 1.1, 1)
    assert looked(made)
    assert not looked([replace(r, swing=replace(r.swing, stepping=True)) for r in made])


@pytest.mark.parametrize("misfit", [0.1, 1.0, 4.0, 25.0])
def test_where_the_model_explains_less_a_change_has_to_be_larger(misfit: float) -> None:
    """In proportion to the size of the residuals, and never smaller than five standard deviations."""
    made = rows(6.0, 5.0, np.array([2.5, -0.5, 0.2, 0.3, *np.zeros(6)]), 4.0, 1)
    larger = replace(SETTINGS, deviations=SETTINGS.deviations * max(misfit, 1.0) ** 0.5)
    assert looked(made, misfit) == looked(made, settings=larger)
    assert looked(made, misfit)[:1] != looked(made, 9.0)[:1]


@pytest.mark.parametrize("noise", [1.0, 60.0])
def test_noise_of_any_size_is_no_change(noise: float) -> None:
    """How much rows scatter is learnt: nothing of the noise is stated."""
    assert not [j for _, j in looked(rows(30.0, noise, np.zeros(10), np.inf, 2)) if j.reported]


def test_a_change_below_the_least_begins_anew_without_a_report() -> None:
    light = np.array([0.6, 0.0, 0.0, 0.0, *np.zeros(6)])
    found = looked(rows(9.0, 0.5, light, 5.0, 3))
    assert found
    assert not found[0][1].reported


def struck(made: list[BlockRows], every: float, seed: int) -> list[BlockRows]:
    """With impacts after half a second, by when there is an estimate that tells them: in single blocks a specific force
    of ten g, of which the target shows a part that varies.
    """
    rng, out = np.random.default_rng(seed), []
    for r in made:
        if rng.random() > BLOCK / every or r.time < 0.5:
            out.append(r)
            continue
        wild = trunk_matrix(np.array([0.0, 0.0, 98.1, *np.zeros(9)]))
        target = wild @ TRUNK * rng.uniform(0.6, 0.7)
        out.append(block(r.time, wild, np.zeros((6, ERRORS)), target, 25.0))
    return out


def test_a_load_is_found_among_impacts_that_bias_the_estimate() -> None:
    """One block in ten is an impact with a hundred times the weight of others, which would make the trunk a third too
    light; loads of a thirtieth of the robot's mass are found nonetheless, and nothing else.
    """
    load = np.array([2.5, -0.5, 0.2, 0.3, *np.zeros(6)])
    for seed in range(3):
        found = looked(struck(rows(8.0, 5.0, load, 6.0, seed), 0.2, seed))
        assert found
        assert 6.0 < found[0][0] < 6.5
    assert not looked(struck(rows(30.0, 5.0, np.zeros(10), np.inf, 3), 0.2, 3))


def test_nothing_is_reported_while_the_model_does_not_fit() -> None:
    load = np.array([5.0, 0.0, 0.0, 0.0, *np.zeros(6)])
    assert looked(rows(6.0, 5.0, load, 4.0, 1))
    assert not looked(rows(6.0, 5.0, load, 4.0, 1), np.inf)


def test_a_load_far_smaller_than_the_joints_disturbance_is_found_at_its_time() -> None:
    """Dry friction that the model lacks moves the vertical force by ten times the load, to and fro with the gait."""
    place, load, unit = PLACES["coulomb"].start, 2.0, np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    friction = 1.5 * errors().std[place]
    made = []
    for r in rows(7.0, 1.0, np.array([load, 0.0, 0.0, 0.0, *np.zeros(6)]), 5.0, 4):
        column = np.sign(np.sin(9.0 * r.time)) * 10.0 * load * 9.81 / friction * unit
        own = np.zeros((6, ERRORS))
        own[:, place] = column
        made.append(block(r.time, r.matrix, own, r.target + column * friction, 1.0))
    seen = []

    def known(history: History) -> Errors:
        seen.append(errors(RowSums.of((history.aged,), 5.0)))
        return seen[-1]

    time, jump = looked(made, known=known)[0]
    assert abs(seen[-1].mean[place] / friction - 1.0) < 0.1
    assert 5.0 < time < 5.5
    assert abs(time - (jump.blocks - 1) * BLOCK - 5.0) < 1.5 * BLOCK
    assert jump.reported


def stepping(seconds: float, load: np.ndarray, at: float, seed: int) -> list[BlockRows]:
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
        own = np.zeros((6, ERRORS))
        own[2, gain] = 20.0 * carried / carried.sum() * 9.81 * TRUNK[0]
        made.append(block(r.time, r.matrix, own, r.target + own[:, gain] @ true, 9.0))
    return made


def found_with(learnt: slice, made: list[BlockRows]) -> list[float]:
    """When changes are reported, with errors `learnt` that are estimated from the rows before."""
    found = looked(made, known=lambda history: errors(RowSums.of((history.aged,), 10.0), learnt))
    return [time for time, jump in found if jump.reported]


def test_a_load_is_found_within_half_a_stride_though_gains_differ() -> None:
    """Averages over a part of a stride vary by more than the load; not once the gains' effect is known."""
    load, soon = np.array([0.05 * SCALE[0], *np.zeros(9)]), []
    for seed, at in enumerate(np.linspace(6.0, 7.1, 4)):
        made = stepping(at + 0.6, load, at, seed)
        soon.append([any(time < at + 0.5 for time in found_with(learnt, made)) for learnt in (JOINTS, LEARNT)])
    without, found = np.sum(soon, axis=0)
    assert without <= 1
    assert found == 4
    assert not found_with(LEARNT, stepping(20.0, np.zeros(10), np.inf, 0))


def test_a_load_that_friction_hides_for_a_moment_is_not_gone() -> None:
    """It has to be gone in the latest blocks and in twice as many."""
    load, back, p = np.array([3.0, *np.zeros(9)]), SETTINGS.back, errors()
    detector = ChangeDetector(SETTINGS, SCALE, 0.3 * wide_prior(ROBOT))
    history = History(ROBOT, TRUNK, LAYOUT, TrunkSettings())
    before, since = (Segment.prior(TRUNK + each, np.full(10, 1e-3), LAYOUT) for each in (0.0 * load, load))
    gone = []
    for r in rows(6.0, 2.0, -load, 4.0, 3):  # with the load, which goes off at 4 s
        history.add(block(r.time, r.matrix, np.zeros((6, ERRORS)), r.target + r.matrix @ load, 4.0), p.mean)
        detector.look(history, p, inf)
        gone.append(detector.returned(before, since, history, p))
    off = round(4.0 / BLOCK)
    assert not any(gone[: off + back])
    assert all(gone[off + 2 * back + 2 :])


def test_a_load_that_is_withdrawn_leaves_nothing_in_the_rows_of_arms() -> None:
    """These are means over more blocks than those that showed that the load is gone."""
    robot, settings = load_robot("b1_z1"), TrunkSettings()
    layout = ErrorLayout.of(robot)
    history, p = History(robot, TRUNK, layout, settings), np.zeros(layout.count)

    def pass_by(blocks: int, torque: float) -> None:
        for _ in range(blocks):
            signals = trunk_signals(np.array([[0.0], [0.0], [9.81]]), np.zeros((3, 1)), np.zeros((3, 1)))[:, 0]
            made = block(BLOCK * history.blocks, trunk_matrix(signals), np.zeros((6, layout.count)), np.zeros(6))
            limbs = np.zeros((layout.limbs, made.columns.shape[1]))
            limbs[:, 10], limbs[:, 11:][:, layout.places["limb_offset"]] = torque, np.eye(layout.limbs)
            history.add(replace(made, limbs=limbs), p)

    pass_by(60, 0.0)
    pass_by(30, 1.0)
    known = history.begin_load(30, p)
    pass_by(settings.changes.back + 1, 0.0)
    history.return_to(known)
    pass_by(40, 0.0)
    assert history.current.limb_count > 0.0
    assert not history.current.of_limbs[0].any()
