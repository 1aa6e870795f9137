"""Settings of a simulated run, and the catalogue of scenarios: each is a function that lists its events."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from types import MappingProxyType
from typing import Literal, TypeVar

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import StaderaError, UnknownNameError, positive
from stadera.lab.control.arms import Arms, ArmTorques
from stadera.lab.control.crawl import Crawl
from stadera.lab.control.played import Played
from stadera.lab.control.reference import Shake, TrunkPose
from stadera.lab.control.stand import Controller, Gait, TestBed
from stadera.lab.control.stepping import Stepping
from stadera.lab.control.steps import CrawlCommand
from stadera.lab.control.trot import Trot
from stadera.lab.control.trunk import TrunkController
from stadera.lab.control.whole_body import WholeBody
from stadera.lab.laws.static_poses import static_poses
from stadera.lab.plant.payload import OutsideForce, Payload, RigidMass, VirtualForce
from stadera.lab.plant.sensors import ERROR_SETS, SensorErrors
from stadera.lab.plant.whole import on_link
from stadera.lab.reality.draw import REAL_SETS, RealSizes
from stadera.logs.recording import Recording
from stadera.robot.model import Robot
from stadera.robot.shapes import FLAT
from stadera.trunk.model import TrunkBounds


@dataclass(frozen=True)
class Load:
    """A load on the trunk, or on another link."""

    amount: float  # positive
    # "kg" for a rigid cube of 10 cm fixed to the trunk; "N" for the paper's virtual force, without inertia
    unit: Literal["kg", "N"] = "kg"
    # [m], of its centre in the frame of what it is on; None for that frame's origin, on the trunk for a quarter of the
    # feet's rectangle behind and to the left of the middle, at the height of the hips
    at: tuple[float, float, float] | None = None
    on: str | None = None  # link or frame of the model; None for the trunk

    def __post_init__(self) -> None:
        positive("a load", self.amount, self.unit)
        if self.unit not in ("kg", "N"):
            raise StaderaError(f"a load is in kg or N, got {self.unit!r}")
        if self.at is not None and not np.isfinite(self.at).all():
            raise StaderaError(f"a load's place must be three finite numbers, got {self.at}")
        if self.on is not None and self.unit == "N":
            raise StaderaError("a virtual force is on the trunk; a load on a link is in kg")

    def payload(self, robot: Robot) -> Payload:
        """Converts it to a payload of the test-bed."""
        size = (0.1, 0.1, 0.1)
        if self.on is not None:
            link, rotation, origin = on_link(robot, self.on)
            x, y, z = (rotation @ np.asarray(self.at or (0.0, 0.0, 0.0)) + origin).tolist()
            return RigidMass.box(self.amount, size, (x, y, z), link if link != robot.trunk else None)
        bounds = TrunkBounds.of(robot)
        middle, half = 0.5 * (bounds.low + bounds.high), 0.5 * (bounds.high - bounds.low)
        at = self.at or (float(middle[0] - 0.5 * half[0]), float(middle[1] + 0.5 * half[1]), float(middle[2]))
        return VirtualForce(self.amount, at) if self.unit == "N" else RigidMass.box(self.amount, size, at)


@dataclass(frozen=True)
class SimulateSettings:
    """Settings of a run."""

    # ideal, standard or harsh, of the sensors; or real, real-unit-gain: of robot, sensors and ground
    errors: str = "standard"
    load: Load | None = None  # None for the scenario's own
    slope: float | None = None  # of the ground [rad]; None for the scenario's own, or with real errors the drawn one
    duration: float | None = None  # [s]; None for the scenario's own
    # of the log [Hz]; the test-bed itself runs at 1 kHz, and the log keeps every n-th sample. None for 250 Hz, or with
    # real errors the drawn one.
    rate: float | None = None
    seed: int = 0  # of all sensor errors
    load_time: float | None = None  # [s], at which the load is added; None for the scenario's own
    speed: float | None = None  # of a walk, forwards [m/s]; None for the scenario's own
    turn: float = 0.0  # of a walk, to the left [rad/s]
    amplitude: float = 1.0  # of a shake, times 3° and 3 % of the robot's height
    stones: float = 0.0  # [m], largest deviation of the stepping stones' heights; 0 for a plane
    hold: int = 1  # periods of the test-bed for which the controller's torques are held, see `TestBed`
    outside: OutsideForce | None = None  # an external force other than a load; None for none
    arms: float = 0.0  # amplitude with which joints outside the legs swing [rad]
    motion: Recording | None = None  # a table of joint positions, of the scenario "motion"

    def __post_init__(self) -> None:
        if self.errors.lower() not in (*ERROR_SETS, *REAL_SETS):
            raise UnknownNameError("set of errors", self.errors, (*ERROR_SETS, *REAL_SETS))
        every = 1.0 if self.rate is None else 1000.0 / self.rate if np.isfinite(self.rate) and self.rate > 0 else 0.0
        if every < 1 or abs(every - round(every)) > 1e-9:
            raise StaderaError(
                f"a log's rate must be 1000 Hz over a whole number (1000, 500, 250, ...), got {self.rate}"
            )
        if self.duration == 0.0:
            raise StaderaError("a run's duration must be positive, got 0.0 s")
        _require(0.0, duration=self.duration, seed=self.seed, load_time=self.load_time, stones=self.stones)
        _require(-np.inf, speed=self.speed, turn=self.turn, amplitude=self.amplitude, arms=self.arms)

    @property
    def sensor_errors(self) -> SensorErrors:
        """Errors of the controller's sensors; with real errors it has separate sensors of `standard` quality."""
        return ERROR_SETS["standard" if self.real_sizes else self.errors.lower()]

    @property
    def real_sizes(self) -> RealSizes | None:
        """Sizes from which real errors are drawn; None for errors of another kind."""
        return REAL_SETS.get(self.errors.lower())

    @property
    def every(self) -> int:
        """Periods of the test-bed per sample of the log."""
        return round(1000.0 / (self.rate or 250.0))

    def require(self, takes: Sequence[str]) -> None:
        """Raises StaderaError: a setting that is not the default is none of those in `takes`, and would be ignored."""
        for setting in fields(self):
            if setting.name not in takes and getattr(self, setting.name) != setting.default:
                users = ", ".join(name for name, one in SCENARIOS.items() if setting.name in one.takes)
                raise StaderaError(f"a run's {setting.name} goes with the scenarios {users}")


