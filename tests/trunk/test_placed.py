"""Loads on limbs: their rows, and the odds of places, against dense normal distributions of all rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.body import Body
from stadera.robot import load_robot
from stadera.trunk.block_rows import WeightedRows
from stadera.trunk.error_model import QUIETEST, ErrorLayout
from stadera.trunk.history import RobustWeights
from stadera.trunk.limbs import LimbRows, by_mass_and_centre
from stadera.trunk.placed import Held, log_odds
from stadera.trunk.segment import Segment
from stadera.trunk.settings import OutlierSettings
from stadera.types import Array

OF_DRIVES = ("rotor", "viscous", "coulomb", "stiction")
LAYOUT = ErrorLayout(6, 6, 2, (3, 3), limbs=3)
PLACES, BLOCKS, LOUDER = 2, 30, 7.0
LOUD = 4.0  # variance of rows that repeat one error
WIDE = np.array([3.0, *[1.0] * 3, *[0.5] * 6])
USUAL = 0.2 * WIDE
SHOWN = np.isin(np.arange(LAYOUT.count), np.r_[(LAYOUT.learnt, *LAYOUT.changing)])
"""Errors that residuals show, or that change with the load; scales of torques are neither."""


def drawn(rng: np.random.Generator, at: int | None) -> list[WeightedRows]:
    """Rows of a trunk and of a load at a place, with errors of the robot, the same in all logs."""
    p, out = 0.005 * SHOWN * np.random.default_rng(1).standard_normal(LAYOUT.count), []
    for k in range(BLOCKS):
        trunk, limbs = rng.standard_normal((6, 11 + LAYOUT.count + 10 * PLACES)), rng.standard_normal((3, 11))
        limbs = np.hstack([limbs, rng.standard_normal((3, LAYOUT.count + 10 * PLACES))])
        limbs[:, :10] = trunk[:, -9:] = limbs[:, -9:] = 0.0  # of a load at the last place its mass alone is told
        trunk[:, 11 + LAYOUT.sticking.start + 1 : 11 + LAYOUT.sticking.stop] = 0.0  # most joints move
        for rows, noise in ((trunk, 0.01), (limbs, 0.01 / np.sqrt(LOUDER))):
            load = rows[:, 11 + LAYOUT.count :].reshape(len(rows), PLACES, 10)
            own = 0.0 if at is None else 0.2 * load[:, at].sum(axis=1)
            rows[:, 10] = 0.1 * rows[:, :10].sum(axis=1) + own + rows[:, 11 : 11 + LAYOUT.count] @ p
            rows[:, 10] += noise * rng.standard_normal(len(rows))
        out.append(WeightedRows(0.02 * k, trunk, 1.0, limbs=limbs))
    return out


def summed(rows: list[WeightedRows]) -> Segment:
    segment = Segment.prior(np.zeros(10), WIDE, LAYOUT, PLACES)
    for each in rows:
        segment = segment.add(each, louder=LOUDER)
    return segment


def likelihood(earlier: list[WeightedRows], rows: list[WeightedRows], covariance: Array, at: int | None) -> float:
    """ln of the density of all rows since the load, and of the triangle and the limbs' rows before it, for a load at a
    place; their noise is `LOUD`.
    """
    root, end, changing = np.sqrt(LOUDER), 11 + LAYOUT.count, np.r_[tuple(LAYOUT.changing)]
    limbs = np.vstack([root * each.limbs for each in earlier if each.limbs is not None])
    before = np.vstack([summed(earlier).triangle, limbs])
    since = np.vstack([np.vstack([each.columns, root * each.limbs]) for each in rows if each.limbs is not None])
    A = np.vstack([before[:, :10], since[:, :10]])
    load = since[:, :10] if at is None else since[:, end + 10 * at :][:, :10]
    Y = np.vstack([np.zeros((len(before), 10)), load])
    C = np.vstack([before[:, 11:end], since[:, 11:end]])
    then, n = np.zeros((len(A), LAYOUT.count)), len(before)
    then[:n, changing], C[:n, changing] = C[:n, changing], 0.0  # other errors than those since
    b = np.concatenate([before[:, 10], since[:, 10]])
    flat = 1e4 * A @ A.T  # the trunk is known by the triangle
    S = LOUD * np.eye(len(b)) + flat + Y @ np.diag(USUAL**2) @ Y.T
    S += C @ covariance @ C.T + then @ covariance @ then.T
    return float(-0.5 * (b @ np.linalg.solve(S, b) + np.linalg.slogdet(S)[1]))


@pytest.mark.parametrize("at", [None, 0, 1])
def test_odds_of_places_are_those_of_the_density_of_all_rows(at: int | None) -> None:
    rng = np.random.default_rng(3)
    earlier, rows = drawn(rng, None), drawn(rng, at)
    covariance = 0.05**2 * np.eye(LAYOUT.count)
    odds = log_odds(summed(rows), summed(earlier), ((0,), (1,), (2,)), covariance, LOUD / QUIETEST, USUAL)
    dense = np.array([likelihood(earlier, rows, SHOWN * covariance, place) for place in (None, 0, 1)])
    np.testing.assert_allclose(
        odds - odds[0], dense - dense[0], rtol=1e-3, atol=0.3
    )  # the weak prior of the trunk is in the odds alone
    if at is not None:
        assert int(np.argmax(odds)) == 1 + at


def test_rows_of_limbs_count_with_the_variance_of_the_trunks() -> None:
    rng = np.random.default_rng(5)
    before, rows = summed(drawn(rng, None)).with_load(None), drawn(rng, 1)
    segment = summed(rows).with_load(Held((2,), before))
    assert segment.load is not None
    root, end = np.sqrt(LOUDER), 11 + LAYOUT.count
    since = np.vstack([np.vstack([each.columns, root * each.limbs]) for each in rows if each.limbs is not None])
    known = before.triangle[:, :11]
    prior = np.hstack([np.diag(1.0 / WIDE), np.zeros((10, 10))]), np.hstack([np.zeros((10, 10)), np.diag(1.0 / WIDE)])
    A = np.vstack(
        [np.hstack([known[:, :10], np.zeros((10, 10))]), *prior, since[:, [*range(10), *range(end + 10, end + 20)]]]
    )
    b = np.concatenate([known[:, 10], np.zeros(20), since[:, 10]])
    found = np.linalg.lstsq(A, b, rcond=None)[0]
    np.testing.assert_allclose(segment.load.mean(np.zeros(LAYOUT.count)), found[10:], rtol=1e-8, atol=1e-9)


def test_residuals_of_limbs_are_not_the_trunks() -> None:
    """Without a load elsewhere: each row's energy is in its own sum, and none is lost."""
    rows = drawn(np.random.default_rng(6), None)
    segment, alone = summed(rows), summed([replace(each, limbs=None) for each in rows])
    np.testing.assert_allclose(segment.in_motion, alone.in_motion, rtol=1e-10)
    of_limbs = np.vstack([each.limbs for each in rows if each.limbs is not None])[:, 10 : 11 + LAYOUT.count]
    np.testing.assert_allclose(segment.of_limbs, of_limbs.T @ of_limbs, rtol=1e-9, atol=1e-9)


