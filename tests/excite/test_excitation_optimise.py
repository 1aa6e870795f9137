"""The optimised motion: within bounds, at rest at both ends, seeded, and more informative than random draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.body import FrictionModel
from stadera.errors import IdentificationError, MissingExtraError, UnknownNameError
from stadera.excite.bounds import LegBounds, Margins
from stadera.excite.design import Excitation, ExciteSettings, excite, motion_table
from stadera.excite.optimise import FourierSearch, FourierSeries, LegExperiment, optimal_excitation
from stadera.lab.laws.paper_draw import paper_draw
from stadera.logs import read, write_table
from stadera.robot import Robot, load_robot
from stadera.robot.stance import standing_configuration

QUICK = FourierSearch(harmonics=4, samples=32, starts=1, iterations=40)


def robot_named(name: str) -> Robot:
    try:
        return load_robot(name)
    except MissingExtraError as missing:
        pytest.skip(str(missing))


@pytest.fixture(scope="module")
def hyq() -> Robot:
    return load_robot("hyq")


@pytest.fixture(scope="module", params=["hyq", "go2"])
def designed(request: pytest.FixtureRequest) -> tuple[Robot, Excitation]:
    robot = robot_named(request.param)
    settings = ExciteSettings(duration=40.0, rate=200.0, seed=1, draws=3, search=QUICK)
    return robot, excite(robot, "RH", settings)


def test_beats_every_random_draw(designed: tuple[Robot, Excitation]) -> None:
    _, found = designed
    assert found.chosen.gain > max(draw.gain for draw in found.draws) + 5.0
    assert found.chosen.rank >= max(draw.rank for draw in found.draws)
    assert found.median_ratio is not None
    assert found.median_ratio > 1.3
    assert found.gained is not None
    assert found.gained > 5.0


def test_respects_position_velocity_torque_and_clearance(designed: tuple[Robot, Excitation]) -> None:
    robot, found = designed
    margins = Margins()
    reference = found.chosen.motion.sample(1000.0)
    bounds = LegBounds.of(robot, "RH")
    torque = bounds.torque(reference)
    for k, joint in enumerate(robot.leg("RH").joints):
        limit = robot.limits[joint]
        q = reference.position[:, k]
        assert limit.lower + margins.position - 1e-3 <= q.min()
        assert q.max() <= limit.upper - margins.position + 1e-3
        assert np.abs(q - bounds.rest[k]).max() <= margins.reach + 1e-3
        assert np.abs(reference.velocity[:, k]).max() <= margins.velocity * limit.velocity + 1e-3
        assert np.abs(torque[:, k]).max() <= margins.effort * limit.effort + 1e-3
    assert bounds.clearance.slack(reference.position[::7]).min() > -2e-3


def test_tight_limits_bind_and_hold(hyq: Robot) -> None:
    tight = {name: replace(limit, velocity=1.5, effort=12.0) for name, limit in hyq.limits.items()}
    bounds = LegBounds.of(replace(hyq, limits=tight), "RH")
    experiment = LegExperiment(bounds, np.full(3, 0.5), rate=200.0)
    motion = optimal_excitation(experiment, np.random.default_rng(0), 30.0, QUICK).sample(500.0)
    fastest, hardest = np.abs(motion.velocity).max(axis=0), np.abs(bounds.torque(motion)).max(axis=0)
    assert (fastest <= 0.7 * 1.5 * 1.01).all()
    assert (hardest <= 0.7 * 12.0 * 1.01).all()
    assert fastest.max() > 0.8 * 0.7 * 1.5


def test_a_leg_of_six_joints_is_designed_as_well() -> None:
    robot = robot_named("g1")
    search = FourierSearch(harmonics=3, samples=24, starts=1, iterations=10, penalties=(200.0,))
    found = excite(robot, "left", ExciteSettings(duration=20.0, draws=1, search=search))
    motion, bounds = found.chosen.motion.sample(50.0), found.experiment.bounds
    assert motion.position.shape[1] == 6
    assert bounds.excess(motion) < 1e-9
    assert bounds.clearance.slack(motion.position[::25]).min() > -1e-9
    assert found.chosen.gain > found.draws[0].gain


def test_starts_and_ends_at_rest_in_the_stance(designed: tuple[Robot, Excitation]) -> None:
    robot, found = designed
    table = motion_table(robot, found.chosen.motion.sample(200.0))
    stance = standing_configuration(robot)
    assert table.joints == robot.tree.joints
    assert table.time[0] == 0.0
    assert table.time[-1] == pytest.approx(40.0)
    assert table.velocity is not None
    assert table.acceleration is not None
    for end in (0, -1):
        np.testing.assert_allclose(table.position[end], stance, atol=1e-9)
        np.testing.assert_allclose(table.velocity[end], 0.0, atol=1e-9)
        np.testing.assert_allclose(table.acceleration[end], 0.0, atol=1e-7)
    others = [k for k, joint in enumerate(table.joints) if joint not in robot.leg("RH").joints]
    np.testing.assert_allclose(table.position[:, others], np.tile(stance[others], (len(table), 1)), atol=1e-9)


def test_table_survives_a_file(hyq: Robot, tmp_path: object) -> None:
    reference = paper_draw(hyq, "LF", np.random.default_rng(0), 4.0).sample(100.0)
    whole, leg = motion_table(hyq, reference), motion_table(hyq, reference, whole=False)
    assert leg.joints == hyq.leg("LF").joints
    back = read(write_table(whole, f"{tmp_path}/motion.csv"))
    np.testing.assert_array_equal(back.position, whole.position)
    assert back.velocity is not None
    np.testing.assert_array_equal(back.velocity, whole.velocity)
    np.testing.assert_array_equal(back.channel("position", leg.joints), leg.position)


def test_same_seed_same_motion(hyq: Robot) -> None:
    experiment = LegExperiment.usual(LegBounds.of(hyq, "RH"), 100.0)
    search = FourierSearch(harmonics=2, samples=16, starts=1, iterations=6)
    one, same, other = (
        optimal_excitation(experiment, np.random.default_rng(seed), 10.0, search).sample(50.0) for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(one.position, same.position)
    assert np.abs(one.position - other.position).max() > 0.01


def test_random_asks_for_the_papers_draw_itself(hyq: Robot) -> None:
    found = excite(hyq, "RH", ExciteSettings(duration=20.0, random=True, seed=5))
    draw = paper_draw(hyq, "RH", np.random.default_rng((5, 0)), 20.0)
    np.testing.assert_array_equal(found.chosen.motion.sample(50.0).position, draw.sample(50.0).position)
    assert found.draws == ()
    assert found.gained is None
    assert found.median_ratio is None


def test_progress_goes_from_nothing_to_all(hyq: Robot) -> None:
    told: list[float] = []
    experiment = LegExperiment.usual(LegBounds.of(hyq, "RH"), 100.0)
    search = FourierSearch(harmonics=2, samples=16, starts=2, iterations=5)
    optimal_excitation(experiment, np.random.default_rng(0), 10.0, search, told.append)
    assert told == sorted(told)
    assert 0.0 < told[0] < 0.5
    assert told[-1] == 1.0


def test_structure_has_the_rank_of_a_leg_on_a_held_trunk(hyq: Robot) -> None:
    rigid = LegExperiment(LegBounds.of(hyq, "RH"), np.ones(3), friction=FrictionModel())
    assert rigid.structure.rank == 17


def test_gain_is_the_entropy_that_sampling_from_the_posterior_shows(hyq: Robot) -> None:
    """½ log det of prior over posterior covariance, each formed by itself."""
    experiment = LegExperiment(LegBounds.of(hyq, "RH"), np.full(3, 0.5), rate=100.0)
    reference = paper_draw(hyq, "RH", np.random.default_rng(0), 10.0).sample(100.0)
    prior = experiment.prior
    rows = [np.zeros((0, len(prior.columns)))]
    for row in experiment.regressor.rows(reference, np.zeros((len(reference), 3))):
        dense = np.zeros((len(reference), len(prior.columns)))
        dense[:, [prior.columns.index(name) for name in row.columns]] = row.matrix
        rows.append(dense / 0.5)
    Y = np.vstack(rows) @ prior.root
    # in whitened coordinates the prior covariance is 1
    expected = -0.5 * np.linalg.slogdet(np.linalg.inv(np.eye(Y.shape[1]) + Y.T @ Y))[1]
    assert experiment.gain(reference) == pytest.approx(expected, rel=1e-6)


def test_gain_grows_with_samples_and_falls_with_noise(hyq: Robot) -> None:
    bounds = LegBounds.of(hyq, "RH")
    reference = paper_draw(hyq, "RH", np.random.default_rng(0), 20.0, bounds).sample(100.0)
    plain = LegExperiment(bounds, np.full(3, 0.5), 100.0)
    gain = plain.gain(reference)
    assert replace(plain, rate=400.0).gain(reference) == pytest.approx(
        replace(plain, noise=np.full(3, 0.25)).gain(reference), rel=1e-9
    )
    assert replace(plain, noise=np.full(3, 5.0)).gain(reference) < gain < replace(plain, rate=400.0).gain(reference)


@pytest.mark.parametrize("duration", [2.0, 9.0, 47.0])
def test_series_and_sinusoids_are_the_same_motion(hyq: Robot, duration: float) -> None:
    series = FourierSeries(LegBounds.of(hyq, "RH"), harmonics=3, period=5.0, duration=duration)
    x = np.random.default_rng(0).normal(0.0, 0.3, series.unknowns)
    time = np.linspace(0.0, duration, 300)
    expected = series.motion(x).at(time)
    q, dq, ddq = (basis @ series.coefficients(x[None])[0] for basis in series.basis(time))
    np.testing.assert_allclose(q + series.bounds.rest, expected.position, atol=1e-12)
    np.testing.assert_allclose(dq, expected.velocity, atol=1e-11)
    np.testing.assert_allclose(ddq, expected.acceleration, atol=1e-10)
    times, seconds = series.quadrature(30)
    assert seconds.sum() == pytest.approx(duration)
    assert 0.0 < times.min() < times.max() < duration


@pytest.mark.parametrize(
    "wrong",
    [
        {"duration": 1.0},
        {"rate": 1.0},
        {"draws": 0},
        {"seed": -1},
        {"stand_height": -0.5},
    ],
)
def test_bad_settings_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(IdentificationError):
        ExciteSettings(**wrong)  # type: ignore[arg-type]


def test_bad_requests_are_refused(hyq: Robot) -> None:
    with pytest.raises(UnknownNameError, match="LF, RF, LH, RH"):
        excite(hyq, "tail")
    with pytest.raises(IdentificationError, match="raise the trunk"):
        excite(hyq, "RH", ExciteSettings(stand_height=0.3))
    with pytest.raises(IdentificationError, match="harmonic"):
        FourierSearch(harmonics=0)
    with pytest.raises(IdentificationError, match="4 samples"):
        FourierSearch(harmonics=6, samples=20)
    stance = standing_configuration(hyq)
    own = {
        joint: replace(hyq.limits[joint], lower=stance[k] - 0.04, upper=stance[k] + 0.04)
        for k, joint in enumerate(hyq.tree.joints)
        if joint in hyq.leg("RH").joints
    }
    stuck = LegExperiment(LegBounds.of(replace(hyq, limits={**hyq.limits, **own}), "RH"), np.ones(3))
    with pytest.raises(IdentificationError, match="no room"):
        optimal_excitation(stuck, np.random.default_rng(0))
