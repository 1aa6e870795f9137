"""Weighs one faulty log through the public interface, and evaluates the result.

The log is simulated once for each robot, motion and seed, with `real` errors, and stored. A signal fault is applied to
its arrays; an external force acts in a separate simulation. `weigh` gets the model file, the log, and the time of the
tare, which ends before the load, or the force, is applied.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from stadera.errors import StaderaError
from stadera.lab.control.planner.feet import PlanError
from stadera.lab.control.trunk import ControlError
from stadera.lab.experiments.faults.forces import FORCES
from stadera.lab.experiments.faults.signals import SIGNAL_FAULTS
from stadera.lab.plant import SimulationError
from stadera.lab.scenarios.run import simulate, stored
from stadera.lab.scenarios.settings import Load, SimulateSettings
from stadera.logs import Recording
from stadera.robot import load_robot
from stadera.robot.model import Robot
from stadera.weigh.result import Weighing
from stadera.weigh.truth import Truth
from stadera.weigh.weigh import weigh

CLEAN = "none"
"""The unmodified log."""

_ERRORS = "real-unit-gain"
_RATE, _HOLD = 250.0, 2  # Hz; periods of the test-bed between two torques of the controller
_TOLD = 200  # characters of a message that are stored


@dataclass(frozen=True)
class LogCase:
    """A log."""

    robot: str
    scenario: str  # trot, crawl, shake or stand
    seed: int  # of everything that is drawn
    share: float = 0.0  # of a load in the robot's mass, added in the middle; 0 for none
    force: str = ""  # external force from the middle on, a name of `FORCES`; empty for none
    duration: float = 5.0  # [s]

    @property
    def middle(self) -> float:
        """Time at which load or force is applied, and the tare ends [s]."""
        return 0.5 * self.duration

    @property
    def name(self) -> str:
        return "-".join(str(value).replace(" ", "_") for value in vars(self).values() if value != "")


@dataclass(frozen=True)
class FaultCase:
    """A weighing."""

    log: LogCase  # the log to weigh
    fault: str = CLEAN  # a name of `SIGNAL_FAULTS`, `CLEAN`, or the log's force


def hidden(case: FaultCase) -> str:
    """Why no log of this motion can show the fault; empty where one can."""
    if case.fault in FORCES:
        return FORCES[case.fault].hidden
    fault = SIGNAL_FAULTS.get(case.fault)
    return "" if fault is None or case.log.scenario not in (fault.motions or (case.log.scenario,)) else fault.hidden


def make_log(case: LogCase, folder: Path) -> dict[str, Any]:
    """Simulates and stores a log and its truth, unless they exist. `fell`: None, or a description of the fall."""
    try:
        _kept(case, load_robot(case.robot), folder)
    except (ControlError, PlanError, SimulationError) as error:
        return {"fell": str(error)}
    return {"fell": None}


def weigh_faulty(case: FaultCase, folder: Path) -> dict[str, Any]:
    """Outcome of a weighing, the log stored in a folder, see `make_log`.

    `status`: "right", verdict good and all values within 3 σ; "silent", verdict good and a value beyond; "named",
    verdict doubtful; "refused", no values; "crashed", an exception other than a StaderaError. `said`: the reason.
    `mass`: of the robot [kg]. `errors`: [error, standard deviation] by quantity, in kg and m, for observed ones.
    `left_out`: whether parts of the log were excluded because of a fault.
    """
    robot = load_robot(case.log.robot)
    log, truth = _kept(case.log, robot, folder)
    faulty = log
    if case.fault in SIGNAL_FAULTS:
        rng = np.random.default_rng(zlib.crc32(repr(case).encode()))
        faulty = SIGNAL_FAULTS[case.fault].spoil(log, robot, rng)
    begin = float(faulty.time[0])
    stretched = (float(faulty.time[-1]) - begin) / (float(log.time[-1]) - float(log.time[0]))
    tare = (begin, begin + stretched * case.log.middle)
    try:
        result = weigh(robot, replace(faulty, source=f"{case.log.robot}, {case.log.scenario}"), tare)
    except Exception as error:  # crashes are part of the study
        status, said = ("refused", str(error)) if isinstance(error, StaderaError) else ("crashed", repr(error))
        return {"status": status, "said": said[:_TOLD], "mass": robot.mass, "errors": {}, "left_out": False}
    errors = figures_of(result, truth)
    good = result.trust.verdict == "good"
    return {
        "status": ("right" if worst(errors) <= 3.0 else "silent") if good else "named",
        "said": "; ".join(result.trust.reasons)[:_TOLD],
        "mass": robot.mass,
        "errors": errors,
        "left_out": any(note.startswith("left out") for note in result.notes),
    }


def figures_of(result: Weighing, truth: Truth) -> dict[str, list[float]]:
    """Error and standard deviation, by name, of what was observed: trunk at the end, payload's mass since the tare."""
    end, before = truth.moments[-1], truth.moments[0]
    values = [result.mass - end.mass, *(result.com - np.array(end.com))]
    stds = [result.mass_std, *result.com_std]
    if result.payload is not None:
        values.append(result.payload.mass - (end.mass - before.mass))
        stds.append(result.payload.mass_std)
    names = ("trunk mass", "trunk com x", "trunk com y", "trunk com z", "payload mass")
    pairs = zip(names, values, stds, strict=False)
    return {name: [float(value), float(std)] for name, value, std in pairs if np.isfinite(value) and np.isfinite(std)}


def worst(errors: Mapping[str, list[float]]) -> float:
    """The largest error in standard deviations; 0 without figures."""
    return max((abs(error) / std for error, std in errors.values()), default=0.0)


def _kept(case: LogCase, robot: Robot, folder: Path) -> tuple[Recording, Truth]:
    return stored(folder / f"{case.name}.parquet", lambda: simulate(robot, case.scenario, _settings(case, robot)))


def _settings(case: LogCase, robot: Robot) -> SimulateSettings:
    return SimulateSettings(
        _ERRORS,
        Load(round(case.share * robot.mass, 3)) if case.share else None,
        duration=case.duration,
        rate=_RATE,
        seed=zlib.crc32(f"{case.robot} {case.scenario} {case.seed}".encode()),
        load_time=case.middle,
        hold=_HOLD,
        outside=FORCES[case.force].make(robot, case.middle) if case.force else None,
    )
