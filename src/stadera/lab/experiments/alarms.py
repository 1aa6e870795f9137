"""False alarms of the walking estimator: changes of the load that are reported for robots without one.

They run errands at a trot, crawl, and sway on the spot. What is weighed is the log, with the model that comes with it.
"""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from scipy.stats import chi2

from stadera.lab.experiments.runner import (
    CaseValues,
    ExperimentResult,
    Outcome,
    Paper,
    Record,
    ReproduceSettings,
    crossed,
    grouped,
)
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.robot import load_robot
from stadera.trunk import TrunkEstimator
from stadera.trunk.samples import Samples

PAPER = Paper.of("alarms")

ROBOTS = ("hyq", "go2", "anymal_c", "b1")
SCENARIOS = ("errands", "crawl", "shake")
SEEDS = {"standard": 5, "harsh": 1}


@dataclass(frozen=True)
class AlarmCase:
    """Settings of one run."""

    robot: str
    scenario: str
    errors: str  # of the sensors, a named set
    seed: int  # of sensors and commands
    seconds: float = 60.0  # simulated time


def cases(settings: ReproduceSettings) -> list[AlarmCase]:
    """The grid, `standard` first, seed by seed; a small part of it in quick mode."""
    if settings.quick:
        return [AlarmCase("go2", scenario, "standard", settings.seed, 10.0) for scenario in SCENARIOS]
    return [
        AlarmCase(robot, scenario, errors, settings.seed + k)
        for errors, seeds in SEEDS.items()
        for k in range(settings.seeds or seeds)
        for robot in ROBOTS
        for scenario in SCENARIOS
    ]


def watch(case: AlarmCase) -> dict[str, Any]:
    """`fell`: None, or a description. `seconds`: simulated time. `alarms`: every reported change: its `time`, when it
    was `noticed`, and its `mass` as a share of the robot's.
    """
    robot, draw = load_robot(case.robot), zlib.crc32(repr(case).encode())
    run = simulate(
        robot, case.scenario, SimulateSettings(case.errors, duration=case.seconds, rate=500.0, seed=draw, hold=2)
    )
    estimator = TrunkEstimator(run.model)
    estimator.add(Samples.of_recording(run.recording, run.model))
    return {
        "fell": run.truth.fell and run.truth.fell[1],
        "seconds": float(run.recording.time[-1]),
        "alarms": [
            {"time": change.time, "noticed": change.noticed, "mass": change.mass / robot.mass}
            for change in estimator.changes
        ],
    }


def summary(grid: Sequence[AlarmCase], runs: Sequence[Outcome]) -> ExperimentResult:
    """Summarises any part of the grid."""
    pairs = list(zip(grid, runs, strict=True))
    records = [record for own in grouped(pairs, lambda case: case.errors).values() for record in _records(own)]
    counts = crossed(
        "False alarms by motion",
        records,
        group=lambda r: str(r.case["errors"]),
        row=lambda r: str(r.case["motion"]),
        column=Record.label,
        corner="motion",
        note="Rate: exact one-sided 95 % bound.",
    )
    facts = {"Runs": f"{len(pairs)}", "Robots": ", ".join(dict.fromkeys(c.robot for c in grid))}
    return PAPER.result(records, (counts,), facts=facts)


EXPERIMENT = PAPER.experiment(cases, watch, summary, keeps=True)


def highest_rate(alarms: int, minutes: float) -> float:
    """Upper end of the one-sided 95 % confidence interval of a Poisson process' rate [1/h]: χ²(2 n + 2) / 2 T."""
    return float(chi2.ppf(0.95, 2 * (alarms + 1))) / 2.0 / (minutes / 60.0)


def _records(pairs: Sequence[tuple[AlarmCase, Outcome]]) -> Iterator[Record]:
    errors = pairs[0][0].errors
    for motion, own in {"all": pairs, **grouped(pairs, lambda case: case.scenario)}.items():
        minutes = sum(run["seconds"] for _, run in own) / 60.0
        alarms = sum(len(run["alarms"]) for _, run in own)
        case: CaseValues = {"errors": errors, "motion": motion, "watched [min]": round(minutes, 2)}
        bound = 0.0 if errors == "standard" else None
        yield PAPER.record(case, "false alarms", "1", float(alarms), bound=bound)
        yield PAPER.record(case, "rate of false alarms, not above, to 95 %", "1/h", highest_rate(alarms, minutes))
        yield PAPER.record(case, "falls", "1", float(sum(run["fell"] is not None for _, run in own)))
