"""Methods that weigh a trunk, for `peers.py`, on the same simulated walks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.lab.baselines import ALL_METHODS
from stadera.lab.control.com_plan import PlanError
from stadera.lab.control.reference import ControlError
from stadera.lab.plant.payload import Tray
from stadera.lab.plant.plant import SimulationError
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.robot import Robot, load_robot
from stadera.trunk import make_estimator
from stadera.trunk.measurement import Measurement
from stadera.trunk.registry import Setup
from stadera.trunk.samples import Samples
from stadera.types import Array

TRUNK_METHODS = {
    "walking": "stadera",
    "contact": "(c) contact forces, of the paper",
    "ls": "batch least squares over 2 s",
    "rls": "recursive least squares",
    "kalman": "Kalman filter of 2025",
}
"""By the name of the registry."""

SETTINGS = {
    "walking": "TrunkEstimator, defaults; tare when the load came",
    "contact": "the paper's step, 0.002 at 1 kHz; it learns only where the robot stands",
    "ls": "ten parameters, rows of 40 ms, all alike",
    "rls": "ten parameters, rows of 10 ms, forgetting in 1 s; the difference of its estimates is the load",
    "kalman": "process and measurement noise as published, 100 Hz; rows exact, which the published filter's are not",
}

CASES = {
    "trot, standard": ("standard", "trot"),
    "trot, real": ("real", "trot"),
    "standing, standard": ("standard", "stand-load"),
}
"""Sensor errors and scenario."""

CLOSE = 0.2  # of the load's mass
FALLEN = 0.5  # rad, of the trunk's tilt, from what it was at first
STEP = 0.1  # s, between two estimates
FIGURES = ("mass", "place", "latency")


@dataclass(frozen=True)
class Walks:
    """What is walked.

    Attributes:
        robots: by name.
        seeds: of sensor errors and of the load's place, for each robot.
        loaded_at: [s].
        duration: [s].
        share: of the load, of the robot's mass.
    """

    robots: tuple[str, ...] = ("hyq", "go2")
    seeds: int = 4
    loaded_at: float = 10.0
    duration: float = 20.0
    share: float = 0.10


@dataclass(frozen=True, eq=False)
class Walk:
    """A run with a load: its samples, when the load came [s], and its mass [kg] and place (3,) [m], trunk frame."""

    samples: Samples
    loaded_at: float
    mass: float
    place: Array


def walked(robot: Robot, case: str, seed: int, walks: Walks) -> Walk | None:
    """The load's place is drawn on the trunk's top; None where the robot fell."""
    errors, scenario = CASES[case]
    tray = Tray.of(robot)
    aside = 0.6 * np.random.default_rng(seed).uniform(-1.0, 1.0, 2) * tray.half_size[:2]
    x, y = (tray.centre[:2] + aside).tolist()
    load = Load(walks.share * robot.mass, "kg", (x, y, tray.top + 0.05))
    settings = SimulateSettings(errors, load, duration=walks.duration, seed=seed, load_time=walks.loaded_at, hold=2)
    try:
        run = simulate(robot, scenario, settings)
    except (ControlError, PlanError, SimulationError):
        return None
    last, imu = run.truth.moments[-1], run.recording.imu
    assert last.payload_com is not None
    assert imu is not None
    assert imu.orientation is not None
    up = Rotation.from_quat(imu.orientation).inv().apply([0.0, 0.0, 1.0])
    if float(np.min(up @ up[0])) < np.cos(FALLEN):
        return None
    return Walk(
        Samples.of_recording(run.recording, robot), walks.loaded_at, last.payload_mass, np.asarray(last.payload_com)
    )


def weighed(method: str, robot: Robot, walk: Walk) -> dict[str, Any]:
    """A method's errors at the end of a walk.

    Returns:
        `mass` [% of the robot's], `place` [mm] in x-y, `latency` [s] after which the mass stayed within `CLOSE`;
        None where the method gives none or never did. `within`: of mass and place, which are within 2 std.
    """
    samples, truth = walk.samples, np.array([walk.mass, *walk.place])
    estimator: Any = make_estimator(method, Setup(robot), ALL_METHODS)
    feed(estimator, samples[samples.time < walk.loaded_at])
    before = estimator.estimate()
    if method == "walking":
        estimator.tare()
    last_off = 0.0
    for begin in np.arange(walk.loaded_at, float(samples.time[-1]), STEP):
        feed(estimator, samples[(samples.time >= begin) & (samples.time < begin + STEP)])
        value, std = payload(method, estimator, before)
        after = begin + STEP - walk.loaded_at
        if not abs(value[0] - walk.mass) < CLOSE * walk.mass:
            last_off = after
    gap = value - truth
    seen = np.isfinite(gap) & np.isfinite(std)
    aside = 1e3 * float(np.hypot(gap[1], gap[2]))
    return {
        "mass": 100.0 * abs(float(gap[0])) / robot.mass if np.isfinite(gap[0]) else None,
        "place": aside if np.isfinite(aside) else None,
        "latency": None if last_off == after else float(last_off + STEP),
        "within": (np.abs(gap[seen]) <= 2.0 * std[seen]).tolist(),
    }


def feed(estimator: Any, samples: Samples) -> None:
    """Hands samples on, one at a time to an estimator that takes them so."""
    if hasattr(estimator, "add"):
        estimator.add(samples)
        return
    rows = (samples.position, samples.velocity, samples.effort, samples.angular_velocity, samples.specific_force)
    for time, *values in zip(samples.time, *rows, strict=True):
        estimator.update(Measurement(float(time), *values))


def payload(method: str, estimator: Any, before: Any) -> tuple[Array, Array]:
    """Mass and place (4,) added since `before`, and their standard deviations; NaN where none is given."""
    if method == "walking":
        found = estimator.payload
        return np.array([found.mass, *found.com]), np.array([found.mass_std, *found.com_std])
    now = estimator.estimate()
    if not (now.time > before.time and now.observed[0] and before.observed[0]):  # it learnt nothing since
        return np.full(4, np.nan), np.full(4, np.nan)
    mass = now.trunk.mass - before.trunk.mass
    moment = now.trunk.mass * now.trunk.com_trunk - before.trunk.mass * before.trunk.com_trunk
    std = np.hypot(now.std[0], before.std[0])
    place = moment / mass if abs(mass) > 1e-6 else np.full(3, np.nan)
    return np.array([mass, *place]), np.array([std, *[np.nan] * 3])


def trunk_rows(walks: Walks, cases: Iterable[str] = CASES) -> Iterator[dict[str, Any]]:
    """A row for each case and method: medians over robots and seeds, and every run's figures."""
    for case in cases:
        runs: dict[str, list[dict[str, Any]]] = {name: [] for name in TRUNK_METHODS}
        for name, seed in product(walks.robots, range(walks.seeds)):
            robot = load_robot(name)
            walk = walked(robot, case, seed, walks)
            for method in TRUNK_METHODS if walk is not None else ():
                assert walk is not None
                runs[method].append(weighed(method, robot, walk))
        yield from (_row(case, method, own) for method, own in runs.items() if own)


def _row(case: str, method: str, runs: list[dict[str, Any]]) -> dict[str, Any]:
    """A figure that fewer than half of the runs have is None."""
    within = [inside for run in runs for inside in run["within"]]
    figures = {key: [np.inf if run[key] is None else run[key] for run in runs] for key in FIGURES}
    medians = {key: float(np.median(values)) for key, values in figures.items()}
    return {
        "case": case,
        "contender": TRUNK_METHODS[method],
        **{key: value if np.isfinite(value) else None for key, value in medians.items()},
        "coverage": float(np.mean(within)) if within else None,
        "runs": runs,
    }
