"""What a scale is worth: robots with `real` errors weighed with and without their weight at the tare.

`python benchmarks/on_scale.py [--seed N] [--seeds K] [--scale KG] [--keep FOLDER] [--json F]`

By gait: errors of the payload and of the trunk (share of the robot), the trunk's bar, and errors over their bars.
The scale shows the true mass of the drawn robot, off by a draw of its standard deviation.
"""

from __future__ import annotations

import zlib
from collections import defaultdict
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from simulated import made_log, parser_of, show

from stadera.errors import StaderaError
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.report.numbers import number
from stadera.robot import load_robot
from stadera.types import Array
from stadera.weigh import weigh

ROBOTS = ("hyq", "go2", "anymal_c", "a1", "aliengo", "spot")
GAITS = ("trot-load", "crawl-load", "shake-load")
BEFORE = 0.5  # s, from the tare's end to the load


def errors(name: str, gait: str, seed: int, scale: float, folder: Path | None) -> Array | None:
    """(2, 5), without and with the scale: payload's and trunk's error [kg], both over their bars, and the trunk's bar
    [kg]; None for a robot that fell or a log that is refused.
    """
    robot, case = load_robot(name), f"{name}-{gait}-{seed}"
    number = zlib.crc32(case.encode())
    settings = SimulateSettings("real", seed=number)
    made = made_log(robot, gait, settings, folder, f"scale-{case}")
    if made is None:
        return None
    log, truth = made
    loaded = next((moment for moment in truth.moments if moment.payload_mass), None)
    if loaded is None or truth.drawn is None:
        return None
    links: Any = truth.drawn["links"]
    whole = sum(body[0] for body in links.values()) + scale * np.random.default_rng(number).standard_normal()
    found = []
    for weight in (None, (float(whole), scale)):
        try:
            result = weigh(robot, log, (float(log.time[0]), loaded.time - BEFORE), weight=weight)
        except StaderaError:
            return None
        assert result.payload is not None
        off, trunk = result.payload.mass - loaded.payload_mass, result.mass - loaded.mass
        found.append((off, trunk, off / result.payload.mass_std, trunk / result.mass_std, result.mass_std))
    return np.array(found)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--seeds", type=int, default=1, help="runs of each robot and gait")
    parser.add_argument("--scale", type=float, default=0.05, metavar="KG", help="standard deviation of the scale")
    chosen = parser.parse_args()
    runs: dict[str, list[Array]] = defaultdict(list)
    for seed, name, gait in product(range(chosen.seed, chosen.seed + chosen.seeds), ROBOTS, GAITS):
        found = errors(name, gait, seed, chosen.scale, chosen.keep)
        if found is not None:
            runs[gait].append(found / np.where([True, True, False, False, True], load_robot(name).mass / 100.0, 1.0))
    out, rows = [], []
    for gait, every in runs.items():
        for k, weighed in enumerate(("without", "with")):
            sizes = np.abs(np.array(every)[:, k])
            median, most = np.median(sizes, axis=0).tolist(), sizes.max(axis=0).tolist()
            out.append({"gait": gait, "scale": weighed, "runs": len(every), "median": median, "largest": most})
            cells = (f"{number(m, 2)} ({number(x, 2)})" for m, x in zip(median, most, strict=True))
            rows.append((f"{gait} {weighed}", str(len(every)), *cells))
    head = ("weighed", "runs", "payload [%]", "trunk [%]", "payload [σ]", "trunk [σ]", "trunk's σ [%]")
    show("Errors, median (largest), % of the robot", head, rows, out, chosen.json)


if __name__ == "__main__":
    main()
