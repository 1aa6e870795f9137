"""The values that experiments hand on, and the registry."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from stadera.errors import MissingExtraError, StaderaError, UnknownNameError
from stadera.lab.experiments import (
    EXPERIMENTS,
    Experiment,
    ExperimentResult,
    Record,
    ReproduceSettings,
    Skipped,
    experiments_named,
    run_experiments,
)
from stadera.lab.experiments.legs import MissingDataError, data_folder, real_log
from stadera.lab.experiments.runner import Paper
from stadera.logs.topics import example
from stadera.report.table import Cell, TableData


def test_bound_is_the_last_value_that_meets_it_either_way() -> None:
    assert Record("x", {}, "error", "m", 1.0, bound=1.0).met is True
    assert Record("x", {}, "error", "m", 1.1, bound=1.0).met is False
    assert Record("x", {}, "rank", "1", 17, bound=17, bound_is="at least").met is True
    assert Record("x", {}, "rank", "1", 16, bound=17, bound_is="at least").met is False
    assert Record("x", {}, "rank", "1", 16).met is None


def test_record_has_the_keys_of_the_contract() -> None:
    plain = Record("x", {"robot": "hyq"}, "error", "m", 2.0, paper=3.0, bound=1.0).to_dict()
    assert plain == {
        "experiment": "x",
        "case": {"robot": "hyq"},
        "metric": "error",
        "unit": "m",
        "value": 2.0,
        "paper": 3.0,
        "bound": 1.0,
        "bound_is": "at most",
        "met": False,
    }
    assert Record("x", {}, "error", "m", 2.0).to_dict()["bound_is"] is None


def test_figure_that_is_no_number_is_refused() -> None:
    with pytest.raises(StaderaError, match="x, error: nan"):
        Record("x", {}, "error", "m", float("nan"))


def test_row_that_does_not_fit_its_head_is_refused() -> None:
    with pytest.raises(StaderaError, match="row of 1 cells under 2 titles"):
        TableData("t", ("a", "b"), (("", ((Cell("1"),),)),))


def test_negative_seed_is_refused() -> None:
    with pytest.raises(StaderaError, match="seed"):
        ReproduceSettings(seed=-1)


def test_experiments_are_found_by_name_in_any_case() -> None:
    assert [e.name for e in experiments_named("TABLE1")] == ["table1"]
    everything = {e.name for e in experiments_named("all")}
    studies = {"alarms", "reality", "faults", "mini_cheetah", "humanoids", "identified"}
    assert everything == set(EXPERIMENTS) - studies, "studies of hundreds of runs are asked for by name"
    assert [e.name for e in experiments_named("alarms")] == ["alarms"]
    with pytest.raises(UnknownNameError, match=r"unknown experiment 'table9'; valid: table1, fig4, .*, all"):
        experiments_named("table9")


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_text_says_what_differs_from_the_paper_and_names_its_equations(name: str) -> None:
    paper = Paper.of(name)
    of_the_paper = re.match(r"table|fig|inertial_share", name)
    assert bool(paper.differs) is bool(of_the_paper)
    for text in (paper.lead, *paper.differs, *paper.notes):
        assert not re.search(r"(?<!the paper's )\beqs?\. ", text), "an equation of what?"


def test_experiment_without_its_input_is_skipped_among_several_and_an_error_alone() -> None:
    def lacking(error: StaderaError) -> Experiment:
        def run(*_: object) -> ExperimentResult:
            raise error

        return Experiment("lacking", run)

    whole = Experiment("whole", lambda *_: ExperimentResult("whole", "Whole", "", ()))
    for error in (MissingDataError("no logs"), MissingExtraError("models", "models", "a robot")):
        found = list(run_experiments([lacking(error), whole], ReproduceSettings(), lambda *_: None))
        assert found[0] == Skipped("lacking", str(error))
        assert isinstance(found[1], ExperimentResult)
        with pytest.raises(type(error)):
            list(run_experiments([lacking(error)], ReproduceSettings(), lambda *_: None))
    with pytest.raises(UnknownNameError):  # any other error is not skipped
        list(run_experiments([lacking(UnknownNameError("leg", "XX", ())), whole], ReproduceSettings(), lambda *_: None))


def test_logs_are_looked_for_where_the_variable_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STADERA_DATA", str(tmp_path))
    assert data_folder() == tmp_path
    with pytest.raises(MissingDataError, match="no such log"):
        real_log("x")
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "x.csv").write_text("time\n")
    assert real_log("x") == tmp_path / "real" / "x.csv"
    monkeypatch.setenv("STADERA_DATA", str(tmp_path / "nowhere"))
    with pytest.raises(MissingDataError, match="set STADERA_DATA"):
        data_folder()
    monkeypatch.delenv("STADERA_DATA")
    monkeypatch.chdir(tmp_path)
    assert data_folder() is None
    assert real_log("go2_legs_in_air") == example("go2_legs_in_air")
    beside = tmp_path / "shared" / "data"
    beside.mkdir(parents=True)
    (tmp_path / "project").mkdir()
    monkeypatch.chdir(tmp_path / "project")
    assert data_folder() == Path("..") / "shared" / "data"
