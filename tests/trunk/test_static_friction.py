"""Static friction that holds a part of a new load, until the joints have moved again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layout import ERRORS, LAYOUT
from stadera.lab.plant.sensors import STANDARD
from stadera.robot import load_robot
from stadera.robot.imu import ImuMount
from stadera.trunk.block_rows import BlockRows, SwingRows, WeightedRows, Weighting
from stadera.trunk.front import Front
from stadera.trunk.history import History
from stadera.trunk.noise import Lately
from stadera.trunk.samples import Samples
from stadera.trunk.segment import Segment
from stadera.trunk.settings import TrunkSettings
from walking import Walk, recorded, walked

RNG = np.random.default_rng(8)
FORWARD, BACKWARD = np.eye(2, dtype=bool)
JOINTS = np.arange(12)


def block(hidden: np.ndarray, slides: np.ndarray) -> WeightedRows:
    """Rows of a robot whose joints all move, but for the friction that may hide in them."""
    columns = np.hstack([RNG.standard_normal((6, 11)), np.zeros((6, ERRORS))])
    return WeightedRows(0.0, columns, 1.0, slides=slides, hidden=hidden)


def empty() -> Segment:
    return Segment.prior(np.zeros(10), np.full(10, 10.0), LAYOUT)


def test_rows_count_as_if_their_common_friction_were_one_more_unknown() -> None:
    """n equal blocks b = A θ + H f + w, all with the same f ~ N(0, 1): the mean of the b has the covariance 1/n + H Hᵀ,
    so θ has the information Aᵀ (1/n + H Hᵀ)⁻¹ A, written out here with f as further unknowns.
    """
    n, H = 7, RNG.standard_normal((6, 12))
    rows = block(np.sqrt(n) * H, np.zeros((2, 12), dtype=bool))
    segment = empty()
    for _ in range(n):
        segment = segment.add(rows)
    A, b = rows.columns[:, :10], rows.columns[:, 10]
    both = np.hstack([A, H])
    normal = n * both.T @ both + np.diag([*np.full(10, 1e-2), *np.ones(12)])
    theta = np.linalg.solve(normal, n * both.T @ b)[:10]
    covariance = np.linalg.inv(normal)[:10, :10]
    assert segment.mean(np.zeros(ERRORS)) == pytest.approx(theta, abs=1e-9)
    assert segment.inverse @ segment.inverse.T == pytest.approx(covariance, abs=1e-9)


def test_the_rows_that_are_left_are_counted() -> None:
    """Friction that hides one of six directions whole leaves five sixths of a block, of its noise too."""
    hidden = np.zeros((6, 12))
    hidden[2, 4] = 1e6
    segment = empty().add(block(hidden, np.zeros((2, 12), dtype=bool)))
    assert (segment.weight, segment.white, segment.moved) == pytest.approx((5 / 6, 5 / 6, 5 / 6))


def test_a_joint_that_has_slid_both_ways_hides_nothing_more() -> None:
    hidden = RNG.standard_normal((6, 12))
    segment, seen = empty(), block(hidden, np.zeros((2, 12), dtype=bool))
    one_way = np.outer(FORWARD, JOINTS < 6)
    segment = segment.add(replace(seen, slides=one_way))
    assert segment.felt(seen).share < 1.0
    segment = segment.add(replace(seen, slides=np.outer(BACKWARD, JOINTS < 6)))
    only_others = replace(seen, hidden=hidden * (JOINTS >= 6))
    assert segment.felt(seen).columns == pytest.approx(empty().felt(only_others).columns)
    segment = segment.add(replace(seen, slides=np.ones((2, 12), dtype=bool)))
    assert segment.felt(seen).columns == pytest.approx(seen.columns)


def test_what_holds_a_joint_that_has_slid_is_its_mean_at_standstill_and_a_part_that_changes() -> None:
    """A torque f on some joints enters the rows as E f. Before a joint has slid it is all stiction, whose sign lifts
    the trunk; then a standstill of f alone explains it, in a robot that moves.
    """
    torque, E, force = RNG.standard_normal(12), RNG.standard_normal((6, 12)), np.array([0.4, -0.3, 9.7])
    place, rests = LAYOUT.places, JOINTS % 3 == 0  # 4 of 12 joints
    lifts = np.where(force @ E[:3] > 0.0, -1.0, 1.0)  # of -E, by which friction acts on the rows
    columns = np.zeros((6, 11 + ERRORS))
    columns[:3, 0] = force
    C = columns[:, 11:]
    C[:, place["offset"]], C[:, place["stiction"]] = -E, E * lifts * rests
    C[:, place["standstill"]] = -E * ~rests
    rows = WeightedRows(0.0, columns, 1.0, hidden=np.zeros((6, 12)), rests=0.6)
    p = np.zeros(ERRORS)
    p[place["stiction"]], p[place["standstill"]] = -lifts * torque * rests, torque * ~rests
    assert empty().felt(rows).errors @ p == pytest.approx(-E @ torque)
    free = replace(empty(), slid=np.ones((2, 12), dtype=bool)).felt(rows).errors
    p[place["stiction"]], p[place["standstill"]] = 0.0, torque
    assert free @ p == pytest.approx(-E @ torque)
    assert free[:, place["stiction"]] == pytest.approx(0.6 * C[:, place["stiction"]])


def test_what_holds_a_joint_that_pauses_is_its_mean_at_standstill_and_a_part_that_changes() -> None:
    """The mean stays in its column; what changes has the column, and the sign, of a joint that stands."""
    E, force = RNG.standard_normal((6, 12)), np.array([0.4, -0.3, 9.7])
    place, pauses = LAYOUT.places, JOINTS % 2 == 0
    columns = np.zeros((6, 11 + ERRORS))
    columns[:3, 0] = force
    C = columns[:, 11:]
    C[:, place["offset"]], C[:, place["standstill"]] = -E, -E
    rows = WeightedRows(0.0, columns, 1.0, hidden=np.zeros((6, 12)), pauses=pauses)
    felt = replace(empty(), slid=np.ones((2, 12), dtype=bool)).felt(rows).errors
    lifts = np.where(force @ E[:3] > 0.0, -1.0, 1.0)  # as of a joint that stands
    assert felt[:, place["stiction"]] == pytest.approx(E * lifts * pauses)
    assert felt[:, place["standstill"]] == pytest.approx(-E)


def test_a_robot_that_has_only_stood_is_weighed_by_all_its_rows_alike() -> None:
    seen = block(RNG.standard_normal((6, 12)), np.zeros((2, 12), dtype=bool))
    columns = seen.columns.copy()
    columns[:, 11 + LAYOUT.sticking.start : 11 + LAYOUT.sticking.stop] = 1.0
    seen = replace(seen, columns=columns)
    assert empty().felt(seen) is seen


def test_a_load_begins_with_joints_that_have_not_slid_under_it() -> None:
    robot, settings = load_robot("hyq"), TrunkSettings()
    history = History(robot, np.zeros(10), LAYOUT, settings, static=np.ones(12))
    swing = SwingRows(np.zeros(12, dtype=bool), *[np.empty((0, 0))] * 4, np.ones((2, 12), dtype=bool), np.zeros(12))
    for k in range(settings.changes.pending):
        columns = np.hstack([RNG.standard_normal((6, 11)), np.zeros((6, ERRORS))])
        history.add(BlockRows(0.02 * k, 0.02, columns, np.ones(6), swing), np.zeros(ERRORS))
    assert history.current.slid.all()
    history.set_tare(np.zeros(ERRORS))
    assert history.loaded is not None
    assert not history.loaded.slid.any()
    history.begin_load(settings.changes.spoilt, np.zeros(ERRORS))
    assert not history.current.slid.any()


def test_what_friction_hides_is_that_of_a_joint_at_rest_or_at_standstill() -> None:
    columns = np.zeros((6, 11 + ERRORS))
    holding = LAYOUT.places["stiction"], LAYOUT.places["standstill"]
    for place, some in zip(holding, (JOINTS < 5, JOINTS >= 5), strict=True):
        columns[:, 11 + place.start : 11 + place.stop] = some
    swing = SwingRows(np.zeros(12, dtype=bool), *[np.empty((0, 0))] * 4, np.zeros((2, 12), dtype=bool), np.zeros(12))
    made = BlockRows(0.0, 0.02, columns, np.ones(6), swing)
    unit, std = np.arange(1.0, 7.0), np.linspace(0.1, 1.0, 12)
    rows = Weighting(unit, static=(holding, std), rests=0.4).weighted(made)
    assert rows.hidden == pytest.approx(std / unit[:, None])
    assert rows.rests == 0.4


def test_a_joint_pauses_after_two_blocks_at_rest_or_creeping_and_blocks_may_come_in_parts() -> None:
    velocity = np.full((12, 4), 0.5)  # the first one moves all the time
    velocity[3:9, 1], velocity[3:9, 2], velocity[3, 3] = 0.0, -0.01, 0.0  # one rests, one creeps, one turns round
    least, follows = np.full((12, 4), 0.001**2), np.ones(12, dtype=bool)
    expected = np.zeros((12, 4), dtype=bool)
    expected[4:9, 1:3] = True
    assert np.array_equal(Lately().pauses(velocity, least, follows), expected)
    parts = Lately()
    found = [parts.pauses(velocity[k : k + 2], least[k : k + 2], follows[:2]) for k in range(0, 12, 2)]
    assert np.array_equal(np.concatenate(found), expected)


@pytest.mark.parametrize(("period", "sway"), [(0.8, 0.0), (0.0, 0.0), (0.0, 0.01)], ids=["march", "stand", "sway"])
def test_joints_pause_in_the_stances_of_a_robot_that_marches_and_in_no_other_motion(period: float, sway: float) -> None:
    robot = load_robot("hyq")
    walk = Walk(seconds=3.0, rate_hz=500.0, speed=0.0, period=period, tilt=0.0, sway=sway, frequency=0.5)
    log = recorded(robot, walked(robot, walk), STANDARD)
    front = Front(robot, ImuMount.of(robot), TrunkSettings())
    front.take(Samples.of_recording(log, robot).table)
    swings = [made.rows.swing for made in front.made() if made.rows is not None]
    pauses, air = (np.array([getattr(swing, name) for swing in swings]) for name in ("pauses", "air"))
    if period:
        swinging = np.repeat(air & np.roll(air, 1, axis=0), 3, axis=1)
        assert pauses[swinging].mean() < 0.1 < pauses.mean()
    else:
        assert not pauses.any()
