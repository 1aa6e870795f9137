"""What weighing while walking costs: an hour of a trot at 1 kHz through `TrunkEstimator`.

HyQ trots once in the test-bed (`standard` sensor errors), and what its sensors said is streamed again and again with
later stamps, a second apart, which the estimator takes for gaps. Fed in two ways, each in a process of its own:

* `update`, one measurement at a time, as on a robot: processor time a sample, of the 20 samples of a block, and of
  single calls, that is how long a control loop would wait;
* `add`, a whole recording at a time, as from a log.

Between the passes Pinocchio's `computeJointTorqueRegressor` of the whole robot runs in a Python loop over the same
samples: the ratio of the two, the median over pairs, depends less on the machine and on what else it does.

Compiling, or loading what was compiled before, is not timed. Objects made before the first pass are kept from Python's
collector of cyclic garbage (`gc.freeze`), as `stadera live` does and a control loop should: it would look through them
for up to 80 ms.

Peak memory after a minute and at the end tells whether memory grows with the log. Making the measurements is not timed.
Run `python benchmarks/walking_estimator.py [--minutes 2]`; `--json F` writes the figures.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is loaded: one core is what is measured

import numpy as np
import pinocchio as pin

from stadera.files import written_together
from stadera.lab.control.stand import TestBed
from stadera.lab.control.trot import Trot
from stadera.lab.pinocchio import pinocchio_model
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import STANDARD, Sensors, recording_of
from stadera.logs import Recording
from stadera.robot import Robot, load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.measurement import measurements_of
from stadera.trunk.samples import Samples
from stadera.types import Array

WAYS = ("update", "add")
PERIOD = 1e-3  # s
BLOCK = 20  # samples of the estimator's block
BOUNDS = {"microseconds_a_sample": 100.0, "block_99_ms": 20.0, "call_99_ms": 2.0, "call_worst_ms": 10.0}
RATIOS = {"add": 2.0, "update": 4.0}
"""Most that a sample may cost, in units of Pinocchio's regressor of the whole robot."""
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


Feed = Callable[[float], Array]
"""Feeds a pass whose stamps are so much later [s]; processor time of each sample (n,) [s]."""


def by_update(robot: Robot, recording: Recording) -> Feed:
    """Feeds a pass measurement by measurement."""
    estimator, said = TrunkEstimator(robot), list(measurements_of(recording, robot))

    def feed(later: float) -> Array:
        spent = np.empty(len(said))
        for k, measurement in enumerate(said):
            moved = replace(measurement, time=measurement.time + later)
            began = time.process_time()
            estimator.update(moved)
            spent[k] = time.process_time() - began
        _ = estimator.trunk
        return spent

    return feed


def by_add(robot: Robot, recording: Recording) -> Feed:
    """Feeds a pass at once; its processor time, evenly on the samples."""
    estimator = TrunkEstimator(robot)

    def feed(later: float) -> Array:
        log = replace(recording, time=recording.time + later)
        began = time.process_time()
        estimator.add(Samples.of_recording(log, robot))
        spent = time.process_time() - began
        _ = estimator.trunk
        return np.full(len(log), spent / len(log))

    return feed


def by_pinocchio(robot: Robot, recording: Recording, most: int = 4000) -> Callable[[], float]:
    """The regressor of joint torques of the whole floating robot, sample by sample; processor time a sample [s]."""
    model, imu = pinocchio_model(robot), recording.imu
    data, n = model.createData(), min(len(recording), most)
    q = np.tile(pin.neutral(model), (n, 1))
    velocity, acceleration = np.zeros((2, n, model.nv))
    assert imu is not None
    q[:, 7:], velocity[:, 6:] = (recording.channel(kind, robot.tree.joints)[:n] for kind in ("position", "velocity"))
    velocity[:, 3:6] = imu.angular_velocity[:n]
    acceleration[1:] = np.diff(velocity, axis=0) / PERIOD

    def run() -> float:
        began = time.process_time()
        for k in range(n):
            pin.computeJointTorqueRegressor(model, data, q[k], velocity[k], acceleration[k])
        return (time.process_time() - began) / n

    return run


def measured(way: str, seconds: float, minutes: float) -> dict[str, float]:
    """One way's figures."""
    robot = load_robot("hyq")
    recording = trot(robot, seconds)
    feed = {"update": by_update, "add": by_add}[way](robot, recording)
    pinocchio = by_pinocchio(robot, recording)
    after_minute, means, reference = 0.0, [], [pinocchio()]
    blocks, calls = Histogram(), Histogram()
    gc.collect()
    gc.freeze()
    for later in passes(seconds, minutes):
        spent = feed(later)
        reference.append(pinocchio())
        means.append(float(spent.mean()))
        calls.add(spent)
        blocks.add(spent[: len(spent) // BLOCK * BLOCK].reshape(-1, BLOCK).sum(axis=1))
        if not after_minute and later >= 60.0:
            after_minute = peak_mb()
    pairs = [mean / (0.5 * (a + b)) for mean, (a, b) in zip(means, pairwise(reference), strict=True)]
    found = {
        "samples": float(calls.count),
        "microseconds_a_sample": 1e6 * float(np.mean(means)),
        "best_pass_microseconds_a_sample": 1e6 * min(means),
        "pinocchio_microseconds_a_sample": 1e6 * float(np.median(reference)),
        "times_pinocchio": float(np.median(pairs)),
        "block_median_ms": 1e3 * blocks.quantile(0.5),
        "block_99_ms": 1e3 * blocks.quantile(0.99),
        "peak_mb_minute": after_minute or peak_mb(),
        "peak_mb_end": peak_mb(),
    }
    if way == "update":
        found |= {"call_99_ms": 1e3 * calls.quantile(0.99), "call_worst_ms": 1e3 * calls.worst}
    return found


class Histogram:
    """Times [s] by their logarithm: memory that does not grow."""

    def __init__(self) -> None:
        self._edges = np.geomspace(1e-7, 10.0, 8001)
        self._counts = np.zeros(len(self._edges) - 1, dtype=int)
        self.count, self.worst = 0, 0.0

    def add(self, times: Array) -> None:
        """Counts some (n,)."""
        self._counts += np.histogram(np.clip(times, self._edges[0], self._edges[-1]), self._edges)[0]
        self.count, self.worst = self.count + len(times), max(self.worst, float(times.max()))

    def quantile(self, share: float) -> float:
        """[s], to a quarter of a per cent."""
        return float(self._edges[1:][np.searchsorted(np.cumsum(self._counts), share * self.count)])


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
        print(
            f"  {now['times_pinocchio']:.1f} times Pinocchio's regressor of the whole robot, "
            f"{now['pinocchio_microseconds_a_sample']:.1f} µs (bound {RATIOS[way]:.0f})"
        )
        if way == "update":
            print(
                f"  a block of {BLOCK} samples: median {now['block_median_ms']:.2f} ms, "
                f"99 % within {now['block_99_ms']:.2f} ms (bound {BOUNDS['block_99_ms']:.0f})"
            )
            print(
                f"  a call: 99 % within {now['call_99_ms']:.2f} ms (bound {BOUNDS['call_99_ms']:.0f}), "
                f"worst {now['call_worst_ms']:.1f} ms (bound {BOUNDS['call_worst_ms']:.0f})"
            )
        print(f"  peak memory {now['peak_mb_minute']:.1f} MB after a minute, {now['peak_mb_end']:.1f} MB at the end")
    if args.json:
        with written_together([args.json]) as (draft,):
            draft.write_text(json.dumps(found, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
