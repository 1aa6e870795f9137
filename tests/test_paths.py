"""Three people's paths, each from README's first line to the last file, outside the repository, by a built wheel.

The scripts are in `tests/paths`. The environment has the wheel and, from the environment of the tests, what it needs.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pinocchio
import pytest

from bags import write_mcap
from browser import CHROMIUM, SCREEN, measure
from log_formats import low_states
from logs_to_play import LOAD, swing_log, walk_log
from sharing import shared
from stadera.inertia import InertialParameters
from stadera.lab.plant.sensors import STANDARD
from stadera.robot import load_robot
from stadera.robot.catalog import find_file
from walking import Walk, recorded, walked

ROOT = Path(__file__).resolve().parent.parent
PATHS = ROOT / "tests" / "paths"


def environment(folder: Path) -> None:
    """Builds the wheel and installs it, and nothing else, into an environment of its own."""
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    pytest.importorskip("hatchling", reason="needs pip install -r requirements/build.in")
    run([*pip, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder / "dist"), str(ROOT)], folder)
    run([sys.executable, "-m", "venv", "--without-pip", str(folder / "venv")], folder)
    (wheel,) = (folder / "dist").glob("*.whl")
    interpreter = folder / "venv" / "bin" / "python"
    run([*pip, "--python", str(interpreter), "install", "--no-deps", "--no-index", str(wheel)], folder)
    (site,) = (folder / "venv").glob("lib/python*/site-packages")
    needed = [path for path in sys.path if "site-packages" in path]  # with what their .pth files added, but the source
    (site / "of_the_tests.pth").write_text("\n".join(needed))
    for code in (ROOT / "src").rglob("*.nb[ci]"):  # machine code, which else takes 10 s at the first start
        there = site / code.relative_to(ROOT / "src")
        there.parent.mkdir(exist_ok=True)
        there.write_bytes(code.read_bytes())
        module = f"{code.name.split('.')[0]}.py"  # numba compares its time
        shutil.copystat(code.parent.parent / module, there.parent.parent / module)


def run(command: list[str], folder: Path, **extra: str) -> str:
    """What a command prints; its errors are the test's."""
    inherited = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "STADERA_DATA")}
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, env={**inherited, "NO_COLOR": "1", **extra}
    )
    assert done.returncode == 0, f"{command}: {done.stdout[-1500:]}{done.stderr[-3000:]}"
    return done.stdout


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The `bin` of the environment."""
    return shared(tmp_path_factory, "wheel", environment) / "venv" / "bin"


def walk_path(installed: Path, folder: Path, name: str, before: str = "") -> str:
    """Runs a path's script, and shell commands before it, in the folder."""
    script = f"set -eu\n{before}\n{(PATHS / name).read_text()}"
    path = f"{installed}{os.pathsep}{os.environ['PATH']}"
    where = run([str(installed / "python"), "-c", "import stadera; print(stadera.__file__)"], folder)
    assert Path(where.strip()).is_relative_to(installed.parent), "the wheel's, not the repository's"
    return run(["bash", "-c", script], folder, PATH=path)


def commands(page: str) -> list[str]:
    return [
        line.strip() for line in re.findall(r"^    ((?:stadera|sed) [^#\n]+)", (ROOT / page).read_text(), re.MULTILINE)
    ]


def values(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text()))


def test_every_command_of_the_readme_is_on_a_path() -> None:
    told = "\n".join(script.read_text() for script in PATHS.glob("*.sh"))
    assert not [command for command in commands("README.md") if command not in told]


