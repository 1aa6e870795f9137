"""Coulomb friction that varies with position, load or after a reversal is found where it does, and else is in a bar."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from identify.leg_runs import hyq, leg_regressor, noisy, run
from stadera.body import JointMotion, Rows
from stadera.body.friction import presliding
from stadera.identify.legs import identify
from stadera.identify.result import Identification
from stadera.identify.settings import IdentifySettings
from stadera.identify.varying import VaryingFriction, with_varying
from stadera.information import Information
from stadera.logs import Recording
from stadera.types import Array

A, B, LOAD, TRAVEL = 0.6, -0.9, 0.15, 2e-3


def dahl(position: Callable[[float], float], velocity: Callable[[float], float], time: Array, travel: float) -> Array:
    """The Dahl state over time, integrated as a differential equation."""
    solved = solve_ivp(
        lambda t, z: [velocity(t) / travel * (1.0 - z[0] * np.sign(velocity(t)))],
        (time[0], time[-1]),
        [np.sign(velocity(time[0]))],
        t_eval=time,
        max_step=1e-3,
        rtol=1e-7,
        atol=1e-8,
    )
    return np.asarray(solved.y[0])


@pytest.mark.parametrize("travel", [2e-4, 1e-3, 5e-3])
def test_presliding_is_dahls_differential_equation(travel: float) -> None:
    time = np.linspace(0.0, 3.0, 3001)

    def position(t: Any) -> Any:
        return 0.3 * np.sin(2.0 * t) + 0.004 * np.sin(25.0 * t)

    def velocity(t: Any) -> Any:
        return 0.6 * np.cos(2.0 * t) + 0.1 * np.cos(25.0 * t)

    error = presliding(position(time), travel) - dahl(position, velocity, time, travel)
    assert np.abs(error).mean() < 1e-4
    assert np.abs(error).max() < 4e-6 / travel  # at a reversal, whose instant lies between samples


def test_presliding_of_a_joint_that_does_not_move_is_zero_and_forgets_its_start() -> None:
    assert not presliding(np.full(5, 0.3), 1e-3).any()
    q = np.sin(np.linspace(0.0, 20.0, 2000))
    assert presliding(q, 1e-3)[700:] == pytest.approx(presliding(q[500:], 1e-3)[200:], abs=1e-12)


def varied(kind: str, joint: int = 2) -> Recording:
    """A leg in the air whose knee's friction varies, from velocities by differences and the true links' torque."""
    recording = run()
    q, t = recording.position, recording.time
    rate = np.gradient(q, t, axis=0)
    sign = np.tanh(rate[:, joint] / 0.02)
    if kind == "position":
        more = sign * (A * np.cos(q[:, joint]) + B * np.sin(q[:, joint]))
    elif kind == "presliding":
        spline = CubicSpline(t, q[:, joint])
        more = 1.2 * (dahl(spline, spline.derivative(), t, TRAVEL) - sign)
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
    assert any(joint in note and "position" in note for note in result.friction_notes())
    assert result.identified_robot().dynamics[joint].coulomb == terms["coulomb"]["value"]


def test_friction_by_load_is_found() -> None:
    joint = hyq().leg("RH").joints[2]
    result = found(varied("load"))
    terms = result.to_dict()["joints"][joint]
    assert terms["coulomb_load"]["value"] == pytest.approx(LOAD, abs=0.05)
    assert terms["coulomb"]["value"] == pytest.approx(1.2, abs=2.0 * terms["coulomb"]["std"])  # of a drive without load
    mean = terms["coulomb"]["value"] + terms["coulomb_load"]["value"] * terms["coulomb_load"]["mean_load"]
    assert result.simulated_robot().dynamics[joint].coulomb == pytest.approx(mean)


def test_presliding_is_found_with_its_travel_and_leaves_coulomb_friction() -> None:
    recording = varied("presliding")
    joint = hyq().leg("RH").joints[2]
    result = found(recording)
    terms = result.to_dict()["joints"][joint]
    assert terms["presliding"]["value"] == pytest.approx(
        TRAVEL, abs=max(3.0 * terms["presliding"]["std"], 0.2 * TRAVEL)
    )
    assert 0.0 < terms["presliding"]["std"] < 0.3 * TRAVEL
    assert terms["coulomb"]["value"] == pytest.approx(1.2, abs=0.05)
    assert any(joint in note and "reversal" in note for note in result.friction_notes())


def test_constant_friction_stays_constant() -> None:
    result = found(noisy(run(), 0.05))
    leg = result.legs[0]
    for name, quantity in leg.parameters.items():
        if "coulomb_" in name and quantity.std is not None:
            assert abs(quantity.value) < 3.0 * quantity.std, name
    assert not [joint for joint, law in leg.varying.items() if law.travel]


def test_what_a_log_does_not_tell_of_load_is_in_the_bar_of_friction() -> None:
    """A joint under a constant load h: μ |h| d is like τ_c d, so that var(τ_c) = var of the data + σ_μ² h²."""
    turning, load, noise, width = np.resize([1.0, -1.0], 400), 20.0, 0.3, 0.06
    rows = Rows(("l.m", "j.coulomb"), np.column_stack([np.full(400, load), turning]), 1.5 * turning, noise)
    law = VaryingFriction({"coulomb_load": 0.0})
    made = with_varying(rows, "j", law, np.zeros(400), turning, {"l.m": 1.0})
    prior = Rows(("j.coulomb_load",), np.array([[1.0 / width]]), np.zeros(1))
    told = Information.of([made, prior], made.columns).fix({"l.m": 0.0})
    std = np.sqrt(np.diag(np.linalg.inv(told.R.T @ told.R)))[told.names.index("j.coulomb")]
    assert std == pytest.approx(np.hypot(noise / np.sqrt(400.0), width * load), rel=1e-3)
