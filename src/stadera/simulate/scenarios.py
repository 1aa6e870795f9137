"""The scenarios, by name. A new one is a function that lists its events, and an entry here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from stadera.control.reference import TrunkPose
from stadera.control.stand import TestBed
from stadera.errors import UnknownNameError
from stadera.estimate.static_poses import static_poses
from stadera.robot.model import Robot
from stadera.simulate.settings import Load

_LOAD_SHARE = 0.1  # of the robot's mass, of a scenario's own load
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


Script = Callable[[Robot, "Load | None", float], Sequence[Event]]
"""Events of a run of a robot with a load (None: as asked) and a duration [s]."""


@dataclass(frozen=True)
class Scenario:
    """A kind of run.

    Attributes:
        summary: one line.
        duration: [s], unless asked for otherwise.
        slope: [rad], likewise.
        script: what happens.
    """

    summary: str
    duration: float
    script: Script
    slope: float = 0.0


def _stand(robot: Robot, load: Load | None, duration: float) -> Sequence[Event]:
    return [] if load is None else [_put_on(robot, load, 0.0)]


def _stand_load(robot: Robot, load: Load | None, duration: float) -> Sequence[Event]:
    return [_put_on(robot, load or Load(round(_LOAD_SHARE * robot.mass, 2)), 0.4 * duration)]


def _poses(robot: Robot, load: Load | None, duration: float) -> Sequence[Event]:
    """Level, then every pose of `static_poses` relative to where the trunk is first, evenly over the duration."""
    poses = static_poses(robot)
    each = duration / len(poses)
    events = list(_stand(robot, load, duration))
    nominal: list[TrunkPose] = []

    def remember(bed: TestBed) -> None:
        nominal.append(bed.controller.reference)

    events.append(Event(0.5 * each, remember))
    for k, (_, pose) in enumerate(pairwise(poses), start=1):

        def move(bed: TestBed, shift: np.ndarray = pose.shift, turn: np.ndarray = pose.turn) -> None:
            start = nominal[0]
            bed.controller.move(start.moved(start.rotation @ shift, turn), _MOVING * each)

        events.append(Event(k * each, move))
    return events


def _put_on(robot: Robot, load: Load, time: float) -> Event:
    payload = load.payload(robot)
    return Event(time, lambda bed: bed.plant.apply_payload(payload))


SCENARIOS: Mapping[str, Scenario] = MappingProxyType(
    {
        "stand": Scenario("stands still, with --load from the beginning", 8.0, _stand),
        "stand-load": Scenario(
            "stands still; a load (10 % of its mass) is put on after 40 % of the time", 12.0, _stand_load
        ),
        "poses": Scenario("holds eleven poses of the trunk, as the method 'poses' wants them", 33.0, _poses),
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