def test_a_go2_engineer_with_a_bag_of_low_states(installed: Path, tmp_path: Path) -> None:
    load = InertialParameters.from_com(2.0, [0.05, 0.0, 0.1], [[0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.01]])
    robot = load_robot("go2")
    motion = walked(robot, Walk(seconds=4.5, rate_hz=250.0, load=load, loaded_at=2.7))
    write_mcap(low_states(recorded(robot, motion, STANDARD, 0)), tmp_path / "walk.mcap")
    told = walk_path(installed, tmp_path, "go2_engineer.sh")
    assert "joints read from /lowstate" in told
    payload = values(tmp_path / "payload.json")["payload"]["mass"]
    assert payload["value"] == pytest.approx(load.mass, abs=3.0 * payload["std"])
    assert payload["std"] < 0.2
    assert values(tmp_path / "payload.json")["trust"]["verdict"] in ("good", "doubtful")
    assert "isaac_lab:" in (tmp_path / "go2_drives.yaml").read_text()
    exported = pinocchio.buildModelFromUrdf(str(tmp_path / "go2_loaded.urdf"), pinocchio.JointModelFreeFlyer())
    whole = sum(inertia.mass for inertia in exported.inertias)
    assert whole == pytest.approx(
        values(tmp_path / "payload.json")["trunk"]["mass"]["value"] + 16.087 - 7.277, abs=0.05
    )
    for name in ("report.html", "payload.html"):
        assert "</html>" in (tmp_path / name).read_text(encoding="utf-8")


def test_a_researcher_with_arrays_and_an_estimator(installed: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="needs pip install 'stadera[figures]'")
    (tmp_path / "robot.urdf").write_bytes(find_file("hyq").read_bytes())
    swing_log(tmp_path / "swing.csv")
    walk_log(tmp_path / "walk.csv")
    shutil.copy(PATHS / "researcher.py", tmp_path)
    shutil.copy(ROOT / "examples" / "own_estimator.py", tmp_path / "mine.py")
    walk_path(installed, tmp_path, "researcher.sh")
    assert "rotor" in (tmp_path / "report.html").read_text(encoding="utf-8")
    found, online = values(tmp_path / "arrays.json")["payload"]["mass"], values(tmp_path / "online.json")
    assert found["value"] == pytest.approx(LOAD.mass, abs=3.0 * found["std"])
    assert online["mass"] == pytest.approx(found["value"], abs=0.5 * found["std"])
    compared = json.loads((tmp_path / "compared.json").read_text())
    assert "mine.py:MeanMass" in json.dumps(compared)
    assert r"\toprule" in (tmp_path / "compared.tex").read_text()
    assert (tmp_path / "payload.pdf").read_bytes().startswith(b"%PDF")
    pinocchio.buildModelFromUrdf(str(tmp_path / "identified.urdf"))
    for name in ("payload.html", "compared.html"):
        assert "</html>" in (tmp_path / name).read_text(encoding="utf-8")


def test_a_student_with_the_paper(installed: Path, tmp_path: Path) -> None:
    first = "\n".join(commands("docs/start.md"))
    told = walk_path(installed, tmp_path, "student.sh", before=first)
    for words in (
        "hip assembly",
        "upper leg",
        "lower leg",
        "simulated",
        "identified",
        "CAD",
        "rank, of 30",
        "table1.html",
        "legs LF and RF are swapped",
        "46 % better",
    ):
        assert words in told
    records = json.loads((tmp_path / "table1.json").read_text())
    keys = {"experiment", "case", "metric", "unit", "value", "paper", "bound", "met"}
    assert all(set(record) >= keys for record in records)
    assert {record["experiment"] for record in records} == {"table1"}
    page = (tmp_path / "table1.html").read_text()
    assert not re.search(r"<(script|img|link|iframe)[^>]*(src|href)=", page)  # nothing is loaded
    assert page.count('class="plot"') == 1
    assert "What differs from the paper, and why" in page
    assert "https://hal.science/hal-01575033" in page
    if CHROMIUM:
        for seen in measure({"table1": page}, tmp_path).values():
            assert 0 < seen["answer"] < seen["badge"] < SCREEN
            assert (seen["scroll"] <= seen["width"], seen["wide"]) == (True, [])
    assert r"\toprule" in (tmp_path / "table1.tex").read_text()
    assert {"payload.html", "legs.html", "go2_drives.yaml"} <= {path.name for path in tmp_path.iterdir()}
