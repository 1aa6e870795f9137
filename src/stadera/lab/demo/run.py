"""The demo: the same walk twice, in parallel, without and with identification.

HyQ crawls, and a heavy box is dropped onto a corner of its back. Both runs have the same controller, planner, sensors,
errors and box. In one of them a supervisor has the load weighed, and passes the estimated trunk to controller and
planner: while walking or, as in the paper, at rest.
"""

from __future__ import annotations

import multiprocessing
import queue
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from queue import Queue
from typing import Any

from stadera.errors import StaderaError, require_known, require_positive
from stadera.lab.demo.film import Camera, Film
from stadera.lab.experiments.loaded_walk import (
    CORNERS,
    LoadedWalk,
    LoadedWalkCase,
    LoadedWalkOutcome,
    Supervision,
    WalkOutcome,
    box_at,
)
from stadera.robot import load_robot

Progress = Callable[[str, float, str], None]
"""Called with a run's name, its progress (0 to 1), and the robot's activity."""

Message = tuple[str, float, str]


@dataclass(frozen=True)
class DemoSettings:
    """Settings of the demo."""

    robot: str = "hyq"
    mass: float = 30.0  # of the box [kg]
    corner: str = "LF"  # of the back, onto which it is dropped
    size: tuple[float, float, float] = (0.14, 0.14, 0.2)  # of the box [m]
    height: float = 0.02  # above the back, from which it is dropped [m]
    load_at: float = 3.5  # time of the drop [s]; by default while the right-hind leg swings
    seconds: float | None = None  # of each run; None for 10, or 14 if the robot stops to weigh
    after_fall: float = 1.5  # time for which a fallen robot is recorded, with its drives braking [s]
    speed: float = 0.12  # [m/s]
    seed: int = 0  # of the sensors' errors
    classic: bool = False  # stop and weigh at rest, as in the paper, instead of weighing while walking

    @property
    def supervisions(self) -> tuple[Supervision, Supervision]:
        """Supervision of the two runs, in their order."""
        return Supervision.NONE, Supervision.STOPPING if self.classic else Supervision.NONSTOP

    @property
    def duration(self) -> float:
        """Duration of each run [s]."""
        return self.seconds or (14.0 if self.classic else 10.0)

    def __post_init__(self) -> None:
        require_positive("the demo's", self, ("mass", "load_at", "duration", "speed", "height", "after_fall"))
        require_known("corner", (self.corner,), CORNERS)
        if not self.load_at < self.duration:
            raise StaderaError(f"the box is let go at {self.load_at} s, and the demo ends at {self.duration} s")
        if self.seed < 0:
            raise StaderaError(f"a seed needs to be at least 0, got {self.seed}")


@dataclass(frozen=True, eq=False)
class DemoRun:
    """One of the two runs: its outcome and its frames."""

    outcome: LoadedWalkOutcome
    film: Film

    @property
    def name(self) -> str:
        return str(self.outcome.case.supervision)


@dataclass(frozen=True, eq=False)
class DemoResult:
    """Both runs, in the order of `DemoSettings.supervisions`."""

    settings: DemoSettings
    without: DemoRun
    identified: DemoRun

    @property
    def runs(self) -> tuple[DemoRun, DemoRun]:
        return self.without, self.identified

    def to_dict(self) -> dict[str, Any]:
        """Plain values: the JSON of `stadera demo`."""
        from stadera.lab.demo.schema import demo_dict

        return demo_dict(self)


def run_demo(settings: DemoSettings | None = None, progress: Progress | None = None) -> DemoResult:
    """Makes both runs in parallel, in spawned processes: a script needs the usual `if __name__ == "__main__"`."""
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
    """Makes one of the two runs in this process."""
    robot = load_robot(settings.robot)
    box = box_at(robot, settings.corner, settings.mass, settings.size, settings.height)
    case = LoadedWalkCase(
        robot=settings.robot,
        payload=box,
        load_at=settings.load_at,
        supervision=supervision,
        seconds=settings.duration,
        speed=settings.speed,
        seed=settings.seed,
    )
    walk, camera, name = LoadedWalk(case), Camera(), str(supervision)
    periods = 0

    def watch(walk: LoadedWalk) -> None:
        nonlocal periods
        camera.look(walk)
        if progress and periods % 100 == 0:
            doing = str(walk.crawl.phase if walk.supervisor is None else walk.supervisor.state)
            progress(name, walk.bed.plant.time / settings.duration, doing)
        periods += 1

    outcome = walk.run(watch)
    if outcome.verdict.outcome is WalkOutcome.FELL:
        _lie_down(walk, camera, settings.after_fall)
    if progress:
        progress(name, 1.0, str(outcome.verdict.outcome))
    return DemoRun(outcome, camera.film())


def _lie_down(walk: LoadedWalk, camera: Camera, seconds: float) -> None:
    """Records the robot after a fall, when the outcome is known, with its drives braking."""
    walk.give_up("it has fallen")
    for _ in range(round(seconds / walk.bed.plant.timestep)):
        walk.step()
        camera.look(walk)


def _run(settings: DemoSettings, way: Supervision, messages: Queue[Message]) -> DemoRun | str:
    """Makes the run; returns an error as text, since not every exception can be passed between processes."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):  # two runs, two cores
        try:
            return one_run(settings, way, lambda *message: messages.put(message))
        except StaderaError as error:
            return str(error)


def _report(messages: Queue[Message], futures: list[Future[DemoRun | str]], progress: Progress | None) -> None:
    """Passes on the processes' messages until they are done."""
    while True:
        try:
            message = messages.get(timeout=0.1)
        except queue.Empty:
            if all(future.done() for future in futures):
                return
            continue
        if progress:
            progress(*message)
