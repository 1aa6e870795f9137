"""Fit quality of an identification: right where model and noise are, and never silent where they are not."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import stadera
from identify.leg_runs import DRIVE, hyq, noisy, run, swing
from stadera.body import FrictionModel
from stadera.errors import MissingExtraError, ModelError, StaderaError, UntrustedError
from stadera.identify.gather import LegScore
from stadera.identify.result import Identification
from stadera.identify.schema import with_identified_legs
from stadera.identify.settings import IdentifySettings, TrustSettings
from stadera.identify.trust import doubted
from stadera.inertia import InertialParameters
from stadera.lab.plant.leg import simulate_leg
from stadera.logs import Recording, read

RH = IdentifySettings(legs=("RH",))


@pytest.fixture(scope="module")
def clean() -> Recording:
    return noisy(run(), 1.0)


@pytest.fixture(scope="module")
def result(clean: Recording) -> Identification:
    return stadera.identify(hyq(), clean, RH)


def with_effort(recording: Recording, scale: dict[str, float]) -> Recording:
    assert recording.effort is not None
    factors = np.array([scale.get(joint, 1.0) for joint in recording.joints])
    return replace(recording, effort=recording.effort * factors)


def test_a_right_model_is_good(result: Identification) -> None:
    assert result.trust.verdict == "good"
    assert result.trust.reasons == ()
    assert result.trust.by_leg.keys() == {"RH"}
    assert result.trust.misfit == pytest.approx(result.trust.by_leg["RH"])
    assert 0.0 < result.trust.misfit < 2.0


def test_the_misfit_is_the_residuals_variance_over_the_stated_one(clean: Recording) -> None:
    """White noise alone: with neither drives' nor torques' imperfections allowed for, it is what the residual is."""
    strict = replace(RH, trust=TrustSettings(friction=1e-9, torque=1e-9))
    trust = stadera.identify(hyq(), noisy(run(), 10.0), strict).trust
    assert 0.5 < trust.misfit < 1.5


@pytest.mark.parametrize("reverse", [("rh_hfe_joint",), ("rh_haa_joint", "rh_hfe_joint", "rh_kfe_joint")])
def test_a_torque_of_the_wrong_sign_is_bad_and_named(clean: Recording, reverse: tuple[str, ...]) -> None:
    trust = stadera.identify(hyq(), with_effort(clean, dict.fromkeys(reverse, -1.0)), RH).trust
    assert trust.verdict == "bad"
    assert f"the torque of {', '.join(map(repr, reverse))} seems to have the other sign" in trust.reasons[0]


def test_torques_of_another_joint_are_bad(clean: Recording) -> None:
    assert clean.effort is not None
    trust = stadera.identify(hyq(), replace(clean, effort=clean.effort[:, [0, 2, 1]]), RH).trust
    assert trust.verdict == "bad"
    assert any("likeliest causes" in reason for reason in trust.reasons)


def test_terms_that_are_not_fitted_are_named_once(clean: Recording) -> None:
    trust = stadera.identify(hyq(), clean, replace(RH, friction=FrictionModel(("armature", "offset")))).trust
    (reason,) = trust.reasons
    assert reason.startswith("viscous, coulomb of the joints are not fitted: the torques' residuals of ")


def test_another_unit_is_doubtful(clean: Recording) -> None:
    """Half the torque can be had by other bodies, but hardly by ones that are like the model's."""
    trust = stadera.identify(hyq(), with_effort(clean, dict.fromkeys(clean.joints, 0.1)), RH).trust
    assert trust.verdict != "good"
    assert any("unit of the torques" in reason for reason in trust.reasons)


def test_a_trunk_that_turns_is_doubtful(clean: Recording) -> None:
    from stadera.logs import Imu

    n = len(clean)
    up = np.tile([0.0, 0.0, 9.81], (n, 1))
    turning = replace(clean, imu=Imu(np.full((n, 3), 0.2), up, None, "base_link"))
    trust = stadera.identify(hyq(), turning, RH).trust
    assert trust.verdict == "doubtful"
    assert "the IMU shows a turning trunk" in trust.reasons[0]


