"""What each mechanism of `TrunkEstimator` is worth: all logs weighed again without it, beside the estimator as it is.

`python benchmarks/ablation.py LOGS [--seed N] [--walks FOLDER] [--only NAME ...]`

Four robots trot, crawl and sway for 10 s with the test-bed's errors `real` and `real-unit-gain` and are loaded at 5 s;
their logs are kept in LOGS. FOLDER holds tables of real walks of one Mini Cheetah (`stadera reproduce mini_cheetah`).

score: mean of ½ (e/σ)² + ln σ over masses and centres: small errors and honest bars alike; lower is better.
errors: median and 95 % of mass errors [% of the robot]; within 2 σ [%]; beyond 4 σ with the verdict good.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from stadera.lab.experiments.reality import RealityCase, real_log
from stadera.logs.reader import read
from stadera.robot import load_robot
from stadera.trunk import ModelErrors, TrunkEstimator, TrunkSettings, changes, front, ground, history, window
from stadera.trunk.samples import Samples

ROBOTS, GAITS, SHARES = ("go2", "hyq", "anymal_c", "b1"), ("trot", "crawl", "shake"), (0.1, 0.05, 0.25, 0.0)
STRAIGHT = ("asphalt_road", "forest", "middle_pebble", "old_asphalt_road", "rock_road", "sidewalk", "small_pebble")
LOADED_AT, SOON = 5.0, 0.5  # s
PLAIN = TrunkSettings()


def sizes(**values: float) -> TrunkSettings:
    return replace(PLAIN, model=replace(ModelErrors(), **values))


MECHANISMS: dict[str, tuple[TrunkSettings, Any, str, Any]] = {
    "as it is": (PLAIN, None, "", None),
    "direction of sliding by samples": (PLAIN, window.Window, "line", lambda self, velocity: velocity),
    "ground level": (PLAIN, ground.GroundNormal, "normals", lambda self, up, *_: up),
    "blocks count alike": (PLAIN, history.RobustWeights, "weight", lambda self, *_: 1.0),
    "blocks at rest count alike": (
        replace(
            PLAIN,
            outliers=replace(PLAIN.outliers, held=1.0),
            changes=replace(PLAIN.changes, sliding=1e-9),
        ),
        None,
        "",
        None,
    ),
    "joints' friction unknown in the air": (PLAIN, front.Front, "know_joints", lambda self, *_: None),
    "spread by Gauss, not Student": (PLAIN, changes, "_student", lambda deviations, _: deviations),
    "size of model errors fixed": (replace(PLAIN, size_spread=0.01), None, "", None),
    "no static friction": (sizes(held=1e-6), None, "", None),
    "no response of the IMU": (sizes(imu_response=1e-6), None, "", None),
    "no lag of velocities": (sizes(velocity_lag=1e-9), None, "", None),
    "drives not alike": (sizes(alike=0.0), None, "", None),
    "static friction not alike": (sizes(sagging=0.0), None, "", None),
    "static friction another after each load": (sizes(renewed=0.0), None, "", None),
}


@contextmanager
def without(place: Any, name: str, instead: Any) -> Iterator[None]:
    """Puts something else in place of an attribute of a module or class."""
    if place is None:
        yield
        return
    kept = getattr(place, name)
    setattr(place, name, instead)
    try:
        yield
    finally:
        setattr(place, name, kept)


def simulated(folder: Path, seed: int) -> Iterator[tuple[RealityCase, Any, Any]]:
    """Cases whose robot does not fall, with samples and truth."""
    k = 0
    for gait in GAITS:
        for name in ROBOTS:
            for errors in ("real-unit-gain", "real"):
                case = RealityCase(name, gait, SHARES[(k + k // 8 + 2 * (k % 2)) % 4], errors, seed)
                k, robot = k + 1, load_robot(name)
                log, truth = real_log(case, robot, folder)
                if truth.fell is None:
                    yield case, Samples.of_recording(log, robot), truth


def weighed(case: RealityCase, samples: Samples, truth: Any, settings: TrunkSettings) -> dict[str, Any]:
    """Errors and standard deviations of the trunk at the tare and of the payload at the end."""
    robot, bare, load = load_robot(case.robot), truth.moments[0], truth.moments[-1]
    estimator = TrunkEstimator(robot, settings=settings)
    estimator.add(samples[samples.time < LOADED_AT])
    trunk, verdict = estimator.estimate(), estimator.trust.verdict
    estimator.tare()
    estimator.add(samples[samples.time >= LOADED_AT])
    payload = estimator.payload
    assert payload is not None
    unit = np.array([robot.mass, *3 * [robot.leg_length]])
    off, std = (trunk.value - [bare.mass, *bare.com]) / unit, trunk.std / unit
    put_on, bar = (payload.mass - load.payload_mass) / robot.mass, payload.mass_std / robot.mass
    late = [change.noticed - LOADED_AT for change in estimator.changes if change.noticed > LOADED_AT]
    return {
        "trunk": abs(off[0]),
        "payload": abs(put_on),
        "off": np.append(off, put_on),
        "std": np.append(std, bar),
        "good": "good" in (verdict, estimator.trust.verdict),
        "noticed": bool(late) and late[0] < SOON if case.share else None,
        "false": len(estimator.changes) - (1 if late and case.share else 0),
    }


def line(name: str, runs: list[dict[str, Any]], walks: list[float]) -> str:
    off, std = (np.concatenate([run[key] for run in runs]) for key in ("off", "std"))
    seen = np.isfinite(std)
    z, good = np.abs(off / std)[seen], np.concatenate([np.full(5, run["good"]) for run in runs])[seen]
    score = float(np.minimum(0.5 * z**2 + np.log(std[seen]), 10.0).mean())
    spread = [100.0 * np.percentile([run[key] for run in runs], p) for key in ("trunk", "payload") for p in (50, 95)]
    loads = [run["noticed"] for run in runs if run["noticed"] is not None]
    cells = [name, f"{score:.3f}", "{:.2f}; {:.1f}".format(*spread[:2]), "{:.2f}; {:.1f}".format(*spread[2:])]
    cells += [f"{100.0 * np.mean(z < 2.0):.0f}", str(int((good & (z > 4.0)).sum())), f"{sum(loads)} of {len(loads)}"]
    cells += [str(sum(run["false"] for run in runs))]
    if walks:
        cells.append(f"{100.0 * np.ptp(walks) / np.mean(walks):.1f}")
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("logs", type=Path)
    parser.add_argument("--seed", type=int, default=7100)
    parser.add_argument("--walks", type=Path)
    parser.add_argument("--only", nargs="*", default=list(MECHANISMS))
    asked = parser.parse_args()
    asked.logs.mkdir(parents=True, exist_ok=True)
    cases, cheetah = list(simulated(asked.logs, asked.seed)), load_robot("mini_cheetah")
    paths = [asked.walks / f"{name}.csv" for name in STRAIGHT] if asked.walks else []
    real = [Samples.of_recording(read(path), cheetah) for path in paths]
    print("| without | score | trunk | payload | within 2 σ | beyond 4 σ | noticed | false | walks' spread [%] |")
    for name in asked.only:
        settings, place, attribute, instead = MECHANISMS[name]
        with without(place, attribute, instead):
            runs, walks = [weighed(*case, settings) for case in cases], []
            for samples in real:
                estimator = TrunkEstimator(cheetah, settings=settings)
                estimator.add(samples)
                walks.append(float(estimator.estimate().value[0]))
        print(line(name, runs, walks), flush=True)


if __name__ == "__main__":
    main()