def _require(least: float, **values: float | None) -> None:
    """Checks that given values are finite, and at least `least`."""
    for name, value in values.items():
        if value is not None and not (np.isfinite(value) and value >= least):
            wanted = "finite" if least == -np.inf else f"finite and at least {least:g}"
            raise StaderaError(f"a run's {name} must be {wanted}, got {value}")


SWING = "swing"
"""The scenario with legs in the air and without a controller: see `stadera.lab.scenarios.run`."""

ALWAYS = ("errors", "duration", "rate", "seed")
"""Settings of all runs."""

_ON_GROUND = (*ALWAYS, "load", "load_time", "slope", "stones", "hold", "outside", "arms")


@dataclass(frozen=True)
class ScenarioDefaults:
    """Default settings of scenarios."""

    load: float = 0.1  # default load as a share of the robot's mass
    load_after: float = 0.4  # time of the load as a share of the duration
    trot: float = 0.3  # speed [m/s]
    # of errands: the fastest trot as a share of √(g h), 0.6 m/s for HyQ, and the fastest turn [rad/s]
    fastest: float = 0.26
    fastest_turn: float = 0.4
    crawl: float = 0.1  # speed [m/s]
    # clearance of a crawling foot above the difference between the highest and the lowest stone [m]
    over_stones: float = 0.02
    between: float = 1.0  # time of standing before each time that a motion is played [s]
    squat: float = 1.2  # time in which it goes down, or up [s]
    depth: float = 0.12  # of a squat, share of the leg
    still: float = 0.3  # time of standing before a motion begins [s]
    moving: float = 0.4  # share of the time for a pose used for moving to it
    swing: float = 40.0  # duration of legs' swinging in the air [s]
    faster: float = 2.5  # factor on the paper's 0.3 to 0.9 Hz for it
    draws: int = 10  # attempts to find a clear one


DEFAULTS = ScenarioDefaults()


@dataclass(frozen=True, eq=False)
class ScriptEvent:
    """A single event."""

    time: float  # [s], from the start
    act: Callable[[TestBed], None]  # function applied to the test-bed at that time


Script = Callable[[Robot, SimulateSettings, float], Sequence[ScriptEvent]]
"""Events of a run besides its load, from a robot, settings and a duration [s]."""


