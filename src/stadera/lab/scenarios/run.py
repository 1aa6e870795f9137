"""Runs a scenario on the test-bed: the sensors' log, and the truth.

In the scenario `swing` legs swing in the air with the trunk held level: a log for identifying the legs of a run's
robot. Each leg follows one of the paper's random draws, two and a half times as fast, so that rotor inertia is
observable. The legs move simultaneously: on a held trunk they do not affect each other, and nothing collides in this
plant.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stadera.errors import IdentificationError
from stadera.excite.bounds import LegBounds, fitting_factor
from stadera.excite.sinusoids import Sinusoids
from stadera.inertia import InertialParameters
from stadera.lab.control.arms import Arms
from stadera.lab.control.monitor import Falls
from stadera.lab.control.stand import TestBed
from stadera.lab.laws.paper_draw import paper_draw
from stadera.lab.plant.leg import Gains, simulate_leg
from stadera.lab.plant.model import DryFriction
from stadera.lab.plant.payload import RigidMass
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import (
    SensorErrors,
    SensorReading,
    Sensors,
    estimator_model,
    measured,
    plant_model,
    recording_of,
    truth_of,
)
from stadera.lab.plant.terrain import Stones, Terrain
from stadera.lab.plant.whole import as_loaded, whole_robot
from stadera.lab.plant.world import TIMESTEP, TrueState
from stadera.lab.reality.draw import DrawnRobot, drawn, with_usual_drives
from stadera.lab.reality.log import TrueMotion, measured_log
from stadera.lab.scenarios.catalog import (
    ALWAYS,
    DEFAULTS,
    SWING,
    Scenario,
    ScriptEvent,
    SimulateSettings,
    controlled,
    scenario_named,
)
from stadera.lab.truth import Truth, TruthAt, read_truth, truth_json, truth_paths
from stadera.logs import Recording, read, write_table
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration
from stadera.types import Progress

_LOOKED = 10  # periods after which a robot that fell is noticed
_AFTER = 0.1  # time of the log after a fall [s]


@dataclass(frozen=True, eq=False)
class Run:
    """Output of a run."""

    recording: Recording  # values of the sensors
    truth: Truth  # of the trunk
    true_motion: Recording  # true joint motion, accelerations, efforts and contact forces, at the log's times
    model: Robot  # the robot model for estimators; with harsh and real errors it differs from the plant's


class _KeptSensors(Sensors):
    """Sensors that store every n-th sample, with the state at which it was read."""

    def __init__(self, errors: SensorErrors, seed: int, robot: Robot, every: int) -> None:
        super().__init__(errors, seed, robot)
        self._every, self._reads = every, 0
        self.samples: list[SensorReading] = []
        self.states: list[TrueState] = []

    def read(self, plant: Plant) -> SensorReading:
        sample = super().read(plant)
        if self._reads % self._every == 0:
            self.samples.append(sample)
            self.states.append(plant.state)
        self._reads += 1
        return sample


def simulate(
    robot: Robot, name: str, settings: SimulateSettings | None = None, progress: Progress | None = None
) -> Run:
    """Runs a scenario of the true robot, before errors are added. The same arguments give the same run.

    The trunk controller keeps the model file's trunk, so a load tilts the trunk, according to eq. 12. Joints outside
    the legs move too, and are in the log as any others.
    """
    settings, scenario = settings or SimulateSettings(), scenario_named(name)
    duration = settings.duration or scenario.duration
    whole = whole_robot(robot)
    made = _drawn(whole, scenario, settings) if settings.real_sizes else _sized(whole, scenario, settings)
    known, draw = made.controlled or made.model, made.draw
    controller, arms = controlled(scenario, as_loaded(known, robot), known, Arms(known, settings.arms))
    plant = Plant(made.real, made.terrain, draw.friction if draw else None)
    plant.reset(standing_configuration(whole))
    if settings.outside is not None:
        plant.pull(settings.outside)
    sensors = _KeptSensors(settings.sensor_errors, settings.seed, whole, 1 if draw else settings.every)
    bed = TestBed(plant, sensors, controller, hold=settings.hold, arms=arms)
    script = scenario.script(robot, made.settings, duration)
    # of the trunk that is weighed, which contains the arms at their reference
    arm = as_loaded(made.real, robot).inertias[robot.trunk] - made.real.inertias[robot.trunk]
    falls = Falls(plant)
    moments = _played(bed, script, duration, arm, falls, progress)
    truth = replace(
        _truth(robot, name, settings, moments, draw),
        slope=made.terrain.slope,
        stiffness=tuple(float(k) for k in bed.trunk_controller.gains.angular_stiffness),
        fell=None if falls.fall is None else (falls.fall.time, falls.fall.how),
    )
    states, source = sensors.states, f"simulated {robot.name}, {name}"
    if draw is None:
        log = recording_of(sensors.samples, whole, source)
    else:
        rate = settings.rate or draw.rate
        log = measured_log(TrueMotion.of(states, whole), whole, draw, settings.seed, rate, source)
        states = states[:: round(1.0 / (rate * TIMESTEP))]
    return Run(log, truth, truth_of(states, whole), as_loaded(made.model, robot))


def _truth(
    robot: Robot, name: str, settings: SimulateSettings, moments: tuple[TruthAt, ...], draw: DrawnRobot | None
) -> Truth:
    return Truth(robot.name, name, settings.errors, settings.seed, moments, drawn=draw.to_dict() if draw else None)


def _now(plant: Plant, arm: InertialParameters, bare: InertialParameters) -> TruthAt:
    """The truth at this instant; of loads on links other than the trunk the one that was added last."""
    now = TruthAt.of(plant.time, plant.truth() + arm, bare)
    held = [load for load in plant.payloads if isinstance(load, RigidMass) and load.link is not None]
    return now.holding(held[-1].parameters, str(held[-1].link)) if held else now


def stored(folder: Path | None, name: str, run: Callable[[], Run]) -> tuple[Recording, Truth]:
    """A run's log and truth from a folder, made now and stored unless they exist; None to store nothing."""
    path = None if folder is None else folder / f"{name}.parquet"
    if path is not None and path.exists():
        return read(path), read_truth(truth_paths(path)[0])
    made = run()
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        truth_paths(path)[0].write_text(json.dumps(truth_json(made.truth)), encoding="utf-8")
        write_table(made.recording, path)  # written last, completely or not at all, so an existing log has its truth
    return made.recording, made.truth


