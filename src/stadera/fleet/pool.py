"""Runs independent tasks: in this process, on a local Dask cluster, or on an existing scheduler.

A task is a module-level function and one small picklable argument, and is deterministic: if a worker dies, its task is
run again on another one. A task whose workers keep dying (out of memory, say) becomes a `Failure`; the others continue.

A journal keeps finished ones, from which an interrupted run resumes.
"""

from __future__ import annotations

import ctypes
import gc
import json
import logging
import os
import signal
import sys
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, TypeVar

import stadera
from stadera.boundary import foreign
from stadera.errors import StaderaError, of_extra, require_positive
from stadera.process import collect_rarely, keep_loaded

Task = TypeVar("Task")
Found = TypeVar("Found")

_CONFIG = {
    # the default spills results to disk and pauses at 0.6 to 0.8 of the limit; results here are small, and memory grows
    # in the task itself, so a worker is only ever restarted
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    # no task is queued on a worker that the previous task may kill
    "distributed.scheduler.worker-saturation": 1.0,
    # each worker's thread for messages would look up what the other one is doing, and both, and the scheduler, whether
    # they are on time, every 10 and 20 ms: 5 % of a worker's time, and of a core
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    # a killed worker is restarted however long a busy machine takes: by default it is given up
    "distributed.deploy.lost-worker-timeout": "1 hour",
}


@dataclass(frozen=True)
class Pool:
    """Settings of the processes that run the tasks. Raises StaderaError: a negative number of workers, one combined
    with a scheduler, or no memory.
    """

    workers: int | None = None  # processes of a local cluster; None for one per core, 0 for this process, without Dask
    scheduler: str | None = None  # address of a Dask scheduler to use, "tcp://host:8786"; None for a local cluster
    # limit of a local worker [bytes], above which it is restarted and its task tried again; weighing needs 430 MB, and
    # 615 MB in the first process on a machine, which compiles
    memory: int = 2_000_000_000
    connect: float = 10.0  # time limit for connecting to a scheduler [s]
    first_worker: float = 60.0  # time limit for the first worker to connect [s]

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 0:
            raise StaderaError(f"a number of workers is not negative, got {self.workers}")
        if self.workers is not None and self.scheduler is not None:
            raise StaderaError(f"{self.scheduler} has its own workers: a number of workers is for this machine alone")
        if not self.memory > 0:
            raise StaderaError(f"a worker needs memory, got {self.memory} bytes")
        require_positive("time of a pool", self, ("connect", "first_worker"))

    def for_tasks(self, count: int) -> Pool:
        """The pool with no more local workers than tasks; a single task is run in this process."""
        if self.scheduler is not None:
            return self
        workers = min(os.cpu_count() or 1 if self.workers is None else self.workers, count)
        return replace(self, workers=0 if workers < 2 else workers)


@dataclass(frozen=True)
class Failure:
    """Outcome of a task that failed: the reason in one line."""

    reason: str


def run_tasks(
    run: Callable[[Task], Found], tasks: Mapping[str, Task], pool: Pool, owners: Mapping[str, str] | None = None
) -> Generator[tuple[str, Found | Failure], None, None]:
    """Yields names and outcomes of `run`, a function of a module, importable by the workers, or a partial of one, as
    they arrive. Ending the iteration early stops the work. Tasks with the same of the `owners`, by name, are run one
    after the other in their order.

    Local workers are spawned, so a script that calls this needs the usual `if __name__ == "__main__"`.

    Raises:
        MissingExtraError: Dask is needed and not installed.
        StaderaError: no scheduler or worker answers, or the workers have another version of this package.
    """
    if not tasks:
        return
    if pool.scheduler is None and pool.workers == 0:
        for name, task in tasks.items():
            yield name, attempted(run, task)
        return
    with _client(pool) as client:
        yield from _gathered(client, run, tasks, owners or {})


