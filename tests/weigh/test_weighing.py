"""`stadera.weigh` as one function: which estimator it chooses, what it takes, what it gives, and what it refuses."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stadera
from stadera.errors import IdentificationError, UntrustedError
from stadera.inertia import InertialParameters
from stadera.lab.plant.sensors import STANDARD
from stadera.logs import LogFile, Recording, write_table
from stadera.logs.recording import take
from stadera.logs.tables import TableReader
from stadera.robot import Robot, load_robot
from stadera.robot.imu import ImuMount
from stadera.robot.model import Frame
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.protocol import Status, TrunkEstimate
from stadera.trust import Trust
from stadera.weigh import Weighing, reading, weigh
from stadera.weigh.reading import CheckedLog
from stadera.weigh.settings import WeighSettings
from walking import Walk, recorded, walked

HYQ = load_robot("hyq")
TRUNK = HYQ.inertias[HYQ.trunk]
LOADED, LOAD = 2.0, InertialParameters.from_com(6.0, [0.1, 0.05, 0.15], 0.05 * np.eye(3))


@cache
def log() -> Recording:
    """A crawl of 4 s; 6 kg come onto the trunk after 2 s."""
    motion = walked(HYQ, Walk(seconds=4.0, rate_hz=500.0, load=LOAD, loaded_at=LOADED))
    return recorded(HYQ, motion, STANDARD, 0)


@cache
def loaded() -> Weighing:
    return weigh(HYQ, log(), tare=(0.0, 1.8))


def before(seconds: float) -> Recording:
    return take(log(), log().time < seconds)


# -- the choice -----------------------------------------------------------------------------------------------------


def test_a_walking_log_is_weighed_in_motion_to_its_end() -> None:
    found = weigh(HYQ, log())
    assert found.method == "walking"
    assert found.time > 3.9
    assert abs(found.mass - (TRUNK.mass + LOAD.mass)) < 4.0 * found.mass_std
    assert [change.kind for change in found.changes] == ["on"]
    assert found.payload is None


def test_a_method_named_from_python_is_the_one_that_runs() -> None:
    found = weigh(HYQ, log(), method="walking")
    assert found.torque_lag is not None
    assert found.spikes == found.to_dict()["spikes"] == 0
    assert found.impacts == found.to_dict()["impacts"] == 0.0
    assert found.vertical is None
    with pytest.raises(IdentificationError, match="used by the method 'orientation' alone, not by walking"):
        weigh(HYQ, log(), method="walking", stiffness=(1.0, 1.0, 1.0))


def test_legs_that_were_taken_by_force_make_the_result_doubtful() -> None:
    found = weigh(replace(HYQ, distrust="the sign is wrong"), log(), method="walking")
    assert found.trust.verdict == "doubtful"
    assert found.trust.reasons[0].endswith("not to be trusted: the sign is wrong")


def test_without_imu_or_with_few_samples_it_weighs_at_rest() -> None:
    with pytest.raises(IdentificationError, match="never stands still"):
        weigh(HYQ, replace(log(), imu=None))
    slow, few = take(log(), slice(None, None, 25)), r"; the log has \d+ samples a second, of which .* 50 are needed"
    with pytest.raises(IdentificationError, match=f"never stands still.*{few}"):
        weigh(HYQ, slow)
    with pytest.raises(IdentificationError, match=f"0 to 1 s: no tare: the robot never stands still.*{few}"):
        weigh(HYQ, slow, tare=(0.0, 1.0))


def test_velocities_may_be_differentiated_from_positions() -> None:
    found = weigh(HYQ, replace(before(1.9), velocity=None))
    assert abs(found.mass - TRUNK.mass) < 4.0 * found.mass_std
    assert any("differentiated from positions" in note for note in found.notes)


def test_robot_and_log_in_every_form(tmp_path: Path) -> None:
    path = write_table(before(1.0), tmp_path / "log.csv")
    masses = [
        weigh("hyq", path).mass,
        weigh(HYQ, str(path)).mass,
        stadera.weigh(HYQ, LogFile.of(path)).mass,
        weigh(HYQ, before(1.0)).mass,
    ]
    assert masses == pytest.approx([masses[0]] * 4, rel=1e-6)
    tared = weigh(HYQ, before(1.5), tare=before(1.0))
    assert tared.payload is not None
    assert abs(tared.payload.mass) < 4.0 * tared.payload.mass_std


def test_a_log_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    passes: list[int] = []
    once = TableReader.stream
    monkeypatch.setattr(TableReader, "stream", lambda *given, **options: passes.append(1) or once(*given, **options))
    path = write_table(before(1.0), tmp_path / "log.parquet")
    weigh(HYQ, path)
    assert passes == [1]


# -- tare and changes -----------------------------------------------------------------------------------------------


def test_one_load_has_one_figure() -> None:
    payload, (change,) = loaded().payload, loaded().changes
    assert payload is not None
    assert (change.mass, change.mass_std) == (payload.mass, payload.mass_std)
    assert abs(payload.mass - LOAD.mass) < 4.0 * payload.mass_std


def test_what_comes_before_the_tare_does_not_count() -> None:
    """Until 0.5 s the torques are those of a much heavier robot."""
    whole, spoilt = log(), log().effort
    assert spoilt is not None
    spoilt = np.where((whole.time < 0.5)[:, None], 1.4 * spoilt, spoilt)
    found = weigh(HYQ, replace(whole, effort=spoilt), tare=(0.5, 1.8))
    right = weigh(HYQ, take(whole, whole.time >= 0.5), tare=(0.5, 1.8))
    assert found.payload is not None
    assert right.payload is not None
    assert found.payload.mass == pytest.approx(right.payload.mass, abs=1e-9)
    assert found.refusals[0].reason == "before the tare's time"
    assert found.mass == pytest.approx(right.mass, abs=1e-9)


def test_a_load_that_comes_within_the_tare_is_an_error() -> None:
    with pytest.raises(IdentificationError, match=r"the load changes within the tare's time, at [12]\.\d+ s"):
        weigh(HYQ, log(), tare=(0.0, 3.0))


def test_a_small_change_within_the_tare_is_a_doubt() -> None:
    """The payload is what comes after the tare's end."""
    found = weigh(HYQ, log(), tare=(0.0, 3.0), settings=WeighSettings(tare_change=1.0))
    assert found.payload is not None
    assert abs(found.payload.mass) < 3.0 * found.payload.mass_std
    assert found.trust.verdict == "doubtful"
    assert any("the load changes within the tare's time, at" in reason for reason in found.trust.reasons)


