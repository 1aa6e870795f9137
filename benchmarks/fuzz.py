"""Reads mutants of every kind of file (`tests/mutants.py`) for so many minutes of processor time; each ends right or in
a StaderaError.

Whatever else happens is a finding: another exception, a message of several lines, more memory or processor time than
allowed, a process that dies. It is printed as KIND:SEED once for each place in the code it comes from; that file is
made and read again, with the traceback, by `python benchmarks/fuzz.py --case KIND:SEED`.

Run `nice python benchmarks/fuzz.py --minutes 30 [--kinds csv,mcap] [--first SEED] [--json F]`; with `--resume F` it
goes on at the seed after that file's last, and adds to it. Exit code 1 if there were findings.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import os
import random
import resource
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from stadera.errors import StaderaError
from stadera.files import written_together

_IMPORTS = 30.0  # s, of processor time that a process takes before its first case
_ASLEEP = 20.0  # times the processor time that is allowed, after which a process that waits counts as hanging

ADDRESS_SPACE = 12 << 30
"""[bytes], so that a bomb ends its process and not the machine."""


class Limits(NamedTuple):
    """What one file of under a megabyte may take."""

    memory: float  # MB
    seconds: float  # of processor time


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


def work(pipe: Connection, limits: Limits, last_words: str) -> None:
    """Takes cases from a pipe until None comes; answers how each ends. A death in native code leaves a traceback in the
    file `last_words`.
    """
    faulthandler.enable(open(last_words, "w"))  # noqa: SIM115  open as long as the process lives
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    warnings.simplefilter("ignore")
    with TemporaryDirectory() as folder:
        os.chdir(folder)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # parsers in C print what they think
        while (case := pipe.recv()) is not None:
            before, began = _peak(reset=True), _processor_time()
            found = ends(*case, Path(folder))
            spent = _processor_time() - began
            if _peak() - before > limits.memory:
                found = ("memory", f"over {limits.memory:g} MB")
            elif spent > limits.seconds:
                found = ("time", f"over {limits.seconds:g} s")
            elif left := os.listdir(folder):
                found = ("left a file", left[0])
                (Path(folder) / left[0]).unlink()
            pipe.send((*found, spent))


def _processor_time() -> float:
    """Of this process and of those it has waited for [s]: on a loaded machine files take no longer by it."""
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def _peak(*, reset: bool = False) -> float:
    """Most memory that this process has held since the last reset [MB]."""
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


class _Worker:
    """A process, and the case it is at."""

    def __init__(self, limits: Limits, folder: str) -> None:
        self._limits, self._last_words = limits, tempfile.mkstemp(dir=folder)[1]
        self.case: tuple[str, int] | None = None
        self._start()

    def _start(self) -> None:
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(target=work, args=(theirs, self._limits, self._last_words), daemon=True)
        self._process.start()
        theirs.close()
        self._allowed = 2.0 * self._limits.seconds + _IMPORTS

    def give(self, case: tuple[str, int]) -> None:
        self.case = case
        self._begun, self._used = time.monotonic(), self._processor_time()
        self.pipe.send(case)

    def _processor_time(self) -> float:
        """Of the process and the children it waited for, so far [s]."""
        with suppress(OSError):
            fields = Path(f"/proc/{self._process.pid}/stat").read_text().rsplit(")", 1)[1].split()
            return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
        return 0.0

    def answer(self) -> tuple[str, str, float] | None:
        """What it found, or how it ended; None while it works within its time."""
        if self.pipe.poll():
            try:
                found: tuple[str, str, float] = self.pipe.recv()
                self._allowed = 2.0 * self._limits.seconds
                return found
            except (EOFError, OSError):
                self._process.join()
                frames = [line.strip() for line in Path(self._last_words).read_text().splitlines() if "File" in line]
                return self._again("died", f"exit code {self._process.exitcode}: {'; '.join(frames[:3])}")
        spent = self._processor_time() - self._used
        if spent > self._allowed or time.monotonic() - self._begun > _ASLEEP * self._allowed:
            self._process.kill()
            return self._again("hangs", f"over {self._allowed:g} s")
        return None

    def _again(self, what: str, where: str) -> tuple[str, str, float]:
        self._start()
        return what, where, 2.0 * self._limits.seconds

    def stop(self) -> None:
        self._process.kill()


class Tally:
    """How cases ended so far, which a file keeps: counts by kind and end, findings by place, slowest, next seed."""

    def __init__(self, kinds: Sequence[str], first: int, before: Mapping[str, Any] | None = None) -> None:
        known = before or {}
        self.counts = {kind: Counter(known.get("counts", {}).get(kind, {})) for kind in kinds}
        self.findings: dict[str, dict[str, Any]] = dict(known.get("findings", {}))
        self.slowest = {kind: float(known.get("slowest", {}).get(kind, 0.0)) for kind in kinds}
        self.first, self.next = int(known.get("first", first)), int(known.get("next", first))
        self.spent = 0.0  # s, in this run

    def add(self, case: tuple[str, int], how: str, where: str, spent: float) -> None:
        kind, seed = case
        self.spent += spent
        self.counts[kind][how if how in ("read", "refused") else "findings"] += 1
        self.slowest[kind] = max(self.slowest[kind], spent)
        self.next = max(self.next, seed + 1)
        if how not in ("read", "refused"):
            entry = self.findings.setdefault(f"{kind}: {how}, {where}", {"case": f"{kind}:{seed}", "count": 0})
            entry["count"] += 1
            if entry["count"] == 1:
                print(f"{kind}:{seed}: {how}, {where}", flush=True)

    def to_dict(self) -> dict[str, Any]:
        counts = {kind: dict(count) for kind, count in self.counts.items()}
        own = {"first": self.first, "next": self.next, "counts": counts}
        return {**own, "slowest": self.slowest, "findings": self.findings}


def campaign(tally: Tally, minutes: float, processes: int, limits: Limits) -> None:
    """Hands out cases, one seed of each kind after the other, and gathers how they end; ends early on Ctrl-C."""
    cases = ((kind, seed) for seed in range(tally.next, sys.maxsize) for kind in tally.counts)
    with TemporaryDirectory() as folder:
        _work_off(tally, cases, minutes, [_Worker(limits, folder) for _ in range(processes)])


def _work_off(tally: Tally, cases: Iterator[tuple[str, int]], minutes: float, workers: Sequence[_Worker]) -> None:
    for worker in workers:
        worker.give(next(cases))
    try:
        while any(worker.case for worker in workers):
            wait([worker.pipe for worker in workers if worker.case], timeout=1.0)
            for worker in workers:
                if worker.case is None or (found := worker.answer()) is None:
                    continue
                tally.add(worker.case, *found)
                worker.case = None
                if tally.spent < 60.0 * minutes:
                    worker.give(next(cases))
    except KeyboardInterrupt:
        print("interrupted")
    finally:
        for worker in workers:
            worker.stop()


def main() -> int:
    from mutants import KINDS

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0, help="of processor time spent on files")
    parser.add_argument("--kinds", default=",".join(KINDS), help=f"of {','.join(KINDS)}")
    parser.add_argument("--first", type=int, help="seed to begin with [default: drawn, and printed]")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--memory", type=float, default=1500.0, help="one file may take [MB]")
    parser.add_argument("--seconds", type=float, default=20.0, help="of processor time that one file may take [s]")
    parser.add_argument("--case", metavar="KIND:SEED", help="make and read this one, here")
    parser.add_argument("--json", type=Path, metavar="F")
    parser.add_argument("--resume", type=Path, metavar="F", help="goes on after this file's last seed, adds to it")
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
    before = json.loads(asked.resume.read_text(encoding="utf-8")) if asked.resume and asked.resume.exists() else None
    tally = Tally(asked.kinds.split(","), first, before)
    print(f"seeds from {tally.next} on", flush=True)
    campaign(tally, asked.minutes, asked.processes, Limits(asked.memory, asked.seconds))
    print(f"{'kind':10}{'read':>10}{'refused':>10}{'findings':>10}{'slowest [s]':>14}")
    for kind, count in tally.counts.items():
        figures = "".join(f"{count.get(name, 0):10}" for name in ("read", "refused", "findings"))
        print(f"{kind:10}{figures}{tally.slowest[kind]:14.2f}")
    if out := asked.json or asked.resume:
        with written_together([out]) as (draft,):
            draft.write_text(json.dumps(tally.to_dict(), indent=1), encoding="utf-8")
    return 1 if tally.findings else 0


if __name__ == "__main__":
    sys.exit(main())
