"""A test weight and a robot's memory, from Python and on the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stadera import IdentificationError, load_robot, weigh
from stadera.inertia import InertialParameters
from stadera.lab.plant.sensors import STANDARD
from stadera.logs import write_table
from stadera.trunk.memory import Memory
from stadera.weigh import TestWeight
from walking import Walk, recorded, walked

HYQ = load_robot("hyq")
PLACE, LOAD = (0.05, 0.0, 0.15), 8.0


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Walks with a load from 3 s on, the torques of all joints 4 % too large."""
    load = InertialParameters.from_com(LOAD, PLACE, 0.1 * np.eye(3))
    folder = tmp_path_factory.mktemp("known")
    walks = [walked(HYQ, Walk(seconds=t, rate_hz=500.0, load=load, loaded_at=3.0)) for t in (6.0, 6.5)]
    made = [recorded(HYQ, walk, STANDARD, 2) for walk in walks]
    scaled = [log.mapped(lambda name, values: 1.04 * values if name == "effort" else values) for log in made]
    return write_table(scaled[0], folder / "walk.csv"), write_table(scaled[1], folder / "later.csv")


@pytest.fixture
def log(logs: tuple[Path, Path]) -> Path:
    return logs[0]


def test_a_test_weight_and_a_memory(logs: tuple[Path, Path], tmp_path: Path, run: Any) -> None:
    log, other = logs
    memory, out = tmp_path / "hyq-17.json", tmp_path / "out.json"
    usual = ("weigh", log, "--robot", "hyq", "--tare", "0:2.8", "--json", out)
    first = run(*usual, "--known", f"{LOAD}kg@{','.join(map(str, PLACE))}", "--memory", memory)
    assert first.code == 0, first.err
    told = json.loads(out.read_text())
    assert told["payload"]["mass"]["value"] == pytest.approx(LOAD, abs=0.02)
    trunk = HYQ.inertias[HYQ.trunk].mass + LOAD
    found = told["trunk"]["mass"]
    assert found["value"] == pytest.approx(trunk, abs=2.0 * found["std"])
    assert found["std"] < 0.02 * HYQ.mass
    assert any("test weight" in note for note in told["notes"])
    kept = Memory.from_dict(json.loads(memory.read_text()))
    assert kept.logs == 1
    alone = run(*usual)
    assert alone.code == 0
    without = json.loads(out.read_text())["trunk"]["mass"]
    twice = run(*usual, "--memory", memory)
    assert twice.code == 0, twice.err
    assert "these samples are in the memory already" in " ".join(json.loads(out.read_text())["notes"])
    assert Memory.from_dict(json.loads(memory.read_text())).logs == 1
    later = run("weigh", other, *usual[2:], "--memory", memory)
    assert later.code == 0, later.err
    again = json.loads(out.read_text())["trunk"]["mass"]
    assert again["std"] < 0.7 * without["std"]
    assert abs(again["value"] - trunk) < abs(without["value"] - trunk)
    assert Memory.from_dict(json.loads(memory.read_text())).logs == 2


def test_what_does_not_fit_is_said(log: Path, tmp_path: Path, run: Any) -> None:
    for bad in ("5kg", "5kg@1,2", "-1@0,0,0", "kg@0,0,0"):
        ended = run("weigh", log, "--robot", "hyq", "--known", bad)
        assert ended.code == 2
        assert "test weight like" in ended.err
    broken = tmp_path / "memory.json"
    broken.write_text("{}")
    ended = run("weigh", log, "--robot", "hyq", "--memory", broken)
    assert ended.code == 1
    assert "not a robot's memory" in ended.err
    assert broken.read_text() == "{}"
    with pytest.raises(IdentificationError, match="since a tare"):
        weigh(HYQ, log, known=TestWeight(LOAD, PLACE))
    with pytest.raises(IdentificationError, match=r"stadera.weigh.TestWeight\(mass, com\), got tuple"):
        weigh(HYQ, log, known=(LOAD, PLACE))  # type: ignore[arg-type]
    with pytest.raises(IdentificationError, match="a test weight and a memory are used, by"):
        weigh(HYQ, log, method="contact", memory=Memory.none(HYQ))
