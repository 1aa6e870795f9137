"""Terminal output of all commands: tables on stdout, progress on stderr if it is a terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from stadera.errors import StaderaError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from stadera.types import Progress


def show(*renderables: RenderableType) -> None:
    """Prints tables and texts on stdout; with fixed width and without colours if it is not a terminal. StaderaError if
    it cannot be written to, such as a full disk.

    If the reader of a pipe stops reading, the rest is discarded without an error.
    """
    from rich.console import Console

    width = None if sys.stdout.isatty() else 140
    console = Console(highlight=False, markup=False, emoji=False, width=width)
    try:
        with console.capture() as shown:  # rich handles broken pipes in its own way
            for renderable in renderables:
                console.print(renderable)
        sys.stdout.write(shown.get())
        sys.stdout.flush()
    except BrokenPipeError:
        write_nowhere(sys.stdout)
    except OSError as error:
        write_nowhere(sys.stdout)
        raise StaderaError(f"standard output: {error.strerror}") from None


def write_nowhere(stream: TextIO) -> None:
    """Redirects a stream, including its buffer, to the null device."""
    with suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)


def prepare_streams() -> None:
    """Prepares stdout and stderr: a closed stream is redirected to the null device, and unencodable characters are
    replaced.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


@contextmanager
def progress() -> Iterator[Progress | None]:
    """Yields a progress reporter; None if stderr is not a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TaskID, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    more = (TimeRemainingColumn(), TextColumn("{task.fields[detail]}"))
    console, hour = Console(stderr=True), 3600.0
    with Bars(*columns, *more, console=console, transient=True, speed_estimate_period=hour) as bars:
        tasks: dict[str, TaskID] = {}

        def report(what: str, done: int, total: int, detail: str = "") -> None:
            if what not in tasks:  # what an earlier run has done does not count as speed
                tasks[what] = bars.add_task(what, total=total or None, completed=done, detail=detail)
            bars.update(tasks[what], completed=done, total=total or None, detail=detail)

        yield report
