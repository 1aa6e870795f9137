"""Logs without an IMU: the same log with and without it, and the truth; what is told of what is not known."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from stadera.cli.app import app
from stadera.errors import IdentificationError, RecordingError, StaderaError
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import Run, simulate
from stadera.logs import Recording, write_table
from stadera.logs.recording import take
from stadera.robot import load_robot
from stadera.trunk.settings import ModelErrors, TrunkSettings
from stadera.weigh import Weighing, diagnose, weigh
from stadera.weigh.settings import WeighSettings

TARE = (0.0, 1.6)
HYQ = load_robot("hyq")


def loaded(robot: str, seed: int, slope: float) -> Run:
    """A load put on at 1.7 of 4 s, standard sensors."""
    wanted = SimulateSettings(duration=4.0, rate=100.0, seed=seed, slope=slope, load_time=1.7, hold=2)
    return simulate(load_robot(robot), "stand-load", wanted)


# drives without friction, as those of the test-bed's `standard` robots are
FREE = WeighSettings(trunk=TrunkSettings(model=ModelErrors(coulomb=1e-4, load_friction=0.0)))


def blind(recording: Recording) -> Recording:
    return replace(recording, imu=None)


@pytest.fixture(scope="module")
def level() -> Run:
    return loaded("hyq", 1, 0.0)


@pytest.fixture(scope="module")
def log(level: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Without its IMU."""
    return write_table(blind(level.recording), tmp_path_factory.mktemp("blind") / "log.csv")


def both(run: Run, folder: Path) -> tuple[Weighing, Weighing]:
    """Weighed by the whole log, and by the log without its IMU."""
    robot = load_robot(run.truth.robot)
    whole = weigh(robot, write_table(run.recording, folder / "whole.csv"), TARE, "standing", settings=FREE)
    return whole, weigh(robot, write_table(blind(run.recording), folder / "blind.csv"), TARE, settings=FREE)


def check(run: Run, whole: Weighing, found: Weighing) -> None:
    true = run.truth.at(4.0)
    assert true.payload_com is not None
    assert whole.payload is not None
    assert found.payload is not None
    assert (found.method, found.vertical.source, whole.vertical.source) == ("standing", "forces", "imu")
    assert abs(found.mass - true.mass) < 3.0 * found.mass_std
    assert abs(found.payload.mass - true.payload_mass) < 3.0 * found.payload.mass_std
    assert 0.8 < found.payload.mass_std / whole.payload.mass_std < 1.5
    assert abs(found.payload.mass - whole.payload.mass) < 3.0 * whole.payload.mass_std
    for seen, com in ((found, true.com), (found.payload, true.payload_com)):
        for k in np.flatnonzero(np.isfinite(seen.com)):
            assert abs(seen.com[k] - com[k]) < 3.0 * seen.com_std[k]
    assert np.isfinite(found.com[1])
    apart = np.degrees(np.arccos(found.vertical.up @ whole.vertical.up))
    assert apart < 3.0 * np.degrees(np.hypot(found.vertical.tilt_std, whole.vertical.tilt_std))
    assert 0.02 < np.degrees(found.vertical.tilt_std) < 1.0
    assert [abs(c.time - 1.7) < 0.6 for c in found.changes] == [True]


def test_level_payload_within_its_bars_and_beside_the_log_with_imu(level: Run, tmp_path: Path) -> None:
    whole, found = both(level, tmp_path)
    check(level, whole, found)
    assert np.isnan(found.com[2]), "one level pose does not show the height"
    assert found.notes[0].startswith("no IMU: weighed while the joints stand still")
    assert not any(note.startswith("no IMU") for note in whole.notes)


def test_on_a_slope(tmp_path: Path) -> None:
    run = loaded("go2", 3, np.radians(6.0))
    check(run, *both(run, tmp_path))


def test_tare_from_another_log_with_or_without_imu(level: Run, tmp_path: Path) -> None:
    log = level.recording
    empty, full = take(log, log.time < 1.65), take(log, log.time > 2.3)
    for tare in (empty, blind(empty)):
        path = write_table(tare, tmp_path / "empty.csv")
        found = weigh(HYQ, write_table(blind(full), tmp_path / "full.csv"), path)
        assert found.payload is not None
        assert abs(found.payload.mass - level.truth.at(4.0).payload_mass) < 3.0 * found.payload.mass_std
        assert any("tare's log" in note for note in found.notes) == (tare.imu is None)


def test_terminal_json_and_report_say_what_is_not_known(log: Path, tmp_path: Path) -> None:
    out, page = tmp_path / "out.json", tmp_path / "out.html"
    args = ["weigh", str(log), "--robot", "hyq", "--tare", "0:1.6"]
    done = CliRunner().invoke(app, [*args, "--json", str(out), "--report", str(page)])
    assert done.exit_code == 0, done.output
    assert "no IMU" in done.output
    found = json.loads(out.read_text())
    assert found["method"] == "standing"
    assert found["trunk"]["inertia"] is None
    assert found["vertical"]["source"] == "forces"
    assert np.linalg.norm(found["vertical"]["up"]["value"]) == pytest.approx(1.0)
    assert 0 < found["vertical"]["tilt_std"] < 0.03
    assert "no IMU" in found["notes"][0]
    assert "direction of the feet" in page.read_text()


def test_methods_that_need_an_imu_name_what_lacks_and_what_works(log: Path) -> None:
    def message(weighed: Callable[[], object]) -> str:
        with pytest.raises(RecordingError) as error:
            weighed()
        return str(error.value)

    in_motion = message(lambda: weigh(HYQ, log, method="walking"))
    at_rest = message(lambda: weigh(HYQ, log, method="contact"))
    for said, method in ((in_motion, "walking"), (at_rest, "contact")):
        assert "imu.angular_velocity.x" in said
        assert "imu.linear_acceleration.z" in said
        assert f"the method {method!r} needs an IMU" in said
        assert "--method standing" in said
        assert "\n" not in said
    assert "--imu-frame head: the log has no IMU" in message(lambda: weigh(HYQ, log, imu_frame="head"))


def walking(recording: Recording) -> Recording:
    """The same as if every joint swung."""
    assert recording.velocity is not None
    return replace(recording, velocity=recording.velocity + np.sin(9.0 * recording.time)[:, None])


def two_feet(recording: Recording) -> Recording:
    standing = {leg.foot: np.full(len(recording), leg.name in ("LF", "RH")) for leg in HYQ.legs}
    return replace(recording, foot_contact=standing)


def sign(recording: Recording) -> Recording:
    assert recording.effort is not None
    effort = recording.effort.copy()
    effort[:, 2] *= -1.0
    return replace(recording, effort=effort)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (
            walking,
            "never stands still, nothing to weigh by: joint .* no IMU, without which only rest",
        ),
        (two_feet, r"only 2 feet carry \(LF, RH\)"),
        (sign, "the sign of the torque of 'lf_kfe_joint' is reversed"),
        (lambda r: replace(r, effort=None), "lf_haa_joint.effort"),
    ],
)
def test_what_cannot_be_weighed(level: Run, spoil: Callable[[Recording], Recording], said: str, tmp_path: Path) -> None:
    path = write_table(spoil(blind(take(level.recording, level.recording.time < 1.0))), tmp_path / "log.csv")
    with pytest.raises(StaderaError, match=said) as error:
        weigh(HYQ, path)
    assert isinstance(error.value, IdentificationError | RecordingError)
    assert "\n" not in str(error.value)


def test_a_right_log_contradicts_nothing(level: Run) -> None:
    assert diagnose(blind(level.recording), HYQ) == ()
