"""The scenarios, by name. A new one is a function that lists its events, and an entry here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from stadera.control.crawl import Crawl
from stadera.control.crawl_settings import CrawlCommand
from stadera.control.reference import TrunkPose
from stadera.control.shake import Shake
from stadera.control.stand import Controller, TestBed
from stadera.control.trot import Trot
from stadera.control.trunk import TrunkController
from stadera.errors import StaderaError, UnknownNameError
from stadera.estimate.static_poses import static_poses
from stadera.estimate.trunk import TrunkModel
from stadera.robot.model import Robot
from stadera.simulate.settings import Load, SimulateSettings

_LOAD_SHARE = 0.1  # of the robot's mass, of a scenario's own load
_TROT_SPEED, _CRAWL_SPEED = 0.3, 0.1  # m/s
_OVER_STONES = 0.02  # m, by which a crawling foot clears the highest stone next to the lowest
_STILL = 0.3  # s, of standing before a motion begins
_MOVING = 0.4  # share of the time for a pose, that the way there takes


@dataclass(frozen=True, eq=False)
class Event:
    """Something that happens once.

    Attributes:
        time: [s], from the start.
        act: done to the test-bed at that time.
    """

    time: float
    act: Callable[[TestBed], None]


Script = Callable[[Robot, SimulateSettings, float], Sequence[Event]]
"""Events of a run of a robot, as asked for, and a duration [s]."""

ControllerOf = Callable[[Robot, TrunkModel], Controller]
"""A controller for the robot that is believed in, with a belief of its trunk to begin with."""


def _standing(robot: Robot, belief: TrunkModel) -> Controller:
    return TrunkController(robot, belief=belief)


def _crawling(robot: Robot, belief: TrunkModel) -> Controller:
    return Crawl(TrunkController(robot, belief=belief))


@dataclass(frozen=True)
class Scenario:
    """A kind of run.

    Attributes:
        summary: one line.
        duration: [s], unless asked for otherwise.
        slope: [rad], likewise.
        script: what happens.
        controller: what it stands or walks by.
    """

    summary: str
    duration: float
    script: Script
    slope: float = 0.0
    controller: ControllerOf = _standing


def _stand(robot: Robot, settings: SimulateSettings, duration: float) -> Sequence[Event]:
    return loaded(robot, settings, 0.0)


def _stand_load(robot: Robot, settings: SimulateSettings, duration: float) -> Sequence[Event]:
    return [_put_on(robot, settings, 0.4 * duration)]


def _poses(robot: Robot, settings: SimulateSettings, duration: float) -> Sequence[Event]:
    """Level, then every pose of `static_poses` relative to where the trunk is first, evenly over the duration."""
    poses = static_poses(robot)
    each = duration / len(poses)
    events = list(_stand(robot, settings, duration))
    nominal: list[TrunkPose] = []

    def remember(bed: TestBed) -> None:
        nominal.append(trunk_controller_of(bed).reference)

    events.append(Event(0.5 * each, remember))
    for k, (_, pose) in enumerate(pairwise(poses), start=1):

        def move(bed: TestBed, shift: np.ndarray = pose.shift, turn: np.ndarray = pose.turn) -> None:
            start = nominal[0]
            trunk_controller_of(bed).move(start.moved(start.rotation @ shift, turn), _MOVING * each)

        events.append(Event(k * each, move))
    return events


def _trot(robot: Robot, settings: SimulateSettings, duration: float) -> Sequence[Event]:
    speed = _TROT_SPEED if settings.speed is None else settings.speed

    def walk(bed: TestBed) -> None:
        trot_of(bed).walk((speed, 0.0), settings.turn)

    return [Event(_STILL, walk), *loaded(robot, settings, 0.4 * duration)]


def _trot_load(robot: Robot, settings: SimulateSettings, duration: float) -> Sequence[Event]:
    start, *_ = _trot(robot, settings, duration)
    return [start, _put_on(robot, settings, 0.4 * duration)]


def _shake(robot: Robot, settings: SimulateSettings, duration: float) -> Sequence[Event]:
    def shake(bed: TestBed) -> None:
        controller = trunk_controller_of(bed)
        controller.follow(Shake.of(controller.robot, controller.reference, controller.time, settings.amplitude))

    return [Event(_STILL, shake), *loaded(robot, settings, 0.4 * duration)]


def _shake_load(robot: Robot, settings: SimulateSettings, duration: float) -> Sequence[Event]:
    start, *_ = _shake(robot, settings, duration)
    return [start, _put_on(robot, settings, 0.4 * duration)]


def _crawl(robot: Robot, settings: SimulateSettings, duration: float) -> Sequence[Event]:
    speed = _CRAWL_SPEED if settings.speed is None else settings.speed

    def walk(bed: TestBed) -> None:
        crawl = crawl_of(bed)
        clearance = max(crawl.settings.clearance, 2.0 * settings.stones + _OVER_STONES if settings.stones else 0.0)
        crawl.settings = replace(crawl.settings, clearance=clearance)
        crawl.command = CrawlCommand(speed, settings.turn)
        crawl.resume()

    return [Event(_STILL, walk), *loaded(robot, settings, 0.4 * duration)]


def _crawl_load(robot: Robot, settings: SimulateSettings, duration: float) -> Sequence[Event]:
    start, *_ = _crawl(robot, settings, duration)
    return [start, _put_on(robot, settings, 0.4 * duration)]


def loaded(robot: Robot, settings: SimulateSettings, time: float) -> Sequence[Event]:
    """The load that was asked for, if any, put on at the time asked for, else at this one [s]."""
    return [] if settings.load is None else [_put_on(robot, settings, time)]


def _put_on(robot: Robot, settings: SimulateSettings, time: float) -> Event:
    payload = (settings.load or Load(round(_LOAD_SHARE * robot.mass, 2))).payload(robot)
    when = time if settings.load_time is None else settings.load_time
    return Event(when, lambda bed: bed.plant.apply_payload(payload))


def trunk_controller_of(bed: TestBed) -> TrunkController:
    """The trunk controller that a test-bed stands or walks by."""
    controller = bed.controller
    if isinstance(controller, TrunkController):
        return controller
    inner = getattr(controller, "controller", None)
    if not isinstance(inner, TrunkController):
        raise StaderaError(f"a {type(controller).__name__} has no trunk controller")
    return inner


def trot_of(bed: TestBed) -> Trot:
    """The trot that a test-bed walks by."""
    if not isinstance(bed.controller, Trot):
        raise StaderaError(f"the test-bed does not trot, its controller is a {type(bed.controller).__name__}")
    return bed.controller


def crawl_of(bed: TestBed) -> Crawl:
    """The crawl that a test-bed walks by."""
    if not isinstance(bed.controller, Crawl):
        raise StaderaError(f"the test-bed does not crawl, its controller is a {type(bed.controller).__name__}")
    return bed.controller


SCENARIOS: Mapping[str, Scenario] = MappingProxyType(
    {
        "stand": Scenario("stands still, with --load from the beginning", 8.0, _stand),
        "stand-load": Scenario(
            "stands still; a load (10 % of its mass) is put on after 40 % of the time", 12.0, _stand_load
        ),
        "poses": Scenario("holds eleven poses of the trunk, as the method 'poses' wants them", 33.0, _poses),
        "trot": Scenario("trots at 0.3 m/s, with --load after 40 % of the time", 8.0, _trot, controller=Trot.of),
        "trot-load": Scenario(
            "trots; a load (10 % of its mass) is put on after 40 % of the time", 8.0, _trot_load, controller=Trot.of
        ),
        "crawl": Scenario("crawls at 0.1 m/s, with --load after 40 % of the time", 12.0, _crawl, controller=_crawling),
        "crawl-load": Scenario(
            "crawls; a load (10 % of its mass) is put on after 40 % of the time",
            12.0,
            _crawl_load,
            controller=_crawling,
        ),
        "shake": Scenario("stands with a small motion of the body, with --load after 40 % of the time", 8.0, _shake),
        "shake-load": Scenario(
            "stands with a small motion; a load (10 % of its mass) is put on after 40 % of the time", 8.0, _shake_load
        ),
        "ramp": Scenario("stands still on a ramp that rises by 10°", 8.0, _stand, float(np.deg2rad(10.0))),
    }
)
"""By name."""


def scenario_named(name: str) -> Scenario:
    """The scenario of that name.

    Raises:
        UnknownNameError: there is none.
    """
    if name not in SCENARIOS:
        raise UnknownNameError("scenario", name, SCENARIOS)
    return SCENARIOS[name]
