"""The notebooks of examples/ run from beginning to end."""

from __future__ import annotations

from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).resolve().parent.parent / "examples" / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_runs(path: Path) -> None:
    nbformat = pytest.importorskip("nbformat", reason="needs pip install 'stadera[docs]'")
    nbclient = pytest.importorskip("nbclient", reason="needs pip install 'stadera[docs]'")
    book = nbformat.read(path, as_version=4)
    client = nbclient.NotebookClient(book, timeout=300, resources={"metadata": {"path": str(path.parent)}})
    client.execute()
    assert all(not cell.get("outputs") for cell in nbformat.read(path, as_version=4).cells)  # kept without outputs
