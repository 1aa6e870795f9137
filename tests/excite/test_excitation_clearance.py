"""Clearance against geometry worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from stadera.errors import IdentificationError
from stadera.excite.bounds import Clearance, ClearanceMap, LegBounds
from stadera.robot import Robot, Shape, load_robot
from stadera.robot.kinematics import foot_positions, forward_kinematics
from stadera.robot.stance import standing_configuration

Array = NDArray[np.float64]

REST = np.array([0.0, -0.65, 1.3])


@pytest.fixture(scope="module")
def hyq() -> Robot:
    return load_robot("hyq")


def shape(link: str, kind: str, size: tuple[float, ...], at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Shape:
    return Shape(link, kind, size, np.eye(3), np.array(at))  # type: ignore[arg-type]


def foot_in_trunk(robot: Robot, leg: str, poses: Array) -> Array:
    """Foot centres by forward kinematics of the whole robot, (samples, 3)."""
    leg_index = [own.name for own in robot.legs].index(leg)
    q = np.tile(standing_configuration(robot), (len(poses), 1))
    q[:, [robot.tree.joints.index(joint) for joint in robot.leg(leg).joints]] = poses
    return foot_positions(robot, q)[:, leg_index]


def with_shapes(robot: Robot, *shapes: Shape) -> Robot:
    return replace(robot, shapes=shapes)


def test_foot_to_a_sphere_on_the_trunk(hyq: Robot) -> None:
    ball = foot_in_trunk(hyq, "RH", REST[None])[0] + np.array([0.14, 0.0, 0.02])
    robot = with_shapes(hyq, shape(hyq.trunk, "sphere", (0.1,), tuple(ball)))
    clearance = Clearance.of(robot, "RH", REST)
    poses = np.random.default_rng(0).uniform(REST - 0.4, REST + 0.4, (300, 3))
    expected = np.linalg.norm(foot_in_trunk(robot, "RH", poses) - ball, axis=1) - 0.1 - robot.leg("RH").foot_radius
    np.testing.assert_allclose(clearance.distance(poses), expected, atol=1e-6)
    assert expected.min() < -0.01  # penetration is among them
    assert expected.max() > 0.05


def test_foot_to_a_box_on_the_trunk(hyq: Robot) -> None:
    middle, edges = np.array([-0.3, -0.3, -0.3]), np.array([0.2, 0.3, 0.1])
    robot = with_shapes(hyq, shape(hyq.trunk, "box", tuple(edges), tuple(middle)))
    clearance = Clearance.of(robot, "RH", REST)
    poses = np.random.default_rng(1).uniform(REST - 0.5, REST + 0.5, (300, 3))
    away = np.abs(foot_in_trunk(robot, "RH", poses) - middle) - 0.5 * edges
    outside = np.linalg.norm(np.maximum(away, 0.0), axis=1) - robot.leg("RH").foot_radius
    near = outside < 0.1
    assert near.any()
    apart = near & (outside > 0)
    np.testing.assert_allclose(clearance.distance(poses)[apart], outside[apart], atol=1e-6)
    far = ~near
    assert (clearance.distance(poses)[far] <= outside[far] + 1e-9).all()
    assert (clearance.distance(poses)[far] >= 0.1 - 1e-6).all()


def test_other_legs_stand_in_the_nominal_stance(hyq: Robot) -> None:
    link = hyq.leg("RF").links[2]
    robot = with_shapes(hyq, shape(link, "sphere", (0.3,), hyq.leg("RF").foot_position))
    poses = np.random.default_rng(2).uniform([-0.2, -1.1, 0.4], [0.2, -0.7, 1.0], (400, 3))
    still = foot_positions(robot, standing_configuration(robot)[None])[0, 1]
    expected = np.linalg.norm(foot_in_trunk(robot, "RH", poses) - still, axis=1) - 0.3 - robot.leg("RH").foot_radius
    found = Clearance.of(robot, "RH", REST).distance(poses)
    near = expected < 0.1
    assert near.any()
    np.testing.assert_allclose(found[near], expected[near], atol=1e-6)


def test_links_of_one_leg_that_are_no_neighbours(hyq: Robot) -> None:
    hip = hyq.leg("RH").links[0]
    aside = np.array([0.02, 0.1, 0.05])
    robot = with_shapes(hyq, shape(hip, "sphere", (0.23,), tuple(aside)))
    folded = np.array([[0.0, -0.65, 2.4], [0.3, 0.1, 2.44]])
    rotations, translations = forward_kinematics(robot.leg_tree("RH"), folded)
    foot = translations[:, 3] + rotations[:, 3] @ np.array(robot.leg("RH").foot_position)
    expected = (
        np.linalg.norm(foot - translations[:, 1] - rotations[:, 1] @ aside, axis=1) - 0.23 - robot.leg("RH").foot_radius
    )
    found = Clearance.of(robot, "RH", REST).distance(folded)
    assert (expected < 0.1).all()
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_neighbours_are_not_looked_at(hyq: Robot) -> None:
    first, second, third = hyq.leg("RH").links
    robot = with_shapes(
        hyq, *(shape(link, "sphere", (0.3,)) for link in (hyq.trunk, first)), shape(second, "sphere", (0.01,))
    )
    clearance = Clearance.of(robot, "RH", REST)
    looked_at = {
        frozenset((clearance.shapes[one].link, clearance.shapes[other].link)) for one, other, _ in clearance.pairs
    }
    assert not looked_at & {frozenset((hyq.trunk, first)), frozenset((first, second)), frozenset((second, third))}


def test_pairs_that_touch_at_rest_are_noted_and_left_out(hyq: Robot) -> None:
    robot = with_shapes(hyq, shape(hyq.trunk, "box", (3.0, 3.0, 3.0)))
    clearance = Clearance.of(robot, "RH", REST)
    assert clearance.notes == ("shapes of rh_lowerleg and trunk touch at rest: not looked at for clearance",)
    assert not clearance.pairs


def test_near_pairs_need_not_keep_more_than_they_have_at_rest(hyq: Robot) -> None:
    foot = foot_in_trunk(hyq, "RH", REST[None])[0]
    radius = hyq.leg("RH").foot_radius
    beside = foot + np.array([0.05 + radius + 0.003, 0.0, 0.0])
    robot = with_shapes(hyq, shape(hyq.trunk, "sphere", (0.05,), tuple(beside)))
    clearance = Clearance.of(robot, "RH", REST, margin=0.02)
    assert clearance.distance(REST[None])[0] == pytest.approx(0.003, abs=1e-6)
    assert clearance.slack(REST[None])[0] == pytest.approx(0.0, abs=1e-6)


def test_poses_are_clear_where_no_slack_is_negative(hyq: Robot) -> None:
    """With pairs that keep less than the margin at rest among them, above the ground and without."""
    bounds = LegBounds.of(hyq, "RH")
    poses = np.random.default_rng(6).uniform(bounds.lower, bounds.upper, (200, 3))
    ball = foot_in_trunk(hyq, "RH", bounds.rest[None])[0] + np.array([0.14, 0.0, 0.02])
    beside = with_shapes(hyq, shape(hyq.trunk, "sphere", (0.1,), tuple(ball)))
    for clearance in (
        bounds.clearance,
        Clearance.of(beside, "RH", bounds.rest, margin=0.02),
        Clearance.of(hyq, "RH", bounds.rest, margin=0.08),
        Clearance.of(hyq, "RH", bounds.rest, margin=0.01, ground=-0.75),
    ):
        slack = clearance.slack(poses)
        assert (np.array([clearance.clear(pose[None]) for pose in poses]) == (slack >= 0.0)).all()
        assert 0.02 < np.mean(slack >= 0.0) < 0.98
        assert clearance.clear(poses[slack >= 0.0])
        assert not clearance.clear(poses)


@pytest.mark.parametrize("kind", ["sphere", "capsule", "cylinder", "box"])
def test_height_over_ground_is_that_of_the_lowest_surface_point(hyq: Robot, kind: str) -> None:
    sizes = {"sphere": (0.08,), "capsule": (0.05, 0.2), "cylinder": (0.06, 0.2), "box": (0.1, 0.2, 0.3)}
    link = hyq.leg("RH").links[2]
    own = shape(link, kind, sizes[kind], (0.3, 0.02, 0.01))
    clearance = Clearance.of(with_shapes(hyq, own), "RH", REST, ground=-2.0)
    poses = np.random.default_rng(3).uniform(REST - 0.5, REST + 0.5, (20, 3))
    rotations, translations = forward_kinematics(hyq.leg_tree("RH"), poses)
    points = surface(kind, sizes[kind]) + own.translation
    lowest = (translations[:, 3, 2, None] + rotations[:, 3, 2] @ points.T).min(axis=1)
    foot = foot_in_trunk(hyq, "RH", poses)[:, 2] - hyq.leg("RH").foot_radius
    expected = np.minimum(lowest, foot) + 2.0
    np.testing.assert_allclose(clearance.height(poses), expected, atol=2e-4)


def surface(kind: str, size: tuple[float, ...]) -> Array:
    """Many points on a shape's surface, (points, 3)."""
    rng = np.random.default_rng(4)
    ball = rng.normal(size=(200_000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    match kind:
        case "sphere":
            return ball * size[0]
        case "capsule":
            return ball * size[0] + np.sign(ball[:, 2:]) * [0.0, 0.0, size[1] / 2]
        case "cylinder":
            angle = rng.uniform(0, 2 * np.pi, 50_000)
            rim = size[0] * np.column_stack((np.cos(angle), np.sin(angle), 0 * angle))
            cap = np.array([0.0, 0.0, 0.5 * size[1]])
            return np.vstack((rim + cap, rim - cap))
        case _:
            corners = np.stack(np.meshgrid(*([(-0.5, 0.5)] * 3)), axis=-1).reshape(-1, 3)
            return corners * np.array(size)


def test_ground_too_near_says_how_much_to_raise_the_trunk(hyq: Robot) -> None:
    lowest = foot_in_trunk(hyq, "RH", REST[None])[0, 2] - hyq.leg("RH").foot_radius
    with pytest.raises(IdentificationError, match=r"raise the trunk by 0\.0[23]0 m or more"):
        Clearance.of(hyq, "RH", REST, margin=0.01, ground=lowest + 0.01)
    assert Clearance.of(hyq, "RH", REST, margin=0.01, ground=lowest - 0.02).slack(REST[None])[0] <= 0.01 + 1e-9


def test_map_is_exact_at_its_poses_and_never_promises_more_once_lowered(hyq: Robot) -> None:
    bounds = LegBounds.of(hyq, "RH")
    table = ClearanceMap.of(bounds.clearance, bounds.lower, bounds.upper, most=216)
    axes = [np.linspace(a, b, 6) for a, b in zip(bounds.lower, bounds.upper, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    np.testing.assert_allclose(table.slack(nodes), bounds.clearance.slack(nodes), atol=1e-9)
    poses = np.random.default_rng(5).uniform(bounds.lower, bounds.upper, (200, 3))
    exact = bounds.clearance.slack(poses)
    assert (table.slack(poses) > exact + 1e-4).any()
    assert (table.lowered(poses, exact).slack(poses) <= exact + 1e-9).all()