def test_a_load_of_which_next_to_nothing_is_known_is_shown_with_its_bar_and_not_as_determined() -> None:
    found = weigh(HYQ, before(1.9), tare=(0.0, 1.87))
    assert found.payload is not None
    assert found.payload.mass_std > 0.1 * HYQ.mass
    assert not found.determined()["payload"]


# -- logs that are right in part ------------------------------------------------------------------------------------


def test_a_fall_at_the_end_leaves_what_was_weighed_before_it() -> None:
    whole = log()
    assert whole.effort is not None
    assert whole.imu is not None
    fallen = whole.time >= 3.0
    force = np.where(fallen[:, None], whole.imu.linear_acceleration[:, [2, 1, 0]], whole.imu.linear_acceleration)
    effort = np.where(fallen[:, None], -0.5 * whole.effort, whole.effort)
    falls = replace(whole, effort=effort, imu=replace(whole.imu, linear_acceleration=force))
    found = weigh(HYQ, falls, (0.0, 1.8))
    until = weigh(HYQ, take(whole, whole.time < found.refusals[-1].begin), (0.0, 1.8))
    assert found.payload is not None
    assert until.payload is not None
    assert found.payload.mass == pytest.approx(until.payload.mass, abs=1e-9)
    assert abs(found.payload.mass - LOAD.mass) < 4.0 * found.payload.mass_std
    assert 2.5 < found.time < 3.0
    assert (found.begin, found.end) == (whole.time[0], whole.time[-1])
    assert found.trust.verdict == "doubtful"
    assert "as in a fall" in found.trust.reasons[-1]
    with pytest.raises(IdentificationError, match=r"0 to 3\.2 s, is not used after 2\.\d+ s: .* as in a fall"):
        weigh(HYQ, falls, (0.0, 3.2))


