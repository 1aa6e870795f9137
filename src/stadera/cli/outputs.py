"""The files that a command is asked for: checked before the work, written all together or none."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stadera.errors import RecordingError, StaderaError
from stadera.files import require_writable, write_text, written_together

if TYPE_CHECKING:
    from stadera.identify.result import Identification
    from stadera.report.figures import Figure
    from stadera.report.table import TableData
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


def check_report(path: Path | None) -> None:
    """Whether a page can be written as a file of that name, None for none.

    Raises:
        StaderaError: neither HTML nor PDF, or a PDF without a browser that prints it.
    """
    if path is None or path.suffix.lower() in (".html", ".htm"):
        return
    if path.suffix.lower() != ".pdf":
        raise StaderaError(f"{path}: a report is written as .html or .pdf")
    from stadera.report.pdf import find_browser

    find_browser(path)


@dataclass(frozen=True)
class FigureFile:
    """A figure that was asked for: its name, None for the most telling, and its file."""

    name: str | None
    path: Path

    @classmethod
    def of(cls, given: str) -> FigureFile:
        """From `[NAME=]F.pdf`.

        Raises:
            StaderaError: not a file that figures are written to. MissingExtraError: Matplotlib is not installed.
        """
        from stadera.report.figures.paper import check_figure

        name, sign, path = given.rpartition("=")
        check_figure(path)
        return cls(name if sign else None, Path(path))

    def output(self, make: Callable[[], Mapping[str, Figure | TableData]]) -> tuple[Path, Writer]:
        """For `write_outputs`; UnknownNameError when it is written and there is no figure of that name."""

        def fill(draft: Path) -> None:
            from stadera.report.figures.paper import drawn, save

            save(drawn(make(), self.name), draft)

        return self.path, fill


def figure_files(given: Iterable[str] | None) -> tuple[FigureFile, ...]:
    """Of all `--figure`. Errors as `FigureFile.of`."""
    return tuple(map(FigureFile.of, given or ()))


@dataclass(frozen=True)
class ResultFiles:
    """The files that a result is written to; None for one that was not asked for."""

    json: Path | None
    report: Path | None
    export: Path | None
    figures: tuple[FigureFile, ...] = ()
    latex: Path | None = None

    def check(self, robot: Robot) -> None:
        """What can be known of them before the work.

        Raises:
            StaderaError: see `check_outputs` and `check_report`; ModelError: the robot's model file is of another kind
                than the export.
        """
        drawn = (figure.path for figure in self.figures)
        check_outputs((self.json, self.report, self.export, self.latex, *drawn))
        check_report(self.report)
        if self.export is not None:
            from stadera.robot.export import check_export

            check_export(robot, self.export)

    def write(
        self,
        result: Identification | Weighing,
        page: Callable[[], str] | None = None,
        figures: Callable[[], Mapping[str, Figure | TableData]] | None = None,
    ) -> None:
        """All of them or none; `page` is the report where it is not the result's own, and `figures` likewise."""
        write_outputs(
            (self.json, json_of(result.to_dict)),
            (self.report, page_of(page or result.to_html)),
            (self.export, result.save_urdf),
            (self.latex, text_of(result.to_latex)),
            *(figure.output(figures or result.to_figures) for figure in self.figures),
        )


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


def page_of(make: Callable[[], str]) -> Writer:
    """Of a page, as HTML or printed as PDF by the file's suffix."""

    def fill(draft: Path) -> None:
        if draft.suffix.lower() != ".pdf":
            write_text(draft, make())
            return
        from stadera.report.pdf import write_pdf

        write_pdf(make(), draft)

    return fill


def text_of(make: Callable[[], str]) -> Writer:
    """Of a text that is made only when its file is."""
    return lambda draft: write_text(draft, make())
