"""Hours of a robot's stream through `LiveSession`: memory that stays flat, an estimate that does not drift.

HyQ sways once in the test-bed (`standard` sensor errors) and what its sensors said is fed again and again with later
stamps, a second apart, in batches of a fifth of a second. In every hundredth batch the accelerometer reads zero, so
that refusals occur all the time.

Measured each minute of the stream: memory of the process, mass and centre of mass against those after the first minute,
in their standard deviations; in the end the notes, the changes of the load that were reported, the processor time.

    python benchmarks/long_run.py --hours 1 --rate 500
    python benchmarks/long_run.py --hours 24 --rate 50 --json day.json
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from stadera.files import written_together
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.live.session import LiveSession
from stadera.logs import Imu, Recording, take
from stadera.robot import load_robot

BOUNDS = {"memory_grows": 0.05, "drift_sigmas": 1.0, "changes": 0}
"""Share of memory after a minute; change of the estimate in its standard deviations; changes of a load that is none."""

_PASS, _BEGIN, _PAUSE = 20.0, 1.0, 1.0  # s: of the simulated motion, its beginning left out, gap between passes
_BATCH = 0.2  # s
_SPOILT = 100  # batches, of which one has samples that cannot be used


def batches(once: Recording, seconds: float) -> Iterator[Recording]:
    """The stream."""
    size = max(2, round(_BATCH * (len(once) - 1) / float(once.time[-1] - once.time[0])))
    length, count, later = float(once.time[-1] - once.time[0]) + _PAUSE, 0, 0.0
    while later < seconds:
        for start in range(0, len(once), size):
            part = take(once, slice(start, start + size))
            part = replace(part, time=part.time + later)
            count += 1
            yield part if count % _SPOILT else _spoilt(part)
        later += length


def _spoilt(part: Recording) -> Recording:
    """With an accelerometer that reads zero."""
    imu = part.imu
    assert imu is not None
    return replace(part, imu=Imu(imu.angular_velocity, 0.0 * imu.linear_acceleration, None, imu.frame))


def memory() -> float:
    """Of this process [MB]."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1024


def run(hours: float, rate: float, seed: int) -> dict[str, Any]:
    """Figures of a stream of so many hours at a rate [Hz]."""
    robot = load_robot("hyq")
    settings = SimulateSettings("standard", duration=_PASS, rate=rate, seed=seed)
    made = simulate(robot, "shake", settings).recording
    once = take(made, made.time >= _BEGIN)
    session, seconds = LiveSession(robot), 3600.0 * hours
    first: tuple[np.ndarray, np.ndarray] | None = None
    after_a_minute, drift, began, minute = np.nan, 0.0, time.process_time(), 1
    for part in batches(once, seconds):
        session.add(part, 0.0)
        if part.time[0] < 60.0 * minute or session.estimator is None:
            continue
        estimate = session.estimator.estimate()
        minute += 1
        if first is None:
            first, after_a_minute = (estimate.value.copy(), estimate.std.copy()), memory()
        with np.errstate(invalid="ignore"):
            drift = max(drift, float(np.nanmax(np.abs(estimate.value - first[0]) / first[1])))
    state = session.state()
    return {
        "hours": hours,
        "rate": rate,
        "memory_after_a_minute_mb": round(after_a_minute, 1),
        "memory_at_the_end_mb": round(memory(), 1),
        "memory_grows": round(memory() / after_a_minute - 1.0, 4),
        "drift_sigmas": round(drift, 3),
        "changes": len(state.changes),
        "notes": len(state.notes),
        "verdict": state.trust.verdict,
        "processor_seconds": round(time.process_time() - began, 1),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--hours", type=float, default=0.1)
    parser.add_argument("--rate", type=float, default=500.0, help="[Hz], 1000 over a whole number")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, metavar="F")
    asked = parser.parse_args()
    figures = run(asked.hours, asked.rate, asked.seed)
    for name, value in figures.items():
        print(f"{name:28}{value}")
    if asked.json:
        with written_together([asked.json]) as (draft,):
            draft.write_text(json.dumps(figures, indent=1), encoding="utf-8")
    return int(any(figures[name] > bound for name, bound in BOUNDS.items()))


if __name__ == "__main__":
    sys.exit(main())
