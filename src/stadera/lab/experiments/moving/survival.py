"""Who survives a load on the way: walks with and without identification, over loads, corners and seeds.

Besides: whether changes of 3 kg are noticed, on and off, whenever in the gait they happen, and whether any is noticed
where there is none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isnan

from stadera.constants import GRAVITY
from stadera.lab.control.crawl.settings import CrawlCommand, CrawlSettings
from stadera.lab.experiments.grid import Outcome, run_grid
from stadera.lab.experiments.moving.loaded_walk import (
    CORNERS,
    STAND,
    LoadedWalkCase,
    LoadedWalkOutcome,
    Supervision,
    loaded_walk,
    weight_at,
)
from stadera.lab.experiments.paper import Paper, ReproduceSettings
from stadera.lab.experiments.result import ExperimentResult, Record
from stadera.report.table import Cell, Row, TableData
from stadera.robot import load_robot
from stadera.supervise import State
from stadera.types import Progress

PAPER = Paper.of("survival")

_ROBOT, _SPEED = "hyq", 0.1


@dataclass(frozen=True)
class SurvivalSettings:
    """The walks of the study.

    Attributes:
        loads, corners, seeds: of the grid, loads in [N].
        worst, worst_corner, worst_seeds: the paper's load, over many seeds.
        small, small_seeds: the least change that has to be noticed [N].
        quiet_walks: without any load.
        load_at: [s], and up to a cycle later. seconds: of a walk [s], with identification and without: at least a cycle
            of walking under load.
        on, off, noticing: when small changes come and go, and how long these walks are [s].
        quiet: how long walks without a load are [s], of which all but the stand is walking.
    """

    loads: tuple[float, ...] = (25.0, 50.0, 75.0, 100.0, 125.0, 150.0)
    corners: tuple[str, ...] = tuple(CORNERS)
    seeds: int = 2
    worst: float = 100.0
    worst_corner: str = "LH"
    worst_seeds: int = 20
    small: float = 3.0 * GRAVITY
    small_seeds: int = 12
    quiet_walks: int = 20
    load_at: float = 4.5
    seconds: Mapping[bool, float] = field(default_factory=lambda: {True: 18.5, False: 13.0})
    on: float = 4.5
    off: float = 15.0
    noticing: float = 19.5
    quiet: float = 31.0


FULL = SurvivalSettings()
_QUICK = SurvivalSettings((50.0, 150.0), ("LH", "RF"), 1, worst_seeds=1, small_seeds=1, quiet_walks=1)


@dataclass(frozen=True)
class SurvivalCase:
    """One walk.

    Attributes:
        load: [N], 0 for none. corner: of the back.
        identify: with identification.
        seed: of the sensors' errors.
        load_at, unload_at: [s]; 0 for never.
        seconds: of the walk.
    """

    load: float
    corner: str
    identify: bool
    seed: int
    load_at: float
    unload_at: float
    seconds: float


def survive(case: SurvivalCase) -> Outcome:
    """How a walk went.

    Raises:
        StaderaError: it cannot be set up.
    """
    payload = weight_at(load_robot(_ROBOT), case.corner, case.load) if case.load else None
    outcome = loaded_walk(
        LoadedWalkCase(
            robot=_ROBOT,
            payload=payload,
            load_at=case.load_at or inf,
            unload_at=case.unload_at or inf,
            supervision=Supervision.STOPPING if case.identify else Supervision.NONE,
            seconds=case.seconds,
            speed=_SPEED,
            seed=case.seed,
        )
    )
    return {
        "survived": outcome.survived and outcome.state not in (State.STANDING, State.SITTING),
        "fell": None if outcome.fall is None else outcome.fall.how,
        "least_margin": _or_none(outcome.least_margin),
        "least_margin_ever": _or_none(outcome.least_margin_ever),
        "noticed": [_noticed(outcome, time) for time in (case.load_at, case.unload_at)],
        "alarms": sum(check.changed for check in outcome.checks),
        "checks": len(outcome.checks),
        "state": str(outcome.state),
        "said": outcome.transitions[-1].reason if outcome.transitions else "",
        "way": outcome.way,
        "walked": outcome.seconds - STAND,
    }


def _or_none(value: float) -> float | None:
    return None if isnan(value) else value


def _noticed(outcome: LoadedWalkOutcome, since: float) -> float | None:
    """Time [s] from a change to the first check after it that says so."""
    if not since:
        return None
    return next((check.time - since for check in outcome.checks if check.changed and check.time > since), None)


@dataclass(frozen=True)
class _Walks:
    """The cases: the grid, the paper's load, small changes, and walks without a load."""

    grid: Sequence[SurvivalCase]
    worst: Sequence[SurvivalCase]
    small: Sequence[SurvivalCase]
    quiet: Sequence[SurvivalCase]

    @classmethod
    def of(cls, study: SurvivalSettings, first: int) -> _Walks:
        """Seeds count from the first; loads come on all over the gait."""
        cycle, seeds = _cycle(), study.seeds

        def walk(load: float, corner: str, identify: bool, seed: int, phase: float) -> SurvivalCase:
            at = round(study.load_at + phase * cycle, 3)
            return SurvivalCase(load, corner, identify, first + seed, at, 0.0, study.seconds[identify])

        def small(k: int) -> SurvivalCase:
            at, corner = round(study.on + k * cycle / study.small_seeds, 3), tuple(CORNERS)[k % 4]
            return SurvivalCase(study.small, corner, True, first + k, at, study.off, study.noticing)

        return cls(
            [
                walk(load, corner, identify, k, (n + k / seeds) / len(study.loads))
                for n, load in enumerate(study.loads)
                for corner in study.corners
                for k in range(seeds)
                for identify in (False, True)
            ],
            [
                walk(study.worst, study.worst_corner, identify, k, k / study.worst_seeds)
                for k in range(study.worst_seeds)
                for identify in (False, True)
            ],
            [small(k) for k in range(study.small_seeds)],
            [
                SurvivalCase(0.0, study.worst_corner, True, first + k, 0.0, 0.0, study.quiet)
                for k in range(study.quiet_walks)
            ],
        )


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """The grid of loads and corners, the paper's load over many seeds, small changes, and walks without a load."""
    study = _QUICK if settings.quick else FULL
    walks = _Walks.of(study, settings.seed)
    cases = list(dict.fromkeys((*walks.grid, *walks.worst, *walks.small, *walks.quiet)))
    found = dict(zip(cases, run_grid(PAPER.name, survive, cases, progress, settings.keep, settings.pool), strict=True))
    watched = [c for c in dict.fromkeys((*walks.grid, *walks.worst, *walks.small)) if c.load >= study.small - 1e-9]
    return PAPER.result(
        (
            *_worst_records(study, walks.worst, found),
            *_noticing_records(study, [c for c in watched if c.identify], found),
            _alarm_record([found[c] for c in walks.quiet]),
        ),
        (_table(walks.grid, found), _failures(walks.grid, found)),
        facts={
            "Robot": _ROBOT,
            "Walks": f"{len(cases)}",
            "Sensors": "standard errors",
            "Plant": "MuJoCo, 1 kHz, crawl, controller and supervisor in the loop",
        },
    )


