"""`stadera identify`: what it writes, and what bad input gets."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from stadera.logs import Recording, read, take, write_table
from stadera.robot import load_robot

JOINTS = ("rh_haa_joint", "rh_hfe_joint", "rh_kfe_joint")


def _table(recording: Recording) -> dict[str, list[str]]:
    """A recording as columns of text, to be spoilt."""
    columns = {"time": recording.time}
    for channel in ("position", "velocity", "effort"):
        values = getattr(recording, channel)
        columns |= {f"{joint}.{channel}": values[:, k] for k, joint in enumerate(recording.joints)}
    return {name: [repr(float(v)) for v in values] for name, values in columns.items()}


def _write(path: Path, table: dict[str, list[str]]) -> Path:
    rows = [",".join(table), *(",".join(cells) for cells in zip(*table.values(), strict=True))]
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.fixture(scope="session")
def spoilable(swing) -> dict[str, list[str]]:
    return {name: cells[:600] for name, cells in _table(swing).items()}


class _Everything:
    """One run with every output, looked at by several tests."""

    def __init__(self, folder: Path) -> None:
        self.json, self.report, self.export = folder / "o.json", folder / "o.html", folder / "o.urdf"


@pytest.fixture(scope="module")
def everything(log, tmp_path_factory) -> _Everything:
    from stadera.cli import main

    files = _Everything(tmp_path_factory.mktemp("out"))
    outputs = ["--json", files.json, "--report", files.report, "--export", files.export]
    with pytest.raises(SystemExit) as exit_info:
        main([str(a) for a in ["identify", log, "--robot", "hyq", "--legs", "rh", *outputs]])
    assert not exit_info.value.code
    return files


def test_json_has_the_contracts_keys(everything):
    found = json.loads(everything.json.read_text())
    assert {"robot", "links", "joints", "rank", "parameters", "physical", "rmse"} <= found.keys()
    assert found["robot"] == "hyq"
    assert found["frames"]["inertia_about"] == "frame origin"
    assert tuple(found["joints"]) == JOINTS
    for link in found["links"].values():
        assert set(link) == {"mass", "com", "inertia"}
        assert set(link["inertia"]) == {"xx", "xy", "xz", "yy", "yz", "zz"}
        for quantity in (link["mass"], *link["com"], *link["inertia"].values()):
            assert set(quantity) == {"prior", "value", "std", "observability"}
            assert quantity["observability"] in ("observable", "partial", "unobservable")
            assert (quantity["observability"] != "unobservable") or quantity["std"] is None
    for joint in found["joints"].values():
        assert {"armature", "viscous", "coulomb", "offset"} <= joint.keys()
        assert all({"value", "std"} <= term.keys() for term in joint.values())
    for part in ("training", "validation"):
        for model in ("prior", "prior_friction", "identified"):
            assert tuple(found["rmse"][part][model]) == JOINTS


def test_masses_are_the_models_and_have_no_std(everything):
    found, robot = json.loads(everything.json.read_text()), load_robot("hyq")
    for name, link in found["links"].items():
        assert link["mass"]["value"] == pytest.approx(robot.inertias[name].mass, rel=1e-9)
        assert link["mass"]["std"] is None


def test_the_export_holds_what_the_json_says(everything):
    found, back = json.loads(everything.json.read_text()), load_robot(everything.export)
    for name, link in found["links"].items():
        body = back.inertias[name]
        inertia = [link["inertia"][axis]["value"] for axis in ("xx", "xy", "xz", "yy", "yz", "zz")]
        assert body.com == pytest.approx([q["value"] for q in link["com"]], rel=1e-8, abs=1e-12)
        assert body.vector[4:] == pytest.approx(inertia, rel=1e-8, abs=1e-10)


def test_the_report_is_one_page(everything):
    page = everything.report.read_text()
    assert page.startswith("<!DOCTYPE html>")
    assert "RH" in page


def test_nothing_else_is_left_beside_the_outputs(everything):
    assert {p.name for p in everything.json.parent.iterdir()} == {"o.json", "o.html", "o.urdf"}


def test_tables_on_stdout_and_silence_on_stderr(run, log):
    finished = run("identify", log, "--robot", "hyq", "--legs", "RH")
    assert finished.code == 0
    assert finished.err == ""
    assert "rh_upperleg" in finished.out
    assert "Torque RMSE [N·m]" in finished.out
    assert "\x1b" not in finished.out


@pytest.fixture(scope="module")
def other(swing: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another log of the leg."""
    return write_table(take(swing, slice(800, None)), tmp_path_factory.mktemp("other") / "other.csv")


