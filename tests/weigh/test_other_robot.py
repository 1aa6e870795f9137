"""Logs of another robot than the one they are weighed as, and logs with half an IMU."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stadera.checks.other_robot import carried, carriers, other_robots
from stadera.errors import RecordingError, UntrustedError
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs import Recording
from stadera.logs.frames import write_table
from stadera.logs.mend import Gear, changed
from stadera.robot import load_robot
from stadera.weigh import weigh


@pytest.fixture(scope="module")
def go2_trot() -> Recording:
    load = Load(2.0, "kg", (0.0, 0.0, 0.12))
    settings = SimulateSettings("standard", load, duration=5.0, rate=250.0, seed=5, load_time=3.0, hold=2)
    log = simulate(load_robot("go2"), "trot-load", settings).recording
    assert log.imu is not None
    return replace(log, imu=replace(log.imu, frame=None))  # the robots name the IMU's frame differently


def test_a_go2s_log_is_doubtful_as_an_a1s(go2_trot: Recording) -> None:
    own, other = (weigh(name, go2_trot, tare=(0.5, 2.5)) for name in ("go2", "a1"))
    assert own.trust.verdict == "good"
    assert not any("perhaps it is" in text for text in (*own.trust.reasons, *own.notes))
    assert other.trust.verdict == "doubtful"
    assert "perhaps it is go2 (16.1 kg)" in " ".join(other.trust.reasons)
    whole = weigh("a1", go2_trot)  # without a tare it may carry a load
    assert whole.trust.verdict == "good"
    assert any("perhaps it is go2 (16.1 kg)" in note and "it carries a load" in note for note in whole.notes)


def test_a_go2s_log_as_a_spots_is_not_one_with_torques_in_another_unit_alone(go2_trot: Recording) -> None:
    with pytest.raises(UntrustedError, match=r"another one, perhaps go2 \(16.1 kg.*add --robot go2, or --gear"):
        weigh("spot", go2_trot)
    small = replace(go2_trot, effort=np.asarray(go2_trot.effort) / 6.33)
    with pytest.raises(UntrustedError, match=r"^[^:]*: the torques are .* too small"):
        weigh("go2", small)
    with pytest.raises(UntrustedError, match=r"^[^:]*: the torques are .* too large.*; leave --gear out, or"):
        weigh("go2", changed(go2_trot, [Gear((6.33,))]))
    radians = replace(go2_trot, position=np.radians(go2_trot.position))
    with pytest.raises(UntrustedError, match=r"beyond its limits.*it is a unit, the torques' scale, or the model"):
        weigh("go2", radians)


def test_what_the_feet_carry_is_compared_with_the_model(go2_trot: Recording) -> None:
    robots = [load_robot(name) for name in ("a1", "b1", "go2")]
    on_go2 = carried(go2_trot, robots[2])
    assert on_go2 == pytest.approx(robots[2].mass + 0.8, abs=1.0)  # the load is on it for two fifths of the time
    found = carriers(go2_trot, robots)
    assert found[0] == (robots[2], on_go2)
    assert robots[1] not in [robot for robot, _ in found]
    assert carried(replace(go2_trot, effort=None), robots[2]) is None


def test_only_a_robot_that_is_much_too_heavy_has_others_named() -> None:
    a1 = load_robot("a1")
    assert other_robots(a1, 1.15 * a1.mass, loaded=False) == ()
    assert other_robots(a1, 17.0, loaded=False)[0].startswith("go2")
    assert other_robots(a1, 300.0, loaded=True) == ()


def test_half_an_imu_is_named_not_passed_over(go2_trot: Recording, tmp_path: Path) -> None:
    log = write_table(go2_trot, tmp_path / "log.csv")
    half = tmp_path / "half.csv"
    half.write_text(log.read_text().replace("imu.linear_acceleration", "imu.acceleration_of_mine"))
    with pytest.raises(RecordingError, match=r"no column imu\.linear_acceleration\.x.*--columns.*--method standing"):
        weigh("go2", half)
