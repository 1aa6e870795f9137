"""A robot that nobody loads: it stands, sets out, walks, turns, stops and sways as drawn. Each change of load
that the walking estimator names is a false alarm.
"""

from __future__ import annotations

import zlib
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from stadera.control import Trot, TrunkController
from stadera.control.crawl import Crawl
from stadera.control.crawl_run import WalkJudge, walk
from stadera.control.stand import Controller
from stadera.experiments.motion import Gait, RobotInMotion, fastest_trot, sway, walk_on
from stadera.robot import load_robot

Array = NDArray[np.float64]

Doing = Literal["standing", "start", "steady", "turning", "stop", "shaking"]

DOING: tuple[Doing, ...] = ("standing", "start", "steady", "turning", "stop", "shaking")
"""What a schedule is made of; to start and to stop are counted from the command on."""

_HOLD = 2  # periods for which torques are held; sensors and estimator are at 1 kHz all the same
_LOOKS = 0.02  # s, from one look at what the robot does to the next
_START, _STOP = 1.0, 1.5  # s
_TROT_TURN = 0.4  # rad/s
_CRAWL_SPEED, _CRAWL_TURN = 0.1, 0.1  # m/s, rad/s
_SLOWER = 2.0  # times as long a crawl takes for everything


@dataclass(frozen=True)
class AlarmCase:
    """A run.

    Attributes:
        robot: its name.
        gait: crawl, trot or shake.
        errors: of the sensors, a named set.
        seed: of sensors and commands.
        seconds: simulated; a shorter run is the beginning of a longer one.
    """

    robot: str
    gait: Gait
    errors: str
    seed: int
    seconds: float = 60.0


@dataclass(frozen=True)
class Stage:
    """One command.

    Attributes:
        doing: what it is.
        seconds: for how long.
        ahead: share of the fastest speed, 0 to 1.
        turn: share of the fastest turn, -1 to 1, to the left.
        amplitude: of a shake.
    """

    doing: Doing
    seconds: float
    ahead: float = 0.0
    turn: float = 0.0
    amplitude: float = 0.0


def schedule(gait: Gait, rng: np.random.Generator) -> Iterator[Stage]:
    """Commands without end, as drawn: stand, set out, go on in some way or other, stop, and again.

    A trot's stands are used for a shake now and then; a crawl takes its time.
    """
    slower = _SLOWER if gait == "crawl" else 1.0
    yield Stage("standing", rng.uniform(0.3, 2.0))
    while True:
        if gait == "shake":
            yield from _shake(rng)
            continue
        ahead, turn = rng.uniform(0.0, 1.0), rng.uniform(-0.5, 0.5)
        yield Stage("start", _START * slower, ahead, turn)
        for _ in range(rng.integers(1, 4)):
            if rng.uniform() < 0.5:
                yield Stage("turning", rng.uniform(2.0, 4.0) * slower, ahead, rng.choice((-1.0, 1.0)))
            ahead = rng.uniform(0.0, 1.0)
            yield Stage("steady", rng.uniform(2.0, 5.0) * slower, ahead, 0.0)
        yield Stage("stop", _STOP * slower)
        yield Stage("standing", rng.uniform(0.5, 2.0))
        if gait == "trot" and rng.uniform() < 0.3:
            yield from _shake(rng)


def _shake(rng: np.random.Generator) -> Iterator[Stage]:
    yield Stage("shaking", rng.uniform(2.0, 6.0), amplitude=rng.uniform(0.3, 1.0))
    yield Stage("stop", _STOP)
    yield Stage("standing", rng.uniform(0.5, 2.0))


def watch(case: AlarmCase) -> dict[str, Any]:
    """What was named in a run without a load.

    `fell`: None, or how. `seconds`: simulated, by what the robot did. `stepped`: seconds of feet being lifted and put
    down. `alarms`: every change named: `time` about which it is to have been, when it was `noticed`, what the robot
    was `doing` then, and by how much the `mass` is to have changed, as a share of the robot's. `halts`: when and why
    a crawl stopped by itself. `share_of_time`: the estimator's processor time in the simulated time.
    """
    run = _Run(case)
    run.go()
    time = run.motion.bed.plant.time
    return {
        "fell": None if run.judge.fall is None else run.judge.fall.how,
        "seconds": dict(run.seconds),
        "stepped": run.stepped,
        "alarms": [run.alarm(change.time, change.noticed, change.mass) for change in run.motion.inner.changes],
        "halts": run.halts,
        "share_of_time": run.motion.cost / max(time, 1e-3),
    }


