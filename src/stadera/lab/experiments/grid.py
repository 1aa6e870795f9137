"""Many runs over cores or machines, with what is done kept, so that an interrupted study goes on.

A case is a frozen dataclass of plain values. With a folder to keep them in, every outcome (then a mapping of plain
values) is one line of `<folder>/<study>.jsonl` as soon as it is there, and cases found in it are not run again. A line
belongs to the version of this package that wrote it; an incomplete line is skipped.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

from stadera.errors import StaderaError
from stadera.fleet.journal import journal, read_journal
from stadera.fleet.pool import Failure, Pool, run_tasks
from stadera.types import Progress

Outcome = Mapping[str, Any]
"""What a case of a kept study came to: numbers (None where there is none), texts, and lists of them."""

Case = TypeVar("Case")
Found = TypeVar("Found")
Key = TypeVar("Key", bound=Hashable)


def run_grid(
    study: str,
    run: Callable[[Case], Found],
    cases: Sequence[Case],
    progress: Progress,
    keep: Path | None = None,
    pool: Pool | None = None,
) -> list[Found]:
    """Every case's outcome, in the cases' order.

    Args:
        study: its name, of the progress and of the file.
        run: a function of a module, from a case to its outcome; the same case gives the same outcome.
        cases: frozen dataclasses of plain values.
        keep: the folder of outcomes kept; None to keep none.
        pool: where cases are run; None for one process a core. A single case is run in this process.

    Raises:
        StaderaError: a case could not be run; what was done until then is kept.
        MissingExtraError: Dask is needed and not installed.
    """
    keys = [_key(case) for case in cases]
    done = _kept(keep, study)
    waiting = {key: case for key, case in zip(keys, cases, strict=True) if key not in done}
    progress(study, len(cases) - len(waiting), len(cases))
    with _keeping(keep, study) as keep_one:
        for key, outcome in run_tasks(run, waiting, (pool or Pool()).for_tasks(len(waiting))):
            if isinstance(outcome, Failure):
                raise StaderaError(f"{study}, {key}: {outcome.reason}")
            done[key] = outcome
            keep_one(key, outcome)
            progress(study, len(done), len(cases))
    return [done[key] for key in keys]


def grouped(pairs: Sequence[tuple[Case, Found]], key: Callable[[Case], Key]) -> dict[Key, list[tuple[Case, Found]]]:
    """Cases and their outcomes by a key of the case, in the order in which keys come first."""
    groups: dict[Key, list[tuple[Case, Found]]] = {}
    for case, outcome in pairs:
        groups.setdefault(key(case), []).append((case, outcome))
    return groups


def _key(case: Any) -> str:
    return json.dumps(asdict(case), sort_keys=True, ensure_ascii=False)


def _file(keep: Path, study: str) -> Path:
    return keep / f"{study}.jsonl"


def _kept(keep: Path | None, study: str) -> dict[str, Any]:
    return {} if keep is None else {str(e["case"]): e["outcome"] for e in read_journal(_file(keep, study))}


@contextmanager
def _keeping(keep: Path | None, study: str) -> Iterator[Callable[[str, Any], None]]:
    """Appends outcomes to the study's file, each at once; does nothing without a folder."""
    if keep is None:
        yield lambda key, outcome: None
        return
    with journal(_file(keep, study)) as append:
        yield lambda key, outcome: append({"case": key, "outcome": dict(outcome)})
