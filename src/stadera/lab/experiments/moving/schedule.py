"""An unloaded robot that stands, sets out, walks, turns, stops and sways at random; reported loads are false alarms."""

from __future__ import annotations

import zlib
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from stadera.lab.control import Trot, TrunkController
from stadera.lab.control.crawl.crawl import Crawl
from stadera.lab.control.crawl.run import WalkMonitor, walk
from stadera.lab.control.stand import Controller
from stadera.lab.experiments.moving.motion import Gait, RobotInMotion, fastest_trot, sway, walk_on
from stadera.robot import load_robot

Doing = Literal["standing", "start", "steady", "turning", "stop", "shaking"]

DOING: tuple[Doing, ...] = ("standing", "start", "steady", "turning", "stop", "shaking")
"""Parts of a schedule; start and stop are counted from the command on."""


@dataclass(frozen=True)
class ScheduleSettings:
    """Settings of the robot's motion in the study."""

    start: float = 1.0  # time for it [s]
    stop: float = 1.5  # time for it [s]
    slower: float = 2.0  # factor on all times for a crawl
    trot_turn: float = 0.4  # the fastest [rad/s]
    crawl_speed: float = 0.1  # the fastest [m/s]
    crawl_turn: float = 0.1  # the fastest [rad/s]
    looks: float = 0.02  # interval for evaluating the robot's activity [s]
    hold: int = 2  # periods for which torques are held; sensors and estimator run at 1 kHz all the same


_HOW = ScheduleSettings()


@dataclass(frozen=True)
class AlarmCase:
    """Settings of one run."""

    robot: str
    gait: Gait  # crawl, trot or shake
    errors: str  # of the sensors, a named set
    seed: int  # of sensors and commands
    seconds: float = 60.0  # simulated time; a shorter run is the beginning of a longer one


@dataclass(frozen=True)
class Activity:
    """One part of a schedule."""

    doing: Doing  # kind of activity
    seconds: float  # duration
    ahead: float = 0.0  # share of the fastest speed, 0 to 1
    turn: float = 0.0  # share of the fastest turn, -1 to 1, to the left
    amplitude: float = 0.0  # of a shake


def schedule(gait: Gait, rng: np.random.Generator) -> Iterator[Activity]:
    """Yields random activities without end; a trot sometimes shakes when it stands, a crawl takes longer."""
    slower = _HOW.slower if gait == "crawl" else 1.0
    yield Activity("standing", rng.uniform(0.3, 2.0))
    while True:
        if gait == "shake":
            yield from _shake(rng)
            continue
        ahead, turn = rng.uniform(0.0, 1.0), rng.uniform(-0.5, 0.5)
        yield Activity("start", _HOW.start * slower, ahead, turn)
        for _ in range(rng.integers(1, 4)):
            if rng.uniform() < 0.5:
                yield Activity("turning", rng.uniform(2.0, 4.0) * slower, ahead, rng.choice((-1.0, 1.0)))
            ahead = rng.uniform(0.0, 1.0)
            yield Activity("steady", rng.uniform(2.0, 5.0) * slower, ahead, 0.0)
        yield Activity("stop", _HOW.stop * slower)
        yield Activity("standing", rng.uniform(0.5, 2.0))
        if gait == "trot" and rng.uniform() < 0.3:
            yield from _shake(rng)


def _shake(rng: np.random.Generator) -> Iterator[Activity]:
    yield Activity("shaking", rng.uniform(2.0, 6.0), amplitude=rng.uniform(0.3, 1.0))
    yield Activity("stop", _HOW.stop)
    yield Activity("standing", rng.uniform(0.5, 2.0))


