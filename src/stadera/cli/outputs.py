"""The files that a command is asked for: checked before the work, written all together or none."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from stadera.errors import RecordingError, StaderaError
from stadera.files import require_writable, written_together

Writer = Callable[[Path], object]
"""Fills the draft of one file."""


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[Path] = ()) -> None:
    """What can be known of the outputs before the work; None is one that was not asked for.

    Raises:
        StaderaError: an output that cannot be written, is named twice, or would replace an input.
    """
    taken = {path.resolve(): "an input" for path in inputs}
    for path in outputs:
        if path is None:
            continue
        place = require_writable(path).resolve()
        if place in taken:
            raise StaderaError(f"{path}: would replace {taken[place]}")
        taken[place] = "another output"


def check_table(path: Path) -> None:
    """Whether tables are written as files of that name.

    Raises:
        RecordingError: a table of an unknown kind.
    """
    from stadera.recording.writer import SUFFIXES

    if path.suffix.lower() not in SUFFIXES:
        raise RecordingError(f"{path}: a table is written as one of {', '.join(SUFFIXES)}")


def write_outputs(*outputs: tuple[Path | None, Writer]) -> None:
    """All outputs or none: every one that was asked for is drafted before the first takes its place.

    Raises:
        StaderaError: an output that cannot be written.
    """
    wanted = [(path, fill) for path, fill in outputs if path is not None]
    with written_together([path for path, _ in wanted]) as drafts:
        for draft, (_, fill) in zip(drafts, wanted, strict=True):
            fill(draft)


def text_of(make: Callable[[], str]) -> Writer:
    """Of a text that is made only when its file is."""
    return lambda draft: draft.write_text(make(), encoding="utf-8")
