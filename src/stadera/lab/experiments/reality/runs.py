"""One log of a robot with `real` errors, weighed by every method with the model file only.

The only information on the run is the time of the tare, the last instant before the load.
"""

from __future__ import annotations

import time
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.errors import IdentificationError, RecordingError
from stadera.identify.legs import identify
from stadera.identify.schema import with_identified_legs
from stadera.identify.settings import IdentifySettings
from stadera.lab.baselines import ALL_METHODS
from stadera.lab.control.planner.feet import PlanError
from stadera.lab.control.trunk import ControlError
from stadera.lab.plant import SimulationError, Tray
from stadera.lab.scenarios.run import simulate, stored
from stadera.lab.scenarios.settings import Load, SimulateSettings
from stadera.lab.scenarios.swing import swing
from stadera.logs import Recording
from stadera.robot import Robot, load_robot
from stadera.robot.imu import ImuMount
from stadera.trunk import make_estimator
from stadera.trunk.registry import Setup
from stadera.trunk.samples import Samples
from stadera.types import Array
from stadera.weigh.truth import Truth

OURS = "walking"
"""Name of the library's estimator in the registry of methods."""
LEGS = "walking, legs identified"
"""The same with legs identified from a log of the robot's legs in the air."""

_TRUNK = ("trunk mass", "trunk com x", "trunk com y", "trunk com z")
_PAYLOAD, _CHANGE = ("payload mass", "payload x", "payload y", "payload z"), "change mass"
FIGURES = (*_TRUNK, *_PAYLOAD, _CHANGE)
"""Estimated quantities, each with error and standard deviation [kg, m]."""


@dataclass(frozen=True)
class RealitySettings:
    """Settings common to all runs of the study, and to their evaluation."""

    duration: float = 10.0  # [s]
    loaded_at: float = 5.0  # [s]
    out: float = 0.6  # of the tray's half size, within which loads are placed [1]
    half_cube: float = 0.05  # of a load [m]
    toppled: float = float(np.deg2rad(45.0))  # tilt of a trunk that has fallen [rad]
    hold: int = 2  # periods of the test-bed for which the controller's torques are held
    heavy: float = 0.10  # least load whose position is evaluated, as a share of the robot's mass
    noticeable: float = 0.05  # least load that should be detected, likewise
    soon: float = 0.5  # time after the load for that [s]


HOW = RealitySettings()


@dataclass(frozen=True)
class RealityCase:
    """Settings of one run."""

    robot: str
    scenario: str  # trot, crawl, shake or stand
    share: float  # of the load in the robot's mass; 0 for none
    errors: str  # real or real-unit-gain
    # of the draw, combined with the other fields: no two cases draw the same robot, except for the common gain
    seed: int


def weigh_real(case: RealityCase, logs: Path | None = None) -> dict[str, Any]:
    """Results of a run, its logs stored in a folder for reuse; None to store none.

    `fell`: None, or a description. `robot_mass`: [kg]. `methods`: by method (of the registry, and `LEGS`) a mapping
    with every quantity of `FIGURES` that it gives, as [error, standard deviation]; `verdict_before`, `verdict`: of the
    fit, at the tare and at the end, None for methods without one; `noticed`: [s] from the load to its detection;
    `false_changes`; `share_of_time`.
    """
    robot = load_robot(case.robot)
    try:
        log, truth = real_log(case, robot, logs)
    except (ControlError, PlanError, SimulationError) as error:
        return {"fell": str(error), "robot_mass": robot.mass, "methods": {}}
    if toppled(log, robot):
        return {"fell": "tilted by more than 45°", "robot_mass": robot.mass, "methods": {}}
    samples = Samples.of_recording(log, robot)
    methods = {name: _weighed(name, robot, samples, truth) for name in (OURS, "ls", "rls", "kalman")}
    legs = _identified(case, robot, logs)
    if legs is not None:
        methods[LEGS] = _weighed(OURS, legs, samples, truth)
    return {"fell": None, "robot_mass": robot.mass, "methods": methods}


def toppled(log: Recording, robot: Robot) -> bool:
    """True if the trunk of a simulated log was ever tilted by more than `RealitySettings.toppled`."""
    if log.imu is None or log.imu.orientation is None:
        raise RecordingError(f"{log.source}: a simulated log has an IMU with its orientation")
    up = Rotation.from_quat(log.imu.orientation) * Rotation.from_matrix(ImuMount.of(robot).rotation).inv()
    return bool((up.as_matrix()[:, 2, 2] < np.cos(HOW.toppled)).any())


def real_log(case: RealityCase, robot: Robot, logs: Path | None) -> tuple[Recording, Truth]:
    """The run's log and truth, stored earlier or simulated now."""
    path = None if logs is None else logs / f"{_name(case)}.parquet"
    return stored(path, lambda: simulate(robot, case.scenario, case_settings(case, robot)))


