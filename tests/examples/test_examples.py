"""Every script of examples/ runs from another folder, and prints what it promises."""

from __future__ import annotations

import json
import re
import runpy
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from logs_to_play import LOAD, swing_log, walk_log
from stadera.identify.legs import identify
from stadera.identify.settings import IdentifySettings
from stadera.lab.plant.sensors import STANDARD
from stadera.logs import write_table
from stadera.robot import load_robot
from walking import Walk, recorded, walked

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
TESTED = {
    "online",
    "weigh_log",
    "identify_own_excitation",
    "export_to_controller",
    "own_regressor",
    "own_estimator",
    "live_client",  # in tests/live
    "live_rclpy_node",  # in tests/live
}


@pytest.fixture(scope="module")
def swing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return swing_log(tmp_path_factory.mktemp("log") / "swing.csv")


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return walk_log(tmp_path_factory.mktemp("log") / "walk.csv")


Example = Callable[..., str]


@pytest.fixture
def example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Example:
    """Runs a script as `python NAME.py ARGUMENTS` would in the test's folder; what it prints."""

    def _example(name: str, *arguments: object) -> str:
        script = EXAMPLES / f"{name}.py"
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [str(script), *map(str, arguments)])
        runpy.run_path(str(script), run_name="__main__")
        return capsys.readouterr().out

    return _example


def test_all_are_tested() -> None:
    assert {path.stem for path in EXAMPLES.glob("*.py")} == TESTED


def test_identify_own_excitation(example: Example, tmp_path: Path) -> None:
    out = example("identify_own_excitation", "hyq", "RH", 20)
    found = re.search(r"rh_kfe_joint\.viscous +([\d.]+) ± ([\d.]+) ", out)
    assert found is not None
    assert found[1] == "0.1000", "an exact log shows the plant's friction to all digits"
    assert 0.0 < float(found[2]) < 0.01, "the bar depends on the motion drawn, that on the processor's rounding"
    assert (tmp_path / "motion.csv").is_file()


def test_export_to_controller(example: Example, swing: Path, tmp_path: Path) -> None:
    legs = tmp_path / "legs.json"
    identify("hyq", swing, IdentifySettings(legs=("RH",))).save_json(legs)
    example("export_to_controller", "hyq", legs)
    config = json.loads((tmp_path / "controller.json").read_text())
    found = json.loads(legs.read_text())["joints"]["rh_kfe_joint"]["viscous"]["value"]
    assert config["joints"]["rh_kfe_joint"]["viscous"] == pytest.approx(found, rel=1e-12)
    assert load_robot(tmp_path / "identified.urdf").mass == pytest.approx(load_robot("hyq").mass, rel=0.01)


def test_own_regressor(example: Example) -> None:
    out = example("own_regressor")
    value, std = (float(word) for word in out.splitlines()[-1].split()[1::2])
    assert abs(value - 12.0) < 4 * std < 0.05


def test_weigh_log(example: Example, walk: Path, tmp_path: Path) -> None:
    out = example("weigh_log", walk, "hyq", 0, 2.5)
    found = re.search(r"payload ([\d.]+) ± ([\d.]+) kg", out)
    assert found is not None
    assert abs(float(found[1]) - LOAD.mass) < 4.0 * float(found[2]) < 2.0  # 3 % of unknown torque gain are 0.24 kg
    assert len(re.findall("load changed at", out)) == 1
    assert load_robot(tmp_path / "weighed.urdf").mass > load_robot("hyq").mass + 7.0


def test_online(example: Example, walk: Path) -> None:
    out = example("online", walk, "hyq", 2.5)
    found = re.search(r"payload ([\d.]+) ± ([\d.]+) kg", out)
    assert found is not None
    assert abs(float(found[1]) - LOAD.mass) < 4.0 * float(found[2]) < 2.0
    assert len(re.findall("the load changed", out)) == 1


def test_own_estimator(example: Example, tmp_path: Path) -> None:
    robot = load_robot("hyq")
    still = walked(robot, Walk(seconds=2.0, rate_hz=250.0, period=0.0, speed=0.0, tilt=0.0, sway=0.0))
    log = write_table(recorded(robot, still, STANDARD, 0), tmp_path / "stand.csv")
    found = re.search(r"trunk ([\d.]+) ", example("own_estimator", log, "hyq"))
    assert found is not None
    assert float(found[1]) == pytest.approx(robot.inertias[robot.trunk].mass, rel=0.03)
