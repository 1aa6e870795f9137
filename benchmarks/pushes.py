"""What a short push leaves behind: the trunk's error while a robot is pushed and after, by gait.

`python benchmarks/pushes.py [--seed N] [--keep FOLDER] [--json F]`

Each robot trots, crawls and sways with the test-bed's `real` errors, and is pushed up, down or aside by 10, 25 or 60 %
of its weight for 0.1, 0.3 or 1 s, at 5 s. Two seconds after the push the trunk's mass and centre should be within 3 σ
of the truth; a push may be reported as a change of the load while it lasts, but not stay one. "withdrawn" counts pushes
that were noticed and are no change in the end. Robots that fall are left out.
"""

from __future__ import annotations

import zlib
from collections import defaultdict
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from simulated import made_log, parser_of, show

from stadera.constants import GRAVITY
from stadera.errors import StaderaError
from stadera.lab.plant.payload import OutsideForce, Tray
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.truth import Truth
from stadera.logs import Recording
from stadera.robot import Robot, load_robot
from stadera.trunk import TrunkEstimator
from stadera.trunk.samples import Samples

ROBOTS = ("hyq", "go2", "anymal_b", "b1", "a1", "aliengo")
GAITS = ("trot", "crawl", "shake")
WAYS = {"up": (0.0, 0.0, 1.0), "down": (0.0, 0.0, -1.0), "aside": (0.0, 1.0, 0.0)}
SHARES, SECONDS = (0.10, 0.25, 0.60), (0.1, 0.3, 1.0)
BEGIN, AFTER, LENGTH = 5.0, 2.0, 9.0  # s


@dataclass(frozen=True)
class Push:
    """One run."""

    robot: str
    gait: str
    way: str
    share: float  # of the weight
    seconds: float  # how long it lasts

    def log(self, robot: Robot, seed: int, folder: Path | None) -> tuple[Recording, Truth] | None:
        """The log, stored earlier or simulated now; None if the robot fell."""
        tray = Tray.of(robot)
        at = (float(tray.centre[0]), float(tray.centre[1]), tray.top)
        size = self.share * robot.mass * GRAVITY
        force = OutsideForce(size, WAYS[self.way], at, BEGIN, BEGIN + self.seconds, ramp=0.03)
        name = "-".join(map(str, (*vars(self).values(), seed)))
        settings = SimulateSettings(
            "real", None, duration=LENGTH, seed=zlib.crc32(name.encode()), hold=2, outside=force
        )
        return made_log(robot, self.gait, settings, folder, f"push-{name}")


def weighed(push: Push, seed: int, folder: Path | None) -> dict[str, Any]:
    """Errors over their standard deviations before the push, at its end, and `AFTER` it; changes noticed and kept."""
    robot = load_robot(push.robot)
    made = push.log(robot, seed, folder)
    if made is None:
        return {"fell": True}
    log, truth = made
    samples, estimator, found = Samples.of_recording(log, robot), TrunkEstimator(robot), {}
    begin, noticed = 0.0, 0
    end = BEGIN + push.seconds
    right = np.array([truth.moments[0].mass, *truth.moments[0].com])
    for name, until in (("before", BEGIN), ("end", end), ("soon", end + 0.5), ("after", end + AFTER)):
        estimator.add(samples[(samples.time >= begin) & (samples.time < until)])
        begin, now = until, estimator.estimate()
        off = (now.value - right) / now.std
        found[name] = float(np.nanmax(np.abs(off)))
        found[f"{name} mass"] = float(now.value[0] - right[0]) / robot.mass
        noticed = max(noticed, len(estimator.changes))
    return found | {
        "fell": False,
        "noticed": noticed,
        "kept": len(estimator.changes),
        "verdict": estimator.trust.verdict,
    }


def cases(seed: int) -> list[Push]:
    """Every robot and gait with each way, size and length of a push once."""
    draw, out = np.random.default_rng(seed), []
    for robot, gait in product(ROBOTS, GAITS):
        shares, seconds = draw.permutation(SHARES), draw.permutation(SECONDS)
        out += [Push(robot, gait, way, float(shares[k]), float(seconds[k])) for k, way in enumerate(WAYS)]
    return out


def main() -> None:
    options, runs = parser_of(__doc__).parse_args(), []
    for push in cases(options.seed):
        try:
            runs.append((push, weighed(push, options.seed, options.keep)))
        except StaderaError as error:
            runs.append((push, {"fell": True, "why": str(error)}))
    by_gait = defaultdict(list)
    for push, run in runs:
        if not run["fell"]:
            by_gait[push.gait].append(run)
    rows = []
    for gait, own in by_gait.items():

        def within(when: str, own: list[dict[str, Any]] = own) -> str:
            return f"{100.0 * np.mean([run[when] < 3.0 for run in own]):.0f}"

        off = [100.0 * abs(run["after mass"]) for run in own]
        kept, noticed = sum(run["kept"] for run in own), sum(run["noticed"] > 0 for run in own)
        row = [str(len(own)), *(within(when) for when in ("before", "end", "soon", "after"))]
        rows.append((gait, *row, f"{np.median(off):.2g}; {np.percentile(off, 95):.2g}", str(noticed), str(kept)))
    header = ("gait", "runs", "before", "at its end", "0.5 s after", "2 s after", "mass off [%]", "noticed", "kept")
    show("Within 3 σ [% of runs]", header, rows, [vars(push) | run for push, run in runs], options.json)


if __name__ == "__main__":
    main()