def test_other_settings_reach_the_result(run, log, other, tmp_path):
    path = tmp_path / "o.json"
    settings = ["--split", "none", "--method", "null-space", "--friction", "viscous", "--torque-lag", "0.002"]
    finished = run(
        "identify",
        log,
        other,
        "--robot",
        "hyq",
        "--legs",
        "rh",
        "--cutoff",
        "20",
        "--up",
        "0,0,2",
        *settings,
        "--json",
        path,
    )
    assert finished.code == 0
    found = json.loads(path.read_text())
    assert found["method"] == "null-space"
    assert found["torque_lag"] == 0.002
    assert set(found["rmse"]) == {"training"}
    assert all(set(joint) == {"viscous"} for joint in found["joints"].values())
    assert any("20 Hz" in note for note in found["notes"])
    assert "warning: nothing was held out" in finished.out


def test_validates_on_another_log(run, log, other, tmp_path):
    path = tmp_path / "o.json"
    finished = run("identify", log, "--robot", "hyq", "--legs", "RH", "--validate", other, "--json", path)
    assert finished.code == 0
    found = json.loads(path.read_text())
    assert found["validated_on"] == str(other)
    assert found["agreement"]["parts"] == ["the first half", "the second half"], "of what was fitted"


def test_the_same_log_twice_is_refused(run, log, swing, tmp_path):
    copy = write_table(swing, tmp_path / "copy.csv")
    for logs, said in (
        ([log, log], f"stadera: error: {log}: given twice; give each log once\n"),
        ([log, "--validate", copy], f"stadera: error: {copy}: holds the same samples as {log}; give each log once\n"),
    ):
        finished = run("identify", *logs, "--robot", "hyq", "--legs", "RH")
        assert finished.code
        assert finished.err == said


def _drop_effort(table: dict[str, list[str]]) -> None:
    del table["rh_hfe_joint.effort"]


def _misname(table: dict[str, list[str]]) -> None:
    table["rh_hfe_jiont.position"] = table.pop("rh_hfe_joint.position")


def _nan(table: dict[str, list[str]]) -> None:
    table["rh_kfe_joint.effort"][7] = "nan"


def _infinite(table: dict[str, list[str]]) -> None:
    table["rh_haa_joint.position"][9] = "inf"


def _standing_time(table: dict[str, list[str]]) -> None:
    table["time"][20] = table["time"][19]


def _time_back(table: dict[str, list[str]]) -> None:
    table["time"][20] = table["time"][10]


def _too_short(table: dict[str, list[str]]) -> None:
    for name in table:
        table[name] = table[name][:4]


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (_drop_effort, "rh_hfe_joint.effort"),
        (_misname, "rh_hfe_joint.position"),
        (_nan, "rh_kfe_joint.effort"),
        (_infinite, "rh_haa_joint.position"),
        (_standing_time, "stands still"),
        (_time_back, "runs back"),
        (_too_short, "too few samples"),
    ],
)
def test_a_bad_log_is_one_line_and_writes_nothing(run, spoilable, tmp_path, spoil, named):
    table = {name: list(cells) for name, cells in spoilable.items()}
    spoil(table)
    path = _write(tmp_path / "bad.csv", table)
    out = tmp_path / "o.json"
    _expect_error(run("identify", path, "--robot", "hyq", "--legs", "RH", "--json", out), named, "bad.csv")
    assert [p.name for p in tmp_path.iterdir()] == ["bad.csv"]


