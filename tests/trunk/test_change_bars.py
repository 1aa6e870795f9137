"""Bars of a tare and of a change, and the blocks that they are of."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import numpy as np
import pytest

from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs import Recording
from stadera.robot import load_robot
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.samples import Samples
from stadera.trunk.settings import ChangeSettings, ModelErrors, TrunkSettings

SETTINGS = ChangeSettings()
BLOCK = 0.02


@cache
def loaded_walk(errors: str = "standard") -> Samples:
    robot = load_robot("hyq")
    load = Load(8.0, "kg", (0.0, 0.0, 0.15))
    settings = SimulateSettings(errors, load, duration=5.0, seed=4, load_time=3.0, hold=2)
    return Samples.of_recording(simulate(robot, "trot-load", settings).recording, robot)


@cache
def loaded_stand() -> Recording:
    """A tenth of the robot is put on after 4 s."""
    robot = load_robot("hyq")
    settings = SimulateSettings("standard", Load(0.1 * robot.mass), duration=5.5, seed=3, load_time=4.0, hold=2)
    return simulate(robot, "stand", settings).recording


def test_a_tare_leaves_out_its_blocks_and_bars_say_what_errors_do() -> None:
    estimator, samples = TrunkEstimator(load_robot("hyq")), loaded_walk()
    before = samples.time < 2.5
    estimator.add(samples[before])
    estimator.tare()
    step = round(BLOCK / float(np.median(np.diff(samples.time))))
    rest, blocks = samples[~before], 0
    while (
        estimator.payload is not None
        and estimator._history.loaded is not None
        and estimator._history.loaded.blocks == 0
    ):
        estimator.add(rest[blocks * step : (blocks + 1) * step])
        blocks += 1
        assert blocks < 10
    assert blocks in (SETTINGS.spoilt + 1, SETTINGS.spoilt + 2)  # a block may be half full at the tare
    estimator.add(rest[blocks * step :])
    payload, (change,) = estimator.payload, estimator.changes
    assert payload is not None
    assert payload.mass == pytest.approx(8.0, abs=0.6)
    assert 0.6 < change.mass_std / payload.mass_std < 1.6  # both know the models' errors


def test_bars_of_a_payload_and_of_its_change_have_what_friction_does_beyond_its_law() -> None:
    """Twice the correction, and none, which moves no estimate; drives without friction have nothing to correct."""
    samples = loaded_walk("harsh")
    bars = []
    for share in (0.0, 2.0):
        estimator = TrunkEstimator(load_robot("hyq"), settings=TrunkSettings(model=ModelErrors(friction_law=share)))
        estimator.add(samples[samples.time < 2.5])
        estimator.tare()
        estimator.add(samples[samples.time >= 2.5])
        payload, (change,) = estimator.payload, estimator.changes
        assert payload is not None
        bars.append((payload.mass, payload.mass_std, change.mass_std))
    without, twice = bars
    assert twice[0] == without[0]
    assert twice[1] > 1.02 * without[1]
    assert twice[2] > 1.02 * without[2]


@pytest.mark.parametrize("joint", [None, "lf_kfe_joint"])
def test_a_joint_that_never_rests_does_not_put_off_what_a_standing_robot_notices(joint: str | None) -> None:
    """One joint's encoder goes to and fro by 20 mrad once a second."""
    robot, log = load_robot("hyq"), deepcopy(loaded_stand())
    assert log.velocity is not None
    if joint is not None:
        k, turn = log.index(joint), 2.0 * np.pi * log.time
        log.position[:, k] += 0.02 * np.sin(turn)
        log.velocity[:, k] += 0.02 * 2.0 * np.pi * np.cos(turn)
    free = TrunkSettings(model=ModelErrors(coulomb=1e-4, load_friction=0.0))  # as these simulated drives are
    estimator = TrunkEstimator(robot, settings=free)
    estimator.add(Samples.of_recording(log, robot))
    (change,) = estimator.changes
    assert change.time == pytest.approx(4.0, abs=0.1)
    assert change.noticed < 4.6
    assert change.mass == pytest.approx(0.1 * robot.mass, abs=3.0 * change.mass_std)


def test_the_load_on_a_robot_that_squats_stays_while_friction_holds_the_joints() -> None:
    """The robot squats down, is loaded, and rises: its joints slide, stick and slide back. That the first rise is not
    as the descent before it shows friction; that joints which stick hold the robot as before is no end of the load.
    """
    robot = load_robot("anymal_b")
    load = Load(4.57, "kg", (-0.07, -0.07, 0.25))
    settings = SimulateSettings("real", load, duration=7.6, seed=9028, load_time=3.8, slope=0.0)
    samples, estimator = (
        Samples.of_recording(simulate(robot, "squat", settings).recording, robot),
        TrunkEstimator(robot),
    )
    estimator.add(samples[samples.time < 3.75])
    estimator.tare()
    for begin in np.arange(3.75, 7.5, 0.25):
        estimator.add(samples[(samples.time >= begin) & (samples.time < begin + 0.25)])
        if begin > 4.2:
            assert estimator.payload is not None
            assert estimator.payload.mass == pytest.approx(4.57, rel=0.1), f"at {begin + 0.25:g} s"
            assert len(estimator.changes) == 1