def watch(case: AlarmCase) -> dict[str, Any]:
    """Changes of load reported in a run without a load.

    `fell`: None, or a description. `seconds`: simulated time by activity. `stepped`: time in seconds in which feet were
    lifted and put down. `alarms`: every reported change: its `time`, when it was `noticed`, the robot's activity
    `doing` at that time, and its `mass` as a share of the robot's. `halts`: when and why a crawl stopped unasked.
    `share_of_time`: the estimator's processor time divided by the simulated time.
    """
    run = _ScheduledRun(case)
    run.go()
    time = run.motion.bed.plant.time
    return {
        "fell": None if run.monitor.fall is None else run.monitor.fall.how,
        "seconds": dict(run.seconds),
        "stepped": run.stepped,
        "alarms": [run.alarm(change.time, change.noticed, change.mass) for change in run.motion.inner.changes],
        "halts": run.halts,
        "share_of_time": run.motion.cost / max(time, 1e-3),
    }


class _ScheduledRun:
    """A robot that follows its schedule."""

    def __init__(self, case: AlarmCase) -> None:
        self.case, self.robot = case, load_robot(case.robot)
        draw = zlib.crc32(f"{case.robot} {case.gait} {case.errors} {case.seed}".encode())
        self.motion = RobotInMotion(self.robot, case.gait, case.errors, draw, _HOW.hold)
        self.monitor = WalkMonitor(self.motion.bed.plant)
        self.seconds: dict[Doing, float] = defaultdict(float)
        self.stepped = 0.0
        self.halts: list[dict[str, Any]] = []
        self._did: list[tuple[float, Doing]] = []
        self._schedule = schedule(case.gait, np.random.default_rng(draw))

    def go(self) -> None:
        controller, plant = self.motion.controller, self.motion.bed.plant
        for activity in self._schedule:
            if self._did:  # a controller accepts commands after its first update
                command(controller, activity)
            end = min(plant.time + activity.seconds, self.case.seconds)
            while plant.time < end - 0.5 * _HOW.looks:
                self._look(activity)
                if walk(self.motion.bed, _HOW.looks, self.monitor) is not None:
                    return
            if plant.time >= self.case.seconds - _HOW.looks:
                return

    def _look(self, activity: Activity) -> None:
        controller, doing = self.motion.controller, activity.doing
        stepping = steps(controller)
        if isinstance(controller, Crawl) and controller.failed and not stepping:
            doing = "standing"
            halt = {"time": controller.events[-1].time, "reason": controller.reason}
            if halt not in self.halts:
                self.halts.append(halt)
        self._did.append((self.motion.bed.plant.time, doing))
        self.seconds[doing] += _HOW.looks
        self.stepped += _HOW.looks * stepping

    def alarm(self, time: float, noticed: float, mass: float) -> dict[str, Any]:
        """A reported change, and the robot's activity at its time."""
        doing = [doing for begin, doing in self._did if begin <= time] or ["standing"]
        return {"time": time, "noticed": noticed, "doing": doing[-1], "mass": mass / self.robot.mass}


def steps(controller: Controller) -> bool:
    """True if it lifts feet and puts them down."""
    if isinstance(controller, Trot):
        return controller.stepping
    return isinstance(controller, Crawl) and controller.leg is not None


def command(controller: Controller, activity: Activity) -> None:
    """Commands an activity; a trot that has not come to rest yet does not shake."""
    if isinstance(controller, Crawl):
        _command_crawl(controller, activity)
    elif isinstance(controller, Trot):
        if activity.doing in _WALKED:
            walk_on(controller, fastest_trot(controller) * activity.ahead, _HOW.trot_turn * activity.turn)
        elif controller.stepping:
            controller.stop()
        else:
            _stand(controller.controller, activity)
    elif isinstance(controller, TrunkController):
        _stand(controller, activity)


_WALKED = ("start", "steady", "turning")


def _command_crawl(crawl: Crawl, activity: Activity) -> None:
    if activity.doing not in _WALKED:
        crawl.request_stop("the schedule says so")
    elif not crawl.failed or activity.doing == "start":  # one that has failed stands until the next start
        walk_on(crawl, _HOW.crawl_speed * activity.ahead, _HOW.crawl_turn * activity.turn)


def _stand(controller: TrunkController, activity: Activity) -> None:
    if activity.doing == "shaking":
        sway(controller, activity.amplitude)
    elif activity.doing == "stop":
        controller.move(controller.reference.moved(np.zeros(3), np.zeros(3)), 0.7 * activity.seconds)
