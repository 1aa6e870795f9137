"""Legs in the air: of the robot of the run on the ground, exact in the truth, with the draw's errors in the log."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stadera.errors import UnknownNameError
from stadera.excite.sinusoids import Sinusoids
from stadera.identify.legs import identify
from stadera.identify.settings import IdentifySettings
from stadera.lab.laws.paper_draw import paper_draw
from stadera.lab.scenarios import run as scenarios
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate, swing
from stadera.lab.truth import truth_json
from stadera.robot import load_robot

GO2 = load_robot("go2")
SEED = 35


def test_the_same_seed_is_the_same_robot() -> None:
    settings = SimulateSettings(errors="real", seed=5, duration=2.0)
    in_air, on_ground = (
        truth_json(run.truth)
        for run in (swing(GO2, "LF", settings), simulate(GO2, "stand", replace(settings, duration=0.5)))
    )
    assert in_air["drawn"] == on_ground["drawn"]
    assert in_air["trunk"] == on_ground["trunk"]


def test_one_leg_or_all() -> None:
    settings = SimulateSettings(errors="standard", duration=2.0)
    one, whole = swing(GO2, "rh", settings), swing(GO2, "all", settings)
    assert one.recording.joints == GO2.leg("RH").joints
    assert set(whole.recording.joints) == set(GO2.tree.joints)
    np.testing.assert_allclose(np.diff(whole.recording.time), 0.004)
    of_leg = [whole.true_motion.joints.index(joint) for joint in one.true_motion.joints]
    np.testing.assert_array_equal(whole.true_motion.position[:, of_leg], one.true_motion.position)
    with pytest.raises(UnknownNameError, match="leg"):
        swing(GO2, "XX", settings)


def test_friction_and_rotors_are_found_in_it() -> None:
    """Friction as it is on the path: it varies with position, and grows with the torque carried."""
    run = swing(GO2, "LF", SimulateSettings(errors="real", seed=106, duration=20.0))
    found = identify(GO2, run.recording, IdentifySettings(legs=("LF",), split=1.0)).to_dict()["joints"]
    drawn, motion = truth_json(run.truth)["drawn"], run.true_motion
    law = drawn["varying"]["friction"]
    for joint, fit in found.items():
        true, gain, k = drawn["joints"][joint], drawn["torque_gain"][joint], list(drawn["joints"]).index(joint)
        position, effort = (values[:, motion.joints.index(joint)] for values in (motion.position, motion.effort))
        place = np.linspace(law["low"][k], law["high"][k], len(law["variation"][k]))
        friction = true["coulomb"] * (1.0 + np.interp(position, place, law["variation"][k]).mean())
        load = np.abs(effort).mean()
        found_there = fit["coulomb"]["value"] + fit["coulomb_load"]["value"] * load
        assert found_there == pytest.approx(gain * (friction + law["load"][k] * load), rel=0.2)
        assert fit["coulomb"]["value"] == pytest.approx(gain * friction, abs=2.5 * fit["coulomb"]["std"])
        assert fit["coulomb"]["std"] < 0.25 * gain * friction
        assert fit["armature"]["value"] == pytest.approx(gain * true["armature"], rel=0.3)


def test_a_draw_that_is_not_clear_is_drawn_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first draw of this seed cannot be drawn in to ANYmal's rest pose."""
    failed: list[bool] = []

    def watched(*how: Any) -> Sinusoids:
        failed.append(True)
        draw = paper_draw(*how)
        failed[-1] = False
        return draw

    monkeypatch.setattr(scenarios, "paper_draw", watched)
    run = swing(load_robot("anymal_b"), "RF", SimulateSettings(errors="ideal", seed=SEED, duration=2.0))
    assert failed[0]
    assert np.ptp(run.recording.position, axis=0).min() > 0.1
