"""The drawing of a weighing, and its words: what is drawn is where the kinematics and the result have it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from stadera.report.figures import Figure, Panel, Series
from stadera.report.figures.robot import limbs, outlines, poses, silhouette, soles
from stadera.report.weigh.plots import place_figure
from stadera.report.weigh.tables import how_sure, may_be_used, where
from stadera.robot import load_robot
from stadera.robot.kinematics import foot_positions
from stadera.trunk.result import TrunkParameters
from stadera.trunk.standing.estimator import Stance, level_axes
from stadera.weigh.result import Weighing

SIDE, ABOVE = np.eye(3)[[0, 2]], np.eye(3)[:2]


def named(panel: Panel, name: str, marker: bool = True) -> Series:
    """The first mark of that name, with a marker or an area."""
    found = [m for m in panel.marks if isinstance(m, Series) and m.name == name and bool(m.marker) is marker]
    return found[0]


def views(result: Weighing) -> tuple[Panel, Panel]:
    figure = place_figure(result)
    assert isinstance(figure, Figure)
    side, top, *_ = figure.panels
    return side, top


def test_feet_are_drawn_where_the_kinematics_have_them(weighed: Weighing) -> None:
    robot, position = weighed.robot, weighed.stance.position
    feet = foot_positions(robot, position[None])[0]
    *_, drawn = silhouette(robot, position, SIDE)
    x, y = drawn.path()
    middles = [np.nanmean([p for p in part if np.isfinite(p).all()][:-1], axis=0) for part in _parts(x, y)]
    np.testing.assert_allclose(sorted(map(tuple, middles)), sorted(map(tuple, feet[:, [0, 2]])), atol=1e-6)


def test_every_joint_is_inside_of_the_drawing(weighed: Weighing) -> None:
    robot, position = weighed.robot, weighed.stance.position
    origins = poses(robot, position[None])[1][0]
    for view in (SIDE, ABOVE):
        points = np.concatenate([np.column_stack(mark.path()) for mark in silhouette(robot, position, view)])
        low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
        assert (origins @ view.T > low).all()
        assert (origins @ view.T < high).all()


def test_a_drawing_contains_its_parts_and_moves_with_the_trunk(weighed: Weighing) -> None:
    """Every ball's rim is within the hull of its part's corners; a turn about the view's axis turns the drawing."""
    robot, q = weighed.robot, weighed.stance.position[None]
    still = [corners[0] for _, corners in outlines(robot, q, SIDE)]
    turn, shift = Rotation.from_euler("y", [[0.3]]).as_matrix(), np.array([[0.1, -0.2, 0.05]])
    moved = [corners[0] for _, corners in outlines(robot, q, SIDE, turn, shift)]
    for before, after in zip(still, moved, strict=True):
        expected = before @ turn[0][np.ix_([0, 2], [0, 2])].T + shift[0, [0, 2]]
        size = np.ptp(before, axis=0).max()
        assert np.abs(after.mean(axis=0) - expected.mean(axis=0)).max() < 0.05 * size
        assert ConvexHull(after).volume == pytest.approx(ConvexHull(before).volume, rel=0.05)
    rotations, origins = poses(robot, q)
    part = next(part for leg in robot.legs for part in limbs(robot, leg) if part.kind == "limb")
    ends = (part.centres @ rotations[0, part.link].T + origins[0, part.link]) @ SIDE.T
    for angle in np.linspace(0.0, 2.0 * np.pi, 25)[:-1]:
        direction = np.array([np.cos(angle), np.sin(angle)])
        farthest = (ends @ direction + part.radii).max()
        assert any(abs((corners @ direction).max() - farthest) < 1e-12 for corners in still)


def test_legs_of_any_number_of_joints_taper(weighed: Weighing) -> None:
    for robot in (weighed.robot, load_robot("g1")):
        for leg in robot.legs:
            radii = np.concatenate([part.radii for part in limbs(robot, leg) if part.kind == "limb"])
            assert (np.diff(radii) <= 1e-12).all()
            assert len(radii) == 2 * len(leg.joints)
    assert len(soles(load_robot("g1"), load_robot("g1").legs[0])) == 4


def test_payload_and_ellipse_are_the_result_s(weighed: Weighing) -> None:
    side, top = views(weighed)
    for panel, view in ((side, SIDE), (top, ABOVE)):
        mark = named(panel, "payload")
        np.testing.assert_allclose([mark.x[0], mark.y[0]], view @ weighed.payload.com)
        (ellipse,) = [m for m in panel.marks if m.colour == "box" and m.fill]
        away = np.column_stack([ellipse.x, ellipse.y]) - view @ weighed.payload.com
        spread = np.linalg.inv(view @ weighed.payload.com_covariance @ view.T)
        np.testing.assert_allclose(np.einsum("ni,ij,nj->n", away, spread, away), 4.0, rtol=1e-6)


