"""The scale of the model errors, against draws of robots with errors of known size."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest

from layout import ERRORS, LAYOUT, PLACES, rows_of
from stadera.lab.plant.sensors import STANDARD
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs import Recording
from stadera.robot import load_robot
from stadera.robot.imu import ImuMount
from stadera.trunk import TrunkEstimator
from stadera.trunk.block_rows import WeightedRows, Weighting, unit_of_rows
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.fit import _CAUSES as CAUSES
from stadera.trunk.fit import Fit
from stadera.trunk.joint_errors import Errors
from stadera.trunk.noise import mean_third_differences_squared
from stadera.trunk.rows import RowMaker
from stadera.trunk.samples import Samples
from stadera.trunk.segment import RowSums, Segment
from stadera.trunk.settings import ModelErrors, SwingDetection, TrunkSettings
from stadera.trunk.sizes import Sizes
from stadera.trunk.swing import SwingJoints
from stadera.trunk.window import window_of
from walking import Walk, recorded, walked

RATE, BLOCK = 500.0, 10
STAND = Walk(seconds=1.0, rate_hz=RATE, speed=0.0, period=0.0, tilt=0.0, sway=0.0)
WALK = Walk(seconds=1.6, rate_hz=RATE)
ROBOT = load_robot("hyq")
DRAWS = 100


@cache
def rows(walk: Walk) -> tuple[tuple[WeightedRows, ...], ErrorModel, float]:
    """Rows of exact signals, with the prior of the model errors and the leg's length."""
    maker, motion = RowMaker(ROBOT, ImuMount.of(ROBOT), SwingDetection()), walked(ROBOT, walk)
    specific = motion.specific_force  # the lever's part is small and the same in all draws
    s = Samples(motion.time, motion.position, motion.velocity, motion.effort, motion.angular_velocity, specific)
    trunk, sizes, length = ROBOT.inertias[ROBOT.trunk], (BLOCK,) * ((len(s) - 3) // BLOCK), ROBOT.leg_length
    window, s = window_of(sizes), s[: BLOCK * len(sizes) + 2]
    squares = mean_third_differences_squared(s.table[:, 1:], window)
    at = motion.normal[window.edges[:-1] + BLOCK // 2][window.block]
    blocks = maker.blocks(s, sizes, maker.motion(s)._replace(normal=at), trunk, squares)[0]
    weighting = Weighting(unit_of_rows(ROBOT))
    made = [weighting.weighted(block) for block in blocks if block is not None]
    return tuple(made), ErrorModel(ROBOT, ModelErrors()), length


def prior(length: float) -> Segment:
    wide = ROBOT.mass * np.array([1.0, *[0.5 * length] * 3, *[0.5 * length**2] * 6])
    return Segment.prior(ROBOT.inertias[ROBOT.trunk].vector, wide, LAYOUT)


def drawn(walk: Walk, scale: float, seed: int) -> Segment:
    """Summed rows of a robot whose model errors are drawn, times a scale."""
    made, model, length = rows(walk)
    rng, theta = np.random.default_rng(seed), ROBOT.inertias[ROBOT.trunk].vector
    values, vectors = np.linalg.eigh(model.covariance)
    p = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(ERRORS))
    kept = np.ones(ERRORS, dtype=bool)
    for name in ("common_gain", "sampling", "stiction"):
        kept[PLACES[name]] = False
    p = np.where(kept, scale * p, p)
    segment = prior(length)
    for block in made:
        noise = np.sqrt(block.white / 6.0) * rng.standard_normal(6)
        target = block.matrix @ theta + block.errors @ p + noise
        segment = segment.add(rows_of(block.time, block.matrix, block.errors, target, block.white))
    return segment


def standardised(walk: Walk, scale: float) -> np.ndarray:
    """Errors of mass and first moment in x and y over their standard deviations, (DRAWS, 3)."""
    _, model, _ = rows(walk)
    swing, truth, found = SwingJoints(model, SwingDetection()), ROBOT.inertias[ROBOT.trunk].vector, []
    for seed in range(1000, 1000 + DRAWS):
        segment = drawn(walk, scale, seed)
        summed, sizes = RowSums.of((segment,), 5.0), Sizes(LAYOUT, TrunkSettings().size_spread)
        usual = Errors(model, swing, None, summed, LAYOUT.by_swing)
        for _ in range(4 if summed.moved else 0):
            sizes.update(*usual.evidence(swing))
        errors = Errors(model, swing, sizes.factors)
        std = np.sqrt(np.diag(errors.trunk_covariance(segment)))
        found.append(((segment.mean(errors.mean) - truth) / std)[:3])
    return np.array(found)


@pytest.mark.parametrize(
    ("walk", "scale", "least"),
    [(STAND, 0.5, 0.9), (STAND, 1.0, 0.9), (WALK, 1.0, 0.9), (WALK, 2.0, 0.65)],
    ids=str,
)
def test_bars_hold_at_other_sizes_of_the_errors(walk: Walk, scale: float, least: float) -> None:
    """Twice the stated sizes in all kinds are at the edge of what their prior allows, and few directions show them."""
    within = (np.abs(standardised(walk, scale)) < 2.0).mean(axis=0)
    assert (within >= least).all(), within


@pytest.mark.filterwarnings("error")
def test_sampling_errors_that_resemble_late_torques_leave_no_negative_energy() -> None:
    """As at the beginning of a log: an estimate of the lag from rows with an impact errs with their sampling errors,
    which so leave less of their own energy, and none less than nothing to the other errors.
    """
    _, model, _ = rows(STAND)
    swing = SwingJoints(model, SwingDetection())
    places = [PLACES[name].start for name in ("torque_lag", "common_gain", "sampling")]
    made = np.zeros((2, 1 + ERRORS))
    made[:, [1 + place for place in places]] = np.array([[-23.0, 6.0, -21.0], [3.0, 1.0, -28.0]])
    made[:, 1:] /= np.sqrt(np.diag(model.covariance))
    summed = RowSums(*2 * [made.T @ made], 2.0, 10.0, 1.0)
    errors = Errors(model, swing, None, summed)
    assert abs(errors.covariance[places[0], places[2]]) > 0.3 * np.prod(errors.std[[places[0], places[2]]])
    assert Fit.of(summed, errors).misfit >= 0.0


@cache
def walk_log() -> Recording:
    return recorded(ROBOT, walked(ROBOT, WALK), STANDARD)


@pytest.mark.parametrize("name", [size.name for size in fields(ModelErrors)])
def test_an_error_that_is_taken_to_be_none_explains_nothing(name: str) -> None:
    """With feet a quarter of a leg off in the model, so that much is left to explain."""
    settings = TrunkSettings(model=replace(ModelErrors(), **{name: 0.0}))
    moved = [replace(leg, foot_position=tuple(np.add(leg.foot_position, [0.0, 0.0, 0.2]))) for leg in ROBOT.legs]
    wrong = replace(ROBOT, legs=tuple(moved))
    estimator = TrunkEstimator(wrong, settings=settings)
    estimator.add(Samples.of_recording(walk_log(), wrong))
    assert estimator.trust.misfit > settings.doubtful
    assert "the residual is" in estimator.trust.reasons[0]
    assert not any(CAUSES.get(name, "nothing") in reason for reason in estimator.trust.reasons)
    assert 0.0 < estimator.trunk.mass_std < ROBOT.mass


def test_a_leg_that_does_not_fit_is_reason_to_doubt_where_all_rows_together_fit() -> None:
    """A knee's torque read 1.75 times as large, in a sway: the other joints' rows hide it from the misfit of all."""
    robot, settings = load_robot("anymal_c"), TrunkSettings()
    log = simulate(robot, "shake", SimulateSettings("standard", None, duration=8.0, seed=3)).recording
    for factor, verdict in ((1.0, "good"), (1.75, "doubtful")):
        effort = log.effort.copy()
        effort[:, 2] *= factor
        estimator = TrunkEstimator(robot, settings=settings)
        estimator.add(Samples.of_recording(replace(log, effort=effort), robot))
        trust = estimator.trust
        assert (trust.verdict, trust.misfit < settings.doubtful) == (verdict, True), trust
        assert any("joints of LF" in reason for reason in trust.reasons) == (verdict == "doubtful"), trust
