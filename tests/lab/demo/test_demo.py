"""The demo, shortened: the box lands early. What is shown must be what was measured."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stadera.lab.demo
from browser import DESK, PHONE, SCREEN, measure, needs_browser
from stadera.cli import main
from stadera.errors import StaderaError
from stadera.lab.demo import DemoResult, DemoSettings, one_run, run_demo, true_load
from stadera.lab.experiments.loaded_walk import WalkOutcome
from stadera.lab.plant.payload import Tray
from stadera.lab.report.demo import demo_html, headline, packed, robot_parts, scene
from stadera.lab.supervise.supervisor import Mode
from stadera.robot import load_robot
from stadera.robot.kinematics import forward_kinematics

SHORT = DemoSettings(seconds=7.0, seed=1, after_fall=0.4)
CLASSIC = DemoSettings(mass=10.0, corner="LH", load_at=3.0, seconds=9.0, speed=0.1, seed=1, classic=True)


@pytest.fixture(scope="module")
def result() -> DemoResult:
    return DemoResult(SHORT, *(one_run(SHORT, identified) for identified in (False, True)))


def test_without_identification_the_robot_falls(result: DemoResult):
    outcome = result.without.outcome
    assert outcome.trace.outcome is WalkOutcome.FELL
    assert outcome.trace.fall is not None
    assert not outcome.transitions
    assert outcome.model.mass == outcome.bare.mass
    assert true_load(outcome).mass == pytest.approx(SHORT.mass)
    film = result.without.film
    assert film.time[-1] == pytest.approx(outcome.trace.fall.time + SHORT.after_fall, abs=0.05), "it is seen to lie"


def test_with_it_the_robot_walks_on_without_a_stop(result: DemoResult):
    outcome = result.identified.outcome
    assert outcome.trace.outcome is WalkOutcome.WALKED
    assert [transition.after for transition in outcome.transitions] == [Mode.WEIGHING, Mode.WALKING]
    assert outcome.updated_after is not None
    assert outcome.noticed_after is not None
    assert 0.0 < outcome.noticed_after <= outcome.updated_after < 1.0
    assert outcome.trace.steps_lost == 0
    assert outcome.trace.least_margin > 0.01
    payload, load = outcome.payload, true_load(outcome)
    assert payload is not None
    assert abs(payload.mass - load.mass) < 4.0 * payload.mass_std + 0.05
    assert (np.abs(payload.com - load.com)[:2] < 4.0 * payload.com_std[:2]).all()
    assert outcome.model.mass == pytest.approx(outcome.truth.mass, abs=1.5)
    assert outcome.model.com_trunk[:2] == pytest.approx(outcome.truth.com[:2], abs=0.008)


def test_film_shows_robot_load_and_truth(result: DemoResult):
    film = result.identified.film
    assert len(film.time) == pytest.approx(SHORT.duration / 0.04, abs=1)
    before, after = film.time < SHORT.load_at, film.time > SHORT.load_at + 0.5
    assert np.isnan(film.box[before]).all()
    assert np.isfinite(film.box[after]).all()
    assert film.feet[:, :, 2].min() > 0.0, "feet are above the ground"
    assert film.force[after].sum(axis=1)[:, 2].mean() == pytest.approx(116.8 * 9.81, rel=0.02)
    # controller and planner know the robot first, not the load when it has just come on, and both at the end
    gap = np.linalg.norm((film.com - film.model)[:, :2], axis=1)
    assert gap[before].max() < 5e-3
    assert gap[film.time > SHORT.load_at + 0.1][0] > 0.02
    assert gap[-1] < 0.008
    late = film.time > SHORT.load_at + 1.0
    found = np.column_stack([film.mass[late, 2], film.trunk_com[late, 2]])
    error = found - np.column_stack([film.mass[late, 0], film.trunk_com[late, 0]])
    assert (np.abs(error) < 4.0 * film.std[late]).all()


def test_the_scene_is_the_film(result: DemoResult):
    """Decoded as the page's script does it: columns within their step, feet where forward kinematics has them."""
    drawn, robot = scene(result), load_robot("hyq")
    for run, shown in zip(result.runs, drawn["runs"], strict=True):
        film = run.film
        columns = decoded(shown)
        kept = film.time >= shown["begin"] - 1e-6
        assert shown["begin"] == pytest.approx(SHORT.load_at - 2.0, abs=0.05)
        for name in ("joints", "feet", "com", "model", "margin"):
            values = getattr(film, name)[kept].reshape(shown["frames"], -1)
            assert columns[name] == pytest.approx(values, abs=2e-4, nan_ok=True)
        assert np.array_equal(np.isnan(columns["box"][:, 0]), np.isnan(film.box[kept][:, 0]))
        turns = columns["trunk"][:, 3:]
        assert ((turns[1:] * turns[:-1]).sum(axis=1) > 0.0).all(), "between two frames one can go"
    frame = columns["joints"][-1]
    rotations, places = forward_kinematics(robot.tree, frame[None])
    feet = [part for part in drawn["robot"]["parts"] if part["kind"] == "foot"]
    centres = [places[0, part["link"]] + rotations[0, part["link"]] @ np.array(part["at"]) for part in feet]
    trunk = columns["trunk"][-1]
    apart = columns["feet"][-1].reshape(4, 3) - trunk[:3]
    assert np.linalg.norm(centres, axis=1) == pytest.approx(np.linalg.norm(apart, axis=1), abs=1e-3)


