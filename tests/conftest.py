"""Helpers that all tests share."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from stadera.cli import main

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real logs: STADERA_DATA, else ../shared/data beside the project; skips where neither exists."""
    named = os.environ.get("STADERA_DATA")
    folder = Path(named) if named else ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real logs: {folder} does not exist (set STADERA_DATA to their folder)")
    return folder


@dataclass(frozen=True)
class Finished:
    """A command that was run in this process: its exit code, and what it printed."""

    code: int
    out: str
    err: str


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., Finished]:
    def _run(*arguments: object) -> Finished:
        with pytest.raises(SystemExit) as exit_info:
            main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Finished(int(exit_info.value.code or 0), captured.out, captured.err)

    return _run
