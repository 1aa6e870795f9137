"""One faulty log, weighed by the front door that a user has, and what came of it.

The log is simulated once for each robot, motion and seed, with `real` errors, and kept; a fault of the signals is
applied to its arrays, a force from outside acts in a simulation of its own. `weigh` is given the model file, the log,
and the time of the tare, which ends before the load, or the force, comes on.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from stadera.errors import StaderaError
from stadera.lab.control.planner.support import PlanError
from stadera.lab.control.trunk import ControlError
from stadera.lab.experiments.faults.forces import FORCES
from stadera.lab.experiments.faults.signals import SIGNAL_FAULTS
from stadera.lab.plant import SimulationError
from stadera.lab.scenarios.run import simulate
from stadera.lab.scenarios.settings import Load, SimulateSettings
from stadera.logs import Recording, read, write_table
from stadera.robot import load_robot
from stadera.robot.model import Robot
from stadera.weigh.result import Weighing
from stadera.weigh.truth import Truth, TruthAt, read_truth, truth_json, truth_paths
from stadera.weigh.weigh import weigh

CLEAN = "none"
"""The log as it is."""

HIDDEN: Mapping[str, str] = MappingProxyType(
    {name: fault.hidden for name, fault in SIGNAL_FAULTS.items() if fault.hidden}
    | {name: force.hidden for name, force in FORCES.items() if force.hidden}
)
"""Faults that no log can show, and why."""

_ERRORS = "real-unit-gain"
_RATE, _HOLD = 250.0, 2  # Hz; periods of the test-bed between two torques of the controller
_TOLD = 200  # characters of what was said that are kept


@dataclass(frozen=True)
class LogCase:
    """A log.

    Attributes:
        robot: its name.
        scenario: trot, crawl, shake or stand.
        seed: of everything that is drawn.
        share: of a load in the robot's mass, that comes on in the middle; 0 for none.
        force: from outside, a name of `FORCES`, from the middle on; empty for none.
        duration: [s].
    """

    robot: str
    scenario: str
    seed: int
    share: float = 0.0
    force: str = ""
    duration: float = 5.0

    @property
    def middle(self) -> float:
        """When load or force comes on, and the tare ends [s]."""
        return 0.5 * self.duration

    @property
    def name(self) -> str:
        """Of its file."""
        return "-".join(str(value).replace(" ", "_") for value in vars(self).values() if value != "")


@dataclass(frozen=True)
class FaultCase:
    """A weighing.

    Attributes:
        log: that is weighed.
        fault: a name of `SIGNAL_FAULTS`, `CLEAN`, or the log's force.
    """

    log: LogCase
    fault: str = CLEAN


def make_log(case: LogCase, folder: Path) -> dict[str, Any]:
    """Simulates and keeps a log and its truth, unless they are there. `fell`: None, or how the robot fell."""
    try:
        _kept(case, load_robot(case.robot), folder)
    except (ControlError, PlanError, SimulationError) as error:
        return {"fell": str(error)}
    return {"fell": None}


def weigh_faulty(case: FaultCase, folder: Path) -> dict[str, Any]:
    """What a weighing came to.

    `status`: "right", verdict good and every figure within 3 σ; "silent", verdict good and one beyond; "named", verdict
    doubtful; "refused", no figures; "crashed", something else than a stadera error. `said`: why. `mass`: of the robot
    [kg]. `errors`: by figure [error, standard deviation], in kg and m, those that were observed. `left_out`: whether
    parts of the log were left out for a fault.

    Args:
        folder: of the logs, see `make_log`.
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
    except StaderaError as error:
        return {"status": "refused", "said": str(error)[:_TOLD], "mass": robot.mass, "errors": {}, "left_out": False}
    except Exception as error:  # the study is about these too
        return {"status": "crashed", "said": repr(error)[:_TOLD], "mass": robot.mass, "errors": {}, "left_out": False}
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
    """By name, error and standard deviation of what was observed: trunk at the end, mass of the payload since the tare.

    Args:
        result: of a weighing.
        truth: of its log.
    """
    end, before = truth.moments[-1], truth.moments[0]
    values = [result.mass - end.mass, *(result.com - np.array(end.com))]
    stds = [result.mass_std, *result.com_std]
    if result.payload is not None:
        values.append(result.payload.mass - _added(end, before))
        stds.append(result.payload.mass_std)
    names = ("trunk mass", "trunk com x", "trunk com y", "trunk com z", "payload mass")
    pairs = zip(names, values, stds, strict=False)
    return {name: [float(value), float(std)] for name, value, std in pairs if np.isfinite(value) and np.isfinite(std)}


def worst(errors: Mapping[str, list[float]]) -> float:
    """The largest error in standard deviations; 0 without figures."""
    return max((abs(error) / std for error, std in errors.values()), default=0.0)


def _added(end: TruthAt, before: TruthAt) -> float:
    return end.mass - before.mass


def _kept(case: LogCase, robot: Robot, folder: Path) -> tuple[Recording, Truth]:
    """The log and its truth, as kept or run now."""
    path = folder / f"{case.name}.parquet"
    if not path.exists():
        run = simulate(robot, case.scenario, _settings(case, robot))
        folder.mkdir(parents=True, exist_ok=True)
        truth_paths(path)[0].write_text(json.dumps(truth_json(run.truth)), encoding="utf-8")
        write_table(run.recording, path)  # last, whole or not at all: a log that is there has its truth
    return read(path), read_truth(truth_paths(path)[0])


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
