"""Terminal output of all commands: tables on stdout, progress on stderr if it is a terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TextIO

if TYPE_CHECKING:
    from rich.console import RenderableType


class Progress(Protocol):
    """Called with the name of the step, the number of items done, and their total (0 if unknown)."""

    def __call__(self, what: str, done: int, total: int, detail: str = "") -> None: ...


def show(*renderables: RenderableType) -> None:
    """Prints tables and texts on stdout; with fixed width and without colours if it is not a terminal. StaderaError if
    it cannot be written to, such as a full disk.

    If the reader of a pipe stops reading, the rest is discarded without an error.
    """
    from rich.console import Console

    from stadera.errors import StaderaError

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
    from rich.progress import BarColumn, TaskID, TaskProgressColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    extra = (TextColumn("{task.fields[left]}"), TextColumn("{task.fields[detail]}"))
    with Bars(*columns, *extra, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, tuple[TaskID, int]] = {}

        def report(what: str, done: int, total: int, detail: str = "") -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=total or None, detail=detail, left=""), done
            task, begun = tasks[what]
            elapsed = bars.tasks[bars.task_ids.index(task)].elapsed or 0.0
            left = remaining(elapsed, done - begun, total - done)
            bars.update(task, completed=done, total=total or None, detail=detail, left=left)

        yield report


def remaining(elapsed: float, done: int, left: int, least: float = 10.0) -> str:
    """Remaining time if the rate stays the same, of `done` steps in `elapsed` [s] without those of an earlier run, and
    `left` to go; empty before it can be estimated, after `least` [s].
    """
    if done <= 0 or left <= 0 or elapsed < least:
        return ""
    seconds = elapsed * left / done
    amount = f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min" if seconds < 6000 else ""
    return f"about {amount or f'{seconds / 3600:.1f} h'} left"