@dataclass(frozen=True, eq=False)
class _Made:
    """Parts of a run: plant, model file, ground, the draw of real errors, and the controller's model if another."""

    real: Robot
    model: Robot
    terrain: Terrain
    settings: SimulateSettings
    draw: DrawnRobot | None = None
    controlled: Robot | None = None


def _sized(robot: Robot, scenario: Scenario, settings: SimulateSettings) -> _Made:
    errors = settings.sensor_errors
    real = plant_model(robot, errors)
    slope = scenario.slope if settings.slope is None else settings.slope
    stones = Stones(seed=settings.seed, height=settings.stones) if settings.stones else None
    return _Made(real, estimator_model(real, errors, settings.seed), Terrain(slope=slope, stones=stones), settings)


def _drawn(robot: Robot, scenario: Scenario, settings: SimulateSettings) -> _Made:
    """The estimator has the model file's robot, the controller usual drives too; settings override what is drawn."""
    assert settings.real_sizes is not None
    sizes = settings.real_sizes.of_drives(robot)
    draw = drawn(robot, sizes, settings.seed)
    terrain = draw.terrain
    slope = settings.slope if settings.slope is not None else scenario.slope or None
    if slope is not None:
        terrain = replace(terrain, slope=slope, heading=0.0)
    if settings.stones:
        terrain = replace(terrain, stones=Stones(seed=settings.seed, height=settings.stones))
    draw = replace(draw, terrain=terrain)
    stones = terrain.stones.height if terrain.stones else 0.0
    usual = with_usual_drives(robot, sizes)
    return _Made(draw.robot, robot, terrain, replace(settings, stones=stones), draw, usual)


