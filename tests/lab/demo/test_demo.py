"""The demo, shortened: the box lands as the robot begins to walk. What is shown must be what was measured."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stadera.lab.demo
from stadera.cli import main
from stadera.errors import StaderaError
from stadera.lab.demo import DemoResult, DemoSettings, one_run, run_demo
from stadera.lab.demo.schema import known_after, true_load
from stadera.lab.report.demo.page import demo_html
from stadera.supervise import State

SHORT = DemoSettings(load_at=1.3, seconds=7.6, seed=1)


@pytest.fixture(scope="module")
def result() -> DemoResult:
    return DemoResult(SHORT, *(one_run(SHORT, way) for way in SHORT.supervisions))


def test_the_load_is_noticed_weighed_and_walked_on_with(result: DemoResult):
    outcome = result.identified.outcome
    states = [transition.after for transition in outcome.transitions]
    assert states == [State.STOPPING, State.WEIGHING_MASS, State.WEIGHING_COM, State.CONVERGED, State.WALKING]
    assert 0 < outcome.noticed_after < 1.0
    assert outcome.survived
    assert outcome.model.mass == pytest.approx(outcome.truth.mass, abs=1.0)
    assert outcome.model.com_trunk[:2] == pytest.approx(outcome.truth.com[:2], abs=0.008)
    payload, load = outcome.payload, true_load(outcome)
    assert payload is not None
    assert abs(payload.mass - load.mass) < 4.0 * payload.mass_std + 0.05
    for k in range(2):
        assert abs(payload.com[k] - load.com[k]) < 4.0 * payload.com_std[k]


def test_without_identification_nobody_learns_of_the_load(result: DemoResult):
    outcome = result.without.outcome
    assert not outcome.transitions
    assert outcome.model.mass == outcome.bare.mass
    assert true_load(outcome).mass == pytest.approx(SHORT.mass)
    assert outcome.least_margin_ever < result.identified.outcome.least_margin


def test_film_shows_robot_load_and_truth(result: DemoResult):
    film = result.identified.film
    assert len(film) == pytest.approx(SHORT.seconds / 0.04, abs=1)
    before, after = film.time < SHORT.load_at, film.time > SHORT.load_at + 0.5
    assert np.isnan(film.box[before]).all()
    assert np.isfinite(film.box[after]).all()
    assert film.legs[:, :, 3, 2].min() > 0.0, "feet are above the ground"
    assert film.force[after].sum(axis=1).mean() == pytest.approx(96.8 * 9.81, rel=0.02)
    # controller and planner know the robot first, not the load when it has just come on, and both at the end
    gap = np.linalg.norm((film.com - film.model)[:, :2], axis=1)
    assert gap[before].max() < 1e-3
    assert gap[after][0] > 0.02
    assert gap[-1] < 0.008
    assert {"walking", "weighing mass"} <= set(film.state)


def test_json_has_the_runs_in_plain_numbers(result: DemoResult):
    found = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    run = found["runs"]["with identification"]
    assert found["load"]["mass"] == pytest.approx(10.0)
    assert run["survived"] is True
    assert run["payload"]["com"]["value"][2] is None
    assert [t["to"] for t in run["transitions"]][-1] == "walking"
    assert all(set(t) == {"time", "from", "to", "reason"} and t["reason"] for t in run["transitions"])
    assert found["runs"]["without identification"]["transitions"] == []
    brief = found["with"]
    assert brief["outcome"] == "walked"
    assert abs(brief["mass_error"]) < 1.0
    assert brief["com_error"] < 0.01
    assert (brief["noticed_after"], brief["payload"]) == (run["noticed_after"], run["payload"])
    assert set(found["without"]) == set(brief) - {"noticed_after", "updated_after", "payload"}
    assert found["without"]["mass_error"] == pytest.approx(-SHORT.mass, abs=0.01)


def test_page_loads_nothing_and_has_both_walks(result: DemoResult):
    page = demo_html(result)
    assert not re.search(r"""(?:src|href)=["'](?!#)""", re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL))
    data = re.search(r'<script type="application/json" id="walks">(.*?)</script>', page)
    assert data is not None
    films = json.loads(data.group(1))["films"]
    assert [len(film["time"]) for film in films] == [len(run.film) for run in result.runs]
    assert page.count("<canvas") == 4
    for transition in result.identified.outcome.transitions:
        assert transition.reason.split(":")[0] in page


