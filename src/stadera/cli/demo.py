"""`stadera demo`: a load lands on a robot that walks, with and without identification."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stadera.cli.outputs import check_outputs, text_of, write_outputs
from stadera.cli.terminal import show

if TYPE_CHECKING:
    from stadera.demo.run import Progress

_REPORT = Path("out") / "demo.html"


def demo(
    report: Annotated[Path, typer.Option(metavar="F.html", help="Write the report, to open in a browser.")] = _REPORT,
    json: Annotated[Path | None, typer.Option("--json", metavar="F", help="Write the result as JSON.")] = None,
    nonstop: Annotated[
        bool, typer.Option("--nonstop", help="Weigh the load on the way, without a stop, instead of at rest.")
    ] = False,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of the sensors' errors.")] = 0,
) -> None:
    """HyQ crawls, and a box of 10 kg lands on its back's left-hind corner: without identification, and with.

    With it, the robot stops to weigh the box and walks on; or it never stops (--nonstop). Takes about a minute on two
    cores. The report has both walks to watch.
    """
    from stadera.demo import DemoSettings, run_demo
    from stadera.report.demo import demo_json, demo_tables
    from stadera.report.demo_html import demo_html
    from stadera.report.json import json_text

    if report == _REPORT:
        report.parent.mkdir(exist_ok=True)
    check_outputs((report, json))
    with _progress() as watch:
        result = run_demo(DemoSettings(seed=seed, nonstop=nonstop), watch)
    write_outputs(
        (report, text_of(lambda: demo_html(result))),
        (json, text_of(lambda: json_text(demo_json(result)))),
    )
    show(*demo_tables(result), f"report: {report}")


@contextmanager
def _progress() -> Iterator[Progress | None]:
    """A live line for each run; None, and silence, where stderr is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TaskID, TaskProgressColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Bars(*columns, TextColumn("{task.fields[doing]}"), console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, TaskID] = {}

        def report(run: str, done: float, doing: str) -> None:
            if run not in tasks:
                tasks[run] = bars.add_task(run, total=1.0, doing=doing)
            bars.update(tasks[run], completed=done, doing=doing)

        yield report