def test_the_trunk_before_is_the_trunk_without_the_payload(weighed: Weighing) -> None:
    prior = weighed.robot.inertias[weighed.robot.trunk]
    mark = named(views(weighed)[1], "trunk before")
    np.testing.assert_allclose([mark.x[0], mark.y[0]], prior.com[:2], atol=1e-9)


def test_a_tilted_robot_is_drawn_level(weighed: Weighing) -> None:
    up = np.array([np.sin(0.2), 0.0, np.cos(0.2)])  # on a slope, nose up
    tilted = replace(weighed, stance=Stance(level_axes(up), weighed.stance.position))
    mark = named(views(tilted)[0], "payload")
    assert mark.y[0] == pytest.approx(weighed.payload.com @ up)


def test_where_the_height_is_not_known_the_outline_is_as_tall_as_the_robot(rested: Weighing) -> None:
    side, top = views(rested)
    strip = next(m for m in side.marks if m.colour == "blue")
    assert (strip.y.min(), strip.y.max()) == pytest.approx(side.y.limits)
    assert not [m for m in side.marks if m.name == "trunk, found"]
    assert named(top, "trunk, found").x[0] == pytest.approx(rested.com[0])
    assert {m.name for m in top.marks} >= {"foot, area by force", "centre of pressure", "support polygon"}


def test_a_load_on_a_link_is_drawn_there(weighed: Weighing) -> None:
    held = replace(weighed, payload=replace(weighed.payload, at="lf_lowerleg"))
    links, ((rotations,), (origins,)) = weighed.robot.tree.links, poses(weighed.robot, weighed.stance.position[None])
    k = links.index("lf_lowerleg")
    mark = named(views(held)[0], "payload")
    expected = SIDE @ (origins[k] + rotations[k] @ weighed.payload.com)
    np.testing.assert_allclose([mark.x[0], mark.y[0]], expected)
    assert where(held).startswith("At x −200.0 ± 2.8, ")
    both = replace(held.payload, at="lf_lowerleg + rf_lowerleg", com=np.full(3, np.nan))
    marks = [m for m in views(replace(held, payload=both))[1].marks if m.name == "link that carries the payload"]
    assert len(marks) == 2


def test_without_a_pose_there_is_no_drawing(weighed: Weighing) -> None:
    assert place_figure(replace(weighed, stance=None)) is None
    assert "balance" not in replace(weighed, stance=None).to_figures()
    assert replace(weighed, stance=None).to_html()


def test_at_rest_without_a_centre_of_mass_the_balance_is_drawn(rested: Weighing) -> None:
    unknown = TrunkParameters.unobserved(rested.robot.inertias[rested.robot.trunk])
    balance = replace(rested.balance, robot_com=np.full(2, np.nan))
    figure = place_figure(replace(rested, trunk=unknown, balance=balance))
    assert len(figure.panels) == 3
    lone = replace(balance, stance=np.array([True, False, False, False]))
    assert place_figure(replace(rested, balance=lone)) is not None
    assert place_figure(replace(rested, balance=replace(balance, stance=np.zeros(4, dtype=bool)))) is None


def test_words(weighed: Weighing, rested: Weighing) -> None:
    assert where(weighed) == (
        "200.0 ± 2.8 mm behind, 100.0 ± 1.8 mm left of and 150.0 ± 2.3 mm above the trunk's origin."
    )
    assert where(rested).endswith("the trunk's origin; its height was not observed.")
    assert how_sure(weighed) == "Good to 1.2 %. By 95 % it is between 7.80 and 8.20 kg."
    scaled = replace(weighed, payload=replace(weighed.payload, mass_std_without_scale=0.01))
    assert how_sure(scaled).startswith("Good to 1.2 %, all of it the torques' scale.")
    exact = replace(weighed, payload=replace(weighed.payload, mass_std=0.0, mass_std_without_scale=0.0))
    assert how_sure(exact) == "Good to 0 %. By 95 % it is between 8.00 and 8.00 kg."
    flat = replace(weighed.payload, com_covariance=np.diag([1e-6, np.nan, np.nan]))
    assert where(replace(weighed, payload=flat)).endswith("; its place across the trunk and height were not observed.")
    held = replace(weighed, payload=replace(flat, at="lf_lowerleg"))
    assert where(held) == "At x −200.0 ± 1.0 mm in the frame of lf_lowerleg; its y and z were not observed."
    alone = replace(weighed, payload=replace(weighed.payload, mass_std_without_scale=0.0999))
    assert "hardly any of it the torques' scale" in how_sure(alone)
    assert may_be_used(weighed).startswith("With care")
    wide = replace(rested, payload=replace(weighed.payload, mass_std=5.0))
    assert may_be_used(wide).startswith("Not yet: ")
    assert "next to nothing" in how_sure(wide)


def _parts(x: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
    points = np.column_stack([x, y])
    return np.split(points, np.flatnonzero(np.isnan(x)))
