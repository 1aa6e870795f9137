"""Humanoids and a quadruped with an arm that carry a load on the back or in a hand, weighed as a user would."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from stadera.errors import StaderaError
from stadera.lab.experiments.fault_kinds import arms_of
from stadera.lab.experiments.runner import ExperimentResult, Outcome, Paper, Record, ReproduceSettings, grouped, spread
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate, stored
from stadera.report.table import Row, TableData
from stadera.robot import load_robot
from stadera.robot.model import Robot
from stadera.weigh.weigh import weigh

PAPER = Paper.of("humanoids")
MOTIONS = (*product(("g1", "talos"), ("shake", "squat", "step")), ("b1_z1", "trot"))
LONGER = {"step": 12.0}  # [s], of a log of which the first two are a stand and the first shift of the weight


@dataclass(frozen=True)
class CarryCase:
    """One log and its weighing."""

    robot: str
    scenario: str
    place: str  # of the load: trunk or hand
    errors: str  # ideal or real
    seed: int
    share: float = 0.08  # of the load in the robot's mass; half of it in the gripper of a quadruped
    duration: float = 8.0  # [s]; the load comes after a half of it
    arms: float = 0.3  # amplitude of the arms' swinging [rad]


def cases(settings: ReproduceSettings) -> list[CarryCase]:
    """All combinations; a quick study is without squats."""
    motions = [motion for motion in MOTIONS if not (settings.quick and motion[1] == "squat")]
    found = []
    for (robot, scenario), k in product(motions, range(settings.seeds or 1)):
        one = CarryCase(robot, scenario, "trunk", "ideal", settings.seed + k, duration=LONGER.get(scenario, 8.0))
        found += [
            replace(one, place=place, errors=errors) for place in ("trunk", "hand") for errors in ("ideal", "real")
        ]
    return found


def weighed(case: CarryCase, logs: Path | None = None) -> dict[str, Any]:
    """Outcome of one weighing: payload's mass and its deviation [kg], place (3,) [m], verdict or why none, truth."""
    robot = load_robot(case.robot)
    hand = hand_of(robot) if case.place == "hand" else None
    mass = case.share * robot.mass * (0.5 if hand and robot.quadruped else 1.0)
    settings = SimulateSettings(
        case.errors,
        Load(round(mass, 3), at=(0.0, 0.03, 0.1) if hand is None else (0.05, 0.0, 0.02), on=hand),
        duration=case.duration,
        rate=250.0,
        seed=case.seed,
        load_time=0.5 * case.duration,
        arms=case.arms,
    )
    name = "-".join((case.robot, case.scenario, case.place, case.errors, str(case.seed)))
    try:
        log, truth = stored(logs, name, lambda: simulate(robot, case.scenario, settings))
    except StaderaError as error:
        return {"fell": str(error)}
    if truth.fell is not None:
        return {"fell": truth.fell[1]}
    now = truth.moments[-1]
    known: dict[str, Any] = {"fell": None, "robot_mass": robot.mass, "at": hand or robot.trunk}
    known |= {"true_mass": now.payload_mass, "true_com": now.payload_com}
    try:
        found = weigh(robot, log, (0.0, 0.48 * case.duration))
    except StaderaError as error:
        return known | {"verdict": "refused", "said": str(error)[:200]}
    payload = found.payload
    said = "; ".join(found.trust.reasons)[:200]
    if payload is None:
        return known | {"verdict": "none found", "said": said}
    values = {"mass": payload.mass, "std": payload.mass_std, "com": payload.com.tolist()}
    return known | values | {"found_at": payload.at or robot.trunk, "verdict": found.trust.verdict, "said": said}


def hand_of(robot: Robot) -> str:
    """The link at the end of the robot's first limb that is no leg."""
    assert robot.extra is not None
    return robot.extra.links[robot.extra.joints.index(arms_of(robot)[0][-1])]


_Pairs = Sequence[tuple[CarryCase, Outcome]]


def summary(grid: Sequence[CarryCase], runs: Sequence[Outcome]) -> ExperimentResult:
    """A table by robot, motion and place."""
    pairs = [(case, run) for case, run in zip(grid, runs, strict=True) if run["fell"] is None]
    return PAPER.result(_records(pairs), (_table(pairs),), facts={"Robots that fell": str(len(runs) - len(pairs))})


def _given(pairs: _Pairs) -> list[Outcome]:
    return [run for _, run in pairs if run["verdict"] in ("good", "doubtful")]


def _error(run: Outcome) -> float:
    """Of the payload's mass, in percent of the robot's."""
    return 100.0 * abs(float(run["mass"] - run["true_mass"])) / float(run["robot_mass"])


def _table(pairs: _Pairs) -> TableData:
    head = ("", "logs", "good", "doubtful", "no figure", "mass [% of the robot]", "error [σ]", "where it is")
    rows: list[Row] = []
    for case, own in grouped(pairs, lambda c: (c.robot, c.scenario, c.place, c.errors)).items():
        given, verdicts = _given(own), [run["verdict"] for _, run in own]
        counts = [str(verdicts.count("good")), str(verdicts.count("doubtful")), str(len(own) - len(given))]
        right = sum(run["found_at"] == run["at"] for run in given)
        sigmas = [abs(float(run["mass"] - run["true_mass"])) / float(run["std"]) for run in given]
        sizes = spread([_error(run) for run in given]), spread(sigmas)
        rows.append((", ".join(case), str(len(own)), *counts, *sizes, f"{right} of {len(given)}"))
    return TableData.of("Payloads", head, rows, "Median; 95th percentile of the logs with a figure.")


def _records(pairs: _Pairs) -> Iterator[Record]:
    for (motion, place, errors), own in grouped(pairs, lambda case: (case.scenario, case.place, case.errors)).items():
        given, case = _given(own), {"motion": motion, "load": place, "errors": errors}
        yield from PAPER.spread(case, "payload's mass", "%", [_error(run) for run in given], (None, None))
        yield PAPER.record(case, "share with a figure", "1", len(given) / len(own))


EXPERIMENT = PAPER.experiment(cases, weighed, summary, keeps=True, keeps_logs=True)
