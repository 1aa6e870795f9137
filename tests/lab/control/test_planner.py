"""Where the centre of mass is to be, and its way there: geometry, and a programme that keeps what it promises."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from stadera.lab.control.com_plan import GroundPlane, PlanError, SupportPhase, SupportPolygon, facing, plan_com
from stadera.lab.control.steps import (
    CrawlCommand,
    CrawlSettings,
    PathPose,
    Step,
    StepTiming,
    body_times,
    footholds,
    support_phases,
)
from stadera.robot import load_robot

FEET = np.array([[0.37, 0.21], [0.37, -0.21], [-0.37, 0.21], [-0.37, -0.21]])
TIMING = StepTiming(step=0.8, swing=0.35, transfer=0.06)

coordinates = st.floats(-1.0, 1.0)
points = st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=6).map(np.array)


def has_area(corners: np.ndarray) -> bool:
    return float(np.linalg.svd(corners - corners.mean(axis=0))[1][-1]) > 0.05


@settings(deadline=None, max_examples=60)
@example(np.array([(0.0, 0.0), (0.0, 6.103515625e-05), (1e-08, -1.0), (-1.0, 0.0)]), (-0.5, 0.0), 0.0)
@given(points.filter(has_area), st.tuples(coordinates, coordinates), st.floats(0.0, 0.1))
def test_the_goal_keeps_the_margin_and_nothing_nearer_does(
    corners: np.ndarray, wish: tuple[float, float], margin: float
) -> None:
    polygon = SupportPolygon.of(corners)
    goal = polygon.goal(wish, margin)
    # the hull against scipy's, and the margin against distances to its edges' lines
    hull = ConvexHull(corners)
    distances = -(hull.equations[:, :2] @ goal + hull.equations[:, 2])
    assert polygon.margin(goal) == pytest.approx(distances.min(), abs=1e-9)
    assert polygon.margin(goal) > -1e-9
    inside = polygon.margin(polygon.centroid)
    assert polygon.margin(goal) >= min(margin, inside) - 1e-6
    if polygon.margin(goal) >= margin - 1e-9:
        rng = np.random.default_rng(0)
        others = rng.dirichlet(np.ones(len(corners)), 300) @ corners
        kept = np.array([polygon.margin(other) >= margin for other in others])
        nearest = np.linalg.norm(goal - np.array(wish))
        assert (np.linalg.norm(others[kept] - np.array(wish), axis=1) >= nearest - 1e-9).all()


def test_contacts_in_a_line_are_no_polygon() -> None:
    with pytest.raises(PlanError, match="in one line"):
        SupportPolygon.of([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.5, 0.5]])


def walk_phases(stride: float) -> list[SupportPhase]:
    steps = [Step(leg, FEET[leg] + [stride, 0.0], TIMING.body) for leg in (2, 0, 3, 1)]
    return support_phases(FEET, steps, TIMING, 0.03, 1.0)


@pytest.mark.parametrize("rest", [0.0, 1.0])
def test_the_way_keeps_zero_moment_point_and_centre_of_mass_over_the_feet(rest: float) -> None:
    phases, height = walk_phases(0.3), 0.6
    plan = plan_com(2.0, np.zeros((3, 2)), phases, height, 0.03, rest)
    begin = 2.0
    for phase in phases:
        for time in np.linspace(begin, begin + phase.duration, 12):
            position, _, acceleration = plan.at(time)
            # 2 mm between the pieces' ends, where the constraints are
            assert phase.support.margin(position - height / 9.81 * acceleration) > 0.028
            assert phase.support.margin(position) > 0.028
        begin += phase.duration
    assert plan.end == pytest.approx(begin)
    np.testing.assert_allclose(plan.at(plan.end + 1.0)[1:], 0.0, atol=1e-5)
    np.testing.assert_allclose(plan.at(plan.end)[0], phases[-1].goal, atol=0.03)


def test_the_ways_velocity_and_acceleration_are_its_derivatives() -> None:
    start = np.array([[0.02, -0.01], [0.1, 0.05], [0.0, 0.2]])
    plan = plan_com(0.0, start, walk_phases(0.2), 0.6, 0.03)
    np.testing.assert_allclose(plan.at(0.0), start, atol=1e-9)
    for time in np.linspace(0.05, 3.0, 17):
        before, after, now = plan.at(time - 1e-5), plan.at(time + 1e-5), plan.at(time)
        np.testing.assert_allclose((after - before)[:2] / 2e-5, now[1:], atol=2e-4)


def test_supports_follow_the_steps() -> None:
    phases = walk_phases(0.3)
    assert [phase.rests for phase in phases] == [False, True] * 4 + [False]
    assert sum(phase.duration for phase in phases) == pytest.approx(4 * 0.8 + TIMING.transfer + 1.0)
    assert [len(phase.support.corners) for phase in phases[::2]] == [4] * 5
    np.testing.assert_allclose(phases[-1].goal, [0.3, 0.0], atol=1e-12)
    landing = support_phases(FEET, [], TIMING, 0.03, 1.0, Step(1, FEET[1], 0.2))
    assert [phase.duration for phase in landing] == [0.2, 1.0]


def test_the_body_has_more_time_where_it_goes_farther() -> None:
    times = body_times(FEET, (2, 0, 3, 1), 0.3, TIMING, 0.6, 0.03)
    assert times.mean() == pytest.approx(TIMING.body)
    assert min(times[[0, 2]]) > max(times[[1, 3]])  # to the other side before hind legs


def test_the_path_is_an_arc() -> None:
    """Against many small straight steps."""
    path, small = PathPose(np.zeros(2), 0.2), PathPose(np.zeros(2), 0.2)
    for _ in range(2000):
        small = small.ahead(0.3, 0.5, 1e-3)
    end = path.ahead(0.3, 0.5, 2.0)
    np.testing.assert_allclose(end.position, small.position, atol=1e-6)
    assert end.heading == pytest.approx(1.2)
    offsets, pose = footholds(np.column_stack([FEET, np.zeros(4)]), 0.0)
    np.testing.assert_allclose([pose.place(offset) for offset in offsets], FEET, atol=1e-12)


def test_the_trunk_faces_along_the_plane_through_the_feet() -> None:
    feet = np.column_stack([FEET, 0.1 + FEET @ [0.2, -0.1]])
    plane = GroundPlane.of(feet)
    np.testing.assert_allclose([plane.at(foot) for foot in feet], feet[:, 2], atol=1e-12)
    rotation = facing(plane.normal, 0.4)
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert np.arctan2(rotation[1, 0], rotation[0, 0]) == pytest.approx(0.4)
    np.testing.assert_allclose(rotation[:, 2], plane.normal)


def test_faster_walks_have_shorter_cycles_and_rest_less() -> None:
    sizes = CrawlSettings.of(load_robot("hyq"))
    slow, fast = sizes.timing(CrawlCommand(0.05)), sizes.timing(CrawlCommand(-0.2))
    assert slow.step == pytest.approx(sizes.cycle / 4)
    assert fast.step == pytest.approx(sizes.longest_stride / 0.8)
    assert slow.rest == 1.0
    assert fast.rest < 0.2
