"""The notebooks of examples/ run from beginning to end, and have the outputs of a run: docs/outputs.py writes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

NOTEBOOKS = sorted((Path(__file__).resolve().parent.parent / "examples" / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_runs(path: Path) -> None:
    nbformat = pytest.importorskip("nbformat", reason="needs pip install 'stadera[docs]'")
    nbclient = pytest.importorskip("nbclient", reason="needs pip install 'stadera[docs]'")
    book = nbformat.read(path, as_version=4)
    client = nbclient.NotebookClient(book, timeout=300, resources={"metadata": {"path": str(path.parent)}})
    client.execute()
    kept = nbformat.read(path, as_version=4)
    assert [shown(cell) for cell in kept.cells] == [shown(cell) for cell in book.cells], (
        "python docs/outputs.py notebooks"
    )


def shown(cell: Any) -> list[tuple[str, ...]]:
    """Kinds of a cell's outputs; its values may differ in the last digits from machine to machine."""
    return [(output.output_type, *sorted(output.get("data", {}))) for output in cell.get("outputs", ())]
