"""A weighing as a model: inertia is written where it was observed; its deviations, against finite differences."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm import with_arm
from stadera.errors import IdentificationError
from stadera.inertia import InertialParameters
from stadera.robot import Robot, load_robot
from stadera.trunk.load import Payload
from stadera.trunk.result import TrunkParameters
from stadera.trust import Trust
from stadera.weigh import Timeline, Weighing, weighed_model
from stadera.weigh.model import payload_link

COM = np.array([-0.2, 0.1, 0.15])
TENSOR = np.array([[0.3, 0.04, -0.02], [0.04, 0.5, 0.01], [-0.02, 0.01, 0.6]])
BOX = InertialParameters.from_com(8.0, COM, TENSOR)
RNG = np.random.default_rng(3)
SHAPE = RNG.standard_normal((10, 10)) * np.array([0.1, *[0.02] * 3, *[0.01] * 6])[:, None]


def payload(body: InertialParameters = BOX, scale: float = 1.0) -> Payload:
    return Payload.of_parameters(body.vector, scale**2 * SHAPE @ SHAPE.T, 0.1)


def weighing(robot: Robot, trunk: TrunkParameters, found: Payload | None = None) -> Weighing:
    none = np.zeros(0)
    line = Timeline(none, none, none, none.reshape(0, 3), none.reshape(0, 3))
    good, lag = Trust("good", 1.0), (0.0, 0.001)
    return Weighing(robot, "log", "walking", "x", good, trunk, 1.0, found, (), line, (), 0.0, 1.0, lag)


def least_ratio(scale: float) -> float:
    """The moments over their deviations, the least of them, by finite differences of Iₒ - m (|c|² 1 - c cᵀ)."""
    axes = np.linalg.eigh(TENSOR)[1]

    def moments(vector: np.ndarray) -> np.ndarray:
        tensor = InertialParameters(vector).inertia_com
        return np.asarray(np.einsum("ik,ij,jk->k", axes, tensor, axes))

    h = 1e-6
    slope = np.array([(moments(BOX.vector + h * e) - moments(BOX.vector - h * e)) / (2 * h) for e in np.eye(10)])
    std = scale * np.linalg.norm(slope.T @ SHAPE, axis=1)
    return float((moments(BOX.vector) / std).min())


def test_observed_from_three_deviations_on() -> None:
    limit = least_ratio(1.0) / 3.0
    assert payload(scale=1.01 * limit).inertia is None
    found = payload(scale=0.99 * limit).inertia
    assert found is not None
    assert found == pytest.approx(TENSOR, abs=1e-12)


def test_deviations_of_the_inertia_about_the_centre_of_mass() -> None:
    found = payload(scale=1e-3)
    h = 1e-6

    def tensor(vector: np.ndarray) -> np.ndarray:
        return InertialParameters(vector).inertia_com[np.triu_indices(3)]

    slope = np.array([(tensor(BOX.vector + h * e) - tensor(BOX.vector - h * e)) / (2 * h) for e in np.eye(10)])
    assert found.inertia_std == pytest.approx(1e-3 * np.linalg.norm(slope.T @ SHAPE, axis=1), rel=1e-5)


def test_a_tensor_no_body_has_is_a_point_mass() -> None:
    impossible = InertialParameters.from_com(8.0, COM, np.diag([0.1, 0.1, 0.5]))
    assert payload(impossible, 1e-3).inertia is None


def test_the_link_says_which_it_is() -> None:
    sure = payload(scale=1e-3)
    link = payload_link(sure, np.zeros(3))
    assert link.tensor == pytest.approx(TENSOR)
    assert "inertia as observed" in link.note
    known = sure.com_covariance[:2, :2]
    blurred = Payload.of_moments(BOX.vector[:4], (1e-3 * SHAPE @ (1e-3 * SHAPE).T)[:4, :4], np.array([1.0, 1.0, 0.0]))
    assert blurred.inertia is None
    assert blurred.com_covariance[:2, :2] == pytest.approx(known)
    link = payload_link(blurred, np.array([0.0, 0.0, 0.03]))
    assert link.body.com == pytest.approx([-0.2, 0.1, 0.03])
    cube = link.body.mass * 0.1**2 / 6.0
    assert link.tensor == pytest.approx(np.diag([cube] * 3), abs=1e-12)
    assert "inertia NOT observed, and assumed to be that of a cube of 0.1 m" in link.note
    assert "z was not observed" in link.note
    with pytest.raises(IdentificationError, match="no payload to write"):
        payload_link(replace(sure, mass=0.0), np.zeros(3))


@pytest.mark.parametrize("unseen", [(), (9,), (3, 4, 5, 6, 7, 8, 9)])
def test_the_trunk_is_written_as_far_as_it_was_observed(unseen: tuple[int, ...]) -> None:
    robot = load_robot("hyq")
    prior = robot.inertias[robot.trunk]
    observed = np.ones(10, dtype=bool)
    observed[list(unseen)] = False
    std = np.where(observed[:4], [0.2, 0.002, 0.002, 0.01], np.nan)
    tensor = prior.inertia_com if len(unseen) else 1.2 * prior.inertia_com
    com = np.where(observed[1:4], prior.com + 0.01, prior.com)
    found = InertialParameters.from_com(70.0, com, tensor)
    trunk = TrunkParameters(found, np.diag(std**2), np.where(observed[4:], 0.1, np.nan), observed)
    result = weighing(robot, trunk)
    model = weighed_model(result)
    assert model.payload is None
    assert model.robot.inertias[robot.trunk].vector == pytest.approx(found.vector)
    assert ("inertia about the centre of mass" in model.note) == bool(unseen)
    assert ("model's own: z, inertia" in model.note) == (3 in unseen)
    shown = result.to_dict()["trunk"]
    assert (shown["com"]["value"][2] is None) == (3 in unseen)
    assert [c["value"] is None for c in shown["inertia"].values()] == [bool(unseen)] * 6


def test_no_trunk_without_its_mass() -> None:
    robot = load_robot("hyq")
    nothing = TrunkParameters(
        robot.inertias[robot.trunk], np.full((4, 4), np.nan), np.full(6, np.nan), np.zeros(10, dtype=bool)
    )
    with pytest.raises(IdentificationError, match="log: no trunk to write"):
        weighed_model(weighing(robot, nothing))


@pytest.mark.parametrize("seen", [True, False])
def test_trunk_and_payload_together_are_the_trunk_that_was_weighed(seen: bool) -> None:
    robot = load_robot("hyq")
    prior = robot.inertias[robot.trunk]
    whole = prior + BOX if seen else InertialParameters.from_com(70.0, prior.com + 0.01, prior.inertia_com)
    std = np.full(6, 0.1 if seen else np.nan)
    trunk = TrunkParameters(whole, np.diag([0.2, 0.002, 0.002, 0.01]) ** 2, std, np.array([*[True] * 4, *[seen] * 6]))
    model = weighed_model(weighing(robot, trunk, payload(scale=1e-3)))
    assert model.payload is not None
    assert "less the payload" in model.note
    both = model.robot.inertias[robot.trunk] + model.payload.body
    assert both.vector[:4] == pytest.approx(whole.vector[:4])
    if seen:
        assert both.vector == pytest.approx(whole.vector)


@pytest.mark.parametrize(("share", "seen"), [(1.5, True), (-1.0, False)])
def test_links_outside_the_legs_leave_the_trunks_own_an_inertia_that_a_body_has(
    share: float, seen: bool, tmp_path: Path
) -> None:
    robot = with_arm("go2", tmp_path)
    assert robot.extra is not None
    arm, lump = robot.extra.lumped, robot.inertias[robot.trunk]
    own = lump - arm
    whole = InertialParameters.from_com(lump.mass, lump.com, lump.inertia_com + (share - 1.0) * own.inertia_com)
    trunk = TrunkParameters(whole, np.diag([0.2, 0.002, 0.002, 0.01]) ** 2, np.full(6, 0.1), np.ones(10, dtype=bool))
    model = weighed_model(weighing(robot, trunk))
    found = model.robot.inertias[robot.trunk]
    assert found.vector[:4] == pytest.approx(whole.vector[:4])
    assert (found - arm).inertia_com == pytest.approx((share if seen else 1.0) * own.inertia_com, abs=1e-9)
    assert ("model's own: inertia about the centre of mass" in model.note) == (not seen)
