"""Torque offsets from legs in the air, against Pinocchio's inverse dynamics of a leg that swings."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin
import pytest

from stadera.lab.supervise import LoadTest
from stadera.lab.supervise.offsets import LegOffsets, SwingOffsets
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import ForceNoise, MeasuredLegs, Measurement

HYQ = load_robot("hyq")
NOISE = ForceNoise.of(HYQ)
TRUE = np.array([0.7, -0.4, 0.55])
LEG = 2
TILT = pin.utils.rotate("y", 0.1) @ pin.utils.rotate("x", -0.05)


def swing(seconds: float = 0.4, period: float = 0.004, touch: float = 0.0) -> Iterator[Measurement]:
    """LH swings with joints on smooth waves that are not at rest at the ends, the tilted trunk turning steadily."""
    model = pin.buildModelFromUrdf(str(HYQ.source), pin.JointModelFreeFlyer())
    data, columns = model.createData(), [HYQ.tree.joints.index(joint) for joint in HYQ.legs[LEG].joints]
    in_q = [model.joints[model.getJointId(joint)].idx_q for joint in HYQ.tree.joints]
    in_v = [model.joints[model.getJointId(joint)].idx_v for joint in HYQ.tree.joints]
    omega, rest = np.array([0.05, -0.1, 0.2]), standing_configuration(HYQ)
    friction = np.array([HYQ.dynamics[joint].viscous for joint in HYQ.tree.joints])
    for k in range(round(seconds / period) + 6):
        time = period * k
        flying = 3 <= k < round(seconds / period) + 3
        phase = 9.0 * time + np.array([0.3, 1.1, 2.0])
        size = np.array([0.15, 0.3, 0.4])
        q, qd, qdd = rest.copy(), np.zeros(12), np.zeros(12)
        q[columns] += size * np.sin(phase)
        qd[columns], qdd[columns] = 9.0 * size * np.cos(phase), -81.0 * size * np.sin(phase)
        full, velocity, acceleration = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        full[3:7] = pin.Quaternion(TILT).coeffs()
        full[in_q], velocity[in_v], acceleration[in_v] = q, qd, qdd
        velocity[3:6] = omega
        torque = pin.rnea(model, data, full, velocity, acceleration)[in_v] + friction * qd
        torque[columns] += TRUE
        if touch and k >= round((seconds - touch) / period) + 3:
            torque[columns] += 30.0  # the foot is on the ground, and nobody has noticed yet
        stance = np.ones(4, dtype=bool)
        stance[LEG] = not flying
        yield Measurement(time, q, qd, torque, omega, 9.81 * TILT[2], TILT, stance=stance)


def found(samples: Iterator[Measurement]) -> list[LegOffsets]:
    gathering = SwingOffsets(MeasuredLegs(HYQ), NOISE)
    return [offsets for m in samples for offsets in gathering.update(m)]


@pytest.mark.parametrize("touch", [0.0, 0.04])
def test_a_swing_tells_its_legs_offsets(touch: float):
    (offsets,) = found(swing(touch=touch))
    assert offsets.leg == LEG
    assert offsets.value == pytest.approx(TRUE, abs=0.01)
    assert np.all(np.sqrt(offsets.variance) < 0.5 * NOISE.torque_constant[LEG])


def test_a_swing_too_short_tells_nothing():
    assert not found(swing(seconds=0.15))


def test_who_does_not_say_which_legs_carry_learns_nothing():
    gathering = SwingOffsets(MeasuredLegs(HYQ), NOISE)
    still = Measurement(0.0, standing_configuration(HYQ), *np.zeros((2, 12)), np.zeros(3), np.array([0.0, 0.0, 9.81]))
    assert gathering.update(still) == []


def test_the_load_test_learns_offsets_from_swings():
    test = LoadTest(87.0, 61.0, NOISE)
    before = test.offsets_std.copy()
    for _ in range(30):
        test.learn_offsets(LegOffsets(LEG, 0.0, TRUE, np.full(3, 0.15**2)))
    own, others = np.arange(6, 9), np.r_[0:6, 9:12]
    assert test.offsets[own] == pytest.approx(TRUE, abs=0.05)
    assert np.all(test.offsets_std[own] < 0.3 * before[own])
    assert np.all(test.offsets_std[own] > 0.04), "offsets drift, so they are never known for good"
    assert not test.offsets[others].any()
    assert test.offsets_std[others] == pytest.approx(before[others])
