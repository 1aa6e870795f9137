"""Legs from several logs: what one pass over all rows says, better than each alone, and honest where logs differ."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from identify.leg_runs import DRIVE, hyq, leg_regressor, noisy, other_hyq, parameters_of, rich_motion, run
from stadera.body.rows import Rows
from stadera.errors import IdentificationError
from stadera.fleet.merge import merge_legs
from stadera.identify.legs import identify
from stadera.identify.result import Identification, robot_with_legs
from stadera.identify.schema import with_identified_legs
from stadera.identify.settings import IdentifySettings
from stadera.information import Information, Unknowns

RH = IdentifySettings(legs=("RH",), split=1.0, torque_lag=0.0)
NOISE = (0.5, 1.0, 2.0)  # N·m, of the three logs


@cache
def alone() -> tuple[Identification, ...]:
    """Three short logs of one leg, each with noise and offsets of its own."""
    logs = []
    for seed, noise in enumerate(NOISE):
        drive = replace(DRIVE, offset=0.7 * (seed - 1))
        logs.append(identify(hyq(), noisy(run(drive, seed, duration=8.0), noise, seed=seed), RH))
    return tuple(logs)


def information(logs: tuple[Identification, ...]) -> dict[str, dict[str, Information]]:
    found = {}
    for k, log in enumerate(logs):
        assert log.legs[0].information is not None
        found[f"log{k}"] = {"RH": log.legs[0].information}
    return found


def least_cost(known: Information) -> float:
    """No x fits better; ρ² alone is not it where the rows do not determine all of x."""
    return known.residual_squared(np.linalg.lstsq(known.R, known.z, rcond=1e-10)[0])


def test_merged_information_is_that_of_one_pass_over_all_rows() -> None:
    """Each log's offsets are unknowns of their own in the batch, which is then projected onto what logs share."""
    regressor, truth = (
        leg_regressor(hyq(), friction=True),
        parameters_of(other_hyq(), leg_regressor(hyq(), True).columns),
    )
    shared = tuple(name for name in regressor.columns if not name.endswith(".offset"))
    batch_rows: list[Rows] = []
    logs = {}
    for k, noise in enumerate(NOISE):
        motion = rich_motion(300, seed=k)
        torque = regressor.predict(motion, truth) + np.random.default_rng(k).normal(k, noise, (300, 3))
        rows = list(regressor.rows(motion, torque, std=noise))
        logs[str(k)] = {"RH": Information.of(rows, regressor.columns)}
        own = {name: f"{name}@{k}" for name in regressor.columns if name.endswith(".offset")}
        batch_rows += [
            Rows(tuple(own.get(c, c) for c in r.columns), r.reduced, r.target, r.std, r.mixing) for r in rows
        ]
    every = tuple(dict.fromkeys((*shared, *(name for rows in batch_rows for name in rows.columns))))
    batch = Information.of(batch_rows, Unknowns.scalars(every)).marginal(shared)
    leg = merge_legs(hyq(), logs, RH).legs[0]
    merged = leg.information
    assert merged is not None
    assert merged.names == shared
    np.testing.assert_allclose(
        merged.R.T @ merged.R, batch.R.T @ batch.R, rtol=1e-9, atol=1e-9 * np.abs(batch.R).max() ** 2
    )
    np.testing.assert_allclose(merged.R.T @ merged.z, batch.R.T @ batch.z, rtol=1e-9, atol=1e-7)
    assert least_cost(merged) == pytest.approx(least_cost(batch), rel=1e-9)
    assert merged.count == batch.count
    assert leg.estimate.columns == shared


def torque_error(found: dict[str, float]) -> float:
    """Of what the parameters predict in another motion, without offsets, root of the mean square [N·m]."""
    regressor = leg_regressor(hyq(), friction=True)
    motion = rich_motion(400, seed=9)
    truth = parameters_of(other_hyq().with_dynamics(dict.fromkeys(hyq().tree.joints, DRIVE)), regressor.columns)
    without = {name: 0.0 for name in regressor.columns if name.endswith(".offset")}
    gap = regressor.predict(motion, found | without) - regressor.predict(motion, truth | without)
    return float(np.sqrt(np.mean(gap**2)))


def test_better_than_each_log_alone() -> None:
    merged = merge_legs(hyq(), information(alone()), RH)
    errors = [torque_error(log.legs[0].estimate.by_name()) for log in alone()]
    assert torque_error(merged.legs[0].estimate.by_name()) < min(errors)
    variance = [np.trace(log.legs[0].estimate.covariance) for log in alone()]
    assert np.trace(merged.legs[0].estimate.covariance) < min(variance)
    assert merged.trust.verdict == "good"
    assert 0.3 < merged.trust.misfit < 2.0
    names = merged.legs[0].estimate.columns
    assert not any(name.endswith(".offset") for name in names)


def test_error_bars_hold() -> None:
    """Of what the data determine, by the combinations that the prior does not matter for."""
    estimate = merge_legs(hyq(), information(alone()), RH).legs[0].estimate
    truth = parameters_of(other_hyq().with_dynamics(dict.fromkeys(hyq().tree.joints, DRIVE)), estimate.columns)
    gap = estimate.values - np.array(list(truth.values()))
    joints = [k for k, name in enumerate(estimate.columns) if name.split(".")[1] in ("armature", "viscous", "coulomb")]
    assert np.sqrt(np.mean((gap[joints] / np.sqrt(np.diag(estimate.covariance)[joints])) ** 2)) < 2.0


def test_logs_that_differ_are_doubtful_and_their_bars_wider() -> None:
    worn = replace(DRIVE, coulomb=3.0, viscous=1.5)
    other = identify(hyq(), noisy(run(worn, 1, duration=8.0), 0.5, seed=7), RH)
    same, differing = (merge_legs(hyq(), information(logs), RH) for logs in (alone()[:1] * 2, (alone()[0], other)))
    assert differing.trust.verdict == "doubtful"
    assert "the logs differ" in differing.trust.reasons[0]
    assert np.trace(differing.legs[0].estimate.covariance) > np.trace(same.legs[0].estimate.covariance)


def test_json_is_what_weigh_takes(tmp_path) -> None:
    merged = merge_legs(hyq(), information(alone()), RH)
    (tmp_path / "legs.json").write_text(json.dumps(merged.to_dict()))
    assert merged.to_dict()["logs"] == ["log0", "log1", "log2"]
    robot, direct = with_identified_legs(hyq(), tmp_path / "legs.json"), robot_with_legs(hyq(), merged.legs)
    for link in hyq().leg("RH").links:
        np.testing.assert_allclose(robot.inertias[link].vector, direct.inertias[link].vector, rtol=1e-9, atol=1e-12)
    for joint in hyq().leg("RH").joints:
        assert robot.dynamics[joint].coulomb == pytest.approx(direct.dynamics[joint].coulomb)


def test_nothing_to_merge() -> None:
    with pytest.raises(IdentificationError, match="nothing to merge"):
        merge_legs(hyq(), {})
