"""`stadera weigh --method walking`: a log of a trotting robot, weighed without a stop."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from stadera.cli.app import app
from stadera.robot import load_robot
from stadera.robot.identified import with_identified_legs

runner = CliRunner()


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("walk") / "trot.parquet"
    args = ["simulate", "trot-load", "--robot", "hyq", "--rate", "1000", "--errors", "standard"]
    done = runner.invoke(app, [*args, "--load", "8kg", "--duration", "5", "--out", str(path)])
    assert done.exit_code == 0, done.output
    return path


def test_payload_change_and_truth(log: Path, tmp_path: Path) -> None:
    out, page = tmp_path / "out.json", tmp_path / "out.html"
    args = ["weigh", str(log), "--robot", "hyq", "--method", "walking", "--tare", "0:1.9"]
    truth = log.with_name("trot.truth.json")
    done = runner.invoke(app, [*args, "--json", str(out), "--report", str(page), "--truth", str(truth)])
    assert done.exit_code == 0, done.output
    found, true = json.loads(out.read_text()), json.loads(truth.read_text())["trunk"][-1]
    assert found["method"] == "walking"
    payload = found["payload"]
    assert payload["mass"]["value"] == pytest.approx(8.0, abs=4 * payload["mass"]["std"])
    assert payload["mass"]["std"] < 0.2
    for k in range(2):
        assert payload["com"]["value"][k] == pytest.approx(true["payload"]["com"][k], abs=0.01)
    assert found["trunk"]["mass"]["value"] == pytest.approx(true["mass"], abs=4 * found["trunk"]["mass"]["std"])
    assert [change["kind"] for change in found["changes"]] == ["on"]
    assert found["changes"][0]["noticed"] - json.loads(truth.read_text())["trunk"][-1]["time"] < 0.2
    line = found["timeline"]
    assert len(line["time"]) == len(line["mass"]) == len(line["com"]) > 30
    assert abs(found["torque_lag"]["value"]) < 1e-3
    assert "Weighing in motion" in page.read_text()
    assert "src=" not in page.read_text().split("<script")[0]


def test_export_reads_back_as_the_json_says(log: Path, tmp_path: Path) -> None:
    """The payload beside the trunk as believed; without a tare the trunk as weighed."""
    robot, out, model = load_robot("hyq"), tmp_path / "out.json", tmp_path / "out.urdf"
    args = ["weigh", str(log), "--robot", "hyq", "--method", "walking", "--json", str(out), "--export", str(model)]
    prior = robot.inertias[robot.trunk]
    for tare, name in ((["--tare", "0:1.9"], "payload"), ([], "trunk")):
        done = runner.invoke(app, [*args, *tare])
        assert done.exit_code == 0, done.output
        found, back, text = json.loads(out.read_text())[name], load_robot(model), model.read_text()
        written = back.inertias[robot.trunk] - prior if tare else back.inertias[robot.trunk]
        assert back.mass - robot.mass == pytest.approx(found["mass"]["value"] - (0.0 if tare else prior.mass), rel=1e-9)
        assert None not in found["com"]["value"]
        assert written.com == pytest.approx(found["com"]["value"], abs=1e-8)
        if not tare:
            known = [component["value"] for component in found["inertia"].values()]
            assert (known == [None] * 6) == ("the model's own: inertia" in text)
            assert known == [None] * 6 or written.vector[4:] == pytest.approx(known, rel=1e-6)


def test_a_tare_outside_the_log(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    args = ["weigh", str(log), "--robot", "hyq", "--method", "walking", "--json", str(out)]
    done = runner.invoke(app, [*args, "--tare", "90:95"])
    assert done.exit_code == 1
    assert "lies outside the log" in str(done.exception)
    assert not out.exists()


def test_legs_as_identified(tmp_path: Path) -> None:
    robot = load_robot("hyq")
    joint, link = robot.legs[0].joints[2], robot.legs[0].links[2]
    body = robot.inertias[link]
    entry = {
        "mass": {"value": body.mass},
        "com": [{"value": float(c) + 0.01} for c in body.com],
        "inertia": dict(
            zip(
                ("xx", "xy", "xz", "yy", "yz", "zz"), ({"value": float(v) + 0.05} for v in body.vector[4:]), strict=True
            )
        ),
    }
    entry["inertia"] |= {name: {"value": 0.0} for name in ("xy", "xz", "yz")}
    path = tmp_path / "legs.json"
    terms = {"armature": {"value": 0.02}, "coulomb": {"value": -0.1}, "offset": {"value": 3.0}}
    path.write_text(json.dumps({"links": {link: entry}, "joints": {joint: terms}}))
    found = with_identified_legs(robot, path)
    assert found.inertias[link].com == pytest.approx(body.com + 0.01)
    assert found.dynamics[joint].armature == 0.02
    assert found.dynamics[joint].coulomb == 0.0
    assert found.dynamics[joint].offset == robot.dynamics[joint].offset


def test_legs_that_are_no_identification(tmp_path: Path, log: Path) -> None:
    path = tmp_path / "legs.json"
    path.write_text("{}")
    done = runner.invoke(app, ["weigh", str(log), "--robot", "hyq", "--method", "walking", "--legs", str(path)])
    assert done.exit_code == 1
    assert "not the JSON of an identification" in str(done.exception)
