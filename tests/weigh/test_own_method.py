"""Weighs by an estimator in a user's own file: `--method FILE.py:Name`."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stadera import IdentificationError, UnknownNameError, load_robot, weigh
from stadera.logs import write_table
from stadera.trunk import registry
from stadera.trunk.protocol import Weigher
from stadera.trunk.registry import is_own, method_of
from standing import static_log

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_estimator.py"
MEAN = f"{EXAMPLE}:MeanMass"


def file(folder: Path, text: str) -> str:
    path = folder / "mine.py"
    path.write_text(text)
    return str(path)


def test_a_class_of_a_file_is_a_method() -> None:
    assert is_own(MEAN)
    assert not is_own("walking")
    method = method_of(MEAN)
    assert method.needs_imu
    assert method.summary.startswith("Mean of the vertical force")


def test_a_log_is_weighed_by_it() -> None:
    robot = load_robot("hyq")
    result = weigh(robot, static_log(robot), tare=(0.0, 1.0), method=MEAN)
    truth = robot.inertias[robot.trunk].mass
    assert result.method == MEAN
    assert result.mass == pytest.approx(truth, rel=0.03)
    assert abs(result.mass - truth) < 3.0 * result.trunk.mass_std
    assert np.isnan(result.trunk.com).all()
    assert result.payload is not None
    assert abs(result.payload.mass) < 3.0 * result.payload.mass_std
    assert result.trust.verdict == "doubtful"
    assert len(result.timeline.time) > 5
    assert np.diff(result.timeline.mass_std).max() < 0.1


def test_it_reaches_json_and_page(tmp_path: Path, run: Callable[..., Any]) -> None:
    robot = load_robot("hyq")
    log, page = tmp_path / "stand.csv", tmp_path / "page.html"
    write_table(static_log(robot), log)
    asked = ["--method", MEAN, "--imu-frame", robot.trunk, "--json", tmp_path / "found.json", "--report", str(page)]
    done = run("weigh", log, "--robot", "hyq", *asked)
    assert done.code == 0, done.err
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["method"] == MEAN
    assert found["trunk"]["mass"]["std"] > 0.0
    assert "Mean of the vertical force" in page.read_text()


def test_installed_packages_name_their_estimators(monkeypatch: pytest.MonkeyPatch) -> None:
    named = EntryPoints(
        EntryPoint(name, f"stadera.lab.laws.{value}", registry.GROUP)
        for name, value in (("mine", "poses:PosesCom"), ("lost", "nowhere:Any"))
    )
    monkeypatch.setattr(registry, "entry_points", lambda group: named.select(group=group))
    robot = load_robot("hyq")
    assert isinstance(method_of("mine").make(registry.Setup(robot)), Weigher)
    result = weigh(robot, static_log(robot), method="mine")
    assert result.mass == pytest.approx(robot.inertias[robot.trunk].mass, rel=0.03)
    with pytest.raises(IdentificationError, match="entry point 'lost' cannot be imported"):
        method_of("lost")
    with pytest.raises(UnknownNameError, match="lost, mine"):
        method_of("other")


def test_what_is_wrong_is_said(tmp_path: Path) -> None:
    with pytest.raises(IdentificationError, match="no such file"):
        method_of("nowhere.py:Mean")
    with pytest.raises(UnknownNameError, match=r"Meen.*MeanMass"):
        method_of(f"{EXAMPLE}:Meen")
    with pytest.raises(IdentificationError, match=r"cannot be imported: .*nonsense"):
        method_of(file(tmp_path, "import nonsense") + ":Any")
    with pytest.raises(IdentificationError, match="has no estimate"):
        method_of(file(tmp_path, "class Half:\n    def update(self, m): ...\n") + ":Half")
    with pytest.raises(UnknownNameError, match=r"walkng.*FILE\.py:Name"):
        weigh("hyq", static_log(load_robot("hyq")), method="walkng")


@pytest.mark.parametrize(
    ("inside", "said"),
    [
        ("def __init__(self): pass", "the estimator Mine failed: TypeError: .* but 2 were given$"),
        ("def update(self, m): raise ValueError('odd')", r"failed: ValueError: odd \(.*mine.py, line 4\)"),
        ("", r"Mine.estimate\(\) gave NoneType, a stadera.trunk.protocol.TrunkEstimate is needed"),
    ],
)
def test_a_class_that_fails_is_named(tmp_path: Path, inside: str, said: str) -> None:
    own = "class Mine:\n    def __init__(self, robot): pass\n    def update(self, m): pass\n"
    path = file(tmp_path, f"{own}    {inside or 'pass'}\n    def estimate(self): pass\n")
    robot = load_robot("hyq")
    with pytest.raises(IdentificationError, match=said):
        weigh(robot, static_log(robot), method=f"{path}:Mine")
