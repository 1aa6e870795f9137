"""`stadera weigh`: simulated logs weighed against their truth, the JSON, the report, and what bad logs get."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from stadera.cli import main, options
from stadera.errors import StaderaError
from stadera.lab.truth import Truth, read_truth
from stadera.logs import Imu, Recording, read, write_table
from stadera.logs.recording import take
from stadera.robot import load_robot
from stadera.trunk.registry import METHODS
from stadera.weigh import Weighing
from stadera.weigh.weigh import AT_REST

Run = Callable[..., Any]
REST = ("--method", "standing")

LOADED = 2.0  # s, when the load of `loading` is put on


def simulated(path: Path, *arguments: object) -> Path:
    with pytest.raises(SystemExit) as exit_info:
        main(["simulate", *map(str, arguments), "--out", str(path)])
    assert not exit_info.value.code
    return path


@pytest.fixture(scope="session")
def loading(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """HyQ with standard sensors; 36 kg are put on its back after 2.0 of 5 s."""
    path = tmp_path_factory.mktemp("loading") / "log.csv"
    wanted = ("--load", "36kg", "--at", "-0.2,0.1,0.1", "--duration", 5, "--rate", 100, "--seed", 4)
    return simulated(path, "stand-load", *wanted)


@pytest.fixture(scope="session")
def truth(loading: Path) -> Truth:
    return read_truth(loading.with_name("log.truth.json"))


def test_payload_as_a_link(run: Run, loading: Path, truth: Truth, tmp_path: Path) -> None:
    out, found = tmp_path / "loaded.urdf", tmp_path / "found.json"
    wanted = ("--robot", "hyq", *REST, "--tare", "0:1.8", "--json", found, "--export", out)
    assert run("weigh", loading, *wanted).code == 0
    robot, result = load_robot("hyq"), json.loads(found.read_text())
    payload, trunk = result["payload"], result["trunk"]
    whole = load_robot(out).inertias[robot.trunk]
    assert whole.mass == pytest.approx(trunk["mass"]["value"], rel=1e-9), "the same as without a tare"
    assert whole.com[:2] == pytest.approx(trunk["com"]["value"][:2], rel=1e-9)
    link = ET.parse(out).getroot().find("link[@name='payload']/inertial/mass")
    place = ET.parse(out).getroot().find("joint[@name='payload_joint']/origin")
    assert link is not None
    assert place is not None
    assert float(link.attrib["value"]) == pytest.approx(payload["mass"]["value"], rel=1e-9)
    written = [float(v) for v in place.attrib["xyz"].split()]
    assert written[:2] == pytest.approx(payload["com"]["value"][:2], rel=1e-9)
    assert written[2] == pytest.approx(robot.inertias[robot.trunk].com[2]), "not observed: level with the trunk's"
    covariance = payload["com_covariance"]
    assert covariance[1][1] == pytest.approx(payload["com"]["std"][1] ** 2)
    assert covariance[2] == [None] * 3
    assert " z was not observed" in out.read_text()


def test_without_a_tare_the_trunk_is_written(run: Run, loading: Path, tmp_path: Path) -> None:
    out, found = tmp_path / "weighed.urdf", tmp_path / "found.json"
    assert run("weigh", loading, "--robot", "hyq", *REST, "--json", found, "--export", out).code == 0
    robot, trunk = load_robot("hyq"), json.loads(found.read_text())["trunk"]
    prior, written = robot.inertias[robot.trunk], load_robot(out).inertias[robot.trunk]
    assert written.mass == pytest.approx(trunk["mass"]["value"], rel=1e-9)
    assert written.com[:2] == pytest.approx(trunk["com"]["value"][:2], rel=1e-9)
    assert written.com[2] == pytest.approx(prior.com[2])
    assert written.inertia_com == pytest.approx(prior.inertia_com)
    assert "and the model's own: z, inertia" in out.read_text()


def test_a_link_that_cannot_be_written(run: Run, loading: Path, tmp_path: Path) -> None:
    nothing = run("weigh", loading, "--robot", "hyq", *REST, "--tare", "2.7:3.5", "--export", tmp_path / "loaded.urdf")
    assert (nothing.code, "no payload to write" in nothing.err) == (1, True)
    wrong = run("weigh", loading, "--robot", "hyq", "--tare", "0:1.8", "--export", tmp_path / "loaded.xml")
    assert wrong.code == 1
    assert "is a URDF" in wrong.err
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_written_into_a_model_leaves_the_other_outputs(
    run: Run, loading: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def elsewhere(self: Weighing, path: Path) -> None:
        raise StaderaError(f"{path}: only one on the trunk is written")

    monkeypatch.setattr(Weighing, "save_urdf", elsewhere)
    out, found, page = tmp_path / "loaded.urdf", tmp_path / "found.json", tmp_path / "found.html"
    wanted = ("--robot", "hyq", *REST, "--tare", "0:1.8", "--json", found, "--report", page, "--export", out)
    ended = run("weigh", loading, *wanted)
    assert ended.code == 1
    assert "only one on the trunk is written" in ended.err
    assert json.loads(found.read_text())["payload"]
    assert page.exists()
    assert not out.exists()
    assert f"wrote {found}" in "".join(ended.out.splitlines())


def test_trunk_payload_and_change(run: Run, loading: Path, truth: Truth, tmp_path: Path) -> None:
    out = tmp_path / "found.json"
    finished = run("weigh", loading, "--robot", "hyq", *REST, "--tare", "0:1.8", "--json", out)
    assert finished.code == 0
    assert "payload since the tare" in finished.out
    found, last = json.loads(out.read_text()), truth.at(5.0)
    assert (found["robot"], found["method"]) == ("hyq", "standing")
    trunk, payload = found["trunk"], found["payload"]
    assert abs(trunk["mass"]["value"] - last.mass) < 3.0 * trunk["mass"]["std"]
    assert trunk["mass"]["std"] < 7.0  # 3 % of all torques, and friction that may hold all knees up, as in a sag
    assert last.payload_com is not None
    for body, com in ((trunk, last.com), (payload, last.payload_com)):
        for k in range(2):
            assert abs(body["com"]["value"][k] - com[k]) < 3.0 * body["com"]["std"][k]
        assert body["com"]["value"][2] is None  # level: the height does not show
        assert body["com"]["std"][2] is None
    assert trunk["inertia"] is None
    assert abs(payload["mass"]["value"] - 36.0) < 3.0 * payload["mass"]["std"]
    # constant errors cancel, static friction of the two loads does not
    assert payload["mass"]["std"] < np.sqrt(2.0) * trunk["mass"]["std"]
    (change,) = found["changes"]
    assert LOADED < change["time"] < LOADED + 1.0
    assert change["mass"] == payload["mass"], "one load, one figure"
    assert change["kind"] == "on"
    assert change["time"] < change["noticed"] < change["time"] + 1.0
    assert found["trust"]["verdict"] == "good"
    assert (payload["frame"], payload["inertia"], payload["inertia_about"]) == ("trunk", None, "com")
    lengths = {name: len(values) for name, values in found["timeline"].items()}
    assert set(lengths) == {"time", "mass", "mass_std", "com", "com_std", "payload_mass", "payload_mass_std"}
    assert len(set(lengths.values())) == 1
    before = np.array(found["timeline"]["time"]) < LOADED
    np.testing.assert_allclose(np.array(found["timeline"]["mass"])[before], truth.at(0.0).mass, atol=1.5)
    assert [com[2] for com in found["timeline"]["com"]] == [None] * lengths["com"]


def test_without_a_tare_no_payload(run: Run, loading: Path, truth: Truth, tmp_path: Path) -> None:
    """But the load is noticed, although the robot has only stood and sags when it is put on."""
    out = tmp_path / "found.json"
    assert run("weigh", loading, "--robot", "hyq", "--json", out).code == 0
    found = json.loads(out.read_text())
    assert found["payload"] is None
    assert found["trust"]["verdict"] == "good"
    (change,) = found["changes"]
    mass = found["trunk"]["mass"]
    for expected, value in ((36.0, change["mass"]), (truth.moments[-1].mass, mass)):
        assert abs(value["value"] - expected) < 3.0 * value["std"] < 0.25 * truth.moments[-1].mass


def test_another_log_as_tare(run: Run, loading: Path, tmp_path: Path) -> None:
    log = read(loading)
    empty, full = tmp_path / "empty.csv", tmp_path / "full.csv"
    write_table(take(log, log.time < 1.9), empty)
    write_table(take(log, log.time > 2.7), full)
    out = tmp_path / "found.json"
    assert run("weigh", full, "--robot", "hyq", *REST, "--tare", empty, "--json", out).code == 0
    found = json.loads(out.read_text())
    (change,) = found["changes"]  # it came between the logs
    assert change["mass"] == found["payload"]["mass"]
    assert abs(found["payload"]["mass"]["value"] - 36.0) < 3.0 * found["payload"]["mass"]["std"]


def test_orientation_by_the_controllers_stiffness(run: Run, loading: Path, truth: Truth, tmp_path: Path) -> None:
    out = tmp_path / "found.json"
    stiffness = ",".join(map(str, truth.stiffness))
    command = ("weigh", loading, "--robot", "hyq", "--method", "orientation", "--json", out)
    assert run(*command, "--stiffness", stiffness).code == 0
    com = json.loads(out.read_text())["trunk"]["com"]
    for k in range(2):
        assert abs(com["value"][k] - truth.at(5.0).com[k]) < 3.0 * com["std"][k]
    refused = run(*command)
    assert refused.code == 1
    assert "--stiffness" in refused.err
    assert refused.err.count("\n") == 1


def test_poses_show_the_height(run: Run, tmp_path: Path) -> None:
    log = simulated(tmp_path / "poses.csv", "poses", "--errors", "ideal", "--duration", 11, "--rate", 50)
    out = tmp_path / "found.json"
    assert run("weigh", log, "--robot", "hyq", "--method", "standing", "--json", out).code == 0
    hyq, trunk = load_robot("hyq"), json.loads(out.read_text())["trunk"]
    np.testing.assert_allclose(trunk["com"]["value"], hyq.inertias[hyq.trunk].com, atol=0.005)
    assert trunk["mass"]["value"] == pytest.approx(hyq.inertias[hyq.trunk].mass, rel=2e-3)


def test_report_is_one_page_with_the_balance(run: Run, loading: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    known = loading.with_name("log.truth.json")
    assert (
        run("weigh", loading, "--robot", "hyq", *REST, "--tare", "0:1.8", "--truth", known, "--report", page).code == 0
    )
    html = page.read_text()
    for said in (
        "from above, enlarged",
        "support polygon",
        "LF",
        "centre of pressure",
        "truth",
        "Mass over time",
        "8.",
    ):
        assert said in html
    assert "<link" not in html
    assert 'src="http' not in html


def without(recording: Recording, channel: str) -> Recording:
    return replace(recording, **{channel: None})


def walking(recording: Recording) -> Recording:
    """The same as if every joint swung."""
    assert recording.velocity is not None
    return replace(recording, velocity=recording.velocity + np.sin(9.0 * recording.time)[:, None])


def on_two_feet(recording: Recording) -> Recording:
    robot = load_robot("hyq")
    standing = {leg.foot: np.full(len(recording), leg.name in ("LF", "RH")) for leg in robot.legs}
    return replace(recording, foot_contact=standing)


def fewer_joints(recording: Recording) -> Recording:
    def less(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else values[:, 1:]

    channels = {name: less(getattr(recording, name)) for name in ("position", "velocity", "effort")}
    return replace(recording, joints=recording.joints[1:], **channels)  # type: ignore[arg-type]


def without_orientation(recording: Recording) -> Recording:
    assert recording.imu is not None
    return replace(recording, imu=Imu(recording.imu.angular_velocity, recording.imu.linear_acceleration))


@pytest.mark.parametrize(
    ("spoil", "arguments", "said"),
    [
        (lambda r: without(r, "effort"), (), "lf_haa_joint.effort"),
        (fewer_joints, (), "no column 'lf_haa_joint.position'"),
        (walking, REST, "never stands still"),
        (on_two_feet, REST, "only 2 feet carry (LF, RH)"),
        (lambda r: r, (*REST, "--tare", "0:0.95"), "does not stand still after the tare's time"),
        (lambda r: r, (*REST, "--tare", "9000:9001"), "9000 to 9001 s, lies outside the log"),
        (lambda r: r, ("--tare", "9000:9001"), "lies outside the log"),
        (lambda r: r, ("--tare", "nowhere.csv"), "no such file"),
        (lambda r: r, ("--method", "guess"), "valid: poses, orientation, contact"),
        (lambda r: r, ("--stiffness", "1,0,1"), "three positive numbers"),
        (lambda r: r, ("--stiffness", "1,1,1"), "used by the method 'orientation' alone"),
        (lambda r: r, ("--stiffness", "1,1,1", "--method", "walking"), "not by walking"),
        (lambda r: r, ("--imu-frame", "nowhere"), "unknown IMU frame"),
        (lambda r: r, ("--truth", "nowhere.json"), "no such file"),
        (without_orientation, ("--method", "orientation", "--stiffness", "900,900,900"), "imu.orientation.x"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(
    run: Run,
    loading: Path,
    tmp_path: Path,
    spoil: Callable[[Recording], Recording],
    arguments: tuple[str, ...],
    said: str,
) -> None:
    recording = read(loading)
    log = write_table(spoil(take(recording, recording.time < 1.0)), tmp_path / "log.csv")
    finished = run(
        "weigh", log, "--robot", "hyq", "--json", tmp_path / "a.json", "--report", tmp_path / "a.html", *arguments
    )
    assert finished.code == 1
    assert said in finished.err
    assert finished.err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]


def test_a_value_that_is_not_finite(run: Run, loading: Path, tmp_path: Path) -> None:
    lines = loading.read_text().splitlines()[:200]
    cells = lines[50].split(",")
    cells[5] = "nan"
    log = tmp_path / "log.csv"
    log.write_text("\n".join([*lines[:50], ",".join(cells), *lines[51:]]) + "\n")
    finished = run("weigh", log, "--robot", "hyq")
    assert finished.code == 1
    assert "is nan at sample 49" in finished.err


def test_bad_usage(run: Run, loading: Path, tmp_path: Path) -> None:
    assert run("weigh", "--robot", "hyq").code == 2
    assert run("weigh", loading, "--robot", "hyq", "--tare", "3:1").code == 2
    assert run("weigh", loading, "--robot", "hyq", "--stiffness", "1,2").code == 2
    same = run("weigh", loading, "--robot", "hyq", "--json", loading)
    assert (same.code, "would replace an input" in same.err) == (1, True)
    assert loading.stat().st_size > 0


def test_the_help_names_every_method_and_the_defaults() -> None:
    how = get_args(options.Method)[1]
    assert set(str(how.metavar).split("|")) == {*METHODS, "FILE.py:NAME"}
    assert f"else {AT_REST}]" in str(how.help)