def attempted(run: Callable[[Task], Found], task: Task) -> Found | Failure:
    """Runs a task; an expected error becomes a `Failure`. Uses one thread, since there are as many processes as cores,
    and so that sums have the same order on every machine. Afterwards the task's memory is free, and what the first one
    loaded is left out when the garbage of later ones is collected.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        try:
            return run(task)
        except StaderaError as error:
            return Failure(str(error))
        finally:
            release_memory()
            keep_loaded()


def release_memory() -> None:
    """Frees what no one refers to, and gives free pages back to the operating system, so that a worker does not grow
    with the tasks. Takes some 50 ms, and less after `keep_loaded`.

    Three things keep memory otherwise: objects in reference cycles, until the collector's oldest generation is due,
    which is many logs later; glibc, whose arenas keep freed pages between those in use; and Arrow's own pool.
    """
    gc.collect()
    if arrow := sys.modules.get("pyarrow"):
        arrow.default_memory_pool().release_unused()
    with suppress(OSError, TypeError, AttributeError):  # outside glibc
        ctypes.CDLL(None).malloc_trim(0)


def _gathered(
    client: Any, run: Callable[[Task], Found], tasks: Mapping[str, Task], owners: Mapping[str, str]
) -> Iterator[tuple[str, Any]]:
    from distributed import KilledWorker, as_completed

    turns: dict[str, deque[str]] = {}
    for name in tasks:
        turns.setdefault(owners.get(name, name), deque()).append(name)
    first = [turn.popleft() for turn in turns.values()]
    waiting = client.map(attempted, [run] * len(first), [tasks[name] for name in first], pure=False, batch_size=1000)
    names = {future.key: name for future, name in zip(waiting, first, strict=True)}
    completed = as_completed(waiting, loop=client.loop)  # type: ignore[no-untyped-call]
    del waiting  # outcomes are released as soon as they are yielded
    for future in completed:
        name = names.pop(future.key)
        if turn := turns[owners.get(name, name)]:
            then = client.submit(attempted, run, tasks[turn[0]], pure=False)
            names[then.key] = turn.popleft()
            completed.add(then)  # type: ignore[no-untyped-call]
            del then
        try:
            outcome = future.result()
        except KilledWorker as error:
            outcome = Failure(f"its worker ended {error.allowed_failures + 1} times, out of memory or killed")
        yield name, outcome


@contextmanager
def _client(pool: Pool) -> Iterator[Any]:
    with of_extra("distributed", "fleet", "more than one worker"):
        import dask
        import distributed
    if pool.scheduler is not None:
        try:
            client: Any = distributed.Client(  # type: ignore[no-untyped-call]
                pool.scheduler, timeout=pool.connect, set_as_default=False
            )
        except (OSError, ValueError) as error:
            raise StaderaError(f"{pool.scheduler}: no Dask scheduler answers there: {error}") from None
        with client:
            _check_workers(client, pool.scheduler, pool.first_worker)
            yield client
        return
    with dask.config.set(_CONFIG):
        cluster: Any = distributed.LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=pool.workers,
            threads_per_worker=1,
            processes=True,
            memory_limit=pool.memory,
            preload=["stadera.fleet.pool"],
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        )
        with cluster, distributed.Client(cluster, set_as_default=False) as client:  # type: ignore[no-untyped-call]
            yield client


def _check_workers(client: Any, address: str, patience: float) -> None:
    """Checks that there are workers with the same version of this package."""
    from distributed import TimeoutError as NoWorkers

    try:
        client.wait_for_workers(1, timeout=patience)
    except NoWorkers:
        raise StaderaError(f"{address}: the scheduler has no workers, and none has come in {patience:g} s") from None
    for worker, version in client.run(_version_here, on_error="return").items():
        if version != stadera.__version__:
            here = f"stadera {version}" if isinstance(version, str) else "no stadera that can be imported"
            raise StaderaError(f"{address}: worker {worker} has {here}, and this is {stadera.__version__}")


def _version_here() -> str:
    return stadera.__version__


def dask_setup(worker: object) -> None:
    """Ignores Ctrl-C, so that the main process shuts the workers down in order."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    collect_rarely()


def read_journal(path: Path) -> Iterator[dict[str, Any]]:
    """Entries written by this version of the package, plain values; incomplete lines are skipped, and a missing file
    has no entries.
    """
    if not path.exists():
        return
    with path.open(encoding="utf-8") as lines:
        for line in lines:
            try:
                entry = json.loads(line)
            except ValueError:
                continue  # incomplete: the run was interrupted while writing it
            if isinstance(entry, dict) and entry.get("version") == stadera.__version__:
                yield entry


@contextmanager
def journal(path: Path) -> Iterator[Callable[[Mapping[str, Any]], None]]:
    """Yields a function that appends entries immediately. Creates the folder if necessary. Raises StaderaError: it
    cannot be written, or another process has it open.
    """
    with foreign(path, "outcomes cannot be kept there", StaderaError):
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("a", encoding="utf-8")
    with file:
        _lock(file, path)
        file.write("\n")  # ends an incomplete line

        def append(entry: Mapping[str, Any]) -> None:
            file.write(json.dumps({"version": stadera.__version__, **entry}, ensure_ascii=False) + "\n")
            file.flush()

        yield append


def _lock(file: IO[str], path: Path) -> None:
    """Locks a file until it is closed. Raises StaderaError: another process has locked it."""
    try:
        import fcntl
    except ImportError:  # not on Windows
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise StaderaError(f"{path}: another run is writing there: wait for it, or write elsewhere") from None
    except OSError:  # a file system without locks
        return
