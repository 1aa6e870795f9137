"""A trunk on the ground: the ground carries a part of it, which no leg feels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs.recording import Recording
from stadera.robot import load_robot
from stadera.robot.kinematics import foot_positions
from stadera.robot.model import Shape
from stadera.robot.stance import lying, standing_configuration
from stadera.trunk.front import LIES
from stadera.weigh import weigh

ROBOT = load_robot("go2")
LOW = replace(ROBOT, shapes=(Shape(ROBOT.trunk, "box", (0.4, 0.2, 0.7), np.eye(3), np.zeros(3)),))  # a belly as low


@pytest.mark.parametrize("name", ["go2", "hyq", "a1", "b1", "anymal_c", "aliengo", "spot"])
def test_a_trunk_between_folded_legs_lies_and_one_that_stands_does_not(name: str) -> None:
    robot = load_robot(name)
    stands = standing_configuration(robot)
    folded = stands.copy()
    for leg in robot.legs:  # thigh and shank level
        _, hfe, kfe = (robot.tree.joints.index(joint) for joint in leg.joints)
        folded[hfe] = np.sign(stands[hfe]) * 0.5 * np.pi
        folded[kfe] = np.sign(stands[kfe]) * np.pi
    up = np.tile([0.0, 0.0, 1.0], (2, 1))
    assert lying(robot, foot_positions(robot, np.array([stands, folded])), up).tolist() == [False, True]


@pytest.mark.parametrize(
    ("kind", "size"),
    [("sphere", (0.1,)), ("capsule", (0.05, 0.3)), ("cylinder", (0.05, 0.3)), ("box", (0.2, 0.3, 0.4))],
)
def test_lowest_points_are_those_of_the_shape_s_surface(kind: str, size: tuple[float, ...]) -> None:
    """Drawn points of the surface, turned and shifted, reach as low and no lower."""
    rng, turn = np.random.default_rng(1), Rotation.random(rng=2).as_matrix()
    n = 200_000
    sphere = rng.standard_normal((n, 3))
    sphere /= np.linalg.norm(sphere, axis=1)[:, None]
    match kind:
        case "sphere":
            points = size[0] * sphere
        case "capsule":
            points = size[0] * sphere + np.outer(np.sign(sphere[:, 2]), [0.0, 0.0, 0.5 * size[1]])
        case "cylinder":
            angle, end = rng.uniform(0.0, 2.0 * np.pi, n), rng.choice([-0.5, 0.5], n)
            points = np.stack([size[0] * np.cos(angle), size[0] * np.sin(angle), size[1] * end], axis=1)
        case _:
            points = rng.choice([-0.5, 0.5], (n, 3)) * np.array(size)
    shift, up = np.array([0.1, -0.2, 0.3]), Rotation.random(rng=3).as_matrix()[:1]
    heights = (points @ turn.T + shift) @ up[0]
    reach = Shape("trunk", kind, size, turn, shift).reach(up @ turn)  # type: ignore[arg-type]
    assert (up @ shift - reach)[0] == pytest.approx(heights.min(), abs=2e-3)


@pytest.fixture(scope="module")
def log() -> Recording:
    return simulate(ROBOT, "stand", SimulateSettings("standard", duration=2.0, rate=200.0, seed=1)).recording


@pytest.mark.parametrize("lies", [slice(0, 200), slice(200, None)], ids=["first", "at last"])
def test_what_a_robot_feels_while_it_lies_is_left_out(log: Recording, lies: slice) -> None:
    """As in any session: it lies, stands up, is weighed, and lies down."""
    assert log.effort is not None
    effort = log.effort.copy()
    effort[lies] *= 0.3  # the ground carries the rest
    found, whole = weigh(LOW, replace(log, effort=effort)), weigh(ROBOT, log)
    assert abs(found.mass - whole.mass) < 0.5 * whole.trunk.mass_std
    (left_out,) = [part for part in found.refusals if part.reason == LIES]
    assert left_out.end - left_out.begin == pytest.approx(1.0, abs=0.06)
    assert not any("nothing was learnt" in reason for reason in found.trust.reasons)
    assert not found.changes


def test_a_robot_that_stands_is_not_said_to_lie_and_one_on_the_ground_is(log: Recording) -> None:
    robot, low = ROBOT, LOW
    for method in (None, "standing"):
        assert not any("lie on the ground" in reason for reason in weigh(robot, log, method=method).trust.reasons)
        found = weigh(low, log, method=method)
        assert found.trust.verdict == "doubtful"
        assert any("lie on the ground" in reason for reason in found.trust.reasons)
