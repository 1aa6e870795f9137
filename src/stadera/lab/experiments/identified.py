"""Study of whole robots identified from walks, sways and legs in the air with `real` errors.

The model file's links are wrong by 5 to 20 % besides what the test-bed draws. One robot trots and sways; then its legs'
swinging in the air is added. Every figure is compared with the truth of the same quantity, as drawn: Coulomb friction
varies with position, and its truth is the mean over the samples in which the joint slides, without load; offsets drift,
and their truth is the mean over the first half of the log, which is fitted with legs in the air. There friction of a
robot that walks too is that over the positions in the air. All torques of a robot have a gain that no log shows; it is
drawn with mean one here (`real-unit-gain`).
"""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from stadera.errors import StaderaError
from stadera.identify.legs import identify
from stadera.identify.result import Identification
from stadera.inertia import InertialParameters
from stadera.lab.experiments.runner import ExperimentResult, Outcome, Paper, Record, ReproduceSettings
from stadera.lab.plant.model import DryFriction
from stadera.lab.reality.draw import VaryingSizes
from stadera.lab.reality.log import offset_drift
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate, stored, swing
from stadera.lab.truth import Truth
from stadera.logs import Recording
from stadera.logs.recording import take
from stadera.robot import Robot, load_robot
from stadera.trunk.drives import TERMS

PAPER = Paper.of("identified")

ROBOTS = ("hyq", "go2", "anymal_b", "anymal_c", "b1", "a1")
_ERRORS, _WRONG = "real-unit-gain", (0.05, 0.2)  # set of errors; relative error of the model's link masses
_SLIDING = 0.1  # velocity above which a joint slides [rad/s]: twice the largest noise


@dataclass(frozen=True)
class IdentifiedCase:
    """Settings of one robot."""

    robot: str
    seconds: float  # of trot and sway each, and of legs in the air
    air: bool  # whether legs in the air are added
    seed: int


def cases(settings: ReproduceSettings) -> list[IdentifiedCase]:
    """Six robots, with and without legs in the air: 30 s of each motion; quick: 8 s."""
    seconds, seeds = (8.0 if settings.quick else 30.0), range(settings.seed, settings.seed + (settings.seeds or 1))
    return [IdentifiedCase(name, seconds, air, seed) for seed, name, air in product(seeds, ROBOTS, (False, True))]


