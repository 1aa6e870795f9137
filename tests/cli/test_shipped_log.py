"""A real log that comes with the package, by its name, from an empty folder."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stadera.robot import load_robot


def test_a_leg_is_identified_from_an_example(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cmeel", reason="example-robot-data is not installed")
    monkeypatch.chdir(tmp_path)
    finished = run("identify", "go2_legs_in_air", "--robot", "go2", "--legs", "FR", "--json", "legs.json")
    assert finished.code == 0, finished.err
    found = json.loads((tmp_path / "legs.json").read_text())
    rmse = found["rmse"]["validation"]
    for joint in load_robot("go2").leg("RF").joints:
        assert rmse["identified"][joint] < rmse["prior_friction"][joint]
    assert run("inspect", "go2_trot").code == 0