class _Run:
    """A robot that does as its schedule says."""

    def __init__(self, case: AlarmCase) -> None:
        self.case, self.robot = case, load_robot(case.robot)
        draw = zlib.crc32(f"{case.robot} {case.gait} {case.errors} {case.seed}".encode())
        self.motion = RobotInMotion(self.robot, case.gait, case.errors, draw, _HOLD)
        self.judge = WalkJudge(self.motion.bed.plant)
        self.seconds: dict[Doing, float] = defaultdict(float)
        self.stepped = 0.0
        self.halts: list[dict[str, Any]] = []
        self._did: list[tuple[float, Doing]] = []
        self._stages = schedule(case.gait, np.random.default_rng(draw))

    def go(self) -> None:
        """Until the time is up or the robot has fallen."""
        controller, plant = self.motion.controller, self.motion.bed.plant
        for stage in self._stages:
            if self._did:  # a controller takes commands from its first update on
                command(controller, stage)
            end = min(plant.time + stage.seconds, self.case.seconds)
            while plant.time < end - 0.5 * _LOOKS:
                self._look(stage)
                if walk(self.motion.bed, _LOOKS, self.judge) is not None:
                    return
            if plant.time >= self.case.seconds - _LOOKS:
                return

    def _look(self, stage: Stage) -> None:
        controller, doing = self.motion.controller, stage.doing
        stepping = steps(controller)
        if isinstance(controller, Crawl) and controller.failed and not stepping:
            doing = "standing"
            halt = {"time": controller.events[-1].time, "reason": controller.reason}
            if halt not in self.halts:
                self.halts.append(halt)
        self._did.append((self.motion.bed.plant.time, doing))
        self.seconds[doing] += _LOOKS
        self.stepped += _LOOKS * stepping

    def alarm(self, time: float, noticed: float, mass: float) -> dict[str, Any]:
        """A change named, and what the robot was doing when it is to have been."""
        doing = [doing for begin, doing in self._did if begin <= time] or ["standing"]
        return {"time": time, "noticed": noticed, "doing": doing[-1], "mass": mass / self.robot.mass}


def steps(controller: Controller) -> bool:
    """Whether it lifts feet and puts them down."""
    if isinstance(controller, Trot):
        return controller.stepping
    return isinstance(controller, Crawl) and controller.leg is not None


def command(controller: Controller, stage: Stage) -> None:
    """Tells the controller of a stage; a trot that has not come to rest yet does not shake."""
    if isinstance(controller, Trot | Crawl) and stage.doing in ("start", "steady", "turning"):
        if isinstance(controller, Crawl) and controller.failed and stage.doing != "start":
            return  # it stands until the next start
        speed, turn = _fastest(controller)
        walk_on(controller, speed * stage.ahead, turn * stage.turn)
    elif isinstance(controller, Trot) and steps(controller):
        controller.stop()
    elif isinstance(controller, Crawl):
        controller.request_stop("the schedule says so")
    else:
        trunk = controller.controller if isinstance(controller, Trot) else controller
        if isinstance(trunk, TrunkController):
            _stand(trunk, stage)


def _stand(controller: TrunkController, stage: Stage) -> None:
    if stage.doing == "shaking":
        sway(controller, stage.amplitude)
    elif stage.doing == "stop":
        controller.move(controller.reference.moved(np.zeros(3), np.zeros(3)), 0.7 * stage.seconds)


def _fastest(controller: Trot | Crawl) -> tuple[float, float]:
    """Speed [m/s] and turn [rad/s]; a trot's speed grows with the root of the legs' length."""
    if isinstance(controller, Trot):
        return fastest_trot(controller), _TROT_TURN
    return _CRAWL_SPEED, _CRAWL_TURN