def _cycle() -> float:
    """Of four steps [s]."""
    return 4.0 * CrawlSettings.of(load_robot(_ROBOT)).timing(CrawlCommand(_SPEED)).step


_Found = Mapping[SurvivalCase, Outcome]


def _worst_records(study: SurvivalSettings, cases: Sequence[SurvivalCase], found: _Found) -> Iterator[Record]:
    case: dict[str, str | float] = {"load [N]": study.worst, "corner": study.worst_corner}
    known, unknown = ([found[c] for c in cases if c.identify is way] for way in (True, False))
    count = float(len(known))
    died, lost = (float(sum(not o["survived"] for o in outcomes)) for outcomes in (known, unknown))
    yield PAPER.record(case, f"falls with identification, of {count:.0f}", "1", _falls(known), bound=0.0)
    yield PAPER.record(case, f"did not survive with identification, of {count:.0f}", "1", died, bound=0.0)
    metric = f"fell or left the support polygon without, of {count:.0f}"
    yield Record(PAPER.name, case, metric, "1", lost, None, count, "at least")
    yield PAPER.record(case, f"falls without identification, of {count:.0f}", "1", _falls(unknown))
    least, ever = (
        100.0 * min((o[name] for o in known if o[name] is not None), default=0.0)
        for name in ("least_margin", "least_margin_ever")
    )
    metric = "least margin with identification"
    yield PAPER.record(case, metric, "cm", least)
    yield PAPER.record(case, f"{metric}, steps before it can be noticed included", "cm", ever)


