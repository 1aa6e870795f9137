"""The page of a fleet: what stands out first, every log in it, nothing loaded, and light enough to be mailed."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from stadera.fleet.departures import by_robot, series_of
from stadera.fleet.run import page_path
from stadera.fleet.table import COLUMNS, FleetTable
from stadera.report.fleet import figure
from stadera.report.table import Shown
from stadera.results import json_text


def fleet(robots: int, logs: int, joints: bool = False, since: float = 1.75e9) -> FleetTable:
    """Made up. unit1 is 0.45 kg heavier in its last third; the fifth log of unit0 failed."""
    rng, rows, listed = np.random.default_rng(0), [], []
    for r in range(robots):
        for k in range(logs):
            log, begin = f"/fleet/unit{r}/{k}<b>.mcap", since + 86400.0 * k
            heavier = 0.45 if r == 1 and 3 * k >= 2 * logs else 0.0
            row: dict[str, Any] = dict.fromkeys(COLUMNS)
            row |= {"log": log, "robot": f"unit{r}", "status": "ok", "begin": begin, "end": begin + 600.0}
            row |= {
                "trunk_mass": 7.2 + heavier + 0.1 * rng.normal(),
                "trunk_mass_std": 0.3,
                "changes": 0,
                "misfit": 1.0,
            }
            for axis in "xyz":
                row |= {f"com_{axis}": 0.002 * rng.normal(), f"com_{axis}_std": 0.002}
            row["trust"] = "doubtful" if k % 20 == 3 else "good"
            if (r, k) == (0, 4):
                row = dict.fromkeys(COLUMNS) | {
                    "log": log,
                    "robot": "unit0",
                    "status": "failed",
                    "error": f"{log}: cut off",
                }
            rows.append(row)
            for joint in (f"{leg}_{part}" for leg in ("FL", "FR", "RL", "RR") for part in ("hip", "thigh", "calf")):
                for name in ("armature", "viscous", "coulomb", "offset") if joints else ():
                    value = {"joint": joint, "parameter": name, "value": 1.0 + 0.05 * rng.normal(), "std": 0.05}
                    listed.append({"log": log, "robot": f"unit{r}", **value})
    return FleetTable(tuple(rows), tuple(listed), (None,) * len(rows))


@pytest.fixture(scope="module")
def page() -> str:
    return fleet(3, 30, joints=True).to_html()


def test_what_stands_out_is_the_headline(page: str) -> None:
    answer = re.search(r'<p class="answer">([^<]*)', page)
    assert answer
    assert re.fullmatch(
        r"1 of 90 logs failed; unit1: trunk mass \+0\.4\d+ ± 0\.0\d+ kg since 2025-07-\d\d \d\d:\d\d",
        answer[1].replace("\xa0", " "),
    )
    assert "stadera weigh /fleet/unit1/20&lt;b&gt;.mcap --robot R --report page.html" in page
    assert page.count('class="out"') == 1


def test_every_log_every_robot_and_why_logs_failed(page: str) -> None:
    body = page[page.index("All logs") :]
    assert body.count('<tr class=""><th scope="row">') == 90
    assert page.count('<div class="plot"') == 3 * (4 + 48)
    failed = page[page.index("Logs that failed") : page.index("What stands out")]
    assert re.search(r"4&lt;b&gt;\.mcap.*unit0.*cut off", failed, re.DOTALL)
    assert "unit0: " not in page.split("Logs that failed")[0]
    assert page.count('"symbol":"circle-open"') > 10, "doubtful logs look different"


def test_it_loads_nothing_and_no_name_of_a_log_is_markup(page: str) -> None:
    own = page.split("<script>")[0]
    assert not re.search(r"<(script|img|link|iframe)\b[^>]*\b(src|href)\s*=", page)
    assert "<b>" not in own
    assert "url(" not in own


def test_without_room_for_all_figures_what_stands_out_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    table = fleet(3, 30)
    monkeypatch.setattr("stadera.report.fleet.SHOWN", Shown(figures=6_000))
    page = table.to_html()
    assert page.count('<div class="plot"') == 1
    assert page.count('class="out"') == 1
    assert "30 logs: 28 good, 2 doubtful; 3 of its figures left out, in which nothing stands out" in page


def test_a_thousand_logs_weigh_less_than_3_mb() -> None:
    assert len(fleet(4, 250, joints=True).to_html().encode()) < 3e6


def test_points_and_rows_open_the_pages_that_exist() -> None:
    table = fleet(2, 6)
    pages = {row["log"]: f"pages/{k}.html" for k, row in enumerate(table.rows) if k < 6 and row["status"] == "ok"}
    page = table.to_html(pages)
    assert page.count('<a href="pages/') == 5
    assert page.count('"customdata":') == 2 * 4, "good and doubtful logs of the first robot: mass and centre"
    assert 'href="pages/' not in table.to_html()
    assert page_path("pages", "/a/b/walk.mcap") != page_path("pages", "/a/c/walk.mcap")
    assert page_path("pages", "s3://bucket/day 1/walk.mcap").name.startswith("walk-")
    assert page_path("pages", "/a/walk_bag/").name.startswith("walk_bag-"), "a bag that is a folder"


def test_failures_are_counted_where_nothing_stands_out() -> None:
    page = fleet(1, 6).to_html()
    assert '<p class="answer">1 of 6 logs failed; the others agree with each other' in page
    assert "Nothing stands out" not in page


def test_a_log_used_by_force_is_counted_as_bad() -> None:
    table = fleet(1, 6)
    table.rows[0]["trust"] = "bad"
    assert "6 logs: 3 good, 1 doubtful, 1 bad, 1 failed" in table.to_html()


def test_where_nothing_stands_out_it_says_so() -> None:
    page = fleet(1, 4, since=0.0).to_html()
    assert '<p class="answer">Nothing stands out' in page
    assert "good</strong>" in page
    assert "begins" not in page


def test_where_nothing_was_found() -> None:
    row = dict.fromkeys(COLUMNS) | {"log": "a", "status": "failed", "error": "a: empty"}
    assert "1 of 1 log failed; no log gave a figure" in FleetTable((row,)).to_html()


def test_json_has_rows_and_what_stands_out() -> None:
    found = fleet(3, 30).to_dict()
    assert json_text(found)
    assert len(found["logs"]) == 90
    (one,) = found["stands_out"]
    assert (one["robot"], one["quantity"], one["kind"], one["first_log"]) == (
        "unit1", "trunk mass", "since", "/fleet/unit1/20<b>.mcap")  # fmt: skip


def test_logs_are_in_order_of_their_stamps_if_they_have_the_time_of_day() -> None:
    table = fleet(1, 6)
    shuffled = FleetTable(table.rows[::-1])
    assert [row["log"] for row in by_robot(shuffled.rows)["unit0"]][::4] == [
        "/fleet/unit0/0<b>.mcap",
        "/fleet/unit0/5<b>.mcap",
    ]
    relative = tuple(row | {"begin": row["begin"] and 0.0} for row in shuffled.rows)
    assert by_robot(relative)["unit0"] == list(relative)
    assert len(next(series_of(shuffled)).value) == 5


@pytest.mark.parametrize(
    ("logs", "since", "step", "title"),
    [
        (3, 0.0, 1.0, "number of the log"),
        (40, 0.0, 5.0, "number of the log"),
        (3, 1.75e9, 1.0, "days since 2025-06-15 15:06"),
    ],
)
def test_ticks_are_at_whole_logs_and_days(logs: int, since: float, step: float, title: str) -> None:
    series = next(iter(series_of(fleet(2, logs, since=since))))
    (panel,) = figure(series, [], {}).panels
    assert (panel.x.step, panel.x.title) == (step, title)


def test_a_log_without_a_figure_keeps_its_number() -> None:
    series = next(iter(series_of(fleet(1, 8, since=0.0))))
    assert series.numbers.tolist() == [1, 2, 3, 4, 6, 7, 8]
