"""`stadera reproduce`: what it writes and prints."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stadera.identify.observability import Identifiability
from stadera.lab import experiments
from stadera.lab.experiments import Experiment, ExperimentResult, Record
from stadera.lab.experiments.legs import MissingDataError
from stadera.lab.experiments.runner import Paper
from stadera.report.figures import Axis, Figure, Panel, line
from stadera.report.table import Cell, TableData


def _result(value: float) -> ExperimentResult:
    table = TableData(
        "Masses <kg>",
        ("", "mass [kg]"),
        (("upper leg", ((Cell("identified"), Cell("2.63", Identifiability.PARTIAL)),)),),
    )
    curve = line(np.linspace(0.0, 1.0, 50), np.linspace(0.0, 2.0, 50), "measured")
    return ExperimentResult(
        "mini",
        "A small experiment",
        "What was done.",
        (Record("mini", {"leg": "RH"}, "error", "m", value, paper=2.0, bound=1.0), Record("mini", {}, "rank", "1", 17)),
        (table,),
        (Figure("Torques", ((Panel(Axis("time [s]"), Axis("torque [N·m]"), (curve,), title="hip"),),)),),
    )


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Puts these experiments in place of the paper's."""

    def _small(*those: Experiment) -> None:
        monkeypatch.setattr(experiments, "_EXPERIMENTS", those)
        monkeypatch.setattr(experiments, "EXPERIMENTS", {e.name: e for e in those})

    return _small


@pytest.mark.parametrize(("value", "met", "words"), [(0.5, True, "its bound is met"), (1.5, False, "NOT met")])
def test_missed_bound_is_said_and_is_no_failure(
    run: Callable[..., Any], small: Callable[..., None], tmp_path: Path, value: float, met: bool, words: str
) -> None:
    small(Experiment("mini", lambda *_: _result(value)))
    done = run("reproduce", "mini", "--json", tmp_path / "m.json", "--report", tmp_path / "m.html")
    assert done.code == 0
    assert words in done.out
    first, second = json.loads((tmp_path / "m.json").read_text())
    assert (first["met"], first["value"], first["bound"], first["paper"]) == (met, value, 1.0, 2.0)
    assert (second["met"], second["bound"], second["paper"]) == (None, None, None)
    page = (tmp_path / "m.html").read_text()
    assert f"{int(met)} of 1 bound met" in page
    assert "Masses &lt;kg&gt;" in page


def test_values_without_a_bound_are_measured(
    run: Callable[..., Any], small: Callable[..., None], tmp_path: Path
) -> None:
    bare = replace(_result(0.5), records=tuple(replace(record, bound=None) for record in _result(0.5).records))
    small(Experiment("mini", lambda *_: bare))
    done = run("reproduce", "mini", "--report", tmp_path / "m.html")
    assert "mini: measured, beside the paper's values" in done.out
    page = (tmp_path / "m.html").read_text()
    assert "Measured, beside the paper" in page
    assert "bounds met" not in page + repr(bare) + done.out


def test_all_goes_on_where_data_are_missing_and_says_so(
    run: Callable[..., Any], small: Callable[..., None], tmp_path: Path
) -> None:
    def lacking(*_: object) -> ExperimentResult:
        raise MissingDataError("no real logs: nowhere does not exist")

    small(Experiment("lacking", lacking), Experiment("mini", lambda *_: _result(0.5)))
    done = run("reproduce", "all", "--json", tmp_path / "m.json", "--report", tmp_path / "m.html")
    assert done.code == 0
    assert "lacking skipped: no real logs" in done.out
    assert len(json.loads((tmp_path / "m.json").read_text())) == 2
    assert "lacking: no real logs" in (tmp_path / "m.html").read_text()
    alone = run("reproduce", "lacking", "--json", tmp_path / "n.json")
    assert alone.code == 1
    assert alone.err == "stadera: error: no real logs: nowhere does not exist\n"
    assert not (tmp_path / "n.json").exists()


def test_unknown_experiment_names_the_valid_ones(run: Callable[..., Any]) -> None:
    done = run("reproduce", "tabel1")
    assert done.code == 1
    assert done.err.startswith("stadera: error: unknown experiment 'tabel1'; valid: table1, fig4, fig5")
    assert "did you mean 'table1'?" in done.err


def test_output_that_cannot_be_written_is_known_before_the_work(
    run: Callable[..., Any], small: Callable[..., None], tmp_path: Path
) -> None:
    def never(*_: object) -> ExperimentResult:
        raise AssertionError("ran")

    small(Experiment("mini", never))
    done = run("reproduce", "mini", "--json", tmp_path / "nowhere" / "m.json")
    assert done.code == 1
    assert "no such folder" in done.err


def test_negative_seed_is_bad_usage(run: Callable[..., Any]) -> None:
    assert run("reproduce", "table1", "--seed", "-1").code == 2


def test_a_number_of_seeds_is_for_studies_that_repeat_their_grid(run: Callable[..., Any]) -> None:
    done = run("reproduce", "table1", "--seeds", "2")
    assert done.code == 1
    studies = "alarms, reality, faults, humanoids, identified"
    only = f"a number of seeds can be set for these experiments only: {studies}"
    assert done.err == f"stadera: error: {only}\n"


def test_every_page_of_the_paper_says_what_differs_and_where_the_paper_is() -> None:
    for name in ("table1", "fig4", "fig5", "table2", "fig6", "table3", "table4", "table5", "inertial_share"):
        entry = Paper.of(name)
        assert entry.differs, name
        page = entry.result([]).to_html()
        assert "What differs from the paper, and why" in page
        assert "https://hal.science/hal-01575033" in page
        assert not re.search(r"(?<!the paper&#39;s )\beq\. \d", page), "an equation's number alone explains nothing"


def test_figures_and_latex_are_written_and_a_wrong_suffix_is_known_before_the_work(
    run: Callable[..., Any], small: Callable[..., None], tmp_path: Path
) -> None:
    small(Experiment("mini", lambda *_: _result(0.5)))
    wanted = (
        "--figure",
        tmp_path / "f.png",
        "--figure",
        f"table-1={tmp_path / 't.svg'}",
        "--latex",
        tmp_path / "t.tex",
    )
    assert run("reproduce", "mini", *wanted).code == 0
    assert {path.name for path in tmp_path.iterdir()} == {"f.png", "t.svg", "t.tex"}
    for option, file, said in (("--figure", "f.bmp", ".pdf, .png, .svg"), ("--report", "r.txt", ".html or .pdf")):
        done = run("reproduce", "mini", option, tmp_path / file)
        assert (done.code, said in done.err, len(done.err.splitlines())) == (1, True, 1)
    done = run("reproduce", "mini", "--figure", f"nosuch={tmp_path / 'n.png'}")
    assert done.code == 1
    assert "unknown figure 'nosuch'; valid: figure-1, table-1" in done.err
    assert not (tmp_path / "n.png").exists()
