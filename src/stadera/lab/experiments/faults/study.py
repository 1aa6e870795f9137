"""Study of thousands of faulty logs: how many are weighed correctly, marked, refused, or silently wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

from stadera.lab.experiments.faults.forces import FORCES
from stadera.lab.experiments.faults.runs import CLEAN, FaultCase, LogCase, hidden, make_log, weigh_faulty, worst
from stadera.lab.experiments.faults.signals import SIGNAL_FAULTS
from stadera.lab.experiments.grid import Outcome, grouped, run_grid
from stadera.lab.experiments.paper import Paper, ReproduceSettings
from stadera.lab.experiments.result import ExperimentResult, Record
from stadera.report.table import Cell, Row, TableData
from stadera.types import Progress

PAPER = Paper.of("faults")

ROBOTS = ("hyq", "go2", "anymal_b", "anymal_c", "b1", "a1")
SCENARIOS = ("trot", "crawl", "shake", "stand")
SEEDS = 8
LOAD = 0.10
"""Load added in every other log, as a share of the robot's mass."""

_STATUS = ("right", "named", "refused", "silent", "crashed")
_MASSES = ("trunk mass", "payload mass")
_NO_FAULT = "no fault"

_Pairs = Sequence[tuple[FaultCase, Outcome]]


def cases(settings: ReproduceSettings) -> list[FaultCase]:
    """All combinations of faults, robots, motions and seeds, and logs without a fault; few in a quick study."""
    signals = tuple(SIGNAL_FAULTS)[:: 2 if settings.quick else 1]
    seeds = settings.seeds or (1 if settings.quick else SEEDS)
    found = []
    for robot, scenario, k in product(ROBOTS[: 2 if settings.quick else None], SCENARIOS, range(seeds)):
        seed = settings.seed + k
        log = LogCase(robot, scenario, seed, LOAD if seed % 2 else 0.0)
        found += [FaultCase(log, fault) for fault in (CLEAN, *signals)]
        found += [FaultCase(LogCase(robot, scenario, seed, force=force), force) for force in FORCES]
    return found


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """Runs the whole grid on all cores. Logs and outcomes stored in `settings.keep` are reused."""
    if settings.keep is not None:
        return run_cases(cases(settings), settings, progress, settings.keep.absolute() / f"{PAPER.name}-logs")
    with TemporaryDirectory() as folder:
        return run_cases(cases(settings), settings, progress, Path(folder))


def run_cases(
    grid: Sequence[FaultCase], settings: ReproduceSettings, progress: Progress, folder: Path
) -> ExperimentResult:
    """Runs any part of the grid, with the logs in a folder."""
    logs = list(dict.fromkeys(case.log for case in grid))
    made = run_grid(
        f"{PAPER.name}-logs", partial(make_log, folder=folder), logs, progress, settings.keep, settings.pool
    )
    walked = {log for log, outcome in zip(logs, made, strict=True) if outcome["fell"] is None}
    left = [case for case in grid if case.log in walked]
    weighed = partial(weigh_faulty, folder=folder)
    runs = run_grid(PAPER.name, weighed, left, progress, settings.keep, settings.pool)
    return summary(left, runs, len(logs) - len(walked))


def summary(grid: Sequence[FaultCase], runs: Sequence[Outcome], fell: int = 0) -> ExperimentResult:
    """Summarises any part of the grid; `fell` logs were not weighed because the robot fell."""
    pairs = list(zip(grid, runs, strict=True))
    shown = [pair for pair in pairs if pair[0].fault != CLEAN and not hidden(pair[0])]
    clean = [pair for pair in pairs if pair[0].fault == CLEAN]
    tables = (
        _table("Faults, by where they are", pairs, _group),
        _table("Faults that a log can show, by motion", shown, lambda case: case.log.scenario),
        _table("Faults that a log can show, by robot", shown, lambda case: case.log.robot),
        _table("Every fault", pairs, lambda case: case.fault + " (hidden)" * bool(hidden(case))),
        _silent(shown),
    )
    facts = {"Weighings": f"{len(pairs)}", "Logs": f"{len({case.log for case in grid})}", "Robots that fell": f"{fell}"}
    return PAPER.result((*_records(shown), *_clean(clean)), tables, facts=facts)


