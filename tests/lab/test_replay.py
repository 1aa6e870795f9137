"""A log is replayed by the model that made it, and not by another; presliding is simulated as it is fitted."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from identify.leg_runs import DRIVE, hyq, other_hyq, run
from stadera.body.friction import presliding
from stadera.errors import ModelError, RecordingError, UntrustedError
from stadera.identify.legs import identify
from stadera.identify.settings import IdentifySettings
from stadera.lab.plant.leg import simulate_leg
from stadera.lab.replay import Drive, JointLaw, Replay, ReplaySettings, _begins, _Simulated, replay, replayed_models
from stadera.limits import LimitError, Limits
from stadera.logs.processing import Preprocessing, preprocess
from stadera.logs.topics import PdGains
from stadera.robot import Robot, load_robot

SHORT = ReplaySettings(windows=(0.25, 0.5), every=1.0, cutoff_hz=40.0)


def true() -> Robot:
    return replace(other_hyq(), dynamics=dict.fromkeys(hyq().tree.joints, DRIVE))


def replayed(**given: object) -> Replay:
    return replay(run(), [Drive("true", true()), Drive("CAD", hyq())], settings=SHORT, **given)  # type: ignore[arg-type]


def test_the_true_model_follows_its_own_log() -> None:
    result = replayed()
    assert result.overall("true", 0.5) < 0.01
    assert result.overall("true", 0.25) < result.overall("true", 0.5)
    assert result.overall("CAD", 0.5) > 20.0 * result.overall("true", 0.5)
    np.testing.assert_allclose(result.recorded[:, 0], result.paths["true"][:, 0], atol=1e-12)
    assert result.begins[0] == pytest.approx(10.0, abs=0.2)  # the second half


def test_a_controller_holds_its_model_to_the_path_and_late_torques_are_known() -> None:
    free, held = replayed(), replayed(gains=PdGains((200.0,), (5.0,)))
    assert held.overall("CAD", 0.5) < 0.2 * free.overall("CAD", 0.5)
    assert held.overall("true", 0.5) < 0.01
    assert replayed(lag=0.02).overall("true", 0.5) > 3.0 * free.overall("true", 0.5)


def test_presliding_acts_as_its_state() -> None:
    """A leg whose friction builds up: its own torque is known from its path, and the path from that torque."""
    robot = true()
    joint = hyq().leg("RH").joints[2]
    loose = robot.with_dynamics({joint: replace(robot.dynamics[joint], coulomb=0.0)})
    recording = simulate_leg(loose, "RH", _reference())
    travel, effort = 5e-3, recording.effort.copy()
    effort[:, 2] += DRIVE.coulomb * presliding(recording.position[:, 2], travel)
    made = replace(recording, effort=effort)
    models = [Drive("with", robot, {joint: JointLaw(travel=travel)}), Drive("without", robot)]
    result = replay(made, models, settings=SHORT)
    assert result.rmse("with", 0.5)[2] < 0.5 * result.rmse("without", 0.5)[2]


def _reference():  # type: ignore[no-untyped-def]
    from identify.leg_runs import swing

    return swing().sample(250.0)


def test_models_are_those_of_an_identification(tmp_path: Path) -> None:
    result = identify(hyq(), run(), IdentifySettings(legs=("RH",)))
    result.save_json(tmp_path / "legs.json")
    models, lag = replayed_models(str(tmp_path / "legs.json"), "hyq")
    names = ["identified", "identified, constant friction", "CAD with friction", "CAD"]
    assert [model.name for model in models] == names
    assert lag == result.torque_lag
    joint = result.legs[0].leg.joints[1]
    assert models[0].robot.dynamics[joint].coulomb == pytest.approx(result.identified_robot().dynamics[joint].coulomb)
    assert models[2].robot.dynamics[joint].coulomb == pytest.approx(result.legs[0].friction_only[f"{joint}.coulomb"])
    rolled = replay(run(), models, settings=SHORT)
    assert rolled.overall("identified", 0.5) < 0.8 * rolled.overall("CAD with friction", 0.5)
    value = json.loads(json.dumps(rolled.to_dict(), allow_nan=False))
    assert set(value["rmse"]) == {"0.25", "0.5"}
    assert "identified" in rolled.to_html()
    assert {"paths", "errors"} == set(rolled.to_figures())
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(ModelError):
        replayed_models(str(tmp_path / "other.json"), "hyq")
    with pytest.raises(LimitError):
        replayed_models("hyq", "hyq", load=partial(load_robot, limits=Limits(elements=10)))


def test_a_short_log_is_refused() -> None:
    with pytest.raises(RecordingError, match="too short"):
        replay(run(), [Drive("true", true())], settings=ReplaySettings(skip=0.97))
    driven = preprocess(run(), Preprocessing(25.0), hyq().leg("RH").joints)
    fitting = replace(driven, time=driven.time - driven.time[0])
    with pytest.raises(RecordingError, match="too short"):
        _begins(fitting, ReplaySettings(windows=(float(fitting.time[-1]),), skip=0.0))


def test_torques_may_act_before_their_stamps_but_no_controller_s() -> None:
    assert replayed(lag=-0.005).overall("true", 0.25) < 0.05
    with pytest.raises(RecordingError, match=r"at its stamp or later, got a lag of -0\.005 s"):
        replayed(lag=-0.005, gains=PdGains((200.0,), (5.0,)))


def test_friction_of_the_load_is_known_at_once() -> None:
    joints, time = hyq().leg("RH").joints, np.zeros(1)
    driven = preprocess(run(), Preprocessing(25.0), joints)
    law = {joint: JointLaw(load=(1.0, 0.0)) for joint in joints}
    simulated = _Simulated(Drive("loaded", true(), law), joints, np.array([0.0, 0.0, 1.0]), 1e-3, None)
    simulated.rollout(driven, float(driven.time[0]), time, 0.0)
    assert (simulated.model.dof_frictionloss > simulated.coulomb + 0.1).any()


def test_faults_of_the_log_are_corrected_or_refused() -> None:
    degrees = replace(run(), position=np.degrees(run().position))
    models = [Drive("true", true())]
    with pytest.raises(UntrustedError):
        replay(degrees, models, settings=SHORT)
    assert replay(degrees, models, settings=SHORT, fix=True).overall("true", 0.5) < 0.01
