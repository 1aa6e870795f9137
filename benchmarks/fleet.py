"""A fleet's logs by one worker, by two, and by a scheduler of its own: same table, nothing lost, seconds and memory.

`python benchmarks/fleet.py [--logs 40] [--seconds 8] [--rate 500] [--long 600] [--json F]`. Four robots trot in the
test-bed, once each; the logs are these runs with sensor errors (`standard`) of a seed each. One log is cut short and so
corrupt. Then, by the command as a person would call it:

* one worker, two workers, and two `dask worker`s of a `dask scheduler` on loopback: the tables' figures are compared;
* two workers, one of which is killed when a quarter of the rows is there: the table is compared again;
* the last call once more: it must do nothing;
* a log of `--long` seconds, and one a tenth as long: the worker's memory must not follow.

Peak memory is a process's resident memory, looked up every 50 ms. Wall time of two workers is worth something only on a
machine with two idle cores; the processor time of all workers is given with it.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from stadera.files import write_text, written_together
from stadera.fleet import read_fleet
from stadera.fleet.table import FleetTable
from stadera.lab.plant.sensors import STANDARD, SensorErrors, measured
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs import Recording, write_table
from stadera.robot import Robot, load_robot

ROBOTS = ("go2", "hyq", "anymal_c", "b1")
LOOKED_EVERY = 0.05  # s
LISTED_EVERY = 1.0  # s, between two searches for new processes, of which each takes milliseconds of a core
TIMED = ("seconds",)
"""Columns that differ between two runs of the same."""


@dataclass
class Cost:
    """Of one call: wall time [s], processor time of all its processes [s], and the largest worker's memory [MB]."""

    wall: float = 0.0
    processor: float = 0.0
    worker_mb: float = 0.0


def sensed(exact: Recording, robot: Robot, seed: int, errors: SensorErrors = STANDARD) -> Recording:
    """A run as sensors of this seed would have given it."""
    rng, imu = np.random.default_rng([seed, 1]), exact.imu
    assert imu is not None
    log = measured(exact, robot, errors, seed)

    def noisy(values: np.ndarray, constant: float, white: float) -> np.ndarray:
        return values + constant * rng.standard_normal(3) + white * rng.standard_normal(values.shape)

    gyro = noisy(imu.angular_velocity, errors.gyro_constant, errors.gyro)
    force = noisy(imu.linear_acceleration, errors.accelerometer_constant, errors.accelerometer)
    return replace(log, imu=replace(imu, angular_velocity=gyro, linear_acceleration=force))


def trot(robot: Robot, seconds: float, rate: float) -> Recording:
    """Exact sensors."""
    return simulate(robot, "trot", SimulateSettings("ideal", duration=seconds, rate=rate, hold=2)).recording