def test_a_fall_in_a_later_chunk_of_a_long_log(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = log()
    assert whole.effort is not None
    fallen = replace(whole, effort=np.where((whole.time >= 3.0)[:, None], -whole.effort, whole.effort))
    parts = [take(fallen, (fallen.time >= t) & (fallen.time < t + 1.0)) for t in range(4)]
    monkeypatch.setattr(reading, "stream", lambda *_, **__: iter(parts))
    read = CheckedLog(HYQ, fallen, WeighSettings())
    kept = list(read)
    assert read.event is not None
    assert read.event.begin == pytest.approx(2.75)
    assert read.event.end == read.end == whole.time[-1]
    assert sum(map(len, kept)) == int((whole.time < 3.0).sum())


def test_a_robot_that_lies_first_is_weighed_once_it_stands() -> None:
    """For half of the log the feet carry nothing."""
    whole = log()
    assert whole.effort is not None
    lying = (whole.time < 2.0)[:, None]
    found = weigh(HYQ, replace(whole, effort=np.where(lying, 0.05 * whole.effort, whole.effort)))
    assert found.trust.verdict == "good"
    assert abs(found.mass - TRUNK.mass - LOAD.mass) < 4.0 * found.mass_std
    assert (found.begin, found.refusals[0].begin) == (whole.time[0], whole.time[0])
    assert 2.0 <= found.refusals[0].end < 2.6
    assert "as before a robot stands up" in found.refusals[0].reason
    assert found.timeline.time[0] > 2.0


def test_rest_at_the_start_alone_is_no_verdict_on_the_rest_of_the_log() -> None:
    """At rest a load that comes in motion cannot be seen: the result says until when it knows."""
    motion = walked(HYQ, Walk(seconds=1.0, rate_hz=100.0, period=0.0, tilt=0.0, sway=0.0, speed=0.0))
    still, walk = recorded(HYQ, motion, STANDARD, 0), take(log(), slice(None, None, 5))
    assert still.imu is not None
    assert walk.imu is not None

    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(still, name), getattr(walk, name)])

    imu = replace(
        still.imu,
        angular_velocity=np.concatenate([still.imu.angular_velocity, walk.imu.angular_velocity]),
        linear_acceleration=np.concatenate([still.imu.linear_acceleration, walk.imu.linear_acceleration]),
    )
    channels = {name: joined(name) for name in ("position", "velocity", "effort")}
    both = replace(still, time=np.concatenate([still.time, 1.0 + walk.time]), imu=imu, **channels)  # type: ignore[arg-type]
    found = weigh(HYQ, both, method="contact")
    assert found.time < 1.1
    assert found.trust.verdict == "doubtful"
    # where the two logs are joined the legs jump, which is a reason as well
    assert any("nothing was learnt after it" in reason for reason in found.trust.reasons)


# -- trust ----------------------------------------------------------------------------------------------------------


def test_a_bad_result_is_refused_with_its_cause_unless_forced(monkeypatch: pytest.MonkeyPatch) -> None:
    bad = Trust("bad", 40.0, {"LF": 90.0}, ("the residuals are 40 times as large as stated; torque gain explains it",))
    monkeypatch.setattr(TrunkEstimator, "trust", bad, raising=False)
    with pytest.raises(UntrustedError, match="torque gain explains it"):
        weigh(HYQ, before(1.0))
    found = weigh(HYQ, before(1.0), force=True)
    assert found.trust == bad
    plain = found.to_dict()
    assert plain["trunk"]["mass"]["trusted"] is False
    assert plain["trust"]["by_leg"] == {"LF": 90.0}
    assert "trust: bad" in repr(found)