def test_a_motion_that_excites_nothing_is_a_result_with_an_honest_rank(run, swing, tmp_path):
    position, effort = (np.tile(x[len(x) // 2], (len(x), 1)) for x in (swing.position, swing.effort))
    rest = Recording(swing.time, swing.joints, position, np.zeros_like(position), effort=effort, source="rest")
    finished = run("identify", write_table(rest, tmp_path / "rest.csv"), "--robot", "hyq", "--legs", "RH")
    assert finished.code == 0
    assert "rank 3 of 51" in finished.out  # one pose: one torque a joint
    assert "no sample moves" in finished.out
    assert "poor excitation" in finished.out


def _expect_error(finished, *named: str) -> None:
    assert finished.code == 1, finished
    assert finished.out == ""
    assert re.fullmatch(r"stadera: error: [^\n]+\n", finished.err), finished.err
    for part in named:
        assert part in finished.err


def test_no_such_leg_names_the_legs(run, log):
    _expect_error(run("identify", log, "--robot", "hyq", "--legs", "XX"), "'XX'", "LF, RF, LH, RH")


def test_no_such_robot_names_the_robots(run, log):
    _expect_error(run("identify", log, "--robot", "hyk"), "'hyk'", "hyq", "did you mean")


def test_no_such_log(run, tmp_path):
    _expect_error(run("identify", tmp_path / "none.csv", "--robot", "hyq"), "none.csv", "no such file")


def test_a_log_that_lacks_the_other_legs(run, log):
    _expect_error(run("identify", log, "--robot", "hyq"), "swing.csv", "lf_haa_joint")


def test_a_log_that_is_not_what_its_name_says(run, log, tmp_path):
    path = tmp_path / "swing.parquet"
    path.write_bytes(log.read_bytes())
    _expect_error(run("identify", path, "--robot", "hyq", "--legs", "RH"), "swing.parquet", "not what its name says")


def test_no_such_friction_term(run, log):
    _expect_error(run("identify", log, "--robot", "hyq", "--friction", "stribeck"), "stribeck", "coulomb")


@pytest.mark.parametrize("mass", ["0.0", "-1.0"])
def test_a_urdf_with_a_bad_mass(run, log, tmp_path, mass):
    source = load_robot("hyq").source.read_text()
    path = tmp_path / "bad.urdf"
    path.write_text(source.replace('<mass value="2.638"', f'<mass value="{mass}"', 1))
    assert path.read_text() != source
    _expect_error(run("identify", log, "--robot", path, "--legs", "RH"), "bad.urdf", "upperleg", "mass")


def test_outputs_are_checked_before_the_work(run, log, tmp_path):
    start = ("identify", log, "--robot", "hyq", "--legs", "RH")
    _expect_error(run(*start, "--json", tmp_path / "no" / "o.json"), "no such folder")
    _expect_error(run(*start, "--report", tmp_path), "is a folder")
    _expect_error(run(*start, "--export", tmp_path / "o.xml"), "o.xml", ".urdf")
    _expect_error(run(*start, "--json", log), "would replace an input")
    _expect_error(run(*start, "--json", tmp_path / "o", "--report", tmp_path / "o"), "would replace another output")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "options",
    [
        ["--cutoff", "fast"],
        ["--cutoff", "-3"],
        ["--split", "1.5"],
        ["--split", "half"],
        ["--up", "0,1"],
        ["--up", "0,0,0"],
        ["--torque-lag", "soon"],
        ["--method", "magic"],
        ["--legs", ","],
        ["--split", "0.5", "--validate", "other.csv"],
    ],
)
def test_malformed_options_are_bad_usage(run, options):
    finished = run("identify", "log.csv", "--robot", "hyq", *options)
    assert finished.code == 2
    assert "stadera: error" not in finished.err


def test_an_export_that_fails_leaves_no_other_output(run, log, tmp_path, monkeypatch):
    from stadera.errors import ModelError
    from stadera.robot import export

    def fails(*_: object, **__: object) -> None:
        raise ModelError("cannot hold it")

    monkeypatch.setattr(export, "export_model", fails)
    outputs = ["--json", tmp_path / "o.json", "--export", tmp_path / "o.urdf"]
    _expect_error(run("identify", log, "--robot", "hyq", "--legs", "RH", *outputs), "cannot hold it")
    assert not list(tmp_path.iterdir())


def test_draws_are_written_on_request(run, log, tmp_path: Path) -> None:
    outputs = ["--draws", f"3={tmp_path / 'd.csv'}", "--json", tmp_path / "o.json"]
    assert run("identify", log, "--robot", "hyq", "--legs", "RH", *outputs).code == 0
    lines = (tmp_path / "d.csv").read_text().splitlines()
    assert len(lines) == 4
    assert "rh_kfe_joint.coulomb" in lines[0]


@pytest.mark.parametrize(
    ("option", "value"), [("--draws", "0=d.csv"), ("--torque-lag", "5"), ("--torque-lag", "soon"), ("--split", "3")]
)
def test_an_option_out_of_range_is_named(run, tmp_path: Path, option: str, value: str) -> None:
    finished = run("identify", tmp_path / "log.csv", "--robot", "hyq", option, value)
    assert finished.code == 2
    assert option in finished.err


def test_a_log_that_the_model_does_not_explain_needs_force(run, swing, tmp_path):
    table = _table(swing)
    table["rh_hfe_joint.effort"] = [repr(-float(v)) for v in table["rh_hfe_joint.effort"]]
    log, out = _write(tmp_path / "log.csv", table), tmp_path / "o.json"
    finished = run("identify", log, "--robot", "hyq", "--legs", "rh", "--json", out)
    assert finished.code == 1
    assert "the torque of 'rh_hfe_joint' seems to have the other sign" in finished.err
    assert finished.out == ""
    assert not out.exists()
    assert run("identify", log, "--robot", "hyq", "--legs", "rh", "--json", out, "--force").code == 0
    found = json.loads(out.read_text())
    assert found["trust"]["verdict"] == "bad"
    assert found["links"]["rh_upperleg"]["com"][0]["trusted"] is False


def test_an_impossible_body_is_in_no_model_file(run, tmp_path) -> None:
    given = ("identify", "go2_legs_in_air", "--robot", "go2", "--legs", "LF", "--method", "null-space")
    _expect_error(run(*given, "--export", tmp_path / "legs.urdf"), "a body that cannot be", "--force")
    assert not list(tmp_path.iterdir())


def test_a_log_that_determines_nothing_is_no_result(run, tmp_path) -> None:
    log = write_table(take(read("go2_legs_in_air"), slice(0, 100)), tmp_path / "log.csv")
    _expect_error(run("identify", log, "--robot", "go2", "--legs", "LF"), "the log determines nothing")
