"""Survival study: walks with a load, with and without identification, over loads, corners and seeds.

Both are evaluated by the same criteria (`loaded_walk.py`): walked, stuck or fell. The number of walks in which the true
centre of mass left the support polygon is counted as well. The study also tests whether changes of 3 kg are detected,
on and off, at any phase of the gait, and whether there are false alarms.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from math import inf

from stadera.constants import GRAVITY
from stadera.lab.control.steps import CrawlCommand, CrawlSettings
from stadera.lab.experiments.loaded_walk import (
    CORNERS,
    LoadedWalk,
    LoadedWalkCase,
    LoadedWalkOutcome,
    Supervision,
    WalkOutcome,
    weight_at,
)
from stadera.lab.experiments.result import CaseValues, ExperimentResult, Record
from stadera.lab.experiments.runner import Outcome, Paper, ReproduceSettings
from stadera.report.table import Cell, Row, TableData
from stadera.results import finite_or_none
from stadera.robot import load_robot

PAPER = Paper.of("survival")

_ROBOT, _SPEED = "hyq", 0.1
WALKED, FELL = str(WalkOutcome.WALKED), str(WalkOutcome.FELL)


@dataclass(frozen=True)
class SurvivalSettings:
    """Walks of the study."""

    loads: tuple[float, ...] = (50.0, 100.0, 150.0, 200.0, 250.0, 300.0)  # of the grid [N]
    corners: tuple[str, ...] = tuple(CORNERS)  # of the grid
    seeds: int = 2  # of the grid
    paper: float = 100.0  # the paper's load [N]
    paper_corner: str = "LH"  # its place
    paper_seeds: int = 20  # over many seeds
    small: float = 3.0 * GRAVITY  # the least change that must be detected [N]
    small_seeds: int = 12
    quiet_walks: int = 20  # number of walks without a load
    load_at: float = 4.5  # [s], and up to a cycle later
    # of a walk [s], with identification and without: at least a cycle of walking under load
    seconds: Mapping[bool, float] = field(default_factory=lambda: {True: 18.5, False: 13.0})
    on: float = 4.5  # time at which a small change is made [s]
    off: float = 15.0  # time at which it is undone [s]
    noticing: float = 19.5  # duration of such a walk [s]
    quiet: float = 31.0  # duration of walks without a load [s], of which all but the stand is walking


FULL = SurvivalSettings()
_QUICK = SurvivalSettings((100.0, 300.0), ("LH", "RF"), 1, paper_seeds=1, small_seeds=1, quiet_walks=1)


@dataclass(frozen=True)
class SurvivalCase:
    """Settings of one walk."""

    part: str  # of the study: the grid, the paper's load, small changes, or quiet walks without a load
    load: float  # [N], 0 for none
    corner: str  # of the back
    identify: bool  # whether identification is used
    seed: int  # of the sensors' errors
    load_at: float  # [s]; 0 for never
    unload_at: float  # [s]; 0 for never
    seconds: float  # of the walk


def cases(settings: ReproduceSettings) -> list[SurvivalCase]:
    """The grid, the paper's load, small changes, and walks without a load; loads are spread over the gait."""
    study, first, cycle = _QUICK if settings.quick else FULL, settings.seed, _cycle()

    def walk(part: str, load: float, corner: str, identify: bool, k: int, phase: float) -> SurvivalCase:
        at = round(study.load_at + phase * cycle, 3)
        return SurvivalCase(part, load, corner, identify, first + k, at, 0.0, study.seconds[identify])

    def small(k: int) -> SurvivalCase:
        at, corner = round(study.on + k * cycle / study.small_seeds, 3), tuple(CORNERS)[k % len(CORNERS)]
        return SurvivalCase("small", study.small, corner, True, first + k, at, study.off, study.noticing)

    grid = product(enumerate(study.loads), study.corners, range(study.seeds), (False, True))
    paper = product(range(study.paper_seeds), (False, True))
    return [
        *(
            walk("grid", load, corner, identify, k, (n + k / study.seeds) / len(study.loads))
            for (n, load), corner, k, identify in grid
        ),
        *(walk("paper", study.paper, study.paper_corner, identify, k, k / study.paper_seeds) for k, identify in paper),
        *map(small, range(study.small_seeds)),
        *(
            SurvivalCase("quiet", 0.0, study.paper_corner, True, first + k, 0.0, 0.0, study.quiet)
            for k in range(study.quiet_walks)
        ),
    ]


def _cycle() -> float:
    """Duration of four steps [s]."""
    return 4.0 * CrawlSettings.of(load_robot(_ROBOT)).timing(CrawlCommand(_SPEED)).step


def survive(case: SurvivalCase) -> Outcome:
    """Outcome of a walk."""
    walk = LoadedWalkCase(
        robot=_ROBOT,
        payload=weight_at(load_robot(_ROBOT), case.corner, case.load) if case.load else None,
        load_at=case.load_at or inf,
        unload_at=case.unload_at or inf,
        supervision=Supervision.STOPPING if case.identify else Supervision.NONE,
        seconds=case.seconds,
        speed=_SPEED,
        seed=case.seed,
    )
    outcome = LoadedWalk(walk).run()
    return {
        "outcome": str(outcome.verdict.outcome),
        "reasons": list(outcome.verdict.reasons),
        "least_margin": finite_or_none(outcome.least_margin),
        "least_margin_ever": finite_or_none(outcome.least_margin_ever),
        "noticed": [_noticed(outcome, time) for time in (case.load_at, case.unload_at)],
        "alarms": len(outcome.noticed),
        "state": str(outcome.state),
        "said": outcome.transitions[-1].reason if outcome.transitions else "",
        "distance": outcome.trace.distance,
        "walked": float(outcome.trace.time[-1]) - walk.stand,
    }


