"""A scenario run on the test-bed: what the sensors said, and what was true."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from stadera.control import TestBed
from stadera.estimate.trunk import TrunkModel
from stadera.recording import Recording
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration
from stadera.sim import (
    Plant,
    Sample,
    Sensors,
    Stones,
    Terrain,
    TrueState,
    estimator_model,
    plant_model,
    recording_of,
    truth_of,
)
from stadera.simulate.scenarios import Event, scenario_named, trunk_controller_of
from stadera.simulate.settings import SimulateSettings
from stadera.simulate.truth import Truth, TruthAt

Progress = Callable[[str, int, int], None]

_PERIOD = 1e-3  # s, of simulation and control
_TOLD_EVERY = 250  # periods


@dataclass(frozen=True, eq=False)
class Run:
    """What a run left behind.

    Attributes:
        recording: what the sensors said.
        truth: what was true of the trunk.
        true_motion: joints, accelerations, efforts and the ground's forces as they were, at the log's times.
        believed: the robot that an estimator is to believe in; differs from the plant's for harsh errors.
    """

    recording: Recording
    truth: Truth
    true_motion: Recording
    believed: Robot


class _KeptSensors(Sensors):
    """Sensors that keep every so manieth sample, and the state it was read in."""

    def keep(self, every: int) -> None:
        self._every, self._reads = every, 0
        self.samples: list[Sample] = []
        self.states: list[TrueState] = []

    def read(self, plant: Plant) -> Sample:
        sample = super().read(plant)
        if self._reads % self._every == 0:
            self.samples.append(sample)
            self.states.append(plant.state)
        self._reads += 1
        return sample


def simulate(
    robot: Robot, name: str, settings: SimulateSettings | None = None, progress: Progress | None = None
) -> Run:
    """Runs a scenario. The same arguments give the same run.

    The trunk controller believes in the model file's trunk all the time: a load tilts the trunk, as eq. 12 says.

    Args:
        robot: the truth; friction and wrong legs of harsh errors come on top.
        name: of the scenario.
        settings: None for the defaults.
        progress: told how many periods are done.

    Raises:
        UnknownNameError: no such scenario.
        StaderaError: the robot cannot be simulated, or its motion runs away.
    """
    settings, scenario = settings or SimulateSettings(), scenario_named(name)
    errors = settings.sensor_errors
    duration = settings.duration or scenario.duration
    slope = scenario.slope if settings.slope is None else settings.slope
    real = plant_model(robot, errors)
    believed = estimator_model(real, errors, settings.seed)
    stones = Stones(seed=settings.seed, height=settings.stones) if settings.stones else None
    plant = Plant(real, Terrain(slope=slope, stones=stones), _PERIOD)
    plant.reset(standing_configuration(robot))
    sensors = _KeptSensors(errors, settings.seed, robot)
    sensors.keep(settings.every)
    bed = TestBed(plant, sensors, scenario.controller(believed, TrunkModel.prior(robot)), hold=settings.hold)
    moments = _played(bed, sorted(scenario.script(robot, settings, duration), key=_when), duration, progress)
    source = f"simulated {robot.name}, {name}"
    truth = Truth(
        robot=robot.name,
        scenario=name,
        errors=settings.errors,
        seed=settings.seed,
        slope=slope,
        stiffness=tuple(float(k) for k in trunk_controller_of(bed).gains.angular_stiffness),
        moments=moments,
    )
    return Run(recording_of(sensors.samples, robot, source), truth, truth_of(sensors.states, robot), believed)


def _when(event: Event) -> float:
    return event.time


def _played(bed: TestBed, events: list[Event], duration: float, progress: Progress | None) -> tuple[TruthAt, ...]:
    """Runs the events out; the trunk's truth at the start and whenever it changes."""
    bare = bed.plant.truth()
    moments = [TruthAt.of(0.0, bare, bare)]
    total, waiting = round(duration / _PERIOD), list(events)
    for k in range(total):
        while waiting and waiting[0].time <= k * _PERIOD + 1e-9:
            loads = bed.plant.payloads
            waiting.pop(0).act(bed)
            if bed.plant.payloads != loads:
                moments = [m for m in moments if m.time < bed.plant.time]
                moments.append(TruthAt.of(bed.plant.time, bed.plant.truth(), bare))
        bed.step()
        if progress and k % _TOLD_EVERY == 0:
            progress("simulating", k, total)
    return tuple(moments)