def make_logs(folder: Path, count: int, seconds: float, rate: float) -> Path:
    """The logs and their manifest; the last log is cut short."""
    lines = ["log,robot,name"]
    for name in ROBOTS:
        robot = load_robot(name)
        exact = trot(robot, seconds, rate)
        for k in range(ROBOTS.index(name), count, len(ROBOTS)):
            path = write_table(sensed(exact, robot, k), folder / f"{name}-{k:03d}.parquet")
            lines.append(f"{path.name},{name},{name}-{k % 8}")
    whole = path.read_bytes()
    (folder / "corrupt.parquet").write_bytes(whole[: len(whole) // 2])
    manifest = folder / "fleet.csv"
    manifest.write_text("\n".join([*lines, f"corrupt.parquet,{name},{name}-0"]) + "\n")
    return manifest


def make_long(path: Path, seconds: float, rate: float) -> Path:
    """20 s of a trot over and over, with new sensor errors and half a second's gap each time; written as it is made."""
    robot = load_robot("go2")
    exact = trot(robot, 20.0, rate)
    every = float(exact.time[-1]) + 0.5

    def parts() -> Iterator[Recording]:
        for k in range(max(1, round(seconds / every))):
            part = sensed(exact, robot, k)
            yield replace(part, time=part.time + k * every)

    return write_table(parts(), path)


def call(out: Path, manifest: Path, *options: str, watch: Callable[[psutil.Process], None] | None = None) -> Cost:
    """`stadera fleet`, watched; raises if it fails."""
    command = [sys.executable, "-m", "stadera", "fleet", "--manifest", str(manifest), "--out", str(out), *options]
    begun, cost, seen = time.perf_counter(), Cost(), {}
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as done:
        whole, due = psutil.Process(done.pid), begun
        while done.poll() is None:
            if time.perf_counter() >= due:
                alive, due = processes(whole, options), time.perf_counter() + LISTED_EVERY
            look(alive, seen, cost)
            if watch is not None:
                watch(whole)
            time.sleep(LOOKED_EVERY)
        if done.returncode:
            assert done.stderr is not None
            raise SystemExit(done.stderr.read())
    cost.wall, cost.processor = time.perf_counter() - begun, sum(seen.values())
    return cost


def processes(whole: psutil.Process, options: tuple[str, ...]) -> list[psutil.Process]:
    """Of a call, and of the workers of a scheduler that it uses."""
    roots = [whole]
    if "--scheduler" in options:
        roots += [p for p in psutil.Process().children() if p.pid != whole.pid]
    return [one for root in roots for one in (root, *children(root))]


def children(of: psutil.Process) -> list[psutil.Process]:
    """All of them, none of a process that has just ended."""
    try:
        return of.children(recursive=True)
    except psutil.NoSuchProcess:
        return []


def look(alive: list[psutil.Process], seen: dict[int, float], cost: Cost) -> None:
    """Takes down processor time by process, and the largest memory."""
    for process in alive:
        try:
            spent, size = process.cpu_times(), process.memory_info().rss / 1e6
        except psutil.Error:
            continue
        seen[process.pid] = spent.user + spent.system
        cost.worker_mb = max(cost.worker_mb, size)


@contextmanager
def scheduler(workers: int = 2) -> Iterator[str]:
    """The address of a scheduler with workers, all processes of their own on loopback."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        file = Path(folder) / "scheduler.json"
        run = [sys.executable, "-m", "dask"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        place = ["--host", "127.0.0.1", "--no-dashboard"]
        began = [subprocess.Popen([*run, "scheduler", "--port", "0", "--scheduler-file", str(file), *place], **quiet)]
        while not file.exists():
            time.sleep(0.1)
        address = json.loads(file.read_text())["address"]
        began += [
            subprocess.Popen([*run, "worker", address, "--nthreads", "1", "--local-directory", folder, *place], **quiet)
            for _ in range(workers)
        ]
        stack.callback(lambda: [process.wait() for process in began])
        stack.callback(lambda: [process.terminate() for process in reversed(began)])
        yield address


class Killer:
    """Kills a worker once, when so many rows are there."""

    def __init__(self, out: Path, rows: int) -> None:
        self.journal, self.rows, self.killed = out.with_name(f".{out.stem}.journal.jsonl"), rows, 0

    def __call__(self, whole: psutil.Process) -> None:
        """Called while the command runs."""
        if self.killed or not self.journal.exists() or self.journal.read_bytes().count(b"\n") <= self.rows:
            return
        workers = [p for p in children(whole) if "spawn_main" in " ".join(p.cmdline())]
        busiest = max(workers, key=lambda p: p.cpu_times().user)
        busiest.kill()
        self.killed = busiest.pid


def largest_difference(a: FleetTable, b: FleetTable) -> float:
    """Of all figures of two tables, relative to them; infinite where anything else differs."""
    if [row["log"] for row in a.rows] != [row["log"] for row in b.rows]:
        return np.inf
    largest = 0.0
    for mine, theirs in zip(a.rows, b.rows, strict=True):
        for name in mine.keys() - set(TIMED):
            x, y = mine[name], theirs[name]
            if isinstance(x, float) and isinstance(y, float):
                largest = max(largest, abs(x - y) / max(abs(x), 1.0))
            elif x != y:
                return np.inf
    return largest


def measure(folder: Path, args: argparse.Namespace) -> dict[str, Any]:
    """All calls; their costs, and how the tables differ from the first."""
    manifest = make_logs(folder, args.logs, args.seconds, args.rate)
    say(f"{args.logs} logs of {args.seconds:g} s at {args.rate:g} Hz and a corrupt one are made")
    costs: dict[str, Cost] = {}

    def run(name: str, *options: str, watch: Callable[[psutil.Process], None] | None = None) -> FleetTable:
        out = folder / f"{name.replace(' ', '-')}.parquet"
        costs[name] = call(out, manifest, *options, watch=watch)
        say(f"{name}: {costs[name]}")
        return read_fleet(out)

    tables = {"one worker": run("one worker", "--workers", "1"), "two workers": run("two workers", "--workers", "2")}
    with scheduler() as address:
        tables["a scheduler"] = run("a scheduler", "--scheduler", address)
    killer = Killer(folder / "killed.parquet", args.logs // 4)
    tables["killed"] = run("killed", "--workers", "2", watch=killer)
    before = (folder / "killed.parquet").read_bytes()
    again = call(folder / "killed.parquet", manifest, "--workers", "2")
    first = tables["one worker"]
    failed = [row for row in first.rows if row["status"] == "failed"]
    return {
        "logs": args.logs,
        "seconds_a_log": args.seconds,
        "rate": args.rate,
        "costs": {name: asdict(cost) for name, cost in costs.items()},
        "worker_killed": killer.killed > 0,
        "largest_difference": {name: largest_difference(first, table) for name, table in tables.items()},
        "second_call": {"wall": again.wall, "same": (folder / "killed.parquet").read_bytes() == before},
        "failed": {Path(row["log"]).name: row["error"].replace(f"{folder}/", "") for row in failed},
        "speed_up": costs["one worker"].wall / costs["two workers"].wall,
        "real_time": args.logs * args.seconds / costs["one worker"].processor,
        "long": [long_log(folder, seconds, args.rate) for seconds in (args.long / 10.0, args.long) if args.long > 0],
        "cores": os.cpu_count(),
    }


def long_log(folder: Path, seconds: float, rate: float) -> dict[str, float]:
    """One log of this length by a worker."""
    log = make_long(folder / f"long-{seconds:g}.parquet", seconds, rate)
    manifest = folder / f"long-{seconds:g}.csv"
    manifest.write_text(f"log,robot\n{log.name},go2\n")
    cost = call(manifest.with_suffix(".out.parquet"), manifest, "--workers", "1")
    say(f"{seconds:g} s: {cost}")
    return {"seconds": seconds, "real_time": seconds / cost.processor, **asdict(cost)}


def say(line: str) -> None:
    """How far it is."""
    print(f"{time.strftime('%H:%M:%S')} {line}", file=sys.stderr, flush=True)


def report(found: dict[str, Any]) -> None:
    """The figures in words."""
    for name, cost in found["costs"].items():
        spent = f"{cost['wall']:7.1f} s, {cost['processor']:7.1f} s of processor time, {cost['worker_mb']:4.0f} MB"
        print(f"{name:12s} {spent}, differs by {found['largest_difference'][name]:.1e}")
    print(f"two workers: {found['speed_up']:.2f} times one; a worker killed: {found['worker_killed']}")
    print(f"second call: {found['second_call']['wall']:.1f} s, same table: {found['second_call']['same']}")
    print(f"failed: {found['failed']}")
    for one in found["long"]:
        print(f"{one['seconds']:g} s: {one['real_time']:.0f} times real time, {one['worker_mb']:.0f} MB")


def main() -> None:
    """Makes the logs, calls, prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--rate", type=float, default=500.0, help="Hz")
    parser.add_argument(
        "--long", type=float, default=600.0, help="s, of the log that memory is measured on; 0 for none"
    )
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = measure(Path(folder), args)
    report(found)
    if args.json:
        with written_together([args.json]) as (draft,):
            write_text(draft, json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