def _noticed(outcome: LoadedWalkOutcome, since: float) -> float | None:
    """Time [s] from a change of the load until a change is detected."""
    return next((time - since for time in outcome.noticed if time > since), None) if since else None


# -- summary ----------------------------------------------------------------------------------------------------------
_Pairs = Sequence[tuple[SurvivalCase, Outcome]]


def summary(cases: Sequence[SurvivalCase], outcomes: Sequence[Outcome]) -> ExperimentResult:
    """Records of the paper's load, of changes noticed and false alarms, and tables of the grid."""
    pairs = list(zip(cases, outcomes, strict=True))
    grid, paper, quiet = ([(c, o) for c, o in pairs if c.part == part] for part in ("grid", "paper", "quiet"))
    return PAPER.result(
        (
            *_way_records(True, [o for c, o in paper if c.identify]),
            *_way_records(False, [o for c, o in paper if not c.identify]),
            *_noticing_records([(c, o) for c, o in pairs if c.identify and c.load >= FULL.small - 1e-9]),
            *_alarm_records([o for _, o in quiet]),
        ),
        (_table(grid), _failures(grid)),
        facts={
            "Robot": _ROBOT,
            "Walks": f"{len(cases)}",
            "Sensors": "standard errors",
            "Plant": "MuJoCo, 1 kHz, crawl, controller and supervisor in the loop",
        },
    )


EXPERIMENT = PAPER.experiment(cases, survive, summary, keeps=True)


def _way_records(identify: bool, walks: Sequence[Outcome]) -> Iterator[Record]:
    """Counts of one kind of walks, with the paper's bounds: it walks with identification and fails without."""
    case: CaseValues = {"load [N]": FULL.paper, "corner": FULL.paper_corner}
    count, none = float(len(walks)), 0.0 if identify else None
    way = f"{'with' if identify else 'without'} identification"
    of = f"{way}, of {count:.0f}"
    fell = [o["outcome"] == FELL for o in walks]
    left = [(o["least_margin"] or 0.0) < 0.0 for o in walks]
    yield PAPER.record(case, f"fell {of}", "1", _number(fell), bound=none)
    yield PAPER.record(case, f"stuck or fell {of}", "1", _number(o["outcome"] != WALKED for o in walks), bound=none)
    out, metric = _number(any(each) for each in zip(fell, left, strict=True)), f"fell or left the support polygon {of}"
    yield PAPER.record(case, metric, "1", out, bound=0.0) if identify else PAPER.least(case, metric, "1", out, count)
    for key, name in (("least_margin", ""), ("least_margin_ever", ", steps before it can be noticed included")):
        least = 100.0 * min((o[key] for o in walks if o[key] is not None), default=0.0)
        yield PAPER.record(case, f"least margin {way}{name}", "cm", least)


def _number(true: Iterable[bool]) -> float:
    return float(sum(true))


def _noticing_records(watched: _Pairs) -> Iterator[Record]:
    """Changes made in walks without a fall, and the time until they are noticed."""
    times = [
        after
        for case, outcome in watched
        if outcome["outcome"] != FELL
        for at, after in zip((case.load_at, case.unload_at), outcome["noticed"], strict=True)
        if at
    ]
    cycle, of = _cycle(), {"change [kg], at least": FULL.small / GRAVITY}
    late = sum(time is None or time > cycle for time in times)
    longest = max((time for time in times if time), default=0.0)
    yield PAPER.record(of, f"changes not noticed within a cycle, of {len(times)}", "1", float(late), bound=0.0)
    yield PAPER.record(of, "longest time to notice one", "s", longest, bound=cycle)


def _alarm_records(quiet: Sequence[Outcome]) -> Iterator[Record]:
    case = {"walked [min]": round(sum(o["walked"] for o in quiet) / 60.0, 2)}
    yield PAPER.record(case, "false alarms", "1", float(sum(o["alarms"] for o in quiet)), bound=0.0)


def _table(grid: _Pairs) -> TableData:
    corners = tuple(dict.fromkeys(c.corner for c, _ in grid))
    groups: dict[str, list[Row]] = {}
    for way, heading in ((False, "without identification"), (True, "with identification")):
        for load in dict.fromkeys(c.load for c, _ in grid):
            walks = [[o for c, o in grid if (c.load, c.corner, c.identify) == (load, k, way)] for k in corners]
            groups.setdefault(heading, []).append((f"{load:.0f} N", *map(_outcomes, walks)))
    note = "How the walks ended, and the least margin of the true centre of mass to the support polygon's edge."
    return TableData.of("Outcomes", ("load", *(f"on {corner}" for corner in corners)), groups, note)


def _outcomes(walks: Sequence[Outcome]) -> Cell:
    count = Counter(o["outcome"] for o in walks)
    least = [o["least_margin"] for o in walks if o["least_margin"] is not None]
    margin = f"{100.0 * min(least):.1f} cm" if least else "none"
    ended = ", ".join(f"{count[str(outcome)]} {outcome}" for outcome in WalkOutcome if count[str(outcome)])
    return Cell(f"{ended}; {margin}", strong=True, good=count[WALKED] == len(walks))


def _failures(grid: _Pairs) -> TableData:
    """Walks with identification that were stuck or fell, and why."""
    rows = [
        (f"{c.load:.0f} N on {c.corner}, seed {c.seed}", o["outcome"], "; ".join([*o["reasons"], o["said"]]))
        for c, o in grid
        if c.identify and o["outcome"] != WALKED
    ]
    return TableData.of("With identification, not walked", ("walk", "outcome", "because"), rows or [("none", "", "")])
