"""Moving links outside the legs against Pinocchio's dynamics of the whole tree."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from arm import with_arm
from stadera.body import Body, Motion
from stadera.inertia import InertialParameters
from stadera.lab.pinocchio import pinocchio_model
from stadera.robot import Robot, load_robot
from stadera.trunk.wrench import trunk_matrix, trunk_signals


def extra_wrench(robot: Robot, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, *trunk: np.ndarray) -> np.ndarray:
    """What the joints outside the legs add to the trunk's rows by moving, (n, 6); all others are at zero."""
    body, n = Body.of(robot), len(q)
    states = [np.hstack([np.zeros((n, 12)), x]) for x in (q, qd, qdd)]
    state = body.at(Motion(*states, *trunk, np.array([0.0, 0.0, 1.0])))
    omega, alpha, a = (x.T for x in trunk)
    contained = np.array([trunk_matrix(s) @ body.lumped for s in trunk_signals(a, omega, alpha).T])
    return state.inertial[:, -1] - contained


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return with_arm("go2", tmp_path)


def base_wrench(model: pin.Model, v: np.ndarray, a: np.ndarray, joints: dict[str, np.ndarray]) -> np.ndarray:
    """What moves the base of a model whose other joints rest at zero, (6,)."""
    q, velocity, acceleration = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    model.gravity = pin.Motion.Zero()
    velocity[:6], acceleration[:6] = v, a
    for name, state in joints.items():
        joint = model.joints[model.getJointId(name)]
        q[joint.idx_q], velocity[joint.idx_v], acceleration[joint.idx_v] = state
    return np.array(pin.rnea(model, model.createData(), q, velocity, acceleration)[:6])


def test_it_is_the_difference_of_the_whole_trees_dynamics_moving_and_at_the_reference(robot: Robot) -> None:
    rng = np.random.default_rng(3)
    robot = robot.posed({"shoulder": 0.4, "lift": 0.1})
    extra = robot.extra
    assert extra is not None
    assert extra.joints == ("lift", "shoulder", "elbow")
    whole = pin.buildModelFromUrdf(str(robot.source), pin.JointModelFreeFlyer())
    frozen = pinocchio_model(robot)
    n = 20
    q, qd, qdd = rng.normal(size=(3, n, 3)) * np.array([0.7, 3.0, 30.0])[:, None, None]
    omega, alpha, specific = rng.normal(size=(3, n, 3)) * np.array([2.0, 10.0, 15.0])[:, None, None]
    found = extra_wrench(robot, q, qd, qdd, omega, alpha, specific)
    for k in range(n):
        v, a = np.append(np.zeros(3), omega[k]), np.append(specific[k], alpha[k])
        moving = {joint: np.array([q[k, j], qd[k, j], qdd[k, j]]) for j, joint in enumerate(extra.joints)}
        expected = base_wrench(whole, v, a, moving) - base_wrench(frozen, v, a, {})
        np.testing.assert_allclose(found[k], expected, atol=1e-9)


def test_the_posed_trunk_has_the_links_where_they_are(robot: Robot) -> None:
    posed = robot.posed({"elbow": -0.8, "lift": 0.2, "nothing": 1.0})
    whole = pin.buildModelFromUrdf(str(robot.source), pin.JointModelFreeFlyer())
    q = pin.neutral(whole)
    for joint, value in (("elbow", -0.8), ("lift", 0.2)):
        q[whole.joints[whole.getJointId(joint)].idx_q] = value
    others = [whole.getJointId(joint) for joint in ("lift", "shoulder", "elbow")]
    reduced = pin.buildReducedModel(whole, others, q)
    expected = InertialParameters.from_pinocchio(reduced.inertias[1]).vector
    np.testing.assert_allclose(posed.inertias[posed.trunk].vector, expected, atol=1e-12)
    assert posed.mass == pytest.approx(robot.mass)
    back = posed.posed({"elbow": 0.0, "lift": 0.0})
    np.testing.assert_allclose(back.inertias[back.trunk].vector, robot.inertias[robot.trunk].vector, atol=1e-12)


def test_at_the_reference_nothing_is_added_at_rest(robot: Robot) -> None:
    posed = robot.posed({"shoulder": 1.0})
    extra = posed.extra
    assert extra is not None
    still = np.zeros((1, 3))
    rest = extra_wrench(posed, extra.reference[None], still, still, *np.zeros((2, 1, 3)), np.array([[0.3, 0.0, 9.8]]))
    np.testing.assert_allclose(rest, 0.0, atol=1e-12)


def test_a_robot_without_such_joints_has_none() -> None:
    assert load_robot("go2").extra is None
