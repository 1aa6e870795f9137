"""`stadera excite`: the table, the JSON and the report it writes, and what bad requests get."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stadera.excite import design as module
from stadera.excite.optimise import FourierSearch
from stadera.logs import read
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration

Run = Callable[..., Any]

RANDOM = ("excite", "--robot", "hyq", "--leg", "rh", "--random", "--duration", "8")


def test_random_draw_as_a_table_a_controller_can_play(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "motion.csv"
    finished = run(*RANDOM, "--rate", "100", "--seed", "3", "--out", out)
    assert finished.code == 0
    assert "rh_kfe_joint" in finished.out
    assert "position [rad]" in finished.out
    motion, robot = read(out), load_robot("hyq")
    assert motion.joints == robot.tree.joints
    np.testing.assert_allclose(np.diff(motion.time), 0.01, rtol=1e-6)
    assert motion.velocity is not None
    assert motion.acceleration is not None
    for end in (0, -1):
        np.testing.assert_allclose(motion.position[end], standing_configuration(robot), atol=1e-9)
        np.testing.assert_allclose(motion.velocity[end], 0.0, atol=1e-9)
    slope = np.gradient(motion.position, 0.01, axis=0)
    np.testing.assert_allclose(slope[1:-1], motion.velocity[1:-1], atol=2e-2)


def test_leg_only_and_seed(run: Run, tmp_path: Path) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        path = tmp_path / f"{name}.parquet"
        assert run(*RANDOM, "--rate", "50", "--seed", seed, "--leg-only", "--out", path).code == 0
    a, b, c = (read(tmp_path / f"{name}.parquet") for name in "abc")
    assert a.joints == load_robot("hyq").leg("RH").joints
    np.testing.assert_array_equal(a.position, b.position)
    assert np.abs(a.position - c.position).max() > 0.01


@pytest.fixture
def quick_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search of a second instead of ten; all else as it is."""
    design = module.excite
    quick = FourierSearch(harmonics=3, samples=16, starts=1, iterations=15)
    monkeypatch.setattr(
        module, "excite", lambda robot, leg, settings, watch: design(robot, leg, replace(settings, search=quick), watch)
    )


@pytest.mark.usefixtures("quick_search")
def test_json_and_report_of_the_optimum(run: Run, tmp_path: Path) -> None:
    page, values = tmp_path / "page.html", tmp_path / "values.json"
    wanted = ("--duration", "12", "--rate", "50", "--report", page, "--json", values)
    finished = run("excite", "--robot", "hyq", "--leg", "RH", *wanted)
    assert finished.code == 0
    assert "nat of information" in finished.out
    found = json.loads(values.read_text())
    assert (found["robot"], found["leg"], found["kind"]) == ("hyq", "RH", "optimised")
    assert found["gained"] > 5.0
    assert found["rigid_rank"] == 17
    assert found["motions"][0]["gain"] > max(m["gain"] for m in found["motions"][1:])
    for joint in found["joints"].values():
        low, high = joint["position_bounds"]
        assert low - 1e-6 <= joint["position"][0] < joint["position"][1] <= high + 1e-6
        assert joint["velocity"] <= joint["velocity_bound"]
        assert joint["torque"] <= joint["torque_bound"]
    html = page.read_text()
    assert html.startswith("<!DOCTYPE html>")
    assert html.count('class="plot"') == 2
    assert "rh_lowerleg.mcx" in html


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--robot", "hyq", "--leg", "tail"), 1, "LF, RF, LH, RH"),
        (("--robot", "nobody", "--leg", "RH"), 1, "hyq"),
        (("--robot", "hyq", "--leg", "RH", "--duration", "1"), 1, "at least 2 s"),
        (("--robot", "hyq", "--leg", "RH", "--rate", "0"), 1, "10 Hz"),
        (("--robot", "hyq", "--leg", "RH", "--out", "motion.txt"), 1, ".csv, .parquet"),
        (("--robot", "hyq", "--leg", "RH", "--out", "nowhere/motion.csv"), 1, "no such folder"),
        (("--robot", "hyq", "--leg", "RH", "--stand-height", "0.3"), 1, "raise the trunk"),
        (("--robot", "hyq"), 2, "--leg"),
        (("--robot", "hyq", "--leg", "LF", "--trunk"), 2, "not both"),
        (("--robot", "hyq", "--trunk", "--duration", "60"), 2, "--duration: needs --leg"),
        (("--robot", "hyq", "--trunk", "--random"), 2, "--random: needs --leg"),
        (("--robot", "hyq", "--trunk", "--leg-only"), 2, "--leg-only: needs --leg"),
        (("--robot", "hyq", "--trunk", "--stand-height", "0"), 2, "--stand-height: needs --leg"),
        (("--robot", "hyq", "--leg", "LF", "--seconds", "3"), 2, "--seconds: needs --trunk"),
        (("--robot", "hyq", "--leg", "LF", "--for", "unitree"), 2, "--for: needs --trunk"),
        (("--robot", "hyq", "--trunk", "--for", "unitree", "--out", "play.csv"), 1, "written as .py"),
    ],
)
def test_bad_requests(run: Run, arguments: tuple[str, ...], code: int, said: str) -> None:
    finished = run("excite", *arguments)
    assert finished.code == code
    assert said in finished.err
    assert "Traceback" not in finished.err
    assert finished.out == ""
