"""The demo: the same walk twice, at the same time, once without identification and once with.

HyQ crawls; a box lands on the left-hind corner of its back. Both runs have the same sensors, the same errors, the same
box; in one of them a supervisor watches, and either stops to weigh or has it weighed on the way.
"""

from __future__ import annotations

import multiprocessing
import queue
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from queue import Queue
from typing import Any

import numpy as np

from stadera.errors import StaderaError
from stadera.lab.demo.film import Camera, Film
from stadera.lab.experiments.moving.loaded_walk import (
    LoadedWalk,
    LoadedWalkCase,
    LoadedWalkOutcome,
    Supervision,
    box_at,
)
from stadera.robot import load_robot

Progress = Callable[[str, float, str], None]
"""Told a run's name, how much of it is done (0 to 1), and what the robot is doing."""

Message = tuple[str, float, str]

_CORNER = "LH"
_BOX = (0.1, 0.1, 0.13)  # m: of steel, that is 10 kg
_TELL_EVERY = 100  # periods
_POLL = 0.1  # s


@dataclass(frozen=True)
class DemoSettings:
    """What is shown.

    Attributes:
        robot: its name.
        mass: of the box [kg].
        load_at: when it is let go [s].
        seconds: of each run.
        speed: [m/s].
        seed: of the sensors' errors.
        nonstop: weigh on the way, instead of at rest.

    Raises:
        StaderaError: a box that is let go after the end, a value that is not positive.
    """

    robot: str = "hyq"
    mass: float = 10.0
    load_at: float = 5.5
    seconds: float = 18.0
    speed: float = 0.1
    seed: int = 0
    nonstop: bool = False

    @property
    def supervisions(self) -> tuple[Supervision, Supervision]:
        """Of the two runs, in their order."""
        return Supervision.NONE, Supervision.NONSTOP if self.nonstop else Supervision.STOPPING

    def __post_init__(self) -> None:
        for name in ("mass", "load_at", "seconds", "speed"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise StaderaError(f"the demo's {name} must be positive, got {getattr(self, name)}")
        if not self.load_at < self.seconds:
            raise StaderaError(f"the box is let go at {self.load_at} s, and the demo ends at {self.seconds} s")
        if self.seed < 0:
            raise StaderaError(f"a seed needs to be at least 0, got {self.seed}")


@dataclass(frozen=True, eq=False)
class DemoRun:
    """One of the two runs: how it went, and its pictures."""

    outcome: LoadedWalkOutcome
    film: Film

    @property
    def name(self) -> str:
        """What is made of the load."""
        return str(self.outcome.case.supervision)


@dataclass(frozen=True, eq=False)
class DemoResult:
    """Both runs, in the order of `DemoSettings.supervisions`."""

    settings: DemoSettings
    without: DemoRun
    identified: DemoRun

    @property
    def runs(self) -> tuple[DemoRun, DemoRun]:
        """Both."""
        return self.without, self.identified

    def to_dict(self) -> dict[str, Any]:
        """The JSON of `stadera demo` as plain values."""
        from stadera.lab.demo.schema import demo_dict

        return demo_dict(self)


def run_demo(settings: DemoSettings | None = None, progress: Progress | None = None) -> DemoResult:
    """Both runs at once, in processes of their own.

    Processes are started afresh (spawned), so a script that gets here needs the usual `if __name__ == "__main__"`.

    Raises:
        StaderaError: a run could not be made.
    """
    settings, context = settings or DemoSettings(), multiprocessing.get_context("spawn")
    ways = settings.supervisions
    with context.Manager() as manager, ProcessPoolExecutor(len(ways), context) as pool:
        messages = manager.Queue()
        futures = [pool.submit(_run, settings, way, messages) for way in ways]
        _report(messages, futures, progress)
        runs = [future.result() for future in futures]
    for run in runs:
        if isinstance(run, str):
            raise StaderaError(run)
    return DemoResult(settings, *runs)  # type: ignore[arg-type]


def one_run(settings: DemoSettings, supervision: Supervision, progress: Progress | None = None) -> DemoRun:
    """One of the two runs, in this process.

    Raises:
        StaderaError: it could not be made.
    """
    robot = load_robot(settings.robot)
    box = box_at(robot, _CORNER, settings.mass, _BOX)
    case = LoadedWalkCase(
        robot=settings.robot,
        payload=box,
        load_at=settings.load_at,
        supervision=supervision,
        seconds=settings.seconds,
        speed=settings.speed,
        seed=settings.seed,
    )
    walk, camera, name = LoadedWalk(case), Camera(robot), str(supervision)
    periods = 0

    def watch(walk: LoadedWalk) -> None:
        nonlocal periods
        camera.look(walk)
        if progress and periods % _TELL_EVERY == 0:
            doing = str(walk.crawl.phase if walk.supervisor is None else walk.supervisor.state)
            progress(name, walk.bed.plant.time / settings.seconds, doing)
        periods += 1

    outcome = walk.run(watch)
    if progress:
        progress(name, 1.0, "fallen" if outcome.fall else "done")
    return DemoRun(outcome, camera.film())


def _run(settings: DemoSettings, way: Supervision, messages: Queue[Message]) -> DemoRun | str:
    """The run, or what went wrong, as text: not every error survives the way between processes."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):  # two runs, two cores
        try:
            return one_run(settings, way, lambda *message: messages.put(message))
        except StaderaError as error:
            return str(error)


def _report(messages: Queue[Message], futures: list[Future[DemoRun | str]], progress: Progress | None) -> None:
    """Passes on what the processes tell, until they are done."""
    while True:
        try:
            message = messages.get(timeout=_POLL)
        except queue.Empty:
            if all(future.done() for future in futures):
                return
            continue
        if progress:
            progress(*message)
