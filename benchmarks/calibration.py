"""Do error bars hold if errors are not of the sizes assumed? Half and three times of each, nothing else changed.

`python benchmarks/calibration.py [--runs FOLDER] [--draws 8] [--real FOLDER] [--json F]` gives three tables:

1. **Assumed sizes.** All sizes of `ModelErrors` times 0.5, 1 and 3, on the logs that `stadera reproduce reality --keep
   FOLDER` left behind (mean torque gain one; robots that fell are left out). Errors, bars and verdicts, by gait. Then
   settings that were chosen on such logs, each alone: `CRITERIA` of `SwingDetection`, and the spread of the errors'
   scale. And with legs identified in the air, `DRIFTS`, the changes since then.
2. **Simulated sizes.** HyQ trots and gets a load of 8 kg; its exact motion gets `standard` sensor errors times 0.5, 1
   and 3, the estimator has its defaults, or the errors' scale half or three times its spread; and three times without
   one of the `CONSTANTS`. NEES/n is the mean of eᵀ C⁻¹ e / 4 with e the error of the trunk's mass and centre of mass
   before the load, C its stated covariance: 1 where bars are right, less where they are too wide.
3. **Real legs.** Each log `ROBOT_legs_in_air.csv` in a folder is cut in two, legs are identified from each half, and
   their parameters compared: differences over both standard deviations, root mean square, 1 where bars are right. The
   second half of these chirps is the faster one.

Shares within 2 σ are of all quantities that were observed.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, replace
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is loaded: processes share the cores

import numpy as np
from rich.console import Console

from fleet import sensed
from stadera.errors import StaderaError
from stadera.files import write_text, written_together
from stadera.identify.legs import identify
from stadera.identify.schema import with_identified_legs
from stadera.identify.settings import IdentifySettings
from stadera.lab.plant.sensors import STANDARD
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.lab.truth import Truth, read_truth
from stadera.logs import Recording
from stadera.logs.reader import read
from stadera.report.table import TableData, rich_table
from stadera.robot import Robot, load_robot
from stadera.trunk import TrunkEstimator
from stadera.trunk.protocol import TrunkEstimate
from stadera.trunk.samples import Samples
from stadera.trunk.settings import ModelErrors, SwingDetection, TrunkSettings
from stadera.types import Array

FACTORS = (0.5, 1.0, 3.0)
LOADED_AT = 5.0  # s, of both kinds of runs
GAITS = {"trot": "trot", "crawl": "crawl", "shake": "sway", "stand": "stand"}
ERRORS = "real-unit-gain"
CRITERIA = ("speed", "part", "repeated")
SPREAD = "size_spread"
CONSTANTS = ("torque_constant", "accelerometer_constant")
LEGS = "drifts"
DRIFTS = ("friction_drift", "offset_drift", "rotor_drift")
UNSCALED = ("alike", "alike_loaded", "sagging", "renewed", "held", "surest")
QUANTITIES = ("trunk mass", "trunk x", "trunk y", "trunk z", "payload mass")

Found = dict[str, Any]


def settings(factor: float, criterion: str = "") -> TrunkSettings:
    """All sizes of the model errors times a factor, correlations and shares of other sizes stay; or one of
    `CRITERIA`, `SPREAD`, or for `LEGS` only the `DRIFTS`.
    """
    if criterion in CRITERIA:
        swing = SwingDetection()
        return TrunkSettings(swing=replace(swing, **{criterion: factor * getattr(swing, criterion)}))
    if criterion == SPREAD:
        return TrunkSettings(size_spread=factor * TrunkSettings().size_spread)
    usual = ModelErrors()
    scaled = DRIFTS if criterion == LEGS else [size.name for size in fields(usual) if size.name not in UNSCALED]
    return TrunkSettings(model=replace(usual, **{name: factor * getattr(usual, name) for name in scaled}))


def weighed(robot: Robot, log: Recording, truth: Truth, how: TrunkSettings) -> Found:
    """Errors of the five quantities [% of the robot, mm], the same over σ, NEES/n of the trunk, and the verdict."""
    samples, estimator = Samples.of_recording(log, robot), TrunkEstimator(robot, settings=how)
    estimator.add(samples[samples.time < LOADED_AT])
    before = estimator.estimate()
    estimator.tare()
    estimator.add(samples[samples.time >= LOADED_AT])
    bare, load, payload = truth.moments[0], truth.moments[-1], estimator.payload
    error = before.value - np.array([bare.mass, *bare.com])
    mass, std = (np.nan, np.nan) if payload is None else (payload.mass - load.payload_mass, payload.mass_std)
    errors = np.array([*error, mass])
    scale = np.array([100.0 / robot.mass, 1e3, 1e3, 1e3, 100.0 / robot.mass])
    return {
        "errors": (scale * errors).tolist(),
        "sigmas": (errors / np.array([*before.std, std])).tolist(),
        "nees": _nees(error, before),
        "verdict": str(estimator.trust.verdict),
    }


def _nees(error: Array, estimate: TrunkEstimate) -> float:
    seen = estimate.observed
    return float(error[seen] @ np.linalg.solve(estimate.covariance[np.ix_(seen, seen)], error[seen])) / max(
        1, seen.sum()
    )


def kept_logs(folder: Path) -> dict[str, list[Path]]:
    """Logs by gait."""
    logs = [log for log in sorted(folder.glob(f"**/*-{ERRORS}-*.parquet")) if _truth_of(log).exists()]
    found = {gait: [log for log in logs if f"-{scenario}-" in log.name] for scenario, gait in GAITS.items()}
    if not any(found.values()):
        raise StaderaError(f"no logs in {folder}: `stadera reproduce reality --keep {folder}` makes them")
    return {gait: logs for gait, logs in found.items() if logs}


def _truth_of(log: Path) -> Path:
    return log.with_name(f"{log.stem}.truth.json")


def weigh_kept(path: Path, factor: float, criterion: str = "") -> Found | None:
    """One of these logs, for `LEGS` with identified ones; None for a robot that fell, or that has none."""
    robot, log, legs = load_robot(path.name.split("-")[0]), read(path), path.with_name(f"{path.stem}.legs.json")
    truth = read_truth(_truth_of(path))
    if truth.fell or log.time[-1] < LOADED_AT or (criterion == LEGS and not legs.exists()):
        return None
    if criterion == LEGS:
        robot = with_identified_legs(robot, legs)
    return weighed(robot, log, truth, settings(factor, criterion))


def weigh_sensed(seed: int, factor: float, spread: float = 1.0, without: str = "") -> Found:
    """The trot with sensor errors of a seed, but for one kind of them."""
    robot, (exact, truth) = load_robot("hyq"), trot()
    errors = replace(STANDARD.times(factor), **({without: 0.0} if without else {}))
    return weighed(robot, sensed(exact, robot, seed, errors), truth, settings(spread, SPREAD))


@cache
def trot() -> tuple[Recording, Truth]:
    """Exact sensors, a load of 8 kg after five seconds."""
    robot = load_robot("hyq")
    load = Load(8.0, "kg")
    run = simulate(robot, "trot-load", SimulateSettings("ideal", load, duration=10.0, rate=500.0, load_time=LOADED_AT))
    return run.recording, run.truth


def halves(path: Path) -> dict[str, Any]:
    """Parameters of all legs from both halves of a log, by kind: their number, rms and largest difference over σ."""
    log, robot = read(path), load_robot(path.name.split("_")[0])
    middle = len(log) // 2
    found = [
        identify(robot, log.mapped(lambda _, values, part=part: values[part]), IdentifySettings(split=1.0))
        for part in (slice(middle), slice(middle, None))
    ]
    kinds: dict[str, list[float]] = {"all": []}
    for legs in zip(*(half.legs for half in found), strict=True):
        for name, first in legs[0].parameters.items():
            second = legs[1].parameters.get(name)  # None of a term that only one half shows
            if second is not None and first.std and second.std and not first.is_held and not second.is_held:
                z = abs(first.value - second.value) / float(np.hypot(first.std, second.std))
                kinds["all"].append(z)
                kinds.setdefault(name.rpartition(".")[2], []).append(z)
    rms = {kind: [len(z), float(np.sqrt(np.mean(np.square(z)))), max(z)] for kind, z in kinds.items()}
    return {"log": path.name, **rms}


def summary(what: str, factor: float, found: Sequence[Found]) -> dict[str, Any]:
    """One row."""
    errors, sigmas = (np.abs([run[name] for run in found]).reshape(len(found), -1) for name in ("errors", "sigmas"))
    aside = np.hypot(errors[:, 1], errors[:, 2])
    row: dict[str, Any] = {"what": what, "factor": factor, "runs": len(found)}
    for of, values in (("payload mass", errors[:, 4]), ("trunk mass", errors[:, 0]), ("trunk x-y", aside)):
        unit = "mm" if values is aside else "%"
        row |= {f"{of} {name} [{unit}]": _quantile(values, q) for name, q in (("median", 0.5), ("95 %", 0.95))}
    for k, name in enumerate(QUANTITIES):
        seen = sigmas[np.isfinite(sigmas[:, k]), k]
        row[f"{name} within 2 σ"] = float((seen <= 2.0).mean()) if len(seen) else None
        row[f"{name} rms error/σ"] = float(np.sqrt((seen**2).mean())) if len(seen) else None
    good = np.array([run["verdict"] == "good" for run in found])
    row["nees/n"] = float(np.mean([run["nees"] for run in found]))
    row["good"] = float(good.mean())
    row["largest σ, verdict good"] = float(np.nanmax(np.where(good[:, None], sigmas, 0.0)))
    return row


def _quantile(values: Array, share: float) -> float | None:
    values = values[np.isfinite(values)]
    return float(np.quantile(values, share)) if len(values) else None


def tables(folder: Path | None, draws: int, each: Callable[..., Iterator[Found | None]]) -> dict[str, list[Found]]:
    """Rows of both tables; the first is empty without a folder."""
    made: dict[str, list[Found]] = {"assumed": [], "simulated": []}
    kept = kept_logs(folder) if folder else {}
    for criterion in ("", *CRITERIA, SPREAD, LEGS):
        for factor, (gait, logs) in product(FACTORS, kept.items()):
            if factor != 1.0 or criterion in ("", LEGS):
                found = [run for run in each(partial(weigh_kept, factor=factor, criterion=criterion), logs) if run]
                if found:
                    made["assumed"].append(summary(f"{gait} {criterion}".strip(), factor, found))
    for spread, factor in product((1.0, 0.5, 3.0), FACTORS if draws else ()):
        found = [run for run in each(partial(weigh_sensed, factor=factor, spread=spread), range(draws)) if run]
        name = "standard" if spread == 1.0 else f"standard, {SPREAD} x {spread:g}"
        made["simulated"].append(summary(name, factor, found))
    for without in CONSTANTS if draws else ():
        found = [run for run in each(partial(weigh_sensed, factor=3.0, without=without), range(draws)) if run]
        made["simulated"].append(summary(f"standard, no {without}", 3.0, found))
    return made


def shown(title: str, rows: Sequence[Found]) -> TableData:
    """A table for the terminal: errors as median; 95th percentile, bars as share within 2 σ; rms of error over σ."""

    def spread(row: Found, of: str, unit: str) -> str:
        return "; ".join(_shown(row[f"{of} {name} [{unit}]"]) for name in ("median", "95 %"))

    def bars(row: Found, name: str) -> str:
        share = row[f"{name} within 2 σ"]
        return "-" if share is None else f"{100 * share:.0f} %; {_shown(row[f'{name} rms error/σ'])}"

    shown_first = (("payload mass", "%"), ("trunk mass", "%"), ("trunk x-y", "mm"))
    columns = ("payload [%]", "trunk [%]", "x-y [mm]")
    head = ("", "times", "runs", *columns, *QUANTITIES, "NEES/n", "good", "largest σ, good")
    return TableData.of(
        title,
        head,
        [
            (
                row["what"],
                f"{row['factor']:g}",
                str(row["runs"]),
                *(spread(row, of, unit) for of, unit in shown_first),
                *(bars(row, name) for name in QUANTITIES),
                f"{row['nees/n']:.2f}",
                f"{100 * row['good']:.0f} %",
                f"{row['largest σ, verdict good']:.1f}",
            )
            for row in rows
        ],
    )


def _shown(value: float | None) -> str:
    return "-" if value is None else f"{value:.2g}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=Path, help="folder of `stadera reproduce reality --keep`")
    parser.add_argument("--draws", type=int, default=8, help="of sensor errors; 0 for none")
    parser.add_argument("--real", type=Path, help="folder of logs of real legs in the air")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    with ProcessPoolExecutor(given.workers) as pool:
        made = tables(given.runs, given.draws, pool.map)
        real = list(pool.map(halves, sorted(given.real.glob("*_legs_in_air.csv")))) if given.real else []
    console = Console(width=220)
    for title, rows in made.items():
        if rows:
            console.print(
                rich_table(shown(f"sizes {title}: errors median; 95th %, bars: within 2 σ [%]; rms error/σ", rows))
            )
    for row in real:
        kinds = (f"{k} {v[1]:.2f} (of {v[0]}, largest {v[2]:.1f})" for k, v in row.items() if k != "log")
        console.print(f"halves of {row['log']}, differences over σ, rms: {', '.join(kinds)}")
    if given.json:
        with written_together([given.json]) as (draft,):
            write_text(draft, json.dumps({**made, "real": real}, indent=1))


if __name__ == "__main__":
    main()