def test_hyq_has_its_meshes():
    """Corners reach as far as HyQ's links do: a shank from knee to foot, a body as long as the trunk's shape."""
    robot = load_robot("hyq")
    drawn = robot_parts(robot)
    corners = {}
    for name, mesh in drawn["meshes"].items():
        shares = np.frombuffer(b64decode(mesh["corners"]), "<u2").reshape(-1, 3)
        faces = np.frombuffer(b64decode(mesh["faces"]), "<u2")
        assert (faces.size % 3, faces.max()) == (0, len(shares) - 1)
        corners[name] = np.array(mesh["low"]) + shares * np.array(mesh["step"])
    shank = robot.legs[0].foot_position[0]
    assert corners["lowerleg"].max(axis=0)[0] == pytest.approx(shank, abs=0.03)
    length = max(shape.size[0] for shape in robot.shapes if shape.link == robot.trunk)
    assert np.ptp(corners["trunk"][:, 0]) > length
    top = Tray.of(robot).top
    assert corners["trunk"][:, 2].max() == pytest.approx(top, abs=0.005), "boxes land on the back"
    shown = [part["link"] for part in drawn["parts"] if part["kind"] == "mesh"]
    assert sorted(shown) == list(range(13))
    assert {part["kind"] for part in drawn["parts"]} == {"mesh", "plate", "foot"}


def decoded(shown: dict[str, Any]) -> dict[str, np.ndarray]:
    raw = np.frombuffer(b64decode(shown["data"]), "<i2").reshape(shown["frames"], -1).astype(float)
    values = np.where(raw == -32768, np.nan, np.array(shown["low"]) + (raw + 32767) * np.array(shown["step"]))
    ends = np.cumsum(list(shown["widths"].values()))
    return dict(zip(shown["widths"], np.split(values, ends[:-1], axis=1), strict=True))


def test_packing_keeps_constants_and_what_is_not_there():
    values = np.array([[1.0, np.nan, -2.0], [1.0, np.nan, 3.0], [1.0, 5.0, np.nan]])
    shown = {**packed(values), "frames": 3, "widths": {"all": 3}}
    assert decoded(shown)["all"] == pytest.approx(values, abs=1e-4, nan_ok=True)


def test_json_has_the_contract_in_plain_numbers(result: DemoResult):
    found = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    without, identified = found["without"], found["with"]
    contract = {"outcome", "distance", "least_margin", "mass_error", "com_error"}
    assert contract <= set(without)
    assert set(without) | {"noticed_after", "updated_after", "payload"} <= set(identified)
    assert (without["outcome"], identified["outcome"]) == ("fell", "walked")
    assert without["reasons"]
    assert identified["reasons"] == []
    assert without["mass_error"] == pytest.approx(-SHORT.mass, abs=0.01)
    assert abs(identified["mass_error"]) < 1.5
    assert identified["com_error"] < 0.01
    assert identified["distance"] > 0.8 * identified["commanded"]
    assert identified["payload"]["mass"]["value"] == pytest.approx(30.0, abs=4.0 * identified["payload"]["mass"]["std"])
    assert identified["payload"]["frame"] == "trunk"
    assert without["fell_after"] > 0.0
    assert (without["steps_lost"], identified["steps_lost"]) == (None, 0)