def test_a_good_fit_of_legs_not_to_be_used_is_doubtful(result: Identification) -> None:
    (leg,) = result.legs
    joint = leg.leg.joints[0]
    unseen = replace(leg.estimate.observability, singular_values=np.zeros(len(leg.estimate.columns)))
    unmeasured = replace(leg.estimate, observability=unseen)
    impossible = replace(leg.estimate, values=-leg.estimate.values)
    for bad, said in (
        (replace(leg, worse=("", joint)), "RH: torques that were not fitted are predicted worse"),
        (replace(leg, estimate=unmeasured), "RH: the log measures nothing"),
        (replace(leg, estimate=impossible), "RH: the solution is not physically consistent"),
    ):
        trust = doubted(result.trust, [bad])
        assert trust.verdict == "doubtful"
        assert trust.reasons[0].startswith(said)
    assert doubted(result.trust, [replace(leg, worse=(joint,))]) == result.trust


def test_torques_predicted_worse_than_by_cad_are_doubtful_everywhere() -> None:
    """A validation log whose hip and knee differ from CAD's the other way, and more than the fitted ones do."""
    cad = replace(hyq(), dynamics=dict.fromkeys(hyq().tree.joints, DRIVE))
    effort = 4.0 * simulate_leg(cad, "RH", swing().sample(250.0)).effort - 3.0 * run().effort
    effort[:, 0] = run().effort[:, 0]
    result = stadera.identify(hyq(), run(), RH, validation=replace(run(), effort=effort, source="other"))
    assert result.trust.verdict == result.to_dict()["trust"]["verdict"] == "doubtful"
    assert "predicted worse than by CAD" in result.trust.reasons[0]
    assert "Trust: doubtful" in result.to_html()


@pytest.mark.parametrize("name", ["go2", "aliengo"])
def test_real_legs_are_not_bad(shared_data, name: str) -> None:
    log = shared_data / "real" / f"{name}_legs_in_air.csv"
    assert stadera.identify(name, log).trust.verdict == "good"
    recording = read(log)
    leg = stadera.load_robot(name).leg("LF")
    wrong = with_effort(recording, {leg.joints[1]: -1.0})
    assert stadera.identify(name, wrong, IdentifySettings(legs=("LF",))).trust.verdict == "bad"


def test_settings_are_positive() -> None:
    with pytest.raises(StaderaError, match="trust setting 'bad' must be positive, got -1"):
        TrustSettings(bad=-1.0)


# -- what a result gives ----------------------------------------------------------------------------------------------


def test_json_and_what_reads_it_back(result: Identification, tmp_path) -> None:
    path = tmp_path / "legs.json"
    result.save_json(path)
    value = json.loads(path.read_text())
    assert value == result.to_dict()
    assert value["trust"] == {
        "verdict": "good", "misfit": result.trust.misfit, "by_leg": dict(result.trust.by_leg), "reasons": [],
    }  # fmt: skip
    there, here = with_identified_legs(hyq(), path), result.identified_robot()
    for link in hyq().leg("RH").links:
        np.testing.assert_allclose(there.inertias[link].vector, here.inertias[link].vector)
    for joint in hyq().leg("RH").joints:
        for term in ("armature", "viscous", "coulomb", "offset"):
            assert getattr(there.dynamics[joint], term) == pytest.approx(getattr(here.dynamics[joint], term))


def test_figures_of_a_bad_result_are_marked(result: Identification) -> None:
    bad = replace(result, trust=replace(result.trust, verdict="bad")).to_dict()
    assert bad["links"]["rh_lowerleg"]["mass"]["trusted"] is False
    assert all(q["trusted"] is False for q in bad["joints"]["rh_kfe_joint"].values())
    assert "trusted" not in result.to_dict()["links"]["rh_lowerleg"]["mass"]