def _played(
    bed: TestBed,
    events: list[ScriptEvent],
    duration: float,
    arm: InertialParameters,
    falls: Falls,
    progress: Progress | None,
) -> tuple[TruthAt, ...]:
    """Runs the events, to the end or until shortly after a fall; returns the trunk's truth at the start and at each
    change.
    """
    bare = bed.plant.truth() + arm
    moments = [TruthAt.of(0.0, bare, bare)]
    total, waiting = round(duration / TIMESTEP), list(events)
    for k in range(total):
        while waiting and waiting[0].time <= k * TIMESTEP + 1e-9:
            loads = bed.plant.payloads
            waiting.pop(0).act(bed)
            if bed.plant.payloads != loads:
                moments = [m for m in moments if m.time < bed.plant.time]
                moments.append(_now(bed.plant, arm, bare))
        bed.step()
        if k % _LOOKED == 0:
            falls.look()
        if falls.fall is not None and bed.plant.time > falls.fall.time + _AFTER:
            break  # of a robot that lies on the ground, while its controller still wants to stand, nothing is of use
        if progress and k % 250 == 0:
            progress("simulating", k, total)
    return tuple(moments)


ALL = "all"


def swing(
    robot: Robot, leg: str = ALL, settings: SimulateSettings | None = None, progress: Progress | None = None
) -> Run:
    """Swings one leg of the model file's robot, or all at once, with the settings' errors, duration, rate and seed. The
    same seed draws the same robot as for a run on the ground. Raises StaderaError: settings of a run on the ground.
    """
    settings = settings or SimulateSettings()
    settings.require(ALWAYS)
    draw = drawn(robot, settings.real_sizes, settings.seed) if settings.real_sizes else None
    real = draw.robot if draw else plant_model(robot, settings.sensor_errors)
    swings = _swings(robot, real, leg, settings, progress or (lambda *_: None), draw.friction if draw else None)
    every = round(1.0 / (settings.rate or draw.rate) / TIMESTEP) if draw else settings.every
    exact, trunk = _merged(swings, every), real.inertias[real.trunk]
    truth = _truth(robot, SWING, settings, (TruthAt.of(0.0, trunk, trunk),), draw)
    if draw is None:
        return Run(measured(exact, robot, settings.sensor_errors, settings.seed), truth, exact, robot)
    motion, source = TrueMotion.held(_merged(swings), real), f"simulated {robot.name}, {SWING}"
    return Run(measured_log(motion, robot, draw, settings.seed, settings.rate, source), truth, exact, robot)


def _swings(
    robot: Robot, real: Robot, leg: str, settings: SimulateSettings, progress: Progress, friction: DryFriction | None
) -> list[Recording]:
    """Exact recordings of the legs, one sample per millisecond."""
    every = [one.name for one in robot.legs]
    names = every if leg.lower() == ALL else [robot.leg(leg).name]
    swings = []
    for k, name in enumerate(names):
        progress("swinging", k, len(names))
        rng = np.random.default_rng((settings.seed, every.index(name)))
        motion = _brisk(robot, name, rng, settings.duration or DEFAULTS.swing).sample(1.0 / TIMESTEP)
        own = [robot.tree.joints.index(joint) for joint in robot.leg(name).joints]
        held = friction.of(own) if friction else None
        swings.append(simulate_leg(real, name, motion, gains=Gains.scaled(robot, name), friction=held))
    return swings


def _brisk(robot: Robot, leg: str, rng: np.random.Generator, duration: float) -> Sinusoids:
    """The paper's draw, faster, and scaled towards the rest pose if speeds or torques would be too large.

    If the path to the rest pose is not clear (a draw on the far side of the trunk), another one is drawn.
    """
    for left in reversed(range(DEFAULTS.draws)):
        try:
            draw = paper_draw(robot, leg, rng, duration)
            faster = replace(draw, frequencies=DEFAULTS.faster * draw.frequencies)
            return faster.drawn_in(fitting_factor(faster, LegBounds.of(robot, leg)))
        except IdentificationError:
            if not left:
                raise
    raise AssertionError("unreachable: the last draw returns or raises")


def _merged(swings: Sequence[Recording], every: int = 1) -> Recording:
    """Merges simultaneous recordings of different joints into one, keeping every n-th sample."""
    first = swings[0]
    joints = tuple(joint for swing in swings for joint in swing.joints)

    def joined(name: str) -> np.ndarray:
        return np.hstack([swing.channel(name, swing.joints) for swing in swings])[::every]

    return Recording(
        time=first.time[::every],
        joints=joints,
        position=joined("position"),
        velocity=joined("velocity"),
        acceleration=joined("acceleration"),
        effort=joined("effort"),
        source=first.source,
    )