def _falls(outcomes: Iterable[Outcome]) -> float:
    return float(sum(o["fell"] is not None for o in outcomes))


def _noticing_records(study: SurvivalSettings, cases: Sequence[SurvivalCase], found: _Found) -> Iterator[Record]:
    stood = [c for c in cases if found[c]["fell"] is None]
    times = [
        after for c in stood for at, after in zip((c.load_at, c.unload_at), found[c]["noticed"], strict=True) if at
    ]
    cycle, case = _cycle(), {"change [kg], at least": study.small / GRAVITY}
    late = sum(time is None or time > cycle for time in times)
    longest = max((time for time in times if time), default=0.0)
    yield PAPER.record(case, f"changes not noticed within a cycle, of {len(times)}", "1", float(late), bound=0.0)
    yield PAPER.record(case, "longest time to notice one", "s", longest, bound=cycle)


def _alarm_record(quiet: Sequence[Outcome]) -> Record:
    case = {"walked [min]": round(sum(o["walked"] for o in quiet) / 60.0, 2)}
    checks, alarms = (sum(o[name] for o in quiet) for name in ("checks", "alarms"))
    return PAPER.record(case, f"false alarms in {checks} checks", "1", float(alarms), bound=0.0)


def _table(cases: Sequence[SurvivalCase], found: _Found) -> TableData:
    """Survivors by load and corner, with and without identification."""
    corners = tuple(dict.fromkeys(c.corner for c in cases))
    groups: dict[str, list[Row]] = {}
    for way, heading in ((False, "without identification"), (True, "with identification")):
        for load in dict.fromkeys(c.load for c in cases):
            walks = [[found[c] for c in cases if (c.load, c.corner, c.identify) == (load, k, way)] for k in corners]
            groups.setdefault(heading, []).append((f"{load:.0f} N", *map(_survivors, walks)))
    note = "How many walks survived, and the least margin of the true centre of mass to the support polygon's edge."
    return TableData.of("Survival", ("load", *(f"on {corner}" for corner in corners)), groups, note)


def _survivors(walks: Sequence[Outcome]) -> Cell:
    alive = sum(bool(o["survived"]) for o in walks)
    least = [o["least_margin"] for o in walks if o["least_margin"] is not None]
    margin = f"{100.0 * min(least):.1f} cm" if least else "none"
    return Cell(f"{alive} of {len(walks)}, {margin}", strong=True, good=alive == len(walks))


def _failures(cases: Sequence[SurvivalCase], found: _Found) -> TableData:
    """Walks with identification that did not survive, and why."""
    rows = [
        (f"{c.load:.0f} N on {c.corner}, seed {c.seed}", o["fell"] or f"{o['state']}: {o['said']}")
        for c in cases
        if c.identify and not (o := found[c])["survived"]
    ]
    return TableData.of("With identification, not survived", ("walk", "because"), rows or [("none", "")])