def test_legs_that_are_not_to_be_trusted_are_refused(result: Identification, tmp_path) -> None:
    path = tmp_path / "legs.json"
    replace(result, trust=replace(result.trust, verdict="bad", reasons=("the sign is wrong",))).save_json(path)
    with pytest.raises(UntrustedError, match=r"the sign is wrong.*identify anew; `--force` takes them") as refused:
        with_identified_legs(hyq(), path)
    assert "\n" not in str(refused.value)
    forced = with_identified_legs(hyq(), path, force=True)
    assert forced.dynamics["rh_kfe_joint"] != hyq().dynamics["rh_kfe_joint"]
    assert (forced.distrust, hyq().distrust) == ("the sign is wrong", "")


def test_legs_of_another_robot_are_refused(result: Identification, tmp_path) -> None:
    """Links of the same names; a robot under another name has the same masses."""
    path = tmp_path / "legs.json"
    result.save_json(path)
    other = replace(hyq(), name="hyq_of_ours")
    assert with_identified_legs(other, path).dynamics == with_identified_legs(hyq(), path).dynamics
    heavier = {link: InertialParameters(1.1 * hyq().inertias[link].vector) for link in hyq().leg("RH").links}
    with pytest.raises(ModelError, match="of the robot 'hyq', whose links have other masses than those of 'hyq_of_"):
        with_identified_legs(other.with_inertias(heavier), path)


def test_identified_legs_bring_their_standard_deviations(result: Identification, tmp_path) -> None:
    path = tmp_path / "legs.json"
    result.save_json(path)
    for robot in (with_identified_legs(hyq(), path), result.identified_robot()):
        assert set(robot.dynamics_std) == set(hyq().leg("RH").joints)
        for joint, std in robot.dynamics_std.items():
            for term in ("armature", "viscous", "coulomb", "offset"):
                found = result.legs[0].parameters[f"{joint}.{term}"]
                assert getattr(std, term) == pytest.approx(np.nan if found.is_held else found.std, nan_ok=True)


def test_a_data_frame_has_a_row_for_each_parameter(result: Identification, monkeypatch) -> None:
    pytest.importorskip("pandas")
    frame = result.to_dataframe()
    assert len(frame) == result.parameters
    row = frame[(frame["of"] == "rh_kfe_joint") & (frame["parameter"] == "coulomb")].iloc[0]
    assert row["leg"] == "RH"
    assert row["value"] == result.legs[0].parameters["rh_kfe_joint.coulomb"].value
    assert np.isnan(frame[frame["observability"] == "unobservable"]["std"]).all()
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(MissingExtraError, match=r"stadera\[dataframe\]"):
        result.to_dataframe()


def test_pages_models_and_plots(result: Identification, tmp_path) -> None:
    result.save_html(tmp_path / "r.html")
    result.save_urdf(tmp_path / "r.urdf")
    assert "<html" in (tmp_path / "r.html").read_text()
    assert stadera.load_robot(tmp_path / "r.urdf").mass == pytest.approx(result.identified_robot().mass)
    assert result.plot().axes
    assert len(repr(result).splitlines()) < 10
    assert "RH: " in repr(result)


def test_a_difference_from_cad_within_chance_is_no_verdict() -> None:
    rng, n = np.random.default_rng(0), 2000
    task: Any = SimpleNamespace(leg=SimpleNamespace(joints=("knee",)))
    truth, time = np.zeros((n, 1)), np.arange(n) / 100.0

    def excess(off: float, least: float = 0.0) -> float:  # in standard deviations
        score = LegScore(task, {}, {}, n)
        noise = rng.normal(size=(n, 2))
        guesses = {"identified": noise[:, :1] + off, "prior_friction": noise[:, 1:]}
        score.kept = [(time, truth, guesses)]
        assert score.excess(least)[""] == score.excess(least)["knee"]
        return score.excess(least)["knee"]

    alike = np.array([excess(0.0) for _ in range(200)])
    assert 0.8 < alike.std() < 1.3
    assert excess(0.5) > 2.0
    assert excess(0.5, 0.5) < 0.0  # it is a tenth larger
