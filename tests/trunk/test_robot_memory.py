"""What earlier logs told of a robot, and a test weight: against dense conditioning, and on drawn robots."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stadera import IdentificationError, TrunkEstimator, load_robot
from stadera.excite.sinusoids import Sinusoids
from stadera.excite.trunk.planted import AXES, Drawn, Planted
from stadera.inertia import InertialParameters
from stadera.information import Information
from stadera.robot.model import JointDynamics
from stadera.trunk import Samples
from stadera.trunk.memory import Memory, MemorySettings, names_of
from stadera.trunk.settings import TrunkSettings

GO2 = load_robot("go2")
LOAD = InertialParameters.from_com(1.5, (0.05, -0.02, 0.1), 0.004 * np.eye(3))
STILL = MemorySettings(friction=0.0, offset=0.0, lag=0.0, daily=0.0)


def sway(seed: int) -> Sinusoids:
    rng = np.random.default_rng(seed)
    largest = np.array([0.16, 0.16, 0.08, 0.01, 0.01, 0.0])
    amplitudes = np.repeat(0.5 * largest[None, :, None], 2, axis=2)
    frequencies, phases = rng.uniform(0.6, 1.6, (1, 6, 2)), rng.uniform(0.0, 6.0, (1, 6, 2))
    starts = np.array([0.0, 2.5])
    return Sinusoids(AXES, np.zeros(6), np.zeros((1, 6)), amplitudes, frequencies, phases, starts, 0.5)


@cache
def drawn(seed: int) -> Drawn:
    return Drawn(GO2, np.random.default_rng((5, seed)))


@cache
def measured(robot: int, log: int, load: InertialParameters | None, later: float = 0.0) -> Samples:
    made = drawn(robot)
    samples = made.measured(Planted.of(made.true, sway(log), 125.0), load)
    return replace(samples, time=samples.time + later)


def weighed(robot: int, log: int, memory: Memory | None = None) -> TrunkEstimator:
    estimator = TrunkEstimator(GO2)
    if memory is not None:
        estimator.recall(memory, settings=STILL)
    estimator.add(measured(robot, log, None))
    estimator.tare()
    estimator.add(measured(robot, log, LOAD, 4.5))
    return estimator


@cache
def remembered(robot: int, logs: int) -> Memory:
    memory = Memory.none(GO2)
    for log in range(logs):
        memory = weighed(robot, log).remember(memory, settings=STILL)
    return memory


def test_information_adds_up_to_the_posterior_of_all_rows() -> None:
    """What two logs tell of errors that each knows only together, against one least-squares fit of both."""
    names, rng = names_of(GO2), np.random.default_rng(0)
    n, memory, normal, right = len(names), Memory.none(GO2), np.eye(len(names)), np.zeros(len(names))
    for log in range(2):
        H, y, start = rng.normal(size=(20, n)), rng.normal(size=20), np.diag(rng.uniform(0.5, 1.0, n))
        after = np.linalg.inv(H.T @ H + np.linalg.inv(start))
        told = Information.of_posterior(names, after @ H.T @ y, after, start, 1e-9)
        memory = memory.with_log(told, 0.0, STILL, log)
        normal, right = normal + H.T @ H, right + H.T @ y
    covariance = np.linalg.inv(normal)
    found = np.array(list(memory.marginals().values()))
    np.testing.assert_allclose(found[:, 0], covariance @ right, atol=1e-9)
    np.testing.assert_allclose(found[:, 1], np.sqrt(np.diag(covariance)), rtol=1e-9)


def test_a_robot_that_was_on_a_scale_remembers_the_scale_of_its_torques() -> None:
    narrower, sigmas = [], []
    for robot in range(2):
        first = weighed(robot, 0)
        truth = drawn(robot).true
        first.know_weight(truth.mass, 0.02)
        of_first = first.remember(Memory.none(GO2), settings=STILL)
        memory = weighed(robot, 1, of_first).remember(of_first, settings=STILL)
        assert memory.logs == 2
        alone, after = weighed(robot, 7), weighed(robot, 7, memory)
        assert alone.payload is not None
        assert after.payload is not None
        narrower.append([after.trunk.mass_std / alone.trunk.mass_std, after.payload.mass_std / alone.payload.mass_std])
        error = [after.payload.mass - LOAD.mass, after.trunk.inertial.mass - truth.inertias[GO2.trunk].mass - LOAD.mass]
        sigmas.append(np.abs(error) / [after.payload.mass_std, after.trunk.mass_std])
        assert after.trust.verdict == "good", after.trust.reasons
    assert np.median(narrower, axis=0)[0] < 0.8
    assert np.median(narrower, axis=0)[1] < 0.95
    assert np.max(sigmas) < 3.0


def test_logs_without_a_scale_never_tell_the_scale_of_the_torques() -> None:
    """However many they are: what they have wrong by that scale, they have wrong alike."""
    memory = remembered(0, 2)
    alone, after = weighed(0, 7).payload, weighed(0, 7, memory).payload
    assert alone is not None
    assert after is not None
    assert after.mass_std_without_scale < alone.mass_std_without_scale
    assert after.scale == pytest.approx(alone.scale, rel=0.02)


def test_it_fades_with_logs_and_days() -> None:
    """Against the covariance of errors that have drifted since."""
    memory = remembered(0, 1)
    later = memory.faded(0.0, MemorySettings())
    long_after = replace(memory, days=0.0).faded(1e4, MemorySettings())

    def told(memory: Memory) -> float:
        return float((memory.known.R**2).sum())

    assert told(memory) > told(later) > told(long_after) > 0.0
    assert told(memory.faded(0.0, STILL)) == pytest.approx(told(memory))
    names, rng = memory.known.names, np.random.default_rng(1)
    H, y = rng.normal(size=(len(names), len(names))), rng.normal(size=len(names))
    whole = replace(memory, known=Information.empty(names).add(H, y), days=0.0)
    drifted = whole.faded(9.0, MemorySettings(daily=0.1)).known
    drift = {"viscous": 0.3, "coulomb": 0.3, "load_friction": 0.3, "offset": 0.4, "torque_lag": 0.1}
    squares = [drift.get(name.split(".")[0], 0.0) ** 2 + 9.0 * 0.1**2 for name in names]
    np.testing.assert_allclose(drifted.covariance(), whole.known.covariance() + np.diag(squares), rtol=1e-6)
    np.testing.assert_allclose(drifted.mean, whole.known.mean, rtol=1e-6)


def test_a_changed_motor_is_named_and_not_merged() -> None:
    memory = remembered(1, 2)
    measured.cache_clear()
    made = drawn(1)
    joint = GO2.tree.joints[4]
    was = made.true.dynamics[joint]
    swapped = JointDynamics(was.armature, was.viscous, was.coulomb + 2.5, was.offset)
    made.true = made.true.with_dynamics({joint: swapped})
    try:
        estimator = weighed(1, 8)
        with pytest.raises(IdentificationError, match=f"2 logs in the Coulomb friction of {joint}"):
            estimator.remember(memory, settings=STILL)
        told = weighed(1, 8, memory)
        assert told.trust.verdict == "doubtful"
        assert any("the memory, which is left out, and the log are" in reason for reason in told.trust.reasons)
    finally:
        drawn.cache_clear()
        measured.cache_clear()


def drifted(made: Drawn, rng: np.random.Generator) -> None:
    """The robot on another day: friction a third more or less, offsets by 0.2 % of the limits, other noise."""
    dynamics, limits = dict(made.true.dynamics), dict(zip(GO2.tree.joints, made._limit, strict=True))
    for joint in (joint for leg in GO2.legs for joint in leg.joints):
        was, (first, second, third) = dynamics[joint], rng.normal(size=3).tolist()
        friction = was.viscous * np.exp(0.3 * first), was.coulomb * np.exp(0.3 * second)
        dynamics[joint] = JointDynamics(was.armature, *friction, was.offset + 0.002 * limits[joint] * third)
    made.true, made._seed = made.true.with_dynamics(dynamics), int(rng.integers(2**32))


def test_six_logs_days_apart_and_a_swapped_motor_in_the_fourth() -> None:
    """The last log is known better than the first, though all drives have drifted since; the log with another motor is
    named, those before are not.
    """
    made, rng, memory = Drawn(GO2, np.random.default_rng((5, 1))), np.random.default_rng(9), Memory.none(GO2)
    bars, joint, motor = list[float](), GO2.tree.joints[4], JointDynamics()
    for log in range(6):
        estimator, day = TrunkEstimator(GO2), 100.0 + 3.0 * log
        estimator.recall(memory, day)
        estimator.add(made.measured(Planted.of(made.true, sway(log), 125.0)))
        estimator.tare()
        loaded = made.measured(Planted.of(made.true, sway(log + 50), 125.0), LOAD)
        estimator.add(replace(loaded, time=loaded.time + 4.5))
        if (payload := estimator.payload) is not None and log in (0, 5):
            bars.append(payload.mass_std)
        if log == 0:
            estimator.know_weight(made.true.mass, 0.02)
        learnt, said = estimator.remembered(memory, day)
        if log == 3:
            assert learnt is None
            assert f"contradicts the memory of 3 logs in the Coulomb friction of {joint}" in said
            made.true = made.true.with_dynamics({joint: motor})
        else:
            assert learnt is not None, said
            assert payload is not None
            assert payload.mass == pytest.approx(LOAD.mass, abs=3.0 * payload.mass_std)
            memory = learnt
        drifted(made, rng)
        if log == 2:
            motor = made.true.dynamics[joint]
            other = JointDynamics(2.0 * motor.armature, motor.viscous, motor.coulomb + 2.0, motor.offset - 0.3)
            made.true = made.true.with_dynamics({joint: other})
    assert memory.logs == 5
    assert bars[-1] < 0.8 * bars[0]


def test_a_memory_is_plain_values_of_one_model() -> None:
    memory = remembered(0, 1)
    back = Memory.from_dict(json.loads(json.dumps(memory.to_dict())))
    np.testing.assert_array_equal(back.known.R, memory.known.R)
    np.testing.assert_array_equal(back.known.z, memory.known.z)
    assert (back.logs, back.robot, back.known.names) == (1, "go2", memory.known.names)
    with pytest.raises(IdentificationError, match="another model than hyq"):
        back.check(load_robot("hyq"))
    for broken in ({}, [], memory.to_dict() | {"R": [1.0]}, memory.to_dict() | {"z": [None]}):
        with pytest.raises(IdentificationError, match="not a robot's memory"):
            Memory.from_dict(broken)
    with pytest.raises(IdentificationError, match="which `--memory` itself writes"):
        Memory.from_dict({"robot": "go2", "trust": {}})


def test_a_test_weight_that_comes_too_late_is_told_how_to_be_kept() -> None:
    memory = remembered(0, 1)
    nothing = Information.empty(memory.known.names)
    scale = nothing.add(3.0 * np.eye(len(memory.known))[-1:], np.ones(1))
    how = "; to keep what a scale or test weight tells now, begin a new memory with this log"
    for evidence, end in ((nothing, ""), (scale, how)):
        with pytest.raises(IdentificationError, match=f"these samples are in the memory already{end}$"):
            memory.with_log(evidence, np.nan, MemorySettings(), memory.seen[0])


def test_a_test_weight_calibrates_the_robot() -> None:
    """With the payload known, the trunk's bar loses the torques' common scale, and the next load is known better."""
    estimator = weighed(2, 0)
    before, trunk = estimator.payload, estimator.trunk
    assert before is not None
    estimator.know_payload(LOAD.mass, LOAD.com, 0.002, 0.002)
    known = estimator.payload
    assert known is not None
    assert known.mass == pytest.approx(LOAD.mass, abs=0.005)
    assert known.mass_std < 0.2 * before.mass_std
    np.testing.assert_allclose(known.com, LOAD.com, atol=0.004)
    assert estimator.trunk.mass_std < trunk.mass_std
    assert estimator.trust.verdict == "good"
    wrong = weighed(2, 0)
    wrong.know_payload(2.0 * LOAD.mass, LOAD.com)
    assert wrong.trust.verdict == "doubtful"
    assert any("the test weight, which is left out, and the log" in reason for reason in wrong.trust.reasons)
    assert wrong.payload is not None
    assert (wrong.payload.mass, wrong.payload.mass_std) == (before.mass, before.mass_std)
    with pytest.raises(IdentificationError, match="since a tare"):
        TrunkEstimator(GO2).know_payload(1.0, (0.0, 0.0, 0.1))
    for bad, place in ((-1.0, (0.0, 0.0, 0.1)), ("a", (0.0, 0.0, 0.1)), (1.0, (0.0, 0.1)), (1.0, None)):
        with pytest.raises(IdentificationError, match="needs a mass above zero"):
            wrong.know_payload(bad, place)  # type: ignore[arg-type]


def test_a_log_is_remembered_once_and_only_for_the_model_that_it_was_weighed_with() -> None:
    memory = remembered(0, 1)
    assert Memory.from_dict(json.loads(json.dumps(memory.to_dict()))).seen == memory.seen
    with pytest.raises(IdentificationError, match="in the memory already"):
        weighed(0, 0).remember(memory, settings=STILL)
    joint = GO2.tree.joints[2]
    identified = GO2.with_dynamics({joint: JointDynamics(0.01, 0.0, 0.5, 0.0)})
    with pytest.raises(IdentificationError, match="other drives, links or feet"):
        memory.check(identified)


def test_what_is_said_during_a_push_is_of_the_load_that_stays() -> None:
    """A payload that is said while a person pushes the robot is on its back, and rows of the push are not."""
    estimator = TrunkEstimator(GO2)
    estimator.add(measured(2, 0, None))
    estimator.tare()
    estimator.add(measured(2, 1, None, 4.5))
    history = estimator._history
    whole = history.loaded
    assert whole is not None
    known = history.begin_load(30, estimator.errors.mean)
    assert known.loaded is not None
    assert known.loaded.blocks < whole.blocks - 30
    estimator._changes.ended = (known.loaded,)
    estimator._end_load(known.loaded)
    estimator.know_payload(0.01, (0.0, 0.0, 0.1))
    assert [segment for segment, _ in estimator._known[0].trunks] == [None, history.tare]
    history.return_to(known)
    assert history.loaded is not None
    assert history.loaded.blocks == known.loaded.blocks + estimator.settings.changes.back


def test_a_trunk_that_a_scale_makes_impossible_is_refused() -> None:
    estimator = TrunkEstimator(GO2, settings=TrunkSettings(apart=1e6))  # else the scale is left out
    estimator.add(measured(2, 0, None))
    before = estimator.trunk.inertial.mass
    estimator.know_weight(GO2.mass - GO2.inertias[GO2.trunk].mass + 0.02, 1e-3)
    assert estimator.estimate().status == "refused"
    assert "runs away" in estimator.refusal
    assert estimator.trunk.inertial.mass == before
