"""Files that appear whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from stadera.errors import StaderaError
from stadera.files import written_together


def write(text: str, *paths: Path, fails: bool = False) -> None:
    with written_together(paths) as drafts:
        for draft in drafts:
            draft.write_text(text)
        if fails:
            raise ZeroDivisionError


def test_all_appear_or_none(tmp_path: Path) -> None:
    old, new = tmp_path / "old.json", tmp_path / "new.html"
    write("first", old)
    with pytest.raises(ZeroDivisionError):
        write("second", old, new, fails=True)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["first"]
    write("second", old, new)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new.html", "old.json"]
    assert {path.read_text() for path in tmp_path.iterdir()} == {"second"}


def test_a_draft_that_was_not_filled_is_named_by_its_file(tmp_path: Path) -> None:
    path = tmp_path / "o.json"
    with pytest.raises(StaderaError, match=r"/o\.json: cannot be written"), written_together([path]):
        pass


def test_bad_paths_are_named(tmp_path: Path) -> None:
    with pytest.raises(StaderaError, match="no such folder"):
        write("", tmp_path / "no" / "o.json")
    with pytest.raises(StaderaError, match="is a folder"):
        write("", tmp_path)
    with pytest.raises(StaderaError, match="named for two outputs"):
        write("", tmp_path / "o", tmp_path / "." / "o")
    assert list(tmp_path.iterdir()) == []
