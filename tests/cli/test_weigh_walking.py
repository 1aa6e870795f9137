"""`stadera weigh`: a log of a trotting robot, weighed in motion."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from stadera.cli.app import app
from stadera.identify.schema import with_identified_legs
from stadera.robot import load_robot
from stadera.trunk.estimator import TrunkEstimator
from stadera.trust import Trust

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
    args = ["weigh", str(log), "--robot", "hyq", "--tare", "0:1.9"]
    truth = log.with_name("trot.truth.json")
    done = runner.invoke(app, [*args, "--json", str(out), "--report", str(page), "--truth", str(truth)])
    assert done.exit_code == 0, done.output
    found, true = json.loads(out.read_text()), json.loads(truth.read_text())["trunk"][-1]
    assert found["method"] == "walking"
    payload = found["payload"]
    assert payload["mass"]["value"] == pytest.approx(8.0, abs=4 * payload["mass"]["std"])
    assert payload["mass"]["std"] < 0.35  # of it 0.24 kg: an error of 3 % of all torques alike cannot be told
    for k in range(2):
        assert payload["com"]["value"][k] == pytest.approx(true["payload"]["com"][k], abs=0.01)
    assert found["trunk"]["mass"]["value"] == pytest.approx(true["mass"], abs=4 * found["trunk"]["mass"]["std"])
    assert [change["kind"] for change in found["changes"]] == ["on"]
    assert found["changes"][0]["mass"] == payload["mass"], "one load, one figure"
    assert found["changes"][0]["noticed"] - json.loads(truth.read_text())["trunk"][-1]["time"] < 0.3
    line = found["timeline"]
    assert len(line["time"]) == len(line["mass"]) == len(line["com"]) > 30
    assert abs(found["torque_lag"]["value"]) < 1e-3
    assert "Weighing in motion" in page.read_text()
    assert "src=" not in page.read_text().split("<script")[0]


def test_export_reads_back_as_the_json_says(log: Path, tmp_path: Path) -> None:
    """The same whole with and without a tare; with one the payload as a link of its own."""
    robot, out, model = load_robot("hyq"), tmp_path / "out.json", tmp_path / "out.urdf"
    args = ["weigh", str(log), "--robot", "hyq", "--json", str(out), "--export", str(model)]
    for tare in ([], ["--tare", "0:1.9"]):
        done = runner.invoke(app, [*args, *tare])
        assert done.exit_code == 0, done.output
        result, text = json.loads(out.read_text()), model.read_text()
        found, written = result["trunk"], load_robot(model).inertias[robot.trunk]
        assert written.mass == pytest.approx(found["mass"]["value"], rel=1e-9)
        assert None not in found["com"]["value"]
        assert written.com == pytest.approx(found["com"]["value"], abs=1e-8)
        assert ('<link name="payload">' in text) == bool(tare)
        if tare:
            assert f'<mass value="{result["payload"]["mass"]["value"]:.6g}'[:-2] in text
        else:
            known = [component["value"] for component in found["inertia"].values()]
            assert (known == [None] * 6) == ("the model's own: inertia" in text)
            assert known == [None] * 6 or written.vector[4:] == pytest.approx(known, rel=1e-6)


def test_a_bad_result_gives_no_figure_unless_forced(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bad = Trust("bad", 40.0, {"LF": 90.0}, ("the model does not explain the log; the likeliest cause is torque gain",))
    monkeypatch.setattr(TrunkEstimator, "trust", bad, raising=False)
    out, page, model = tmp_path / "out.json", tmp_path / "out.html", tmp_path / "out.urdf"
    args = ["weigh", str(log), "--robot", "hyq", "--json", str(out), "--report", str(page), "--export", str(model)]
    refused = runner.invoke(app, args)
    assert refused.exit_code == 1
    assert "the likeliest cause is torque gain" in str(refused.exception)
    assert not list(tmp_path.iterdir())
    forced = runner.invoke(app, [*args, "--force"])
    assert forced.exit_code == 0, forced.output
    found = json.loads(out.read_text())
    assert found["trust"] == {"verdict": "bad", "misfit": 40.0, "by_leg": {"LF": 90.0}, "reasons": list(bad.reasons)}
    marked = [found["trunk"]["mass"], found["trunk"]["com"], *(change["mass"] for change in found["changes"])]
    assert all(figure["trusted"] is False for figure in marked)
    assert forced.output.count("untrusted") >= 6
    assert page.read_text().count("untrusted") >= 6
    assert "NOT TO BE TRUSTED" in model.read_text()


def test_a_tare_outside_the_log(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    args = ["weigh", str(log), "--robot", "hyq", "--json", str(out)]
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
    terms = {"armature": {"value": 0.02}, "coulomb": {"value": -0.1}, "offset": {"value": -3.0}}
    path.write_text(json.dumps({"links": {link: entry}, "joints": {joint: terms}}))
    found = with_identified_legs(robot, path)
    assert found.inertias[link].com == pytest.approx(body.com + 0.01)
    assert found.dynamics[joint].armature == 0.02
    assert found.dynamics[joint].coulomb == 0.0
    assert found.dynamics[joint].offset == -3.0


def test_legs_that_are_no_identification(tmp_path: Path, log: Path) -> None:
    path = tmp_path / "legs.json"
    path.write_text("{}")
    done = runner.invoke(app, ["weigh", str(log), "--robot", "hyq", "--legs", str(path)])
    assert done.exit_code == 1
    assert "not the JSON of an identification" in str(done.exception)


def test_legs_that_are_not_to_be_trusted_need_force(tmp_path: Path, log: Path) -> None:
    path = tmp_path / "legs.json"
    trust = {"verdict": "bad", "misfit": 80.0, "by_leg": {}, "reasons": ["torques that do not fit"]}
    path.write_text(json.dumps({"links": {}, "joints": {}, "trust": trust}))
    args = ["weigh", str(log), "--robot", "hyq", "--legs", str(path)]
    done = runner.invoke(app, args)
    assert done.exit_code == 1
    assert "torques that do not fit" in str(done.exception)
    assert "--force" in str(done.exception)
    assert runner.invoke(app, [*args, "--force"]).exit_code == 0