@dataclass(frozen=True)
class Scenario:
    """A scenario."""

    duration: float  # default duration [s]
    events: Script | None = None  # besides the load
    takes: tuple[str, ...] = _ON_GROUND  # settings that it uses
    own: bool = False  # whether it has a load of its own, where the settings have none
    # of the load [s], from the duration [s]
    load_time: Callable[[SimulateSettings, float], float] = lambda _, duration: DEFAULTS.load_after * duration
    slope: float = 0.0  # default slope [rad]
    # a quadruped's controller, from the model of its robot; None to stand, as any robot can
    gait: Callable[[Robot], Gait] | None = None
    stepping: bool = False  # whether it is of robots on two flat feet only

    def script(self, robot: Robot, settings: SimulateSettings, duration: float) -> list[ScriptEvent]:
        """Events of a run of this duration [s], in order of time. Raises StaderaError: settings it does not use,
        or a load after the end.
        """
        settings.require(self.takes)
        events = [*self.events(robot, settings, duration)] if self.events else []
        if settings.load is not None or self.own:
            share = 0.5 * DEFAULTS.load if self.stepping else DEFAULTS.load  # beside one of two feet
            payload = (settings.load or Load(round(share * robot.mass, 2))).payload(robot)
            when = self.load_time(settings, duration) if settings.load_time is None else settings.load_time
            if when >= duration:
                raise StaderaError(f"a load at {when:g} s never lands in a run of {duration:g} s")
            events.append(ScriptEvent(when, lambda bed: bed.plant.apply_payload(payload)))
        elif settings.load_time is not None:
            raise StaderaError("a run's load_time needs a load, or a scenario with one of its own, as stand-load")
        return sorted(events, key=lambda event: event.time)


def _poses(robot: Robot, settings: SimulateSettings, duration: float) -> Sequence[ScriptEvent]:
    """Level, then every pose of `static_poses` relative to the initial pose, evenly over the duration."""
    poses = static_poses(robot)
    each = duration / len(poses)
    nominal: list[TrunkPose] = []

    def move(bed: TestBed, shift: np.ndarray, turn: np.ndarray) -> None:
        start = nominal[0]
        bed.trunk_controller.move(start.moved(start.rotation @ shift, turn), DEFAULTS.moving * each)

    return [
        ScriptEvent(0.5 * each, lambda bed: nominal.append(bed.trunk_controller.reference)),
        *(ScriptEvent(k * each, partial(move, shift=p.shift, turn=p.turn)) for k, p in enumerate(poses) if k),
    ]


def _motion(start: Callable[[TestBed, SimulateSettings], None]) -> Script:
    """A motion that starts after a short stand."""
    return lambda robot, settings, duration: [ScriptEvent(DEFAULTS.still, lambda bed: start(bed, settings))]


Kind = TypeVar("Kind")


def _of(kind: type[Kind], bed: TestBed) -> Kind:
    """The test-bed's controller, of this kind."""
    assert isinstance(bed.controller, kind)
    return bed.controller


def _trot(bed: TestBed, settings: SimulateSettings) -> None:
    _of(Trot, bed).walk((DEFAULTS.trot if settings.speed is None else settings.speed, 0.0), settings.turn)


def _errands(robot: Robot, settings: SimulateSettings, duration: float) -> Sequence[ScriptEvent]:
    """Sets out, walks at changing speeds, turns and stops at random, and sometimes sways before it sets out again."""
    rng, time = np.random.default_rng(settings.seed), DEFAULTS.still
    events: list[ScriptEvent] = []

    def walk(bed: TestBed, ahead: float, turn: float) -> None:
        trot = _of(Trot, bed)
        speed = ahead * DEFAULTS.fastest * GRAVITY * trot.settings.pendulum
        trot.walk((speed, 0.0), turn * DEFAULTS.fastest_turn)

    def sway(bed: TestBed) -> None:
        if not _of(Trot, bed).stepping:
            _shake(bed, settings)

    while time < duration:
        for _ in range(rng.integers(1, 4)):
            turn = float(rng.choice((-1.0, 0.0, 1.0)))
            events.append(ScriptEvent(time, partial(walk, ahead=rng.uniform(0.0, 1.0), turn=turn)))
            time += rng.uniform(2.0, 5.0)
        events += [
            ScriptEvent(time, lambda bed: _of(Trot, bed).stop()),
            *([ScriptEvent(time + 2.0, sway)] * bool(rng.uniform() < 0.3)),
        ]
        time += rng.uniform(2.0, 5.0)
    return [event for event in events if event.time < duration]


def _shake(bed: TestBed, settings: SimulateSettings) -> None:
    controller = bed.trunk_controller
    controller.follow(Shake.of(controller.robot, controller.reference, controller.time, settings.amplitude))


def _squats(robot: Robot, settings: SimulateSettings, duration: float) -> Sequence[ScriptEvent]:
    down = np.array([0.0, 0.0, -DEFAULTS.depth * settings.amplitude * robot.leg_length])
    start: list[TrunkPose] = []

    def move(bed: TestBed, shift: np.ndarray) -> None:
        controller = bed.trunk_controller
        start[:] = start or [controller.reference]
        controller.move(start[0].moved(shift, np.zeros(3)), DEFAULTS.squat)

    times = np.arange(DEFAULTS.between, duration, DEFAULTS.squat)
    return [ScriptEvent(float(t), partial(move, shift=(1 - k % 2) * down)) for k, t in enumerate(times)]


