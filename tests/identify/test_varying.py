"""Coulomb friction that varies with position or load is found where it is, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identify.leg_runs import hyq, leg_regressor, noisy, run
from stadera.body import JointMotion
from stadera.identify.legs import identify
from stadera.identify.result import Identification
from stadera.identify.settings import IdentifySettings
from stadera.logs import Recording

A, B, LOAD = 0.6, -0.9, 0.15


def varied(kind: str, joint: int = 2) -> Recording:
    """A leg in the air whose knee's friction varies, from velocities by differences and the true links' torque."""
    recording = run()
    q, t = recording.position, recording.time
    rate = np.gradient(q, t, axis=0)
    sign = np.tanh(rate[:, joint] / 0.02)
    if kind == "position":
        more = sign * (A * np.cos(q[:, joint]) + B * np.sin(q[:, joint]))
    else:
        regressor = leg_regressor(hyq())
        links = {
            c: float(hyq().inertias[c.rsplit(".", 1)[0]].to_dict()[c.rsplit(".", 1)[1]]) for c in regressor.columns
        }
        motion = JointMotion(q, rate, np.gradient(rate, t, axis=0))
        more = LOAD * sign * np.abs(regressor.predict(motion, links)[:, joint])
    assert recording.effort is not None
    effort = recording.effort.copy()
    effort[:, joint] += more
    return noisy(replace(recording, effort=effort), 0.05)


def found(recording: Recording) -> Identification:
    return identify(hyq(), recording, IdentifySettings(legs=("RH",)))


def test_friction_by_position_is_found_with_its_mean_in_the_coulomb_term() -> None:
    recording = varied("position")
    joint = hyq().leg("RH").joints[2]
    without = identify(hyq(), recording, IdentifySettings(legs=("RH",), varying=None))
    result = found(recording)
    terms = result.to_dict()["joints"][joint]
    for name, true in (("coulomb_cos", A), ("coulomb_sin", B)):
        assert terms[name]["value"] == pytest.approx(true, abs=max(4.0 * terms[name]["std"], 0.05))
    q = recording.position[: len(recording) // 2, 2]
    mean = 1.2 + A * np.cos(q).mean() + B * np.sin(q).mean()  # of the drive's Coulomb friction and what varies
    assert terms["coulomb"]["value"] == pytest.approx(mean, abs=0.1)
    ratio = [r.legs[0].rmse["validation"]["identified"][joint] for r in (result, without)]
    assert ratio[0] < 0.7 * ratio[1]
    assert any(joint in note and "position" in note for note in result.notes)
    assert result.identified_robot().dynamics[joint].coulomb == terms["coulomb"]["value"]


def test_friction_by_load_is_found() -> None:
    joint = hyq().leg("RH").joints[2]
    terms = found(varied("load")).to_dict()["joints"][joint]
    assert terms["coulomb_load"]["value"] == pytest.approx(LOAD, abs=0.05)


def test_constant_friction_stays_constant() -> None:
    result = found(noisy(run(), 0.05))
    assert not [name for leg in result.legs for name in leg.parameters if "coulomb_" in name]
    assert set(result.to_dict()["joints"][hyq().leg("RH").joints[2]]) == {"armature", "viscous", "coulomb", "offset"}