def test_command(
    result: DemoResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(stadera.lab.demo, "run_demo", lambda settings, progress: result)
    with pytest.raises(SystemExit) as exit_info:
        main(["demo", "--json", "demo.json"])
    printed = capsys.readouterr()
    assert not exit_info.value.code
    assert printed.err == ""
    assert "with identification" in printed.out
    assert "report: out/demo.html" in printed.out
    assert (tmp_path / "out" / "demo.html").stat().st_size > 1e6
    assert json.loads((tmp_path / "demo.json").read_text())["seed"] == SHORT.seed


def test_runs_in_processes_tell_what_went_wrong():
    with pytest.raises(StaderaError, match="no_such_robot"):
        run_demo(DemoSettings(robot="no_such_robot"))


@pytest.mark.parametrize("bad", [{"mass": 0.0}, {"seconds": -1.0}, {"load_at": 99.0}, {"seed": -1}])
def test_settings_that_make_no_sense(bad: dict[str, float]):
    with pytest.raises(StaderaError):
        DemoSettings(**bad)  # type: ignore[arg-type]


# -- without a stop -----------------------------------------------------------------------------------------------
NONSTOP = DemoSettings(load_at=2.2, seconds=5.0, seed=1, nonstop=True)


@pytest.fixture(scope="module")
def nonstop(result: DemoResult) -> DemoResult:
    return DemoResult(NONSTOP, result.without, one_run(NONSTOP, NONSTOP.supervisions[1]))


def test_the_load_is_taken_over_on_the_way_and_no_step_is_lost(nonstop: DemoResult):
    outcome = nonstop.identified.outcome
    assert outcome.survived
    assert [transition.after for transition in outcome.transitions] == [State.WEIGHING, State.WALKING]
    assert len(outcome.noticed) == 1
    assert 0 < outcome.noticed_after < 0.5
    assert outcome.updated_after is not None
    assert outcome.noticed_after <= outcome.updated_after < 1.0
    assert outcome.steps_lost == 0
    assert np.diff(outcome.steps).max() < 1.3 * outcome.step_time
    payload, load = outcome.payload, true_load(outcome)
    assert payload is not None
    assert abs(payload.mass - load.mass) < 4.0 * payload.mass_std + 0.05
    assert (np.abs(payload.com - load.com)[:2] < 4.0 * payload.com_std[:2]).all()
    assert outcome.model.mass == pytest.approx(outcome.truth.mass, abs=0.6)
    assert outcome.model.com_trunk[:2] == pytest.approx(outcome.truth.com[:2], abs=0.005)


def test_what_is_known_on_the_way_has_bands_that_hold_the_truth(nonstop: DemoResult):
    film = nonstop.identified.film
    late = film.time > NONSTOP.load_at + 1.0
    assert np.isfinite(film.std[late]).all()
    found = np.column_stack([film.mass[late, 2], film.trunk_com[late, 2]])
    error = found - np.column_stack([film.mass[late, 0], film.trunk_com[late, 0]])
    assert (np.abs(error) < 4.0 * film.std[late]).all()
    known = known_after(nonstop.identified)
    assert known is not None
    assert known < 1.5
    assert known_after(nonstop.without) is None


def test_page_and_json_without_a_stop(nonstop: DemoResult):
    page = demo_html(nonstop)
    assert "Updated after" in page
    assert "Weighing on the way" in page
    assert page.count("<canvas") == 4
    run = json.loads(json.dumps(nonstop.to_dict(), allow_nan=False))["runs"]["without a stop"]
    assert run["steps_lost"] == 0
    assert run["noticed_after"] < run["taken_over_after"] < 1.0
    assert run["known_after"] < 1.5
    assert len(run["steps"]) >= 3


def test_a_step_that_does_not_come_is_lost(nonstop: DemoResult):
    outcome = replace(nonstop.identified.outcome, step_time=1.0, seconds=8.2, loaded_at=2.5)
    assert replace(outcome, steps=(1.0, 2.0, 3.0, 4.1, 5.1, 6.4, 7.3)).steps_lost == 0
    assert replace(outcome, steps=(1.0, 2.0, 3.0, 5.1, 6.4, 7.3)).steps_lost == 1, "a pause"
    assert replace(outcome, steps=(1.0, 2.0, 3.0, 4.1, 5.1)).steps_lost == 3, "it stands at the end"
    assert replace(outcome, steps=(1.0, 4.1), loaded_at=np.nan).steps_lost == 0, "no load, nothing to lose by"
