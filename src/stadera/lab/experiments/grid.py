"""Many runs over the processor's cores, with what is done kept, so that an interrupted study goes on.

A case is a frozen dataclass of plain values. With a folder to keep them in, every outcome (then a mapping of plain
values) is one line of `<folder>/<study>.jsonl` as soon as it is there, and cases found in it are not run again. A line
belongs to the version of this package that wrote it; an incomplete line is skipped.
"""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import stadera
from stadera.errors import StaderaError
from stadera.types import Progress

Outcome = Mapping[str, Any]
"""What a case of a kept study came to: numbers (None where there is none), texts, and lists of them."""

Case = TypeVar("Case")
Found = TypeVar("Found")
Key = TypeVar("Key", bound=Hashable)

_AHEAD = 2  # cases handed out for each process


def run_grid(
    study: str,
    run: Callable[[Case], Found],
    cases: Sequence[Case],
    progress: Progress,
    keep: Path | None = None,
    processes: int | None = None,
) -> list[Found]:
    """Every case's outcome, in the cases' order.

    Processes are spawned, so a script that calls this needs the usual `if __name__ == "__main__"`.

    Args:
        study: its name, of the progress and of the file.
        run: a function of a module, from a case to its outcome; the same case gives the same outcome.
        cases: frozen dataclasses of plain values.
        keep: the folder of outcomes kept; None to keep none.
        processes: None for one a core.

    Raises:
        StaderaError: a case could not be run; what was done until then is kept.
    """
    keys = [_key(case) for case in cases]
    done: dict[str, Any] = _kept(keep, study)
    waiting = {key: case for key, case in zip(keys, cases, strict=True) if key not in done}
    finished = len(cases) - len(waiting)
    progress(study, finished, len(cases))
    count = min(processes or os.cpu_count() or 1, len(waiting))
    with _keeping(keep, study) as keep_one:
        for key, outcome in _in_turn(run, waiting) if count <= 1 else _spawned(run, waiting, count):
            if isinstance(outcome, str):
                raise StaderaError(f"{study}, {key}: {outcome}")
            done[key] = outcome
            keep_one(key, outcome)
            finished += 1
            progress(study, finished, len(cases))
    return [done[key] for key in keys]


def _in_turn(run: Callable[[Any], Any], waiting: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for key, case in waiting.items():
        yield key, outcome_or_error(run, case)


def _spawned(run: Callable[[Any], Any], waiting: Mapping[str, Any], processes: int) -> Iterator[tuple[str, Any]]:
    """As they come in. Few cases are handed out ahead, so that an error ends the study soon."""
    left = iter(waiting.items())
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), one_thread) as pool:
        running: dict[Future[Any], str] = {}
        try:
            while True:
                for key, case in left:
                    running[pool.submit(outcome_or_error, run, case)] = key
                    if len(running) >= _AHEAD * processes:
                        break
                if not running:
                    return
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    yield running.pop(future), future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def grouped(pairs: Sequence[tuple[Case, Found]], key: Callable[[Case], Key]) -> dict[Key, list[tuple[Case, Found]]]:
    """Cases and their outcomes by a key of the case, in the order in which keys come first."""
    groups: dict[Key, list[tuple[Case, Found]]] = {}
    for case, outcome in pairs:
        groups.setdefault(key(case), []).append((case, outcome))
    return groups


def one_thread() -> None:
    """One thread for this process: there are as many processes as cores."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)


def outcome_or_error(run: Callable[..., Found], *arguments: Any) -> Found | str:
    """The outcome, or the error as text: not every error can be pickled."""
    try:
        return run(*arguments)
    except StaderaError as error:
        return str(error)


def _key(case: Any) -> str:
    return json.dumps(asdict(case), sort_keys=True, ensure_ascii=False)


def _file(keep: Path, study: str) -> Path:
    return keep / f"{study}.jsonl"


def _kept(keep: Path | None, study: str) -> dict[str, Outcome]:
    if keep is None or not _file(keep, study).exists():
        return {}
    done = {}
    for line in _file(keep, study).read_text(encoding="utf-8").splitlines():
        try:
            entry = json.loads(line)
        except ValueError:
            continue  # incomplete: the study was interrupted while it was written
        if isinstance(entry, dict) and entry.get("version") == stadera.__version__:
            done[str(entry["case"])] = entry["outcome"]
    return done


@contextmanager
def _keeping(keep: Path | None, study: str) -> Iterator[Callable[[str, Any], None]]:
    """Appends outcomes to the study's file, each at once; does nothing without a folder."""
    if keep is None:
        yield lambda key, outcome: None
        return
    path = _file(keep, study)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("a", encoding="utf-8")
    except OSError as error:
        raise StaderaError(f"{path}: outcomes cannot be kept there: {error.strerror}") from None
    with file:
        file.write("\n")  # ends an incomplete line

        def keep_one(key: str, outcome: Any) -> None:
            line = {"version": stadera.__version__, "case": key, "outcome": dict(outcome)}
            file.write(json.dumps(line, ensure_ascii=False) + "\n")
            file.flush()

        yield keep_one
