"""Moments near rest, against Pinocchio's statics of the raw model file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.standing import StandingRobot

from stadera.lab.supervise import RestLimits, RestMoment, RestWatch
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import ContactForceEstimator, Measurement

HYQ = load_robot("hyq")
TILTED = Rotation.from_euler("xyz", [4.0, -6.0, 20.0], degrees=True).as_matrix()


def moments(samples: list[Measurement], limits: RestLimits | None = None) -> list[RestMoment]:
    watch = RestWatch(ContactForceEstimator(HYQ), limits)
    return [moment for m in samples if (moment := watch.update(m)) is not None]


def stood(seconds: float, load: float = 0.0, rotation: np.ndarray | None = None) -> list[Measurement]:
    standing = StandingRobot(HYQ, load, (-0.3, 0.1, 0.2))
    first = standing.measurement(0.0, standing_configuration(HYQ), rotation)
    return [replace(first, time=0.004 * k) for k in range(round(seconds / 0.004) + 1)]


@pytest.mark.parametrize("rotation", [np.eye(3), TILTED])
def test_mass_at_rest(rotation: np.ndarray):
    found = moments(stood(1.0, 7.0, rotation))
    assert len(found) >= 3
    for moment in found:
        assert moment.mass == pytest.approx(HYQ.inertias[HYQ.trunk].mass + 7.0, abs=1e-6)
        assert moment.end - moment.begin <= 0.12 + 0.004 + 1e-9


def test_constant_offsets_move_the_mass_as_felt():
    """By as much as torques that are off do: the forces are linear in them."""
    offsets = np.random.default_rng(0).normal(0.0, 2.0, 12)
    samples = stood(0.3)
    columns = ContactForceEstimator(HYQ).legs.columns
    effort = samples[0].effort.copy()
    effort[columns.ravel()] += offsets
    clean, biased = moments(samples)[0], moments([replace(m, effort=effort) for m in samples])[0]
    assert biased.mass - clean.mass == pytest.approx(clean.slope @ offsets, rel=1e-9)
    assert abs(biased.mass - clean.mass) > 0.1


def test_a_common_vertical_acceleration_cancels():
    """Torques, and the specific force, of a robot that is pushed upwards as a whole scale alike."""
    up = [
        replace(m, effort=m.effort * 1.02, specific_force=m.specific_force * 1.02, rotation=np.eye(3))
        for m in stood(0.3, 7.0)
    ]
    assert moments(up)[0].mass == pytest.approx(HYQ.inertias[HYQ.trunk].mass + 7.0, abs=1e-6)


def test_variance_is_that_of_white_torque_noise():
    rng, samples = np.random.default_rng(1), stood(25.0)
    limits = RestLimits(joint_velocity=1.0)
    torque = ContactForceEstimator(HYQ).noise.torque_white
    scale = np.zeros(12)
    scale[ContactForceEstimator(HYQ).legs.columns.ravel()] = torque.ravel()
    noisy = [
        replace(
            m,
            effort=m.effort + scale * rng.standard_normal(12),
            specific_force=m.specific_force + 0.05 * rng.standard_normal(3),
        )
        for m in samples
    ]
    found = moments(noisy, limits)
    masses = np.array([moment.mass for moment in found])
    assert np.var(masses) == pytest.approx(np.mean([moment.variance for moment in found]), rel=0.35)


def test_no_moment_while_something_moves():
    samples = stood(1.0)
    assert not moments([replace(m, joint_velocity=np.full(12, 1.0)) for m in samples])
    assert not moments([replace(m, angular_velocity=np.array([0.0, 0.5, 0.0])) for m in samples])
    assert not moments([replace(m, specific_force=m.specific_force * 1.1) for m in samples])
    assert not moments([replace(m, stance=np.array([True, True, False, True])) for m in samples])


def test_a_short_rest_is_left_out_and_one_long_enough_ends_with_the_motion():
    still, limits = stood(0.2), RestLimits(shortest=0.1)
    moving = [replace(m, time=m.time + 0.2, joint_velocity=np.full(12, 1.0)) for m in still]
    found = moments([*still, *moving], limits)
    assert len(found) == 1
    assert found[0].end <= 0.22
    assert not moments([*still[:10], *[replace(m, time=m.time - 0.1) for m in moving[16:]]], limits)
