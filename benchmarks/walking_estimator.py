"""What weighing while walking costs: an hour of a trot at 1 kHz through `TrunkEstimator`.

HyQ trots once in the test-bed (`standard` sensor errors), and what its sensors said is streamed again and again with
later stamps, a second apart, which the estimator takes for gaps. Fed in two ways, each in a process of its own:

* `update`, one measurement at a time, as on a robot: processor time a sample, and of the 20 samples of a block, that is
  how long a control loop would wait at worst;
* `add`, a whole recording at a time, as from a log.

Peak memory after a minute and at the end tells whether memory grows with the log. Making the measurements is not timed.
Run `python benchmarks/walking_estimator.py [--minutes 2]`; `--json F` writes the figures.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is loaded: one core is what is measured

import numpy as np

from stadera.files import written_together
from stadera.lab.control import TestBed, Trot
from stadera.lab.plant import STANDARD, Plant, Sensors
from stadera.lab.record import recording_of
from stadera.logs import Recording
from stadera.robot import Robot, load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.measurement import Measurement, measurements_of
from stadera.trunk.samples import Samples

WAYS = ("update", "add")
PERIOD = 1e-3  # s
BLOCK = 20  # samples of the estimator's block
BOUNDS = {"microseconds_a_sample": 100.0, "block_99_ms": 20.0}
_PAUSE = 1.0  # s between one pass and the next
_SETTLE = 1.0  # s of the trot's beginning that is left out


def trot(robot: Robot, seconds: float) -> Recording:
    """What the sensors say of so many seconds of trotting at 0.3 m/s."""
    plant, controller = Plant(robot), Trot.of(robot)
    plant.reset(standing_configuration(robot))
    bed = TestBed(plant, Sensors(STANDARD, 0, robot), controller, hold=2)
    bed.run(0.5)
    controller.walk((0.3, 0.0), turn=0.2)
    bed.run(_SETTLE)
    recorder, samples = Sensors(STANDARD, 1, robot), []
    bed.run(seconds, lambda _: samples.append(recorder.read(plant)))
    return recording_of(samples, robot)


def passes(length: float, minutes: float) -> Iterator[float]:
    """By how much the stamps of each pass are later [s]."""
    yield from (k * (length + _PAUSE) for k in range(max(1, round(60.0 * minutes / length))))


def by_update(robot: Robot, recording: Recording) -> Callable[[float], list[float]]:
    """Feeds a pass measurement by measurement; processor time [s] of each block's samples."""
    estimator, said = TrunkEstimator(robot), list(measurements_of(recording, robot))

    def feed(later: float) -> list[float]:
        spent = []
        for start in range(0, len(said), BLOCK):
            block: list[Measurement] = [replace(m, time=m.time + later) for m in said[start : start + BLOCK]]
            began = time.process_time()
            for measurement in block:
                estimator.update(measurement)
            spent.append(time.process_time() - began)
        estimator.parameters()
        return spent

    return feed


def by_add(robot: Robot, recording: Recording) -> Callable[[float], list[float]]:
    """Feeds a pass at once; its processor time [s], evenly on the blocks."""
    estimator = TrunkEstimator(robot)

    def feed(later: float) -> list[float]:
        log = replace(recording, time=recording.time + later)
        began = time.process_time()
        estimator.add(Samples.of_recording(log, robot))
        spent = time.process_time() - began
        estimator.parameters()
        blocks = len(log) // BLOCK
        return [spent / blocks] * blocks

    return feed


def measured(way: str, seconds: float, minutes: float) -> dict[str, float]:
    """One way's figures."""
    robot = load_robot("hyq")
    recording = trot(robot, seconds)
    feed = {"update": by_update, "add": by_add}[way](robot, recording)
    blocks = np.empty(0)
    after_minute = 0.0
    spent, counts = [], []
    edges = np.geomspace(1e-5, 10.0, 4001)  # a histogram: what is kept must not grow either
    histogram = np.zeros(len(edges) - 1, dtype=int)
    for later in passes(seconds, minutes):
        blocks = np.array(feed(later))
        spent.append(float(blocks.sum()))
        counts.append(len(blocks))
        histogram += np.histogram(np.clip(blocks, edges[0], edges[-1]), edges)[0]
        if not after_minute and later >= 60.0:
            after_minute = peak_mb()
    share = np.cumsum(histogram) / histogram.sum()
    return {
        "samples": float(BLOCK * sum(counts)),
        "microseconds_a_sample": 1e6 * sum(spent) / (BLOCK * sum(counts)),
        "best_pass_microseconds_a_sample": 1e6 * min(s / (BLOCK * n) for s, n in zip(spent, counts, strict=True)),
        "block_median_ms": 1e3 * float(edges[1:][np.searchsorted(share, 0.5)]),
        "block_99_ms": 1e3 * float(edges[1:][np.searchsorted(share, 0.99)]),
        "peak_mb_minute": after_minute or peak_mb(),
        "peak_mb_end": peak_mb(),
    }


def peak_mb() -> float:
    """The process's peak resident memory [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Runs both ways and prints their figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0, help="of samples at 1 kHz that are streamed")
    parser.add_argument("--seconds", type=float, default=10.0, help="of trotting that is simulated")
    parser.add_argument("--ways", default=",".join(WAYS))
    parser.add_argument("--json", type=Path)
    parser.add_argument("--way", choices=WAYS, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.way:
        print(json.dumps(measured(args.way, args.seconds, args.minutes)))
        return
    found: dict[str, dict[str, float]] = {}
    for way in args.ways.split(","):
        command = [sys.executable, __file__, "--way", way, f"--seconds={args.seconds}", f"--minutes={args.minutes}"]
        found[way] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        now = found[way]
        real_time = 1e6 * PERIOD / now["microseconds_a_sample"]
        print(f"{way}: {now['samples']:.0f} samples of HyQ's trot at 1 kHz")
        print(
            f"  {now['microseconds_a_sample']:.1f} µs a sample (bound {BOUNDS['microseconds_a_sample']:.0f}), "
            f"{real_time:.1f} x real time; best pass {now['best_pass_microseconds_a_sample']:.1f} µs"
        )
        if way == "update":
            print(
                f"  a block of {BLOCK} samples: median {now['block_median_ms']:.2f} ms, "
                f"99 % within {now['block_99_ms']:.2f} ms (bound {BOUNDS['block_99_ms']:.0f})"
            )
        print(f"  peak memory {now['peak_mb_minute']:.1f} MB after a minute, {now['peak_mb_end']:.1f} MB at the end")
    if args.json:
        with written_together([args.json]) as (draft,):
            draft.write_text(json.dumps(found, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
