"""Links, drives and the trunk from a robot on its feet, alone and together with legs in the air."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from stadera import identify
from stadera.identify.floating import _Columns, floating_log
from stadera.identify.result import Identification
from stadera.identify.schema import with_identified_legs
from stadera.identify.settings import IdentifySettings
from stadera.information import Information
from stadera.lab.plant.leg import simulate_leg
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs import Recording
from stadera.robot import JointDynamics, Robot
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.settings import ModelErrors

from identify.leg_runs import hyq, noisy, swing  # isort: skip


@cache
def made() -> Robot:
    """A HyQ whose knees have 1.5 N·m of Coulomb friction that the model lacks."""
    drives = {leg.joints[2]: JointDynamics(coulomb=1.5) for leg in hyq().legs}
    return replace(hyq(), dynamics=dict(hyq().dynamics) | drives)


@cache
def walk() -> Recording:
    """A crawl of the robot: what its drives need more than the model's is added to the torques."""
    recording = simulate(
        hyq(), "crawl", SimulateSettings(errors="standard", duration=7.0, rate=250.0, seed=1, hold=2)
    ).recording
    knees = [recording.joints.index(leg.joints[2]) for leg in hyq().legs]
    assert recording.effort is not None
    rate = recording.channel("velocity", recording.joints)[:, knees]
    effort = recording.effort.copy()
    effort[:, knees] += 1.5 * np.tanh(rate / 0.02)
    return replace(recording, effort=effort, source="walk")


@cache
def on_feet() -> Identification:
    return identify(hyq(), walk())


def test_a_walk_tells_trunk_and_drives() -> None:
    result = on_feet()
    truth = hyq().inertias[hyq().trunk]
    assert result.trunk is not None
    assert abs(result.trunk.inertial.mass - truth.mass) < 3.0 * result.trunk.mass_std
    z = []
    for leg in result.legs:
        knee = leg.parameters[f"{leg.leg.joints[2]}.coulomb"]
        assert knee.std is not None
        z.append((knee.value - 1.5) / knee.std)
        assert leg.estimate.is_physical
    assert np.abs(z).max() < 3.5
    values = [leg.parameters[f"{leg.leg.joints[2]}.coulomb"].value for leg in result.legs]
    assert np.median(values) == pytest.approx(1.5, rel=0.25)


def test_what_is_not_observed_stays_at_the_model() -> None:
    for leg in on_feet().legs:
        for link in leg.leg.links:
            mass = leg.parameters[f"{link}.m"]
            assert mass.value == pytest.approx(mass.prior, rel=0.1)
            assert mass.is_held or mass.std is not None


def test_the_prior_divided_out_and_put_back_gives_the_posterior() -> None:
    rng = np.random.default_rng(0)
    rows, noise = rng.normal(size=(3, 5)), rng.normal(size=(5, 5))
    prior = noise @ noise.T + np.eye(5)
    target = rng.normal(size=3)
    covariance = np.linalg.inv(rows.T @ rows + np.linalg.inv(prior))
    told = Information.of_posterior("abcde", covariance @ rows.T @ target, covariance, prior, least=1e-9)
    np.testing.assert_allclose(told.R.T @ told.R, rows.T @ rows, atol=1e-9)
    np.testing.assert_allclose(told.R.T @ told.z, rows.T @ target, atol=1e-9)


def test_an_error_that_hides_in_another_makes_it_no_less_known_than_that() -> None:
    """A knee's offset, told to 0.1 N·m together with a weight of its link that is known to 0.3 N·m, is told to both;
    and what is told in common with it stays so.
    """
    model = ErrorModel(hyq(), ModelErrors(alike=0.0))
    start, at = np.diag(model.variance), model.layout.places["offset"].start + 2
    viscous = model.layout.places["viscous"].start + 2
    rows, hidden = np.zeros((2, model.layout.count)), np.zeros(model.layout.count)
    rows[0, [at, viscous]], rows[1, at], hidden[at] = (100.0, 100.0), 10.0, 0.3
    covariance = np.linalg.inv(np.linalg.inv(start + 1e-12 * np.eye(len(start))) + rows.T @ rows)
    mean, leg = np.zeros(len(start)), hyq().legs[0]
    told = _Columns.of(hyq()).of_legs(mean, covariance, start + 1e-12 * np.eye(len(start)), hidden)[leg.name]
    both = [told.names.index(f"{leg.joints[2]}.{term}") for term in ("offset", "viscous")]
    known = np.linalg.inv((told.R.T @ told.R)[np.ix_(both, both)])
    seen = np.linalg.inv((rows.T @ rows)[np.ix_([at, viscous], [at, viscous])])
    seen[0, 0] += 0.3**2
    np.testing.assert_allclose(known, seen, rtol=1e-4)


def test_walk_and_legs_in_the_air_together_know_more(tmp_path: Path) -> None:
    hung = simulate_leg(made(), "RH", swing().sample(250.0))
    air = noisy(replace(hung, velocity=None, acceleration=None, source="air"), 0.5)
    together, alone = (identify(hyq(), logs, IdentifySettings(legs=("RH",))) for logs in ([air, walk()], air))
    joint = hyq().leg("RH").joints[2]
    both, one = (r.legs[[leg.leg.name for leg in r.legs].index("RH")].parameters for r in (together, alone))
    assert both[f"{joint}.coulomb"].std <= one[f"{joint}.coulomb"].std * 1.001
    assert both[f"{joint}.coulomb"].value == pytest.approx(1.5, rel=0.15)
    assert together.trunk is not None
    trunk = on_feet().trunk
    assert trunk is not None
    np.testing.assert_array_equal(together.trunk.inertial.vector, trunk.inertial.vector)  # legs tell nothing of it
    assert alone.trunk is None
    assert "walk" in together.source
    together.save_json(path := tmp_path / "robot.json")
    taken = with_identified_legs(hyq(), path)
    np.testing.assert_allclose(taken.inertias[hyq().trunk].vector, together.trunk.inertial.vector, rtol=1e-6, atol=1e-9)
    assert taken.dynamics[joint].coulomb == pytest.approx(both[f"{joint}.coulomb"].value)


def test_tables_and_page_of_a_walk() -> None:
    from stadera.report.identify.tables import identification_tables

    assert identification_tables(on_feet())
    assert "trunk" in repr(on_feet())
    assert "<html" in on_feet().to_html()
    assert on_feet().to_dict()["trunk"]["mass"]["std"] > 0.0


def test_offsets_of_several_walks_are_each_log_s_own() -> None:
    log = floating_log(hyq(), walk(), lambda *_: None, 0.1)
    name = hyq().legs[0].name
    kept, dropped = (log.of_leg(name, {}, offsets=o) for o in (True, False))
    assert isinstance(kept, Information)
    assert {n for n in kept.names if n not in dropped.names} == {f"{j}.offset" for j in hyq().legs[0].joints}