def case_settings(case: RealityCase, robot: Robot) -> SimulateSettings:
    """Settings of the run's simulation."""
    draw = _draw(case)
    load = _load(case, robot, draw)
    return SimulateSettings(case.errors, load, duration=HOW.duration, seed=draw, load_time=HOW.loaded_at, hold=HOW.hold)


def _identified(case: RealityCase, robot: Robot, logs: Path | None) -> Robot | None:
    """The model file with legs identified from the robot's own log in the air; None if log or fit is refused."""
    with TemporaryDirectory() as folder:
        path = (Path(folder) if logs is None else logs) / f"{_name(case)}.legs.json"
        try:
            if not path.exists():
                in_air = swing(robot, settings=SimulateSettings(case.errors, seed=_draw(case)))
                identify(robot, in_air.recording, IdentifySettings(split=1.0)).save_json(path)
            return with_identified_legs(robot, path)
        except IdentificationError:
            return None


def _name(case: RealityCase) -> str:
    return "-".join(str(value) for value in vars(case).values())


def _draw(case: RealityCase) -> int:
    return zlib.crc32(repr(replace(case, errors="")).encode())


def _load(case: RealityCase, robot: Robot, draw: int) -> Load | None:
    """A cube on the tray, at a random position away from its edges."""
    if not case.share:
        return None
    tray = Tray.of(robot)
    aside = HOW.out * np.random.default_rng(draw).uniform(-1.0, 1.0, 2) * tray.half_size[:2]
    x, y = (tray.centre[:2] + aside).tolist()
    return Load(case.share * robot.mass, "kg", (x, y, tray.top + HOW.half_cube))


def _weighed(name: str, robot: Robot, samples: Samples, truth: Truth) -> dict[str, Any]:
    estimator: Any = make_estimator(name, Setup(robot), ALL_METHODS)
    begun = time.process_time()
    estimator.add(samples[samples.time < HOW.loaded_at])
    before, verdict_before = estimator.estimate(), _verdict(estimator)
    if name == OURS:
        estimator.tare()
    estimator.add(samples[samples.time >= HOW.loaded_at])
    spent = time.process_time() - begun
    bare, load = truth.moments[0], truth.moments[-1]
    figures: dict[str, Any] = {"share_of_time": spent / float(samples.time[-1] - samples.time[0])}
    figures |= {"verdict_before": verdict_before, "verdict": _verdict(estimator)}
    figures |= _errors(_TRUNK, before.value - np.array([bare.mass, *bare.com]), before.std)
    value, std = _payload(estimator) if name == OURS else _difference(before, estimator.estimate())
    place = np.full(3, np.nan) if load.payload_com is None else np.asarray(load.payload_com)
    figures |= _errors(_PAYLOAD, value - np.array([load.payload_mass, *place]), std)
    if name == OURS:
        figures |= _changes(estimator.changes, load.payload_mass)
    return figures


def _errors(names: tuple[str, ...], errors: Array, stds: Array) -> dict[str, list[float]]:
    pairs = zip(names, errors.tolist(), stds.tolist(), strict=True)
    return {name: [error, std] for name, error, std in pairs if np.isfinite(error) and np.isfinite(std)}


def _payload(estimator: Any) -> tuple[Array, Array]:
    """Mass and position of the payload since the tare, and their standard deviations, (4,) each."""
    found = estimator.payload
    if found is None:
        return np.full(4, np.nan), np.full(4, np.nan)
    return np.array([found.mass, *found.com]), np.array([found.mass_std, *found.com_std])


def _difference(before: Any, after: Any) -> tuple[Array, Array]:
    """The same from two estimates of the trunk with independent errors; no standard deviations for the position."""
    mass = after.trunk.mass - before.trunk.mass
    moment = after.trunk.mass * after.trunk.com_trunk - before.trunk.mass * before.trunk.com_trunk
    seen = np.isfinite(before.std) & np.isfinite(after.std)
    std = np.where(seen, np.hypot(before.std, after.std), np.nan)
    place = moment / mass if mass else np.full(3, np.nan)
    return np.array([mass, *place]), std


def _verdict(estimator: Any) -> str | None:
    trust = getattr(estimator, "trust", None)
    trust = trust() if callable(trust) else trust
    return None if trust is None else str(trust.verdict)


def _changes(changes: tuple[Any, ...], mass: float) -> dict[str, Any]:
    """The first change detected after the load is assigned to the load; all others are false."""
    after = [change for change in changes if change.noticed > HOW.loaded_at]
    found = after[0] if after and mass > 0 else None
    false = len(changes) - (found is not None)
    if found is None:
        return {"noticed": None, "false_changes": false}
    change = [found.mass - mass, found.mass_std]
    return {"noticed": found.noticed - HOW.loaded_at, "false_changes": false, _CHANGE: change}