def _records(pairs: _Pairs) -> Iterator[Record]:
    case: dict[str, str | float] = {"faults": "that a log can show"}
    total = max(len(pairs), 1)
    beyond = [worst(outcome["errors"]) for _, outcome in pairs if outcome["status"] == "silent"]
    for status in _STATUS:
        share = sum(outcome["status"] == status for _, outcome in pairs) / total
        bound = {"silent": PAPER.bounds["silent_3"], "crashed": 0.0}.get(status)
        yield PAPER.record(case, f"share {status}", "1", share, bound=bound)
    over = float(sum(sigma > 5.0 for sigma in beyond))
    yield PAPER.record(case, "silent beyond 5 σ", "1", over, bound=PAPER.bounds["silent_5"])


def _clean(pairs: _Pairs) -> Iterator[Record]:
    if not pairs:
        return
    case: dict[str, str | float] = {"faults": "none"}
    statuses = [outcome["status"] for _, outcome in pairs]
    called = sum(status in ("named", "refused", "crashed") for status in statuses) / len(pairs)
    yield PAPER.record(case, "share called faulty", "1", called, bound=PAPER.bounds["clean"])
    yield PAPER.record(case, "share beyond 3 σ", "1", statuses.count("silent") / len(pairs))
    part = sum(bool(outcome["left_out"]) for _, outcome in pairs) / len(pairs)
    yield PAPER.record(case, "share with parts left out", "1", part)


def _group(case: FaultCase) -> str:
    if case.fault == CLEAN:
        return _NO_FAULT
    where = SIGNAL_FAULTS[case.fault].group if case.fault in SIGNAL_FAULTS else "force from outside"
    return f"{where}, that no log can show" if hidden(case) else where


def _table(title: str, pairs: _Pairs, key: Callable[[FaultCase], str]) -> TableData:
    head = ("", "runs", "right", "named", "refused", "silent", "beyond 5 σ", "largest [σ]", "of the robot's mass [%]")
    rows = [_row(name, [outcome for _, outcome in own]) for name, own in grouped(pairs, key).items()]
    return TableData.of(title, head, rows, "The last three are of the silent ones.")


def _row(name: str, outcomes: Sequence[Outcome]) -> Row:
    counts = [sum(outcome["status"] == status for outcome in outcomes) for status in _STATUS[:4]]
    silent = [outcome for outcome in outcomes if outcome["status"] == "silent"]
    sigmas = [worst(outcome["errors"]) for outcome in silent]
    over = sum(sigma > 5.0 for sigma in sigmas)
    bad = Cell(f"{over}", strong=True, good=not over)
    if not silent:
        return (name, f"{len(outcomes)}", *map(str, counts), bad, "–", "–")
    percent = max(_percent(outcome) for outcome in silent)
    return (name, f"{len(outcomes)}", *map(str, counts), bad, f"{max(sigmas):.1f}", f"{percent:.1f}")


def _percent(outcome: Outcome) -> float:
    """The larger of the mass errors, in per cent of the robot's mass."""
    errors = outcome["errors"]
    off = max((abs(errors[name][0]) for name in _MASSES if name in errors), default=0.0)
    return 100.0 * float(off) / float(outcome["mass"])


def _silent(pairs: _Pairs) -> TableData:
    """All errors beyond 5 σ, the worst first."""
    found = [(worst(o["errors"]), case, o) for case, o in pairs if o["status"] == "silent"]
    rows: list[Row] = []
    for sigma, case, outcome in sorted(found, key=lambda entry: -entry[0]):
        if sigma > 5.0:
            name = max(outcome["errors"], key=lambda n, e=outcome["errors"]: abs(e[n][0]) / e[n][1])  # type: ignore[misc]
            log = case.log
            where = (log.robot, log.scenario, f"{log.seed}")
            rows.append((case.fault, *where, name, f"{sigma:.1f}", f"{_percent(outcome):.1f}"))
    head = ("fault", "robot", "motion", "seed", "figure", "error [σ]", "of the robot's mass [%]")
    return TableData.of("Silently wrong by more than 5 σ", head, rows)