def test_each_row_has_a_usual_size_of_its_own() -> None:
    """Rows of a wrist scatter as those of a waist do, each in its unit, and one that is always so is no outlier."""
    rng, sizes = np.random.default_rng(2), np.array([0.1, 3.0])
    segment = Segment.prior(np.zeros(10), WIDE, LAYOUT)
    for each in drawn(rng, None):
        segment = segment.add(WeightedRows(each.time, each.columns[:, : 11 + LAYOUT.count], 1.0))
    robust = RobustWeights(OutlierSettings(), least=1e-6, each=True)
    columns, weights = np.zeros((2, 11 + LAYOUT.count)), []
    for _ in range(300):
        columns[:, 10] = sizes * rng.standard_normal(2)
        weights.append(robust.weight(columns, segment, np.zeros(LAYOUT.count)))
    np.testing.assert_allclose(np.sqrt(robust.noise), sizes, rtol=0.25)
    assert np.mean(weights) == pytest.approx(1.0, abs=0.15)


def test_joints_of_limbs_share_the_scale_of_all_torques_and_either_rest_or_slide() -> None:
    """Signs of velocities that are noise would tell that joints which rest have no friction."""
    robot = load_robot("b1_z1")
    body, layout, rng = Body.of(robot), ErrorLayout.of(robot), np.random.default_rng(0)
    limbs = LimbRows(robot, body, (), layout)
    count = len(limbs.joints)
    still = rng.uniform(size=(4, count)) < 0.5
    sums = {"limb_terms": rng.uniform(0.5, 1.5, (4, count, 5)), "limb_left": np.zeros((4, count))}
    sums["limb_columns"] = rng.standard_normal((4, count, count, 10))
    limbs.quieten(sums, np.zeros(4, dtype=bool), None, still)
    C = limbs.rows(sums, by_mass_and_centre(body), still)[:, :, 11:]
    at = {name: np.diagonal(C[:, :, layout.places[f"limb_{name}"]], axis1=1, axis2=2) for name in (*OF_DRIVES, "gain")}
    np.testing.assert_array_equal(C[:, :, layout.places["common_gain"].start], at["gain"])
    for name in OF_DRIVES:
        np.testing.assert_array_equal(at[name] != 0.0, still if name == "stiction" else ~still)
