"""Whatever numbers and texts a file has, it is read as it says or refused in one line."""

from __future__ import annotations

import re
from functools import cache
from math import isfinite
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from robot.robot_files import quadruped
from stadera.errors import StaderaError
from stadera.logs import read
from stadera.logs.foreign.column_map import FACTORS, parsed
from stadera.robot import load_robot

few = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
NUMBERS = st.one_of(st.floats(width=32).map(repr), st.floats().map(repr), st.integers(-(10**25), 10**25).map(str))
TEXTS = st.one_of(NUMBERS, st.text(st.characters(exclude_categories=["Cs"]), max_size=8))
MOST = 1e4
"""Of a position that no check refuses [rad]."""


def refused(error: StaderaError, path: Path | str) -> None:
    assert str(path) in str(error)
    assert "\n" not in str(error)


@few
@given(st.lists(st.tuples(NUMBERS, NUMBERS), min_size=3, max_size=6))
def test_a_csv_table_has_the_numbers_that_were_written(tmp_path: Path, rows: list[tuple[str, str]]) -> None:
    path = tmp_path / "log.csv"
    lines = [f"{0.01 * k:.2f},{a},{b}" for k, (a, b) in enumerate(rows)]
    path.write_text("\n".join(["time,a.position,a.effort", *lines]) + "\n")
    try:
        log = read(path)
    except StaderaError as error:
        refused(error, path)
        assert not all(isfinite(float(v)) and abs(float(v)) < MOST for row in rows for v in row)
        return
    assert log.effort is not None
    expected = np.array([[float(v) for v in row] for row in rows])
    np.testing.assert_array_equal(np.column_stack([log.position[:, 0], log.effort[:, 0]]), expected)


@few
@given(st.lists(st.lists(TEXTS, min_size=1, max_size=4), min_size=1, max_size=5))
@example([["time", "a.position"], ["0", "1"], ["1", "2"]])
@example([['"'], ["\r"], [","]])
def test_a_csv_table_of_anything_is_read_or_refused(tmp_path: Path, cells: list[list[str]]) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join(",".join(row) for row in cells), encoding="utf-8", newline="")
    try:
        read(path)
    except StaderaError as error:
        refused(error, path)


def quoted(text: str) -> str:
    """A TOML string."""
    return '"' + re.sub(r'[\\"\x00-\x1f\x7f]', "", text) + '"'


QUOTED = TEXTS.map(quoted)
PAIRS = st.tuples(st.sampled_from(["position", "effort", "rate_hz", "{joint}.position"]), st.one_of(QUOTED, NUMBERS))
VALUES = st.one_of(
    NUMBERS,
    QUOTED,
    st.lists(QUOTED, max_size=2).map(lambda v: f"[{', '.join(v)}]"),
    PAIRS.map(lambda pair: f'{{ "{pair[0]}" = {pair[1]} }}'),
)


@few
@given(st.dictionaries(st.sampled_from(["joints", "base", "about", "columns", "units", "x"]), VALUES, max_size=4))
@example({"units": '{ "position" = "deg" }', "columns": '{ "time" = "t" }'})
@example({"units": '{ "position" = "0.0" }'})
@example({"units": '{ "rate_hz" = "x" }'})
def test_a_column_map_of_anything_is_read_or_refused(entries: dict[str, str]) -> None:
    try:
        found = parsed("\n".join(f"{key} = {value}" for key, value in entries.items()), "map.toml")
    except StaderaError as error:
        refused(error, "map.toml")
        return
    assert all(source.unit in ("", *FACTORS) or source.unit for way in found.columns.values() for source in way)


@cache
def _numbers() -> list[re.Match[str]]:
    """Places of numbers in the attributes of a URDF."""
    return list(re.finditer(r'(?:mass value|ixx|iyy|lower|upper|effort|velocity|xyz|rpy)="([^"]+)"', quadruped()))


@few
@given(st.data(), TEXTS)
def test_numbers_of_a_urdf_are_read_as_they_are_or_refused(tmp_path: Path, data: st.DataObject, text: str) -> None:
    place = data.draw(st.sampled_from(_numbers()))
    begin, end = place.span(1)
    path = tmp_path / "robot.urdf"
    escaped = re.sub(r'[<&">]', "", text)
    path.write_text(quadruped()[:begin] + escaped + quadruped()[end:], encoding="utf-8")
    try:
        robot = load_robot(path)
    except StaderaError as error:
        refused(error, path)
        return
    masses = [robot.inertias[link].mass for link in robot.tree.links]
    assert np.isfinite(masses).all()
    if place.group(0).startswith("mass"):
        others = re.findall(r'mass value="([^"]+)"', path.read_text(encoding="utf-8"))
        assert sum(masses) == pytest.approx(sum(map(float, others)))
