"""The viewer opened by commands, or the file with its recording."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stadera.robot import Robot
    from stadera.weigh.settings import Watch


@contextmanager
def watching(robot: Robot, view: bool, save: Path | None) -> Iterator[Watch | None]:
    """Yields a viewer's `watch`, None if none was requested; the file is complete when the block ends without an
    error.
    """
    if not view and save is None:
        yield None
        return
    from stadera.files import written_together
    from stadera.live.view import Viewer

    with (
        written_together([] if save is None else [save]) as drafts,
        Viewer(robot, spawn=view, save=drafts[0] if drafts else None) as viewer,
    ):
        yield viewer.watch
