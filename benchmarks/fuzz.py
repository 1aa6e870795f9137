"""Reads mutants of every kind of file (`tests/mutants.py`) for so many minutes; each ends right or in a StaderaError.

Whatever else happens is a finding: another exception, a message of several lines, more memory or time than allowed, a
process that dies. A finding is printed as KIND:SEED once for each place in the code it comes from; that file is made
and read again, with the traceback, by `python benchmarks/fuzz.py --case KIND:SEED`.

Run `nice python benchmarks/fuzz.py --minutes 30 [--kinds csv,mcap] [--first SEED] [--json F]`. Exit code 1 if there
were findings.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import sys
import time
import traceback
import warnings
from collections import Counter
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from stadera.errors import StaderaError
from stadera.files import written_together

ADDRESS_SPACE = 12 << 30
"""[bytes], so that a bomb ends its process and not the machine."""


class Limits(NamedTuple):
    """What one file of under a megabyte may take."""

    memory: float  # MB
    seconds: float


def ends(kind: str, seed: int, folder: Path) -> tuple[str, str]:
    """How reading one mutant ends: "read", "refused", or a finding; and where."""
    from mutants import KINDS, mutant

    path = mutant(kind, seed, folder)
    try:
        KINDS[kind].read(path)
    except StaderaError as error:
        return ("refused", "") if "\n" not in str(error) else ("several lines", str(error)[:60])
    except BaseException as error:
        frames = [f for f in traceback.extract_tb(error.__traceback__) if "stadera" in f.filename]
        place = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else "outside"
        return type(error).__name__, place
    finally:
        path.unlink(missing_ok=True)
    return "read", ""


def work(pipe: Connection, limits: Limits) -> None:
    """Takes cases from a pipe until None comes; answers how each ends."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    warnings.simplefilter("ignore")
    with TemporaryDirectory() as folder:
        os.chdir(folder)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # parsers in C print what they think
        while (case := pipe.recv()) is not None:
            before, began = _peak(reset=True), time.monotonic()
            found = ends(*case, Path(folder))
            spent = time.monotonic() - began
            if _peak() - before > limits.memory:
                found = ("memory", f"over {limits.memory:g} MB")
            elif spent > limits.seconds:
                found = ("time", f"over {limits.seconds:g} s")
            elif left := os.listdir(folder):
                found = ("left a file", left[0])
                (Path(folder) / left[0]).unlink()
            pipe.send((*found, spent))


def _peak(*, reset: bool = False) -> float:
    """Most memory that this process has held since the last reset [MB]."""
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


class _Worker:
    """A process, and the case it is at."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self.case: tuple[str, int] | None = None
        self._start()

    def _start(self) -> None:
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(target=work, args=(theirs, self._limits), daemon=True)
        self._process.start()
        theirs.close()
        self._begun = time.monotonic() + 30.0  # for its imports

    def give(self, case: tuple[str, int]) -> None:
        self.case = case
        self._begun = max(self._begun, time.monotonic())
        self.pipe.send(case)

    def answer(self) -> tuple[str, str, float] | None:
        """What it found, or how it ended; None while it works within its time."""
        if self.pipe.poll():
            try:
                self._begun = 0.0
                found: tuple[str, str, float] = self.pipe.recv()
                return found
            except (EOFError, OSError):
                self._process.join()
                return self._again("died", f"exit code {self._process.exitcode}")
        if time.monotonic() - self._begun > 2.0 * self._limits.seconds:
            self._process.kill()
            return self._again("hangs", f"over {2.0 * self._limits.seconds:g} s")
        return None

    def _again(self, what: str, where: str) -> tuple[str, str, float]:
        self._start()
        return what, where, 2.0 * self._limits.seconds

    def stop(self) -> None:
        self._process.kill()


def campaign(kinds: list[str], first: int, minutes: float, processes: int, limits: Limits) -> dict[str, Any]:
    """Hands out cases, one seed of each kind after the other, and gathers how they end."""
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in kinds}
    findings: dict[str, dict[str, Any]] = {}
    slowest = dict.fromkeys(kinds, 0.0)
    cases = ((kind, seed) for seed in range(first, sys.maxsize) for kind in kinds)
    until = time.monotonic() + 60.0 * minutes
    workers = [_Worker(limits) for _ in range(processes)]
    for worker in workers:
        worker.give(next(cases))
    try:
        while any(worker.case for worker in workers):
            wait([worker.pipe for worker in workers if worker.case], timeout=1.0)
            for worker in workers:
                if worker.case is None or (found := worker.answer()) is None:
                    continue
                (kind, seed), (how, where, spent) = worker.case, found
                counts[kind][how if how in ("read", "refused") else "findings"] += 1
                slowest[kind] = max(slowest[kind], spent)
                if how not in ("read", "refused"):
                    entry = findings.setdefault(f"{kind}: {how}, {where}", {"case": f"{kind}:{seed}", "count": 0})
                    entry["count"] += 1
                    if entry["count"] == 1:
                        print(f"{kind}:{seed}: {how}, {where}", flush=True)
                worker.case = None
                if time.monotonic() < until:
                    worker.give(next(cases))
    finally:
        for worker in workers:
            worker.stop()
    return {"counts": {k: dict(c) for k, c in counts.items()}, "slowest": slowest, "findings": findings}


def main() -> int:
    from mutants import KINDS

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--kinds", default=",".join(KINDS), help=f"of {','.join(KINDS)}")
    parser.add_argument("--first", type=int, help="seed to begin with [default: drawn, and printed]")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--memory", type=float, default=1500.0, help="one file may take [MB]")
    parser.add_argument("--seconds", type=float, default=20.0, help="one file may take [s]")
    parser.add_argument("--case", metavar="KIND:SEED", help="make and read this one, here")
    parser.add_argument("--json", type=Path, metavar="F")
    asked = parser.parse_args()
    if asked.case:
        kind, seed = asked.case.split(":")
        with TemporaryDirectory() as folder:
            from mutants import mutant

            path = mutant(kind, int(seed), Path(folder))
            print(f"{path.name}: {path.stat().st_size} bytes")
            print(KINDS[kind].read(path))
        return 0
    first = random.randrange(10**9) if asked.first is None else asked.first
    print(f"seeds from {first} on", flush=True)
    limits = Limits(asked.memory, asked.seconds)
    result = campaign(asked.kinds.split(","), first, asked.minutes, asked.processes, limits)
    print(f"{'kind':10}{'read':>10}{'refused':>10}{'findings':>10}{'slowest [s]':>14}")
    for kind, count in result["counts"].items():
        figures = "".join(f"{count.get(name, 0):10}" for name in ("read", "refused", "findings"))
        print(f"{kind:10}{figures}{result['slowest'][kind]:14.2f}")
    if asked.json:
        with written_together([asked.json]) as (draft,):
            draft.write_text(json.dumps({"first": first, **result}, indent=1), encoding="utf-8")
    return 1 if result["findings"] else 0


if __name__ == "__main__":
    sys.exit(main())
