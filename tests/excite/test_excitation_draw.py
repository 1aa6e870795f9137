"""Sinusoids and the paper's random draw: exact derivatives, rest at both ends, limits, seeds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stadera.errors import IdentificationError, UnknownNameError
from stadera.excite.bounds import LegBounds, Margins
from stadera.excite.sinusoids import Sinusoids
from stadera.lab.laws.paper_draw import gravity_shifting_poses, paper_draw
from stadera.lab.pinocchio import pinocchio_model
from stadera.robot import Robot, load_robot


@pytest.fixture(scope="module")
def hyq() -> Robot:
    return load_robot("hyq")


def random_sinusoids(seed: int, harmonics: int = 3) -> Sinusoids:
    rng = np.random.default_rng(seed)
    shape = (3, 2, harmonics)
    return Sinusoids(
        ("a", "b"),
        rng.uniform(-1, 1, 2),
        rng.uniform(-1, 1, (3, 2)),
        rng.uniform(-0.5, 0.5, shape),
        rng.uniform(0.2, 2.0, shape),
        rng.uniform(-3, 3, shape),
        np.array([0.0, 2.0, 3.5, 6.0]),
        1.5,
    )


@given(seed=st.integers(0, 10**6), harmonics=st.integers(0, 5))
@settings(max_examples=25, deadline=None)
def test_velocity_and_acceleration_are_the_derivatives_of_position(seed: int, harmonics: int) -> None:
    motion = random_sinusoids(seed, harmonics)
    step, time = 1e-5, np.linspace(-0.5, motion.duration + 0.5, 700)
    before, now, after = (motion.at(time + shift) for shift in (-step, 0.0, step))
    np.testing.assert_allclose((after.position - before.position) / (2 * step), now.velocity, atol=2e-7)
    np.testing.assert_allclose((after.velocity - before.velocity) / (2 * step), now.acceleration, atol=2e-6)


@given(seed=st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_starts_and_ends_at_rest_and_stays_there(seed: int) -> None:
    motion = random_sinusoids(seed)
    ends = motion.at(np.array([-1.0, 0.0, motion.duration, motion.duration + 3.0]))
    np.testing.assert_allclose(ends.position, np.tile(motion.rest, (4, 1)), atol=1e-12)
    np.testing.assert_allclose(ends.velocity, 0.0, atol=1e-12)
    np.testing.assert_allclose(ends.acceleration, 0.0, atol=1e-10)


@given(seed=st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_stays_within_what_its_segments_and_rest_span(seed: int) -> None:
    motion = random_sinusoids(seed)
    swing = np.abs(motion.amplitudes).sum(axis=2)
    upper = np.maximum((motion.origins + swing).max(axis=0), motion.rest)
    lower = np.minimum((motion.origins - swing).min(axis=0), motion.rest)
    q = motion.sample(200.0).position
    assert (q <= upper + 1e-12).all()
    assert (q >= lower - 1e-12).all()


def test_drawn_in_is_a_homothety_about_the_rest_pose() -> None:
    motion = random_sinusoids(5)
    whole, half = motion.sample(50.0), motion.drawn_in(0.5).sample(50.0)
    np.testing.assert_allclose(half.position - motion.rest, 0.5 * (whole.position - motion.rest), atol=1e-12)
    np.testing.assert_allclose(half.acceleration, 0.5 * whole.acceleration, atol=1e-11)


def test_sampling_is_even_and_reaches_the_end() -> None:
    motion = random_sinusoids(1)
    reference = motion.sample(333.0)
    np.testing.assert_allclose(np.diff(reference.time), 1 / 333.0, rtol=1e-9)
    assert 0 <= reference.time[-1] - motion.duration < 1 / 333.0
    np.testing.assert_allclose(reference.position[-1], motion.rest, atol=1e-12)


@pytest.mark.parametrize(
    "change",
    [
        {"fade": 1.6},
        {"fade": 0.0},
        {"starts": np.array([0.0, 3.0, 2.0, 6.0])},
        {"rest": np.zeros(3)},
        {"origins": np.full((3, 2), np.nan)},
        {"phases": np.zeros((3, 2, 1))},
    ],
)
def test_bad_sinusoids_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(IdentificationError):
        replace(random_sinusoids(0), **change)  # type: ignore[arg-type]


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
def test_bad_rate_is_refused(rate: float) -> None:
    with pytest.raises(IdentificationError, match="rate"):
        random_sinusoids(0).sample(rate)


def test_draw_has_the_papers_ranges(hyq: Robot) -> None:
    draws = [paper_draw(hyq, "RH", np.random.default_rng(seed), 60.0) for seed in range(10)]
    frequencies = np.array([d.frequencies for d in draws])
    phases = np.array([d.phases for d in draws])
    amplitudes = np.array([d.amplitudes for d in draws])[..., 0]
    assert 0.3 <= frequencies.min() < 0.36
    assert 0.85 < frequencies.max() <= 0.9
    assert 0.0 <= phases.min() < 0.2
    assert 2.9 < phases.max() <= np.pi
    np.testing.assert_array_less(amplitudes.max(axis=(0, 1)), np.array([0.25, 0.20, 0.40]) + 1e-6)
    np.testing.assert_array_less([0.2, 0.16, 0.3], amplitudes.max(axis=(0, 1)))
    assert all(d.duration == pytest.approx(60.0) and len(d.origins) == 6 for d in draws)


def test_draw_is_seeded(hyq: Robot) -> None:
    one, same, other = (paper_draw(hyq, "RH", np.random.default_rng(seed), 30.0).sample(50.0) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.position, same.position)
    assert np.abs(one.position - other.position).max() > 0.01


@pytest.mark.parametrize(("duration", "seed"), [(2.0, 0), (12.0, 1), (60.0, 2)])
@pytest.mark.parametrize("leg", ["LF", "RH"])
def test_draw_respects_limits_with_margins(hyq: Robot, leg: str, duration: float, seed: int) -> None:
    margins = Margins()
    reference = paper_draw(hyq, leg, np.random.default_rng(seed), duration).sample(400.0)
    assert reference.time[-1] == pytest.approx(duration, abs=1 / 400.0)
    for k, joint in enumerate(hyq.leg(leg).joints):
        limit = hyq.limits[joint]
        assert reference.position[:, k].min() >= limit.lower + margins.position - 1e-6
        assert reference.position[:, k].max() <= limit.upper - margins.position + 1e-6
        assert np.abs(reference.velocity[:, k]).max() <= margins.velocity * limit.velocity


def test_tight_velocity_limits_draw_the_motion_in(hyq: Robot) -> None:
    slow = replace(hyq, limits={name: replace(limit, velocity=0.5) for name, limit in hyq.limits.items()})
    reference = paper_draw(slow, "RH", np.random.default_rng(0), 40.0).sample(100.0)
    assert 0.2 < np.abs(reference.velocity).max() <= 0.7 * 0.5 + 1e-9


def test_torque_bound_agrees_with_pinocchio(hyq: Robot) -> None:
    import pinocchio as pin

    bounds = LegBounds.of(hyq, "RH")
    motion = paper_draw(hyq, "RH", np.random.default_rng(2), 20.0).sample(5.0)
    torque = bounds.torque(motion)
    model = pinocchio_model(hyq)
    data = model.createData()
    columns = [hyq.tree.joints.index(joint) for joint in bounds.joints]
    q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    for k in range(len(motion)):
        q[7:][columns], v[6:][columns], a[6:][columns] = motion.position[k], motion.velocity[k], motion.acceleration[k]
        expected = pin.rnea(model, data, q, v, a)[6:][columns]
        expected = expected + [
            hyq.dynamics[j].viscous * w for j, w in zip(bounds.joints, motion.velocity[k], strict=True)
        ]
        np.testing.assert_allclose(torque[k], expected, atol=1e-9)


def test_origins_shift_the_gravity_torque_more_than_random_poses_do(hyq: Robot) -> None:
    bounds = LegBounds.of(hyq, "RH")
    room = np.array([0.25, 0.2, 0.4])
    rng = np.random.default_rng(0)

    def least_shift(poses: np.ndarray) -> float:
        torque = bounds.gravity_torque(np.vstack((bounds.rest, poses)))
        torque = torque / bounds.gravity_torque(rng.uniform(bounds.lower, bounds.upper, (500, 3))).std(axis=0)
        apart = np.linalg.norm(torque[:, None] - torque, axis=2)
        return float(apart[np.triu_indices(len(torque), 1)].min())

    chosen = least_shift(gravity_shifting_poses(bounds, room, 6))
    random = [least_shift(rng.uniform(bounds.lower + room, bounds.upper - room, (6, 3))) for _ in range(50)]
    assert chosen > max(random)


def test_bad_requests_are_refused(hyq: Robot) -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(UnknownNameError, match="LF, RF, LH, RH"):
        paper_draw(hyq, "XX", rng)
    for duration in (0.0, 1.0, -5.0, np.nan):
        with pytest.raises(IdentificationError, match="at least 2 s"):
            paper_draw(hyq, "RH", rng, duration)
    with pytest.raises(IdentificationError, match="shares"):
        Margins(effort=0.0)


def test_a_torque_limit_that_cannot_hold_the_leg_is_named(hyq: Robot) -> None:
    weak = replace(hyq, limits=hyq.limits | {"lf_kfe_joint": replace(hyq.limits["lf_kfe_joint"], effort=0.5)})
    with pytest.raises(IdentificationError, match=r"out of bounds: lf_kfe_joint needs .* N·m to hold the leg and may"):
        paper_draw(weak, "LF", np.random.default_rng(0), 10.0)
