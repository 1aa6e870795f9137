"""Runs many cases over cores or machines, and stores finished ones, so that an interrupted study can be resumed.

A case is a frozen dataclass of plain values. With a folder, every outcome (then a mapping of plain values) is stored
immediately as one line of `<folder>/<study>.jsonl`, and cases found there are not run again. A line is valid for the
version of this package that wrote it; an incomplete line is skipped.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from stadera.errors import StaderaError
from stadera.fleet.journal import journal, read_journal
from stadera.fleet.pool import Failure, Pool, run_tasks
from stadera.types import Progress

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Outcome = Mapping[str, Any]
"""Outcome of a case: numbers (None for missing ones), texts, and lists of them."""

Append = Callable[[Mapping[str, Any]], None]
Case = TypeVar("Case", bound="DataclassInstance")
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
    """Returns every case's outcome, in the cases' order.

    Args:
        study: name of the study, for progress and file.
        run: a module-level, deterministic function from a case to its outcome.
        keep: folder of stored outcomes; None to store none.
        pool: where cases are run; None for one process per core. A single case is run in this process.
    """
    keys = [json.dumps(asdict(case), sort_keys=True, ensure_ascii=False) for case in cases]
    file = None if keep is None else keep / f"{study}.jsonl"
    done = {} if file is None else {str(entry["case"]): entry["outcome"] for entry in read_journal(file)}
    waiting = {key: case for key, case in zip(keys, cases, strict=True) if key not in done}
    progress(study, len(cases) - len(waiting), len(cases))
    with _stored_in(file) as store:
        for key, outcome in run_tasks(run, waiting, (pool or Pool()).for_tasks(len(waiting))):
            if isinstance(outcome, Failure):
                raise StaderaError(f"{study}, {key}: {outcome.reason}")
            done[key] = outcome
            store({"case": key, "outcome": outcome})
            progress(study, len(done), len(cases))
    return [done[key] for key in keys]


def _stored_in(file: Path | None) -> AbstractContextManager[Append]:
    """Appends entries to a file; None to store nothing."""
    return nullcontext(lambda _: None) if file is None else journal(file)


def grouped(pairs: Sequence[tuple[Case, Found]], key: Callable[[Case], Key]) -> dict[Key, list[tuple[Case, Found]]]:
    """Groups cases and outcomes by a key of the case, in the order of first appearance."""
    groups: dict[Key, list[tuple[Case, Found]]] = {}
    for case, outcome in pairs:
        groups.setdefault(key(case), []).append((case, outcome))
    return groups
