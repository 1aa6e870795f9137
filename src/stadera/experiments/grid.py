"""Many runs over the processor's cores, with what is done kept, so that a study that was broken off goes on.

A case is a frozen dataclass of plain values, its outcome a mapping of plain values. With a folder to keep them in,
every outcome is one line of `<folder>/<study>.jsonl` as soon as it is there, and cases found in it are not run again. A
line belongs to the version of this package that wrote it; a line broken off is left out.
"""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

import stadera
from stadera.errors import StaderaError
from stadera.experiments.result import Progress

Outcome = Mapping[str, Any]
"""What a case came to: numbers (None where there is none), texts, and lists of them."""

_AHEAD = 2  # cases handed out for each process


def run_grid(
    study: str,
    run: Callable[[Any], Outcome],
    cases: Sequence[Any],
    progress: Progress,
    keep: Path | None = None,
    processes: int | None = None,
) -> list[Outcome]:
    """Every case's outcome, in the cases' order.

    Processes are started afresh (spawned), so a script that gets here needs the usual `if __name__ == "__main__"`.

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
    done = _kept(keep, study)
    waiting = {key: case for key, case in zip(keys, cases, strict=True) if key not in done}
    progress(study, len(cases) - len(waiting), len(cases))
    count = min(processes or os.cpu_count() or 1, len(waiting))
    found = _here(run, waiting) if count <= 1 else _apart(run, waiting, count)
    with _Keeper(keep, study) as keeper:
        for number, (key, outcome) in enumerate(found, len(cases) - len(waiting) + 1):
            if isinstance(outcome, str):
                raise StaderaError(f"{study}, {key}: {outcome}")
            done[key] = outcome
            keeper.write(key, outcome)
            progress(study, number, len(cases))
    return [done[key] for key in keys]


def _here(run: Callable[[Any], Outcome], waiting: Mapping[str, Any]) -> Iterator[tuple[str, Outcome | str]]:
    for key, case in waiting.items():
        yield key, _outcome(run, case)


def _apart(
    run: Callable[[Any], Outcome], waiting: Mapping[str, Any], processes: int
) -> Iterator[tuple[str, Outcome | str]]:
    """As they come in; never more handed out than processes can take up soon, so that an error ends it soon."""
    left = iter(waiting.items())
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _one_thread) as pool:
        running: dict[Future[Outcome | str], str] = {}
        try:
            while True:
                for key, case in left:
                    running[pool.submit(_outcome, run, case)] = key
                    if len(running) >= _AHEAD * processes:
                        break
                if not running:
                    return
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    yield running.pop(future), future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _one_thread() -> None:
    """Every process has one core: threads of theirs would only wait for each other."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)


def _outcome(run: Callable[[Any], Outcome], case: Any) -> Outcome | str:
    """The outcome, or what went wrong, as text: not every error survives the way between processes."""
    try:
        return run(case)
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
            continue  # broken off while it was written
        if isinstance(entry, dict) and entry.get("version") == stadera.__version__:
            done[str(entry["case"])] = entry["outcome"]
    return done


class _Keeper:
    """Appends outcomes to the study's file, each at once; or does nothing without a folder."""

    def __init__(self, keep: Path | None, study: str) -> None:
        self._path = None if keep is None else _file(keep, study)
        self._file: TextIO | None = None

    def __enter__(self) -> _Keeper:
        if self._path is not None:
            try:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                self._file = self._path.open("a", encoding="utf-8")
                self._file.write("\n")  # a line broken off ends here
            except OSError as error:
                raise StaderaError(f"{self._path}: outcomes cannot be kept there: {error.strerror}") from None
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def write(self, key: str, outcome: Outcome) -> None:
        if self._file is not None:
            line = {"version": stadera.__version__, "case": key, "outcome": dict(outcome)}
            self._file.write(json.dumps(line, ensure_ascii=False) + "\n")
            self._file.flush()
