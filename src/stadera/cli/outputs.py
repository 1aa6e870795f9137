"""The files that a command is asked for: checked before the work, written all together or none."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stadera.errors import RecordingError, StaderaError
from stadera.files import require_writable, write_text, written_together

if TYPE_CHECKING:
    from stadera.identify.result import Identification
    from stadera.robot import Robot
    from stadera.weigh.result import Weighing

Writer = Callable[[Path], object]
"""Fills the draft of one file."""


def check_outputs(outputs: Iterable[Path | None]) -> None:
    """What can be known of the outputs before the work; None is one that was not asked for.

    Raises:
        StaderaError: an output that cannot be written, is named twice, or would replace an input.
    """
    taken = set()
    for path in filter(None, outputs):
        place = require_writable(path)
        if place in taken:
            raise StaderaError(f"{path}: would replace another output")
        taken.add(place)


def check_table(path: Path) -> None:
    """Whether tables are written as files of that name.

    Raises:
        RecordingError: a table of an unknown kind.
    """
    from stadera.logs.tables.write import SUFFIXES

    if path.suffix.lower() not in SUFFIXES:
        raise RecordingError(f"{path}: a table is written as one of {', '.join(SUFFIXES)}")


@dataclass(frozen=True)
class ResultFiles:
    """The files that a result is written to; None for one that was not asked for."""

    json: Path | None
    report: Path | None
    export: Path | None

    def check(self, robot: Robot) -> None:
        """What can be known of them before the work.

        Raises:
            StaderaError: see `check_outputs`; ModelError: the robot's model file is of another kind than the export.
        """
        check_outputs((self.json, self.report, self.export))
        check_report(self.report)
        if self.export is not None:
            from stadera.robot.export import check_export

            check_export(robot, self.export)

    def write(self, result: Identification | Weighing, page: Callable[[], str] | None = None) -> None:
        """All of them or none; `page` is the report where it is not the result's own."""
        write_outputs(
            (self.json, json_of(result.to_dict)),
            (self.report, text_of(page or result.to_html)),
            (self.export, result.save_urdf),
        )


def check_report(path: Path | None) -> None:
    """Whether a page can be written as a file of that name, None for none.

    Raises:
        StaderaError: it is not HTML.
    """
    if path is not None and path.suffix.lower() not in (".html", ".htm"):
        raise StaderaError(f"{path}: a report is written as .html")


def write_outputs(*outputs: tuple[Path | None, Writer]) -> None:
    """All outputs or none: every one that was asked for is drafted before the first takes its place.

    Raises:
        StaderaError: an output that cannot be written.
    """
    wanted = [(path, fill) for path, fill in outputs if path is not None]
    with written_together([path for path, _ in wanted]) as drafts:
        for draft, (_, fill) in zip(drafts, wanted, strict=True):
            fill(draft)


def json_of(make: Callable[[], Any]) -> Writer:
    """Of plain values, as JSON, made only when its file is."""

    def fill(draft: Path) -> None:
        from stadera.report.json import json_text

        write_text(draft, json_text(make()))

    return fill


def text_of(make: Callable[[], str]) -> Writer:
    """Of a text that is made only when its file is."""
    return lambda draft: write_text(draft, make())