def test_an_estimate_that_ran_away_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = TrunkEstimator.estimate

    def ran_away(self: TrunkEstimator) -> TrunkEstimate:
        return replace(asked(self), status=Status.REFUSED, reason="the estimate runs away: a mass of 900 kg")

    monkeypatch.setattr(TrunkEstimator, "estimate", ran_away)
    with pytest.raises(UntrustedError, match="runs away"):
        weigh(HYQ, before(1.0))
    assert weigh(HYQ, before(1.0), force=True).trust.verdict == "bad"


@pytest.mark.parametrize(("unused", "verdict"), [(0.1, "good"), (1.5, "doubtful")])
def test_a_short_unused_end_is_no_doubt(unused: float, verdict: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a gait that ends while a joint touches its stop; a change of the load would be missed in a long one."""
    asked = TrunkEstimator.estimate

    def refused(self: TrunkEstimator) -> TrunkEstimate:
        found = asked(self)
        return replace(found, time=found.time - unused, status=Status.REFUSED, reason="a joint is at its stop")

    monkeypatch.setattr(TrunkEstimator, "estimate", refused)
    assert weigh(HYQ, before(2.0)).trust.verdict == verdict


def test_torques_of_the_wrong_sign_are_refused_or_marked() -> None:
    right = before(1.0)
    assert right.effort is not None
    wrong = replace(right, effort=-right.effort)
    with pytest.raises(UntrustedError, match="signs of all torques are reversed"):
        weigh(HYQ, wrong)
    with pytest.raises(UntrustedError, match="signs of all torques are reversed"):
        weigh(HYQ, replace(wrong, imu=None))


# -- the IMU's frame ------------------------------------------------------------------------------------------------


def test_an_imu_in_another_frame_of_the_model_weighs_the_same() -> None:
    motion = walked(HYQ, Walk(seconds=2.0, rate_hz=500.0, tilt=0.1, frequency=1.5))
    turn = Rotation.from_euler("xyz", [30, -50, 100], degrees=True).as_matrix()
    robot: Robot = replace(HYQ, frames={**HYQ.frames, "sensor": Frame(HYQ.trunk, turn, np.array([0.3, -0.2, 0.25]))})
    there = recorded(robot, motion, STANDARD, 0, ImuMount.of(robot, "sensor"))
    assert there.imu is not None
    for found in (
        weigh(robot, there),
        weigh(robot, replace(there, imu=replace(there.imu, frame=None)), imu_frame="sensor"),
    ):
        assert abs(found.mass - TRUNK.mass) < 3.0 * found.mass_std
        assert (np.abs(found.com - TRUNK.com)[:2] < 3.0 * found.com_std[:2]).all()
        assert found.trunk.observed[3]
        assert abs(found.com[2] - TRUNK.com[2]) < 3.0 * found.com_std[2]


# -- handed on ------------------------------------------------------------------------------------------------------


def test_outputs(tmp_path: Path) -> None:
    found = loaded()
    assert len(repr(found).splitlines()) < 10
    assert "payload: 6." in repr(found) or "payload: 5.9" in repr(found)
    found.save_json(tmp_path / "found.json")
    plain = json.loads((tmp_path / "found.json").read_text())
    assert set(plain["payload"]) == {
        "mass",
        "com",
        "com_covariance",
        "inertia",
        "inertia_std",
        "frame",
        "inertia_about",
        "at",
        "places",
    }
    assert plain["payload"]["frame"] == HYQ.trunk
    assert plain["trust"]["verdict"] == found.trust.verdict
    found.save_html(tmp_path / "found.html")
    assert "payload since the tare" in (tmp_path / "found.html").read_text()
    found.save_urdf(tmp_path / "found.urdf")
    assert load_robot(tmp_path / "found.urdf").inertias[HYQ.trunk].mass == pytest.approx(found.mass, rel=1e-9)
    pytest.importorskip("pandas")
    frame = found.to_dataframe()
    coms = [f"com_{a}{s}" for a in "xyz" for s in ("", "_std")]
    assert list(frame.columns) == ["time", "mass", "mass_std", *coms, "payload_mass", "payload_mass_std"]
    assert frame["payload_mass"].iloc[-1] == pytest.approx(found.payload.mass)
    assert len(frame) == len(found.timeline.time)
