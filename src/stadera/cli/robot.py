"""Options of `weigh` and `live` for the robot: its identified legs, its load, what is known of it, and its viewer."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from stadera.cli import options as opt
from stadera.cli import parse
from stadera.cli.options import flag, option
from stadera.files import write_text
from stadera.results import json_text

if TYPE_CHECKING:
    from stadera.limits import Limits
    from stadera.robot import Robot
    from stadera.trunk.memory import Memory
    from stadera.weigh.settings import Watch


@dataclass(frozen=True)
class RobotOptions(opt.ModelOptions):
    """Options for the robot that is weighed."""

    weight: opt.Weight = None
    memory: Annotated[
        Path | None, option("F.json", "What earlier logs told of this robot; read if it is there, and written anew.")
    ] = None
    at: Annotated[
        str | None,
        option("LINK", "Link or frame on which the payload is, such as a hand's [default: the likeliest place]."),
    ] = None
    legs: opt.LegsFile = None
    force: opt.Force = False
    imu_frame: opt.ImuFrame = None
    view: Annotated[bool, flag("Show the robot and its estimates in Rerun.", "--view")] = False
    rrd: Annotated[Path | None, option("F.rrd", "Write a recording for Rerun.", "--rrd")] = None

    @property
    def on_scale(self) -> tuple[float, float] | None:
        """The weight, parsed: mass and standard deviation [kg]. Raises BadParameter."""
        return None if self.weight is None else parse.weight(self.weight)

    def model(self, name: str, limits: Limits) -> Robot:
        """Loads the robot, with identified legs if given; with `force` also if these are not to be trusted."""
        from stadera.identify.schema import with_identified_legs

        robot = self.load(name, limits)
        return robot if self.legs is None else with_identified_legs(robot, self.legs, self.force)

    def remembered(self, robot: Robot) -> Memory | None:
        """The memory in its file, a new one if there is no such file. Raises IdentificationError: it holds none of the
        robot's.
        """
        from stadera.errors import IdentificationError
        from stadera.trunk.memory import Memory

        if self.memory is None or not self.memory.exists():
            return None if self.memory is None else Memory.none(robot)
        try:
            return Memory.from_dict(json.loads(self.memory.read_text(encoding="utf-8"))).check(robot)
        except (ValueError, IdentificationError) as error:
            raise IdentificationError(f"--memory {self.memory}: {error}") from None

    @contextmanager
    def watching(self, robot: Robot) -> Iterator[Watch | None]:
        """Yields a viewer's `watch`, None if none was requested; the file is complete when the block ends without an
        error.
        """
        if not self.view and self.rrd is None:
            yield None
            return
        from stadera.files import written_together
        from stadera.live.view import Viewer

        with (
            written_together([] if self.rrd is None else [self.rrd]) as drafts,
            Viewer(robot, spawn=self.view, save=drafts[0] if drafts else None) as viewer,
        ):
            yield viewer.watch


def save_memory(memory: Memory | None, path: Path) -> None:
    """Writes it, if there is one."""
    if memory is not None:
        write_text(path, json_text(memory.to_dict()))
