"""What every regressor must be: rows linear in named parameters, the same in chunks, and an independent library's.

A new regressor is one more entry of CASES: how it makes rows of some samples, and what another library says that the
target must be for given parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from body.reference import (
    floating_torques,
    leg_regressor,
    named,
    random_inertias,
    random_motion,
    random_tree,
    random_trunk,
    robot_of,
    stack,
)
from stadera.body import FrictionModel, JointMotion, JointTorqueRegressor, Rows, TrunkMotion
from stadera.robot import Robot, load_robot

SAMPLES = 24


@dataclass(frozen=True, eq=False)
class Case:
    """A regressor at work.

    Attributes:
        columns: all parameters.
        rows: the rows of some of the samples, one or more sets.
        truth: parameters by name.
        expected: by an independent library, the targets that the truth has, one array for each set of rows.
    """

    columns: tuple[str, ...]
    rows: Callable[[slice], list[Rows]]
    truth: dict[str, float]
    expected: list[np.ndarray]


@cache
def hyq() -> Robot:
    return load_robot("hyq")


def sliced(trunk: TrunkMotion, samples: slice) -> TrunkMotion:
    return TrunkMotion(trunk.specific_force[samples]) if trunk.specific_force.ndim == 2 else trunk


def torque_case(regressor: JointTorqueRegressor, joints: JointMotion, trunk: TrunkMotion, truth, expected) -> Case:
    def rows(samples: slice) -> list[Rows]:
        return list(regressor.rows(joints.slice(samples), expected[samples], sliced(trunk, samples), std=0.3))

    return Case(regressor.columns, rows, truth, list(expected.T))


def leg_with_friction() -> Case:
    tree, joints, up = hyq().leg_tree("RH"), random_motion(3, SAMPLES), np.array([0.2, -0.1, 1.0])
    regressor = JointTorqueRegressor(tree, FrictionModel.full())
    rng = np.random.default_rng(0)
    truth = named(dict(hyq().inertias), tree.links[1:]) | {c: float(rng.uniform()) for c in regressor.columns[30:]}
    expected = leg_regressor(tree, joints, up) @ np.array([truth[c] for c in regressor.columns[:30]])
    for k, joint in enumerate(tree.joints):
        q̇ = joints.velocity[:, k]
        expected[:, k] += truth[f"{joint}.armature"] * joints.acceleration[:, k] + truth[f"{joint}.viscous"] * q̇
        expected[:, k] += truth[f"{joint}.coulomb"] * np.tanh(q̇ / 0.02) + truth[f"{joint}.offset"]
    return torque_case(regressor, joints, TrunkMotion.held(up), truth, expected)


def whole_tree(robot: Robot) -> Case:
    joints, trunk = random_motion(len(robot.tree.joints), SAMPLES), random_trunk(SAMPLES)
    expected = floating_torques(robot, joints, trunk, np.stack([np.eye(3)] * SAMPLES))
    truth = named(dict(robot.inertias), robot.tree.links[1:])
    return torque_case(JointTorqueRegressor(robot.tree), joints, trunk, truth, expected)


def oblique_tree() -> Case:
    tree = random_tree(7)
    return whole_tree(robot_of(tree, random_inertias(tree.links, 7), hyq()))


CASES: dict[str, Callable[[], Case]] = {
    "joint torques of a leg": leg_with_friction,
    "joint torques of a robot": lambda: whole_tree(hyq()),
    "joint torques of an oblique tree": oblique_tree,
}


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]()


def test_names_are_unique_and_known(case: Case) -> None:
    assert len(set(case.columns)) == len(case.columns)
    assert set(case.truth) == set(case.columns)
    for rows in case.rows(slice(None)):
        assert len(set(rows.columns)) == len(rows.columns)
        assert set(rows.columns) <= set(case.columns)
        assert all(name.count(".") >= 1 and all(name.rsplit(".", 1)) for name in rows.columns)


def test_targets_are_an_independent_librarys(case: Case) -> None:
    for rows, expected in zip(case.rows(slice(None)), case.expected, strict=True):
        predicted = rows.predict(np.array([case.truth[c] for c in rows.columns]))
        np.testing.assert_allclose(predicted, expected, atol=1e-10 * np.abs(expected).max())


def test_rows_are_one_a_sample_finite_and_of_positive_noise(case: Case) -> None:
    for rows in case.rows(slice(None)):
        assert rows.matrix.shape == (SAMPLES, len(rows.columns))
        assert np.isfinite(rows.matrix).all()
        assert (np.asarray(rows.std) > 0).all()


def test_chunks_are_the_whole(case: Case) -> None:
    whole = stack(case.rows(slice(None)), case.columns)
    sets = len(case.expected)
    chunks = [case.rows(slice(a, b)) for a, b in ((0, 1), (1, 11), (11, SAMPLES))]
    joined = [stack([chunk[k] for chunk in chunks], case.columns) for k in range(sets)]
    np.testing.assert_allclose(np.concatenate([r.matrix for r in joined]), whole.matrix, rtol=1e-13, atol=1e-13)
    np.testing.assert_array_equal(np.concatenate([r.target for r in joined]), whole.target)


def test_no_samples_are_no_rows(case: Case) -> None:
    assert all(len(rows) == 0 for rows in case.rows(slice(0, 0)))


def test_same_rows_twice(case: Case) -> None:
    """Nothing random, nothing kept: neither rows nor their columns change from call to call."""
    for first, again in zip(case.rows(slice(None)), case.rows(slice(None)), strict=True):
        assert first.columns == again.columns
        np.testing.assert_array_equal(first.matrix, again.matrix)