def identified(case: IdentifiedCase, logs: Path | None = None) -> dict[str, Any]:
    """`refused`: why there is no figure, or None. `drives`: by term, [error, standard deviation, truth, limit] of each
    joint, the standard deviation None where it is not determined. `links`: [error, the model's error, 1 if observable]
    of each mass of the legs. `trunk`: [error, standard deviation] of mass and centre of mass. `robot`: relative error
    of the whole mass.
    """
    draw = zlib.crc32(f"{case.robot} {case.seed}".encode())
    robot = load_robot(case.robot)
    try:
        made = [_log(case, robot, draw, scenario, logs) for scenario in ("trot", "shake")]
        if any(truth.fell for _, truth in made):
            return {"refused": "it fell"}
        given, drawn = [log for log, _ in made], dict(made[0][1].drawn or {})
        if case.air:
            given.append(_log(case, robot, draw, "swing", logs)[0])
        result = identify(_wrong(robot, draw), given)
    except StaderaError as error:
        return {"refused": str(error)}
    if result.trust.verdict == "bad":
        return {"refused": result.trust.reasons[0]}
    # of several logs the mean positions are those of the legs in the air
    fitted = [take(given[-1], slice(0, len(given[-1]) // 2))] if case.air else given
    return {"refused": None} | _compared(result, robot, drawn, fitted)


def _log(case: IdentifiedCase, robot: Robot, draw: int, scenario: str, logs: Path | None) -> tuple[Recording, Truth]:
    settings = SimulateSettings(_ERRORS, duration=case.seconds, seed=draw)
    name = f"{case.robot}-{scenario}-{case.seconds:g}-{case.seed}"
    in_air = scenario == "swing"
    run = (lambda: swing(robot, settings=settings)) if in_air else (lambda: simulate(robot, scenario, settings))
    log, truth = stored(logs, name, run)
    return replace(log, source=scenario), truth


def _wrong(robot: Robot, seed: int) -> Robot:
    """The model file with links of other masses, their centres and shapes kept."""
    rng = np.random.default_rng(seed)
    links = {}
    for leg in robot.legs:
        for link in leg.links:
            factor = 1.0 + float(rng.choice((-1.0, 1.0)) * rng.uniform(*_WRONG))
            links[link] = InertialParameters(factor * robot.inertias[link].vector)
    return robot.with_inertias(links)


def _true_drives(robot: Robot, drawn: dict[str, Any], logs: Sequence[Recording]) -> dict[str, dict[str, float]]:
    """True terms by joint, of the samples that were fitted, see above."""
    joints, varying = robot.tree.joints, drawn["varying"]
    law = DryFriction(**{name: np.array(value) for name, value in varying["friction"].items()})
    position, velocity = (
        np.concatenate([log.channel(name, joints) for log in logs]) for name in ("position", "velocity")
    )
    slides = np.abs(velocity) > _SLIDING
    friction = (law.at(position, np.zeros(len(joints))) * slides).sum(axis=0) / np.maximum(slides.sum(axis=0), 1)
    true = {joint: drawn["joints"][joint] | {"coulomb": friction[k]} for k, joint in enumerate(joints)}
    whole = offset_drift(np.linspace(0.0, 1.0, 2001), np.array(varying["drift"]), VaryingSizes().warming)
    drifted = whole[:1001].mean(axis=0)
    for k, joint in enumerate(joints):
        true[joint]["offset"] += drawn["torque_offset"][joint] + drifted[k]
    return true


def _compared(result: Identification, robot: Robot, drawn: dict[str, Any], logs: Sequence[Recording]) -> dict[str, Any]:
    drives: dict[str, list[Any]] = {term: [] for term in TERMS}
    true_drives = _true_drives(robot, drawn, logs)
    links = []
    for leg in result.legs:
        for joint, term in product(leg.leg.joints, TERMS):
            found, true = leg.parameters[f"{joint}.{term}"], float(true_drives[joint][term])
            std = None if found.is_held else found.std
            drives[term].append([found.value - true, std, true, robot.limits[joint].effort])
        for link in leg.leg.links:
            mass, true = leg.parameters[f"{link}.m"], float(drawn["links"][link][0])
            links.append([mass.value - true, mass.prior - true, float(mass.verdict == "observable")])
    true_trunk = InertialParameters(np.array(drawn["links"][robot.trunk]))
    trunk: list[list[float]] = []
    whole = sum(body[0] for body in drawn["links"].values())
    if result.trunk is not None:
        body = result.trunk.inertial
        off = np.array([body.mass - true_trunk.mass, *(body.com - true_trunk.com)])
        trunk = np.column_stack([off, [result.trunk.mass_std, *result.trunk.com_std]]).tolist()
    whole_off = result.identified_robot().mass / whole - 1.0
    of_trunk = {"trunk": trunk, "trunk_mass": true_trunk.mass, "robot": whole_off}
    return {"drives": drives, "links": links, **of_trunk}


def summary(grid: Sequence[IdentifiedCase], found: Sequence[Outcome]) -> ExperimentResult:
    records: list[Record] = []
    for air in (False, True):
        own = [f for case, f in zip(grid, found, strict=True) if case.air == air]
        good = [f for f in own if f["refused"] is None]
        said = {"logs": "trot, sway, legs in the air" if air else "trot, sway"}

        def record(metric: str, unit: str, value: float, bound: float | None = None, said: Any = said) -> None:
            if np.isfinite(value):
                records.append(PAPER.record(said, metric, unit, float(value), bound=bound))

        record("robots", "1", len(good))
        record("refused or fallen", "1", len(own) - len(good))
        if good:
            _of_drives(good, record, 0.5 if air else 1.0)
            _of_links(good, record)
            _of_trunks(good, record)
    facts = {f"{c.robot}{', air' * c.air}": f["refused"] for c, f in zip(grid, found, strict=True) if f["refused"]}
    return PAPER.result(records, facts=facts)


def _of_drives(good: Sequence[Outcome], record: Callable[..., None], share: float) -> None:
    for term in TERMS:
        off, std, true, limit = np.array([row for f in good for row in f["drives"][term]], dtype=float).T
        size = limit if term == "offset" else np.abs(true)
        known = np.isfinite(std)
        z = (off / std)[known]
        bound = PAPER.bounds.get(term)
        where = "of the limit" if term == "offset" else "relative"
        if known.any():
            error = 100.0 * float(np.median(np.abs(off / size)[known]))
            record(f"{term}: median error, {where}", "%", error, None if bound is None else share * bound)
        record(f"{term}: determined", "%", 100.0 * float(known.mean()))
        if known.any():
            record(f"{term}: within 2 σ", "%", 100.0 * float((np.abs(z) < 2.0).mean()))
            record(f"{term}: NEES/n", "1", float(np.mean(z**2)))


def _of_links(good: Sequence[Outcome], record: Callable[..., None]) -> None:
    off, before, observable = np.array([row for f in good for row in f["links"]]).T
    record("link masses: observable", "%", 100.0 * float(observable.mean()))
    seen = observable > 0
    if seen.any():
        ratio = float(np.median(np.abs(off[seen])) / np.median(np.abs(before[seen])))
        record("link masses called observable: error over the model's", "1", ratio, PAPER.bounds["links"])


def _of_trunks(good: Sequence[Outcome], record: Callable[..., None]) -> None:
    rows = [(np.array(f["trunk"]), f["trunk_mass"]) for f in good if f["trunk"]]
    if not rows:
        return
    off = np.array([np.abs(trunk[:, 0]) / [mass, 1.0, 1.0, 1.0] for trunk, mass in rows])
    z = np.array([trunk[:, 0] / trunk[:, 1] for trunk, _ in rows])
    robots = [abs(f["robot"]) for f in good if f["trunk"]]
    record("robot: median error of the whole mass", "%", 100.0 * float(np.median(robots)))
    record("trunk: median error of the mass", "%", 100.0 * float(np.median(off[:, 0])), PAPER.bounds["trunk"])
    record("trunk: median error of the centre, x-y", "mm", 1e3 * float(np.median(off[:, 1:3])), PAPER.bounds["xy"])
    record("trunk: median error of the centre, z", "mm", 1e3 * float(np.nanmedian(off[:, 3])), PAPER.bounds["z"])
    record("trunk: within 2 σ", "%", 100.0 * float((np.abs(z[np.isfinite(z)]) < 2.0).mean()))


EXPERIMENT = PAPER.experiment(cases, identified, summary, keeps=True, keeps_logs=True)
