"""What all commands share towards the terminal: tables on stdout, progress on stderr while a person watches."""

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
    """Called with what is being done, how many steps of it are done, and how many there are (0: not known)."""

    def __call__(self, what: str, done: int, total: int, detail: str = "") -> None: ...


_PIPE_WIDTH = 140


def show(*renderables: RenderableType) -> None:
    """Print tables and texts on stdout; at a fixed width, without colours, where that is no terminal.

    Who reads a pipe may stop reading: the rest is then left out, and that is no error.

    Raises:
        StaderaError: stdout cannot be written to, such as a full disk.
    """
    from rich.console import Console

    from stadera.errors import StaderaError

    width = None if sys.stdout.isatty() else _PIPE_WIDTH
    console = Console(highlight=False, markup=False, emoji=False, width=width)
    try:
        with console.capture() as shown:  # rich has its own way with broken pipes
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
    """Sends what is still in a stream's buffer, and whatever follows, to the null device."""
    with suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)


def prepare_streams() -> None:
    """Makes stdout and stderr fit to be written to: one that was closed goes nowhere, and no character is an error."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


@contextmanager
def progress() -> Iterator[Progress | None]:
    """Something to report progress to; None, and silence, where stderr is no terminal."""
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


_LONG = 10.0  # s, of work after which a remaining time is shown


def remaining(elapsed: float, done: int, left: int) -> str:
    """How long the rest will take if it goes on as so far; nothing before that can be said.

    Args:
        elapsed: [s]. done: steps made in it, those of an earlier run apart. left: steps to go.
    """
    if done <= 0 or left <= 0 or elapsed < _LONG:
        return ""
    seconds = elapsed * left / done
    amount = f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min" if seconds < 6000 else ""
    return f"about {amount or f'{seconds / 3600:.1f} h'} left"
