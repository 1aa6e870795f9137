"""What the weighing routine promises and what it brings: robots with `real` errors that do it without and with a load.

`python benchmarks/routine.py [--robots go2,b1] [--seed N] [--seeds K] [--errors real-unit-gain] [--json F]`

By robot: error and bar of the payload (share of the robot), its place, predicted bar over the reached one, changes that
were none, falls. The load is 5 to 20 % of the robot, anywhere on its back.
"""

from __future__ import annotations

import os
import zlib
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from simulated import made_log, parser_of, show

from stadera.excite.trunk.design import RoutineSettings, weighing_routine
from stadera.excite.trunk.result import Routine
from stadera.lab.plant.payload import Tray
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.logs import Recording
from stadera.trunk import Samples, TrunkEstimator

STILL = 0.2  # s, from the end of the first motion to the tare


def run(routine: Routine, errors: str, seed: int, folder: Path | None) -> dict[str, Any] | None:
    """One robot weighed; None if it fell."""
    robot, motion = routine.robot, routine.planted.motion
    table = Recording(routine.planted.time, robot.tree.joints, motion.position, source="routine")
    number = zlib.crc32(f"{robot.name}-{seed}".encode())
    rng, tray = np.random.default_rng(number), Tray.of(robot)
    x, y = (tray.centre[:2] + 0.5 * rng.uniform(-1.0, 1.0, 2) * tray.half_size[:2]).tolist()
    load = Load(float(rng.uniform(0.05, 0.2)) * robot.mass, "kg", (x, y, tray.top + 0.05))
    length = routine.settings.seconds
    how = SimulateSettings(errors, load, duration=2.0 * length + 3.0, seed=number, motion=table)
    made = made_log(robot, "motion", how, folder, f"routine-{robot.name}-{errors}-{seed}")
    if made is None:
        return None
    samples, truth = Samples.of_recording(made[0], robot), made[1].moments[-1]
    estimator, tared = TrunkEstimator(robot), 1.0 + length + STILL
    estimator.add(samples[samples.time < tared])
    early = len(estimator.changes)
    estimator.tare()
    estimator.add(samples[samples.time >= tared])
    payload = estimator.payload
    assert payload is not None
    assert truth.payload_com is not None
    off = payload.com - np.array(truth.payload_com)
    return {
        "error": abs(payload.mass - truth.payload_mass) / robot.mass,
        "sigma": abs(payload.mass - truth.payload_mass) / payload.mass_std,
        "bar": payload.mass_std_without_scale or np.nan,
        "x-y": 1e3 * float(np.hypot(*off[:2])),
        "z": 1e3 * abs(float(off[2])),
        "false": early + max(len(estimator.changes) - early - 1, 0),
        "verdict": str(estimator.trust.verdict),
    }


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--robots", default="go2,b1,anymal_c")
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--errors", default="real-unit-gain")
    asked = parser.parse_args()
    rows, kept = [], {}
    for name in asked.robots.split(","):
        routine = weighing_routine(name, RoutineSettings())
        found = [run(routine, asked.errors, seed, asked.keep) for seed in range(asked.seed, asked.seed + asked.seeds)]
        runs = [one for one in found if one is not None]
        kept[name] = {"expected": routine.to_dict()["expected"], "runs": found}
        error, z = (np.array([one[key] for one in runs]) for key in ("error", "sigma"))
        place = [f"{np.nanmedian([one[key] for one in runs]):.0f}" for key in ("x-y", "z")]
        bar = float(np.median([one["bar"] for one in runs])) / routine.expected.mass
        rows.append(
            (
                name,
                f"{100.0 * np.median(error):.2f}; {100.0 * np.percentile(error, 95):.2f}",
                *place,
                f"{bar:.1f}",
                f"{z.max():.1f}",
                f"{sum(one['false'] for one in runs)}",
                f"{sum(one['verdict'] == 'good' for one in runs)} of {len(runs)}, {len(found) - len(runs)} fell",
            )
        )
    head = ("robot", "payload's error [%]", "x-y [mm]", "z [mm]", "bar/promised", "largest [σ]", "false", "good")
    show("Weighing routine; error as a share of the robot: median; 95 %", head, rows, kept, asked.json)


if __name__ == "__main__":
    main()
