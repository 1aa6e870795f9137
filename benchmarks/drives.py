"""What walks and sways tell about drives: rotor inertia, friction and torque offsets against those drawn.

`python benchmarks/drives.py [--seed N] [--seeds K] [--keep FOLDER] [--json F]`

By gait and term, over all joints of six robots with `real` errors, each weighed once: how many were observed, the
median error of these (relative; offsets as a share of the joint's limit), and how many lie within 2 standard
deviations.
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
from stadera.robot import load_robot
from stadera.trunk.drives import TERMS
from stadera.types import Array
from stadera.weigh import weigh

ROBOTS = ("hyq", "go2", "anymal_c", "a1", "aliengo", "spot")
GAITS = ("trot-load", "crawl-load", "shake-load")


def joints(name: str, gait: str, seed: int, folder: Path | None) -> Array | None:
    """(4 terms, 3, joints): error over what it is compared with, error over its bar, and whether it was observed; None
    for a robot that fell or a log that is refused.
    """
    robot, case = load_robot(name), f"{name}-{gait}-{seed}"
    settings = SimulateSettings("real", seed=zlib.crc32(case.encode()))
    made = made_log(robot, gait, settings, folder, f"scale-{case}")
    if made is None or made[1].drawn is None:
        return None
    log, truth = made
    try:
        drives = weigh(robot, log).drives
    except StaderaError:
        return None
    assert drives is not None
    drawn: Any = truth.drawn
    true = np.array([[drawn["joints"][joint][term] for term in TERMS] for joint in drives.joints])
    true[:, 3] += [drawn["torque_offset"][joint] for joint in drives.joints]
    scale = np.where(np.arange(4) < 3, np.abs(true), [[robot.limits[joint].effort] for joint in drives.joints])
    off = drives.value - true
    return np.stack([np.abs(off / scale), np.abs(off / drives.std), drives.observed]).transpose(2, 0, 1)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--seeds", type=int, default=1, help="runs of each robot and gait")
    chosen = parser.parse_args()
    found: dict[str, list[Array]] = defaultdict(list)
    for seed, name, gait in product(range(chosen.seed, chosen.seed + chosen.seeds), ROBOTS, GAITS):
        each = joints(name, gait, seed, chosen.keep)
        if each is not None:
            found[gait].append(each)
    out = []
    for gait, every in found.items():
        for term, (off, z, seen) in zip(TERMS, np.concatenate(every, axis=2), strict=True):
            error = float(np.median(off[seen > 0])) if seen.any() else float("nan")
            row = {"gait": gait, "term": term, "joints": len(z), "observed": float(seen.mean()), "error": error}
            out.append(row | {"within 2 sigma": float((z < 2.0).mean()), "largest": float(z.max())})
    rows = [
        (f"{r['gait']} {r['term']}", *(f"{100.0 * r[key]:.3g} %" for key in ("observed", "error", "within 2 sigma")))
        for r in out
    ]
    head = ("drives", "observed", "error, median", "within 2 σ")
    show("Drives by motion", head, rows, out, chosen.json)


if __name__ == "__main__":
    main()
