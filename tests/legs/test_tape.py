"""Recorded arithmetic gives what numpy gives, to the last bit but for sines; regressors give the same rows."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stadera.compiled import kernel
from stadera.legs import FrictionModel, JointMotion, JointTorqueRegressor, TrunkMotion, joint_torques
from stadera.legs.components import Component, add, cross, dot, minus, plus, scale, times
from stadera.legs.tape import Recorder
from stadera.robot import load_robot

pytest.importorskip("numba")

RNG = np.random.default_rng(0)
SAMPLES = 300  # two whole tiles and a part


def compiled() -> ModuleType:
    found = kernel("stadera.legs.kernels.tape")
    assert found is not None
    return found


def expressions(x: list[Component]) -> list[Component | None]:
    """Of six components, with all kinds of steps, shared ones, constants and rows that are left alone."""
    v, w = (x[0], 0.5, x[1]), (x[2], x[3], -1.0)
    turned = cross(v, w)
    product = times(x[4], x[5])
    return [
        *add(turned, scale(x[4], v)),
        dot(v, w),
        plus(product, x[0]),  # a product that is needed elsewhere too
        minus(x[1], product),
        minus(x[0], times(x[1], x[2])),
        minus(times(x[1], x[2]), x[0]),
        minus(2.0, x[3]),
        minus(x[3], 2.0),
        minus(0.0, x[3]),
        plus(product, product),
        x[5],
        3.25,
        None,
    ]


def test_results_are_those_of_numpy() -> None:
    inputs, recorder = RNG.normal(size=(6, SAMPLES)), Recorder(6)
    tape = recorder.tape(expressions(list(recorder.inputs)), compiled())
    out = np.full((15, SAMPLES), 7.0)
    tape.run(inputs, out)
    for row, value in zip(out, expressions(list(inputs)), strict=True):
        np.testing.assert_array_equal(row, 7.0 if value is None else value)
    with pytest.raises(ValueError, match="15 rows"):
        tape.run(inputs, out[:14])


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.sampled_from("+-*"), st.integers(0, 50), st.integers(0, 50)), min_size=1, max_size=40))
def test_any_sequence_of_steps(steps: list[tuple[str, int, int]]) -> None:
    def results(x: list[Component]) -> list[Component]:
        x = list(x)
        for kind, a, b in steps:
            operation = {"+": plus, "-": minus, "*": times}[kind]
            x.append(operation(x[a % len(x)], x[b % len(x)]))
        return x[3:]

    inputs, recorder = RNG.uniform(-1.0, 1.0, (3, 5)), Recorder(3)
    out = np.empty((len(steps), 5))
    recorder.tape(results([*recorder.inputs]), compiled()).run(inputs, out)
    for row, value in zip(out, results([*inputs]), strict=True):
        np.testing.assert_array_equal(row, value)


@pytest.mark.parametrize("size", [0.8, 10.0, 1e3, 9e5])
def test_sines_are_within_a_rounding_or_two(size: float) -> None:
    recorder = Recorder(1)
    tape = recorder.tape([*recorder.cosine_and_sine(recorder.inputs[0])], compiled())
    angle = np.concatenate([RNG.uniform(-size, size, 5000), 0.5 * np.pi * np.arange(-8, 9), [0.0, -0.0]])
    out = np.empty((2, len(angle)))
    tape.run(angle[None], out)
    np.testing.assert_allclose(out, [np.cos(angle), np.sin(angle)], rtol=0.0, atol=2.3e-16)


def both(regressor: JointTorqueRegressor, joints: JointMotion, trunk: TrunkMotion, patch: pytest.MonkeyPatch) -> None:
    torque = RNG.normal(size=(len(joints), len(regressor.outputs)))
    patch.setattr(joint_torques, "_WORTH_COMPILED", 1 << 60)
    expected = list(regressor.rows(joints, torque, trunk))
    patch.setattr(joint_torques, "_WORTH_COMPILED", 1)
    for rows, other in zip(regressor.rows(joints, torque, trunk), expected, strict=True):
        assert rows.columns == other.columns
        np.testing.assert_allclose(rows.reduced, other.reduced, rtol=0.0, atol=1e-14 * np.abs(other.reduced).max())


def motion(joints: int, largest: float = 2.0) -> JointMotion:
    return JointMotion(*RNG.uniform(-largest, largest, (3, SAMPLES, joints)))


def turning(constant_force: bool) -> TrunkMotion:
    force, omega, alpha = RNG.normal(size=(3, SAMPLES, 3))
    return TrunkMotion(force[0] if constant_force else force, omega, alpha)


@pytest.mark.parametrize("name", ["hyq", "go2", "anymal_c"])
@pytest.mark.parametrize("friction", [FrictionModel(), FrictionModel.full()])
def test_rows_of_a_leg(name: str, friction: FrictionModel, monkeypatch: pytest.MonkeyPatch) -> None:
    regressor = JointTorqueRegressor(load_robot(name).leg_tree("RH"), friction)
    for trunk in (TrunkMotion.held(), TrunkMotion.held((0.3, -0.2, 1.0)), turning(True), turning(False)):
        both(regressor, motion(3), trunk, monkeypatch)


def test_rows_of_a_whole_robot_and_its_trunk(monkeypatch: pytest.MonkeyPatch) -> None:
    regressor = JointTorqueRegressor(load_robot("hyq").tree, FrictionModel(), trunk_rows=True)
    both(regressor, motion(12), turning(False), monkeypatch)
    both(regressor, motion(12), TrunkMotion.held(), monkeypatch)


def test_angles_beyond_the_range_of_the_sines(monkeypatch: pytest.MonkeyPatch) -> None:
    both(JointTorqueRegressor(load_robot("hyq").leg_tree("LF")), motion(3, 1e8), TrunkMotion.held(), monkeypatch)
