"""Output files of a command: checked before the computation, none over an input, written all together or not at all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer.core import TyperCommand

from stadera.cli.options import JsonFile, ReportFile, option
from stadera.cli.terminal import show
from stadera.errors import RecordingError, StaderaError
from stadera.files import require_writable, write_text, written_together
from stadera.results import Result, json_text

if TYPE_CHECKING:
    from stadera.report.figures import Figure
    from stadera.report.table import TableData


Writer = Callable[[Path], object]
"""Fills the draft of one file."""


def check_outputs(outputs: Iterable[Path | None]) -> None:
    """Checks the outputs before the computation; None stands for one that was not requested. Raises StaderaError: an
    output cannot be written, is named twice, or would replace an input.
    """
    taken = set()
    for path in filter(None, outputs):
        place = require_writable(path)
        if place in taken:
            raise StaderaError(f"{path}: would replace another output")
        taken.add(place)


def check_table(path: Path | None) -> None:
    """Checks that the path's suffix is a format for tables, None for no table. Raises RecordingError: it is not."""
    from stadera.logs.frames import SUFFIXES

    if path is not None and path.suffix.lower() not in SUFFIXES:
        raise RecordingError(f"{path}: a table is written as one of {', '.join(SUFFIXES)}")


def check_report(path: Path | None) -> None:
    """Checks that the path's suffix is a format for reports; None for no report. Raises StaderaError: neither HTML nor
    PDF, or a PDF without a browser to print it.
    """
    if path is None or path.suffix.lower() in (".html", ".htm"):
        return
    if path.suffix.lower() != ".pdf":
        raise StaderaError(f"{path}: a report is written as .html or .pdf")
    from stadera.report.page import find_browser

    find_browser(path)


@dataclass(frozen=True)
class ResultFiles:
    """Options for the files of a result."""

    json: JsonFile = None
    report: ReportFile = None
    figure: Annotated[
        list[str] | None,
        option("[NAME=]F.pdf", "Draw a figure (.pdf, .png or .svg), the main one or the named one; repeatable."),
    ] = None
    latex: Annotated[Path | None, option("F.tex", "Write the tables as LaTeX.")] = None

    @property
    def figures(self) -> list[tuple[str | None, Path]]:
        """Names (None for the main one) and files of the figures."""
        parted = [given.rpartition("=") for given in self.figure or ()]
        return [(name if sign else None, Path(path)) for name, sign, path in parted]

    def check(self, *others: Path | None) -> None:
        """Checks these and other files before the computation. Raises StaderaError: see `check_outputs` and
        `check_report`; not a format for figures. MissingExtraError: Matplotlib is not installed.
        """
        if self.figure:
            from stadera.report.figures.paper import check_figure

            for _, path in self.figures:
                check_figure(path)
        check_outputs((*others, self.json, self.report, self.latex, *(path for _, path in self.figures)))
        check_report(self.report)

    def write(
        self,
        *others: tuple[Path | None, Writer],
        values: Callable[[], Any],
        page: Callable[[], str],
        latex: Callable[[], str],
        figures: Callable[[], Mapping[str, Figure | TableData]],
    ) -> None:
        """Writes these and other files, or none. Raises UnknownNameError: there is no figure of a name."""

        def draw(draft: Path, name: str | None) -> None:
            from stadera.report.figures.paper import drawn, save

            save(drawn(figures(), name), draft)

        write_outputs(
            *others,
            (self.json, json_of(values)),
            (self.report, page_of(page)),
            (self.latex, text_of(latex)),
            *((path, partial(draw, name=name)) for name, path in self.figures),
        )

    def write_result(self, result: Result, *others: tuple[Path | None, Writer]) -> None:
        """Writes a result's files and others, or none."""
        values, page, latex, figures = result.to_dict, result.to_html, result.to_latex, result.to_figures
        self.write(*others, values=values, page=page, latex=latex, figures=figures)


def write_outputs(*outputs: tuple[Path | None, Writer]) -> None:
    """Writes all outputs or none: each is drafted before the first replaces its target. Raises StaderaError: an output
    cannot be written.
    """
    wanted = [(path, fill) for path, fill in outputs if path is not None]
    with written_together([path for path, _ in wanted]) as drafts:
        for draft, (_, fill) in zip(drafts, wanted, strict=True):
            fill(draft)


def text_of(make: Callable[[], str]) -> Writer:
    """Writer of a text, computed only if the file is requested."""
    return lambda draft: write_text(draft, make())


def json_of(make: Callable[[], Any]) -> Writer:
    """Writer of plain values as JSON, computed only if the file is requested."""
    return text_of(lambda: json_text(make()))


def page_of(make: Callable[[], str]) -> Writer:
    """Writer of a page as HTML, or printed as PDF, according to the file's suffix."""

    def fill(draft: Path) -> None:
        if draft.suffix.lower() != ".pdf":
            write_text(draft, make())
            return
        from stadera.report.page import write_pdf

        write_pdf(make(), draft)

    return fill


OUTPUTS = frozenset(
    {"memory", "json", "report", "export", "out", "model", "latex", "figure", "keep", "merge", "record", "rrd"}
)
"""Parameters that name outputs. All other parameters that name files are inputs."""

REPLAY = "replay:"
"""Prefix of the path of a log that is replayed in place of a running robot."""


class GatedCommand(TyperCommand):
    """A command whose inputs are derived from its parameters, so that none can be forgotten."""

    def invoke(self, ctx: Any) -> Any:
        """Runs the command within the gate, and reports the files written."""
        from stadera.files import output_gate

        with output_gate(inputs_of(ctx.params)) as gate:
            try:
                return super().invoke(ctx)
            finally:  # also before an error that comes after them
                if gate.written:
                    _show_written(gate.written)


def _show_written(files: Iterable[tuple[Path, bool]]) -> None:
    written: dict[Path, bool] = {}
    for path, replaced in files:  # files written repeatedly are reported once
        written.setdefault(path, replaced)
    show(*(f"wrote {path}{' in place of the one before' * replaced}" for path, replaced in written.items()))


def inputs_of(parameters: Mapping[str, Any]) -> Iterator[Path]:
    """The files that parameters name, including those of a named robot and files included by a model."""
    for name, value in parameters.items():
        if name in OUTPUTS:
            continue
        for text in value if isinstance(value, list | tuple) else [value]:
            if isinstance(text, Path | str) and text:
                yield from _files(str(text), name)


def _files(text: str, parameter: str) -> Iterator[Path]:
    path = _robot(text) if parameter in ("robot", "target") else Path(text.removeprefix(REPLAY))
    yield path
    if path.suffix.lower() in (".xml", ".mjcf", ".urdf") and path.is_file():
        import re

        found = re.findall(r'<(?:include|compiler)[^>]*?(?:file|filename)="([^"]+)"', path.read_text(errors="replace"))
        yield from (path.parent / name for name in found)


def _robot(text: str) -> Path:
    from stadera.robot.catalog import resolve

    try:
        return resolve(text)[1]
    except StaderaError:
        return Path(text)
