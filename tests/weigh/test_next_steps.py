"""What to do next: bars that are computed are those that are reached."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stadera import TrunkEstimator, load_robot
from stadera.excite.trunk import design
from stadera.excite.trunk.design import RoutineSettings, undesigned_bars
from stadera.excite.trunk.planted import Drawn, Planted
from stadera.inertia import InertialParameters
from stadera.trunk import Samples
from stadera.weigh.next_steps import NextStep, UseLimits, next_steps, steps_known

GO2 = load_robot("go2")
LOAD = InertialParameters.from_com(1.0, (0.0, 0.0, 0.1), 0.002 * np.eye(3))


@pytest.fixture(autouse=True)
def bars_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the load that is asked about, not those that all tests share."""
    for name in ("undesigned_bars", "bars_of_steps"):
        monkeypatch.setattr(design, name, getattr(design, name).__wrapped__)


@cache
def logs(size: float) -> tuple[Samples, Samples]:
    """A robot that sways a little or much for three seconds, without and with a load."""
    from stadera.excite.sinusoids import Sinusoids
    from stadera.excite.trunk.planted import AXES

    amplitudes = np.repeat(size * np.array([0.1, 0.1, 0.04, 0.0, 0.0, 0.0])[None, :, None], 2, axis=2)
    frequencies = np.random.default_rng(3).uniform(0.5, 1.4, (1, 6, 2))
    phases = np.random.default_rng(4).uniform(0.0, 6.0, (1, 6, 2))
    path = Sinusoids(AXES, np.zeros(6), np.zeros((1, 6)), amplitudes, frequencies, phases, np.array([0.0, 2.5]), 0.5)
    drawn = Drawn(GO2, np.random.default_rng(5))
    planted = Planted.of(drawn.true, path, 200.0)
    loaded = drawn.measured(planted, LOAD)
    return drawn.measured(planted), Samples(loaded.time + 3.5, *(getattr(loaded, n) for n in NAMES))


NAMES = ("position", "velocity", "effort", "angular_velocity", "specific_force", "extra")


@cache
def weighed(size: float, tare: bool = True) -> TrunkEstimator:
    bare, loaded = logs(size)
    estimator = TrunkEstimator(GO2)
    estimator.add(bare)
    if tare:
        estimator.tare()
        estimator.add(loaded)
    return estimator


@cache
def steps_of(estimator: TrunkEstimator, limits: UseLimits | None = None) -> tuple[NextStep, ...]:
    known = steps_known(GO2, estimator, limits)
    return next_steps(GO2, estimator.trunk, estimator.payload, known, limits)


def test_a_payload_that_is_hardly_known_is_known_after_a_sway() -> None:
    estimator = weighed(0.02)
    assert estimator.payload is not None
    steps = steps_of(estimator)
    assert any("sway for 5 s" in step.do and "stadera excite --robot go2 --trunk" in step.do for step in steps)
    assert [step.payload_std for step in steps] == sorted(step.payload_std for step in steps)
    assert all(step.payload_std < UseLimits().gained * estimator.payload.mass_std for step in steps)
    sway = next(step for step in steps if "sway" in step.do)
    assert sway.to_dict()["then"] == {"payload_std": sway.payload_std, "trunk_std": None}
    reached = weighed(1.0).payload
    assert reached is not None
    assert sway.payload_std == pytest.approx(reached.mass_std, rel=1.0)


