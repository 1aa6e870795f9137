"""Helpers that all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real logs: STADERA_DATA, else ../shared/data beside the project; skips where neither exists."""
    named = os.environ.get("STADERA_DATA")
    folder = Path(named) if named else ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real logs: {folder} does not exist (set STADERA_DATA to their folder)")
    return folder
