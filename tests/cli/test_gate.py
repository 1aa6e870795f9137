"""The gate that every output of a command passes."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from robot.robot_files import mjcf, quadruped
from stadera.cli.app import app
from stadera.cli.outputs import OUTPUTS, GatedCommand, inputs_of


@pytest.fixture
def files(tmp_path: Path, log: Path) -> Path:
    """A folder with one of everything that `weigh` reads."""
    shutil.copy(log, tmp_path / "log.csv")
    shutil.copy(log, tmp_path / "tare.csv")
    for name, text in (("toy.urdf", quadruped()), ("legs.json", '{"links": {}, "joints": {}}'), ("truth.json", "{}")):
        (tmp_path / name).write_text(text)
    (tmp_path / "map.toml").write_text('[columns]\ntime = "t"\n')
    return tmp_path


@pytest.mark.parametrize("taken", ["log.csv", "tare.csv", "toy.urdf", "legs.json", "truth.json", "map.toml"])
@pytest.mark.parametrize("option", ["--json", "--report", "--export"])
def test_no_output_replaces_an_input(run, files: Path, taken: str, option: str) -> None:
    target = files / ("target" + {"--report": ".html", "--export": ".urdf"}.get(option, ".json"))
    target.hardlink_to(files / taken)
    before = (files / taken).read_bytes()
    names = {"--tare": "tare.csv", "--robot": "toy.urdf", "--legs": "legs.json", "--truth": "truth.json"}
    asked = [part for name, file in names.items() for part in (name, files / file)]
    finished = run("weigh", files / "log.csv", *asked, "--columns", files / "map.toml", option, target)
    assert (finished.code, finished.out) == (1, "")
    assert "would replace an input" in finished.err
    assert (files / taken).read_bytes() == before


def test_what_was_written_is_named_and_what_it_replaced(run, files: Path) -> None:
    asked = ("identify", files / "log.csv", "--robot", "hyq", "--legs", "RH", "--json", files / "o.json")
    assert f"\nwrote {files / 'o.json'}\n" in run(*asked).out
    again = run(*asked, "--report", files / "o.html").out
    assert again.endswith(f"wrote {files / 'o.json'} in place of the one before\nwrote {files / 'o.html'}\n")


def test_a_report_of_another_kind_is_refused_before_the_work(run, files: Path) -> None:
    finished = run("identify", files / "log.csv", "--robot", "hyq", "--report", files / "o.docx")
    assert finished.code == 1
    assert "a report is written as .html" in finished.err


def test_inputs_are_whatever_is_no_output(tmp_path: Path) -> None:
    (tmp_path / "legs.xml").write_text("<mujoco/>")
    (tmp_path / "robot.xml").write_text(mjcf('<include file="legs.xml"/>'))
    named = {"logs": ["a.csv", "b.csv"], "robot": str(tmp_path / "robot.xml"), "json": Path("o.json"), "seed": 3}
    found = set(inputs_of({**named, "tare": "0:1", "legs": None}))
    assert {Path("a.csv"), Path("b.csv"), tmp_path / "robot.xml", tmp_path / "legs.xml"} <= found
    assert Path("o.json") not in found
    assert any(path.name == "hyq.urdf" for path in inputs_of({"robot": "hyq"}))


def test_every_command_has_the_gate_and_every_output_is_known_to_it() -> None:
    assert all(issubclass(command.cls, GatedCommand) for command in app.registered_commands)
    written = {
        name
        for command in app.registered_commands
        for name, kind in command.callback.__annotations__.items()
        if "Write" in str(kind) or name in ("json", "report")
    }
    assert written <= OUTPUTS