def _crawl(bed: TestBed, settings: SimulateSettings) -> None:
    crawl = _of(Crawl, bed)
    over = 2.0 * settings.stones + DEFAULTS.over_stones if settings.stones else 0.0
    crawl.settings = replace(crawl.settings, clearance=max(crawl.settings.clearance, over))
    crawl.steps.command = CrawlCommand(DEFAULTS.crawl if settings.speed is None else settings.speed, settings.turn)
    crawl.resume()


def _steps(robot: Robot, settings: SimulateSettings, duration: float) -> Sequence[ScriptEvent]:
    return [ScriptEvent(WholeBody.centred, lambda bed: _of(Stepping, bed).walk(settings.speed or 0.0))]


def _again(settings: SimulateSettings) -> float:
    """Time at which the motion is played a second time [s]."""
    if (table := settings.motion) is None:
        raise StaderaError("the scenario 'motion' plays a table, --motion F.csv: see `stadera excite --trunk`")
    return 2.0 * DEFAULTS.between + float(table.time[-1] - table.time[0])


def _played(robot: Robot, settings: SimulateSettings, duration: float) -> Sequence[ScriptEvent]:
    """The motion twice."""
    again, table = _again(settings), settings.motion
    assert table is not None
    return [ScriptEvent(time, lambda bed: _of(Played, bed).play(table)) for time in (DEFAULTS.between, again)]


_WALKING, _SWAYING = (*_ON_GROUND, "speed", "turn"), (*_ON_GROUND, "amplitude")
_TROT = Scenario(8.0, _motion(_trot), _WALKING, gait=Trot.of)
_CRAWL = Scenario(12.0, _motion(_crawl), _WALKING, gait=lambda robot: Crawl(TrunkController(robot)))
_STEP = Scenario(10.0, _steps, (*_ON_GROUND, "speed"), stepping=True)

SCENARIOS: Mapping[str, Scenario] = MappingProxyType(
    {
        "stand": Scenario(8.0, load_time=lambda *_: 0.0),
        "stand-load": Scenario(12.0, own=True),
        "poses": Scenario(33.0, _poses, load_time=lambda *_: 0.0),
        "trot": _TROT,
        "trot-load": replace(_TROT, own=True),
        "errands": Scenario(20.0, _errands, _SWAYING, gait=Trot.of),
        "crawl": _CRAWL,
        "crawl-load": replace(_CRAWL, own=True),
        "shake": Scenario(8.0, _motion(_shake), _SWAYING),
        "shake-load": Scenario(8.0, _motion(_shake), _SWAYING, own=True),
        "squat": Scenario(8.0, _squats, _SWAYING),
        "step": _STEP,
        "step-load": replace(_STEP, own=True),
        "motion": Scenario(
            13.0,
            _played,
            (*_ON_GROUND, "motion"),
            load_time=lambda settings, _: _again(settings) - 0.5 * DEFAULTS.between,
            gait=lambda robot: Played(TrunkController(robot)),
        ),
        "ramp": Scenario(8.0, load_time=lambda *_: 0.0, slope=float(np.deg2rad(10.0))),
    }
)
"""By name; `-load` has a load of its own."""


def controlled(scenario: Scenario, robot: Robot, whole: Robot, arms: Arms) -> tuple[Controller, ArmTorques | None]:
    """The controller of a robot, whole or as its model file is loaded, and what moves the arms if it does not. Raises
    StaderaError: the scenario has a gait of quadrupeds and the robot is none, or the other way round.
    """
    if robot.quadruped and not scenario.stepping:
        made = TrunkController(robot) if scenario.gait is None else scenario.gait(robot)
        return made, ArmTorques(whole, arms) if robot.extra else None
    if robot.quadruped or scenario.gait is not None:
        on_two = [leg.contact for leg in robot.legs] == [FLAT, FLAT]
        able = {n: on_two if one.stepping else robot.quadruped or one.gait is None for n, one in SCENARIOS.items()}
        can = ", ".join(name for name in SCENARIOS if able[name])
        kind = "a quadruped" if robot.quadruped else "no quadruped of three joints a leg"
        raise StaderaError(f"robot {robot.name} is {kind}: it can {can}")
    return (Stepping if scenario.stepping else WholeBody)(whole, arms), None


def scenario_named(name: str) -> Scenario:
    """The scenario with that name."""
    if name not in SCENARIOS:
        raise UnknownNameError("scenario", name, (*SCENARIOS, SWING))
    return SCENARIOS[name]
