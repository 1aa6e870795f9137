"""Real walks of one MIT Mini Cheetah: is one robot one weight, and is a robot in the air refused?

The logs are tables of a folder, one a recording, with an accelerometer (`STRAIGHT`, `TURNING`, `AIR`). The trunk's true
mass is not known, so logs are compared with each other and with plain least squares.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stadera.errors import StaderaError
from stadera.identify.legs import identify
from stadera.lab.baselines import ALL_METHODS
from stadera.lab.experiments.legs import MissingDataError
from stadera.lab.experiments.runner import ExperimentResult, Paper, Record, ReproduceSettings
from stadera.logs.reader import read
from stadera.report.numbers import with_std
from stadera.report.table import Row, TableData
from stadera.robot import Robot, load_robot
from stadera.trunk import make_estimator
from stadera.trunk.registry import Setup
from stadera.trunk.samples import Samples
from stadera.types import Array
from stadera.weigh import weigh
from stadera.weigh.result import Weighing

PAPER = Paper.of("mini_cheetah")

STRAIGHT = ("asphalt_road", "forest", "middle_pebble", "old_asphalt_road", "rock_road", "sidewalk", "small_pebble")
TURNING = ("concrete_left_circle", "concrete_right_circle", "concrete_galloping")
AIR = ("air_walking_gait", "air_jumping_gait")


@dataclass(frozen=True)
class WalkLog:
    """A log by name, and its file."""

    name: str
    path: Path


@dataclass(frozen=True, eq=False)
class Walk:
    """One log: its weighing or why there is none, and the trunk's mass by plain least squares [kg]."""

    name: str
    found: Weighing | None
    refusal: str
    least_squares: float
    legs: str  # of a log in the air: how its identified legs fit


def cases(settings: ReproduceSettings) -> list[WalkLog]:
    """Every log of the folder `settings.data`. Raises MissingDataError: it holds no straight walk."""
    folder = settings.data or Path()
    logs = [WalkLog(name, folder / f"{name}.csv") for name in (*STRAIGHT, *TURNING, *AIR)]
    there = [log for log in logs if log.path.is_file()]
    if not any(log.name in STRAIGHT for log in there):
        raise MissingDataError(f"{folder}: none of the walks {STRAIGHT[0]}.csv, {STRAIGHT[1]}.csv, ...")
    return there


def weighed(log: WalkLog) -> Walk:
    """Weighs one log with the model file only."""
    robot = load_robot("mini_cheetah")
    plain: Any = make_estimator("ls", Setup(robot), ALL_METHODS)
    plain.add(Samples.of_recording(read(log.path), robot))
    mass = float(plain.estimate().trunk.mass)
    legs = _legs(robot, log.path) if log.name in AIR else ""
    try:
        return Walk(log.name, weigh(robot, log.path), "", mass, legs)
    except StaderaError as error:
        return Walk(log.name, None, str(error).removeprefix(f"{log.path}: "), mass, legs)


def _legs(robot: Robot, path: Path) -> str:
    try:
        trust = identify(robot, path).trust
        return "; ".join((f"misfit {trust.misfit:.2g}, {trust.verdict}", *trust.reasons[:2]))
    except StaderaError as error:
        return str(error).removeprefix(f"{path}: ")


def summary(_: Sequence[WalkLog], walks: Sequence[Walk]) -> ExperimentResult:
    legs = [(walk.name, walk.legs) for walk in walks if walk.legs]
    head = ("log", "trunk [kg]", "least squares [kg]", "x [mm]", "y [mm]", "misfit", "changes", "verdict or reason")
    tables = (
        TableData.of("Trunk of one robot, model file only", head, map(_row, walks), sides="lrrrrrrw"),
        TableData.of("Legs identified in the air", ("log", "result"), legs, sides="lw"),
    )
    return PAPER.result(_records(walks), tables)


EXPERIMENT = PAPER.experiment(cases, weighed, summary, alone=True)


def _records(walks: Sequence[Walk]) -> list[Record]:
    def record(metric: str, unit: str, value: float, bound: str | None = None) -> Record:
        limit = None if bound is None else PAPER.bounds[bound]
        return PAPER.record({"robot": "mini_cheetah"}, metric, unit, float(value), bound=limit)

    records = [
        record("walks with a figure", "1", sum(w.found is not None for w in walks if w.name not in AIR)),
        record("in the air, refused", "1", sum(w.found is None for w in walks if w.name in AIR)),
        record("changes of the load", "1", sum(len(w.found.changes) for w in walks if w.found), "changes"),
    ]
    own = [w.found for w in walks if w.name in STRAIGHT and w.found is not None]
    if len(own) < 2:
        return records
    mass, std = np.array([w.mass for w in own]), np.array([w.mass_std for w in own])
    common = float(mass @ std**-2 / (std**-2).sum())
    com: Array = np.array([w.com[:2] for w in own])
    apart = 1e3 * float(np.nanmax(np.ptp(com, axis=0)))
    return [
        *records,
        record("straight walks: largest less smallest mass", "%", 100.0 * np.ptp(mass) / common, "spread"),
        record("straight walks: largest error, own bars", "σ", float((np.abs(mass - common) / std).max()), "bars"),
        record("straight walks: median bar", "%", 100.0 * float(np.median(std / mass)), "bar"),
        record("straight walks: spread of the centre, x and y", "mm", apart, "centre"),
    ]


def _row(walk: Walk) -> Row:
    found, plain = walk.found, f"{walk.least_squares:.2f}"
    if found is None:
        return walk.name, "–", plain, "–", "–", "–", "–", walk.refusal
    x, y = (with_std(1e3 * float(c), 1e3 * float(s)) for c, s in zip(found.com[:2], found.com_std[:2], strict=True))
    mass, trust = with_std(found.mass, found.mass_std), found.trust
    reasons = "; ".join((trust.verdict, *trust.reasons))
    return walk.name, mass, plain, x, y, f"{trust.misfit:.2g}", str(len(found.changes)), reasons
