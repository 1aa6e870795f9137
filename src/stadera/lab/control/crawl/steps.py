"""Sequence of a crawl's steps: the next leg, its foothold, and the steps after it."""

from __future__ import annotations

from stadera.lab.control.crawl.settings import CrawlCommand, CrawlSettings, StepTiming, standing_height
from stadera.lab.control.planner.feet import Footholds, PathPose
from stadera.lab.control.planner.steps import PlannedStep, body_times
from stadera.legs.model import foot_positions
from stadera.robot.model import LEG_NAMES, Robot
from stadera.robot.stance import standing_configuration
from stadera.types import Array


class StepSequence:
    """The steps of a crawl along its path.

    Args:
        robot: defines the nominal positions of the feet.
        settings: sequence, sizes and times.
        command: desired motion.

    Attributes:
        timing: of the command.

    Raises:
        CrawlError: the command is too fast for this robot.
    """

    def __init__(self, robot: Robot, settings: CrawlSettings, command: CrawlCommand) -> None:
        self._settings, self._height = settings, standing_height(robot)
        self._order = tuple(LEG_NAMES.index(name) for name in settings.sequence)
        self._turn = 0
        feet = foot_positions(robot, standing_configuration(robot)[None])[0]
        self._footholds, self._path = Footholds.of(feet, 0.0)
        self.timing: StepTiming
        self.command = command

    @property
    def command(self) -> CrawlCommand:
        """Desired motion."""
        return self._command

    @command.setter
    def command(self, command: CrawlCommand) -> None:
        settings = self._settings
        self.timing, self._command = settings.timing(command), command
        stride = abs(command.speed) * 4.0 * self.timing.step
        offsets = self._footholds.offsets
        self._body_times = body_times(offsets, self._order, stride, self.timing, self._height, settings.margin)

    def start(self, feet: Array, heading: float) -> None:
        """Starts the path in the middle of the feet (4, 3) [m], with a heading [rad]."""
        self._footholds, self._path = Footholds.of(feet, heading)

    @property
    def leg(self) -> int:
        """The next leg."""
        return self._order[self._turn % 4]

    @property
    def target(self) -> Array:
        """Foothold of the next leg, (2,) [m]."""
        return self._target(self._turn, self._next(self._path))

    @property
    def heading(self) -> float:
        """Heading of the path at its landing [rad]."""
        return self._next(self._path).heading

    def done(self) -> None:
        """Advances to the next leg after a landing."""
        self._path, self._turn = self._next(self._path), self._turn + 1

    def body_time(self, late: float) -> float:
        """Time for the body's motion before the next swing [s], shorter after a late landing."""
        body = float(self._body_times[self._turn % 4])
        return max(body - late, self._settings.tuning.least_body * body, 2.0 * self.timing.transfer)

    def ahead(self, body: float) -> list[PlannedStep]:
        """The next steps, the first after a body motion of `body` [s]."""
        steps, path = [], self._path
        for turn in range(self._turn, self._turn + self._settings.tuning.planned):
            path = self._next(path)
            before = body if turn == self._turn else float(self._body_times[turn % 4])
            steps.append(PlannedStep(self._order[turn % 4], self._target(turn, path), before))
        return steps

    def _next(self, path: PathPose) -> PathPose:
        return path.ahead(self._command.speed, self._command.turn, self.timing.step)

    def _target(self, turn: int, path: PathPose) -> Array:
        command, step = self._command, self.timing.step
        return self._footholds.next(self._order[turn % 4], path, command.speed, command.turn, step)