def test_page_loads_nothing_says_how_it_ended_and_is_small(result: DemoResult):
    page = demo_html(result)
    assert not re.search(r"""(?:src|href)=["'](?!#)""", re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL))
    assert len(page.encode()) < 3e6  # as all pages: small enough to be mailed; two libraries are 2 MB of it
    assert headline(result) in page
    assert "falls after" in headline(result)
    assert "walks on without a stop" in headline(result)
    data = re.search(r'<script type="application/json" id="walks">(.*?)</script>', page)
    assert data is not None
    runs = json.loads(data.group(1))["runs"]
    assert [run["good"] for run in runs] == [False, True]
    assert any(event["level"] == "bad" and event["text"].startswith("fell") for event in runs[0]["events"])
    assert "<noscript>" in page
    for transition in result.identified.outcome.transitions:
        assert transition.reason.split(":")[0] in page


@needs_browser
def test_page_shows_both_robots_and_play_on_the_first_screen(result: DemoResult, tmp_path: Path):
    seen = measure({"demo": demo_html(result)}, tmp_path)
    for width, screen in ((DESK, SCREEN), (PHONE, 660)):
        found = seen[f"demo-{width}"]
        assert found["canvas"] == 1
        assert 0 < found["answer"] < found["play"] < screen
        assert found["scroll"] <= found["width"]
        assert (found["wide"], found["boxes"]) == ([], 0)


def test_a_stuck_robot_is_called_stuck_everywhere(result: DemoResult):
    outcome = result.without.outcome
    trace = replace(outcome.trace, fall=None, position=np.zeros_like(outcome.trace.position))
    stuck = replace(result, without=replace(result.without, outcome=replace(outcome, trace=trace)))
    assert stuck.to_dict()["without"]["outcome"] == "stuck"
    assert "gets stuck after 0.00 m" in headline(stuck)
    assert scene(stuck)["runs"][0]["good"] is False
    assert scene(stuck)["runs"][0]["events"][-1] == {"time": trace.loaded_at + 1.0, "text": "stuck", "level": "bad"}


def test_command(
    result: DemoResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(stadera.lab.demo, "run_demo", lambda settings: result)
    with pytest.raises(SystemExit) as exit_info:
        main(["demo", "--json", "demo.json"])
    printed = capsys.readouterr()
    assert not exit_info.value.code
    assert printed.err == ""
    assert "with identification" in printed.out
    assert "wrote out/demo.html" in printed.out
    assert (tmp_path / "out" / "demo.html").stat().st_size > 3e5
    assert json.loads((tmp_path / "demo.json").read_text())["seed"] == SHORT.seed


def test_runs_in_processes_tell_what_went_wrong():
    with pytest.raises(StaderaError, match="too fast for this robot"):
        run_demo(DemoSettings(speed=9.0))


# -- the paper's way ----------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def classic(result: DemoResult) -> DemoResult:
    return DemoResult(CLASSIC, result.without, one_run(CLASSIC, identified=True))


def test_the_load_is_noticed_weighed_at_rest_and_walked_on_with(classic: DemoResult):
    outcome = classic.identified.outcome
    states = [transition.after for transition in outcome.transitions]
    assert states == [
        Mode.STOPPING,
        Mode.WEIGHING_MASS,
        Mode.WEIGHING_COM,
        Mode.CONVERGED,
        Mode.WALKING,
    ]
    assert outcome.noticed_after is not None
    assert 0 < outcome.noticed_after < 1.0
    assert outcome.trace.steps_lost > 3
    assert outcome.model.mass == pytest.approx(outcome.truth.mass, abs=1.0)
    assert outcome.model.com_trunk[:2] == pytest.approx(outcome.truth.com[:2], abs=0.008)
    payload, load = outcome.payload, true_load(outcome)
    assert payload is not None
    assert abs(payload.mass - load.mass) < 4.0 * payload.mass_std + 0.05
    assert np.isnan(payload.com[2])
    assert "weighing centre of mass" in demo_html(classic)