def test_ten_steps_are_offered_with_the_bar_that_they_bring() -> None:
    """By the estimator on a made walk; robots with other errors that take these steps get such a bar in the median."""
    steps, bars = steps_of(weighed(0.02)), list[float]()
    step = next(step for step in steps if "ten slow steps" in step.do)
    for seed in (9, 10, 11):
        drawn, rate = Drawn(GO2, np.random.default_rng(seed)), 250.0
        walk = Planted.stepping(drawn.true, 10, rate)
        loaded = drawn.measured(walk, LOAD)
        estimator = TrunkEstimator(GO2)
        estimator.add(drawn.measured(walk))
        estimator.tare()
        estimator.add(Samples(loaded.time + walk.time[-1] + 1.0, *(getattr(loaded, n) for n in NAMES)))
        assert estimator.payload is not None
        bars.append(estimator.payload.mass_std)
        assert estimator.payload.mass == pytest.approx(LOAD.mass, abs=3.0 * estimator.payload.mass_std)
        assert estimator.trust.verdict == "good"
    assert 1.0 / 1.7 < step.payload_std / np.median(bars) < 1.7


def test_feet_of_steps_carry_nothing_in_the_air_and_stay_where_they_stand() -> None:
    walk = Planted.stepping(GO2, 8, 200.0)
    torque, force = walk.torques(GO2.inertias[GO2.trunk])
    air = walk.carries < 1e-9
    assert (air.mean(axis=0) > 0.05).all()
    assert np.abs(force[air]).max() < 1e-9
    world = walk.contacts + walk.pose[:, None, 3:]  # the trunk is level
    standing = walk.carries[:, 0] == 1.0
    jumps = np.abs(np.diff(world[:, 0], axis=0))[standing[1:] & standing[:-1]]
    assert jumps.max() < 2e-5
    weight = (force * walk.motion.normal[:, None]).sum(axis=2)
    assert weight[walk.carries == 1.0].min() > -0.05 * weight.sum(axis=1).mean()
    assert weight.sum(axis=1).mean() == pytest.approx(9.81 * GO2.mass, rel=0.02)
    assert np.isfinite(torque).all()


def test_a_memory_of_more_logs_is_worth_what_is_said() -> None:
    estimator = weighed(1.0)
    assert estimator.payload is not None
    one, three = estimator.bars_remembered(1)[0], estimator.bars_remembered(3)[0]
    assert three <= one < estimator.payload.mass_std


def test_bars_of_a_known_weight_are_those_that_are_reached_with_it() -> None:
    expected, estimator = weighed(1.0), weighed.__wrapped__(1.0)
    payload, trunk = expected.bars_on_scale(0.02)
    estimator.know_weight(GO2.mass, 0.02)
    assert estimator.payload is not None
    assert (payload, trunk) == pytest.approx((estimator.payload.mass_std, estimator.trunk.mass_std), rel=1e-6)
    calibrated, _ = expected.bars_calibrated(1.6)
    assert expected.payload is not None
    assert 0.3 * expected.payload.mass_std < calibrated < expected.payload.mass_std
    alone = weighed(1.0, tare=False)
    (step,) = steps_of(alone)
    assert "--weight" in step.do
    assert step.to_dict()["then"]["payload_std"] is None
    assert step.trunk_std < 0.5 * alone.trunk.mass_std


def test_nothing_is_to_be_done_where_bars_are_narrow() -> None:
    assert steps_of(weighed(1.0), UseLimits(fine=0.5)) == ()
    bars = undesigned_bars(GO2, 0.1)
    assert bars is not None
    assert bars.mass < 0.12
    assert RoutineSettings().seconds == 5.0


def test_a_mass_that_was_not_observed_has_to_be_so_by_a_step() -> None:
    nothing = TrunkEstimator(GO2).trunk
    known = (NextStep("one", trunk_std=0.3 * GO2.mass), NextStep("two", trunk_std=0.1 * GO2.mass))
    assert next_steps(GO2, nothing, None, known) == known[1:]


def test_a_step_that_hardly_narrows_the_bar_is_not_offered() -> None:
    """Such as the motion that the log has already: a step cuts the bar by a third at least."""
    trunk = weighed(1.0, tare=False).trunk
    known = (NextStep("a little", trunk_std=0.75 * trunk.mass_std), NextStep("much", trunk_std=0.6 * trunk.mass_std))
    assert next_steps(GO2, trunk, None, known) == known[1:]
