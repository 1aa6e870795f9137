"""What feet carry: logs of a robot on its feet need an IMU; legs in the air seem to carry nothing."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from identify.leg_runs import hyq, noisy, run
from stadera import identify
from stadera.errors import RecordingError
from stadera.identify.job import carried_shares
from stadera.identify.settings import IdentifySettings
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs import Recording
from stadera.robot import load_robot

UP = np.array([0.0, 0.0, 1.0])


@cache
def on_its_feet(scenario: str) -> Recording:
    return simulate(hyq(), scenario, SimulateSettings(errors="standard", duration=2.0, rate=250.0, seed=1)).recording


@pytest.mark.parametrize("scenario", ["stand", "crawl"])
def test_a_robot_on_its_feet_without_imu_is_refused(scenario: str) -> None:
    log = replace(on_its_feet(scenario), imu=None)
    with pytest.raises(RecordingError, match=r"feet carry .*LF \d+ %, RF \d+ %, LH \d+ %, RH \d+ %.* swing freely"):
        identify(hyq(), log)
    with pytest.raises(RecordingError, match=r"weight \(RH \d+ %\)"):
        identify(hyq(), log, IdentifySettings(legs=("RH",)))


def test_torques_of_a_robot_on_its_feet_validate_nothing() -> None:
    settings, stand = IdentifySettings(legs=("RH",)), on_its_feet("stand")
    with pytest.raises(RecordingError, match=r"weight \(RH \d+ %\): legs are validated while they swing freely"):
        identify(hyq(), run(), settings, validation=stand)
    with pytest.raises(RecordingError, match="only torques of legs in the air are validated, and no log with such"):
        identify(hyq(), stand, settings, validation=run())


def test_what_feet_carry_is_the_weight() -> None:
    shares = carried_shares(on_its_feet("stand"), hyq(), UP)
    assert set(shares) == {"LF", "RF", "LH", "RH"}
    assert sum(shares.values()) == pytest.approx(1.0, abs=0.03)


def test_legs_in_the_air_carry_nothing() -> None:
    shares = carried_shares(noisy(run(), 2.0), hyq(), UP)
    assert abs(shares.pop("RH")) < 0.02
    assert not shares, "legs that are not recorded are left out"


def test_real_legs_in_the_air_carry_nothing(shared_data) -> None:
    from stadera.logs import read

    for name in ("go2", "aliengo"):
        log = read(shared_data / "real" / f"{name}_legs_in_air.csv")
        assert max(map(abs, carried_shares(log, load_robot(name), UP).values())) < 0.02


def test_a_leg_in_the_air_is_identified_while_others_stand() -> None:
    """And the standing ones say nothing of the drives."""
    stand, swing = on_its_feet("stand"), run()
    n = min(len(stand), len(swing))
    leg = hyq().leg("RH").joints
    at = [stand.joints.index(joint) for joint in leg]
    position, effort = stand.position[:n].copy(), stand.channel("effort", stand.joints)[:n].copy()
    position[:, at], effort[:, at] = swing.position[:n], swing.channel("effort", leg)[:n]
    log = replace(
        stand, time=swing.time[:n], position=position, effort=effort, velocity=None, imu=None, foot_force={},
        foot_contact={}, notes=(),
    )  # fmt: skip
    with pytest.raises(RecordingError, match="those in the air are identified by --legs RH"):
        identify(hyq(), log)
    settings = IdentifySettings(legs=("RH",), torque_lag=0.0)
    together, alone = identify(hyq(), log, settings), identify(hyq(), log, replace(settings, spread=None))
    np.testing.assert_allclose(together.legs[0].estimate.values, alone.legs[0].estimate.values, rtol=1e-9)
