"""A study's runs: the same whatever the number of processes, and never done twice."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from stadera.errors import StaderaError
from stadera.fleet.pool import Pool
from stadera.lab.experiments.runner import Outcome, run_grid


@dataclass(frozen=True)
class Square:
    of: float
    traces: str = ""


def square(case: Square) -> Outcome:
    if case.of < 0:
        raise StaderaError("negative")
    if case.traces:
        (Path(case.traces) / f"{case.of:g}").touch(exist_ok=False)
    return {"square": case.of**2, "nothing": None}


def values(outcomes: list[Outcome]) -> list[float]:
    return [outcome["square"] for outcome in outcomes]


def quiet(*_: object) -> None:
    pass


@pytest.mark.parametrize("processes", [0, 2])
def test_outcomes_come_in_the_cases_order(processes: int) -> None:
    told: list[tuple[str, int, int]] = []
    cases = [Square(k) for k in (3.0, 1.0, 2.0, 0.0, 4.0, 5.0)]
    outcomes = run_grid("squares", square, cases, lambda *a: told.append(a), pool=Pool(processes))
    assert values(outcomes) == [9.0, 1.0, 4.0, 0.0, 16.0, 25.0]
    assert outcomes[0]["nothing"] is None
    assert told[0] == ("squares", 0, 6)
    assert told[-1] == ("squares", 6, 6)


def test_what_is_done_is_not_done_again(tmp_path: Path) -> None:
    traces = tmp_path / "traces"
    traces.mkdir()
    cases = [Square(k, str(traces)) for k in (1.0, 2.0)]
    run_grid("squares", square, cases[:1], quiet, keep=tmp_path, pool=Pool(0))
    kept = tmp_path / "squares.jsonl"
    kept.write_text(kept.read_text() + '{"version": "0.1", "ca')  # broken off
    told: list[tuple[str, int, int]] = []
    assert values(run_grid("squares", square, cases, lambda *a: told.append(a), keep=tmp_path, pool=Pool(0))) == [1, 4]
    assert told[0] == ("squares", 1, 2)
    assert values(run_grid("squares", square, cases, quiet, keep=tmp_path, pool=Pool(0))) == [1, 4]


def test_lines_of_another_version_are_not_trusted(tmp_path: Path) -> None:
    run_grid("squares", square, [Square(3.0)], quiet, keep=tmp_path, pool=Pool(0))
    kept = tmp_path / "squares.jsonl"
    kept.write_text(kept.read_text().replace('"version": "', '"version": "0.0.').replace("9.0", "8.0"))
    assert values(run_grid("squares", square, [Square(3.0)], quiet, keep=tmp_path, pool=Pool(0))) == [9]


def test_a_case_that_cannot_be_run_is_named_and_the_others_kept(tmp_path: Path) -> None:
    cases = [Square(1.0), Square(-1.0), Square(2.0)]
    with pytest.raises(StaderaError, match=r'squares, .*"of": -1.0.*: negative'):
        run_grid("squares", square, cases, quiet, keep=tmp_path, pool=Pool(0))
    assert '"square": 1.0' in (tmp_path / "squares.jsonl").read_text()


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StaderaError, match="outcomes cannot be kept"):
        run_grid("squares", square, [Square(1.0)], quiet, keep=tmp_path / "file", pool=Pool(0))
