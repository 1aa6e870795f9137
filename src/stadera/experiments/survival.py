"""Who survives a load on the way: walks with and without identification, over loads, corners and seeds.

Besides: whether changes of 3 kg are noticed, on and off, whenever in the gait they happen, and whether any is noticed
where there is none.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isnan

from stadera.control.crawl_settings import CrawlCommand, CrawlSettings
from stadera.experiments.grid import Outcome, run_grid
from stadera.experiments.loaded_walk import (
    CORNERS,
    STAND,
    Identification,
    LoadedWalkCase,
    LoadedWalkOutcome,
    loaded_walk,
    weight_at,
)
from stadera.experiments.result import (
    Cell,
    Experiment,
    ExperimentResult,
    Progress,
    Record,
    ReproduceSettings,
    TableData,
)
from stadera.robot import load_robot
from stadera.supervise import State

NAME = "survival"

LOADS = (25.0, 50.0, 75.0, 100.0, 125.0, 150.0)
"""[N]."""

_ROBOT, _SPEED = "hyq", 0.1
_WORST, _WORST_CORNER = 100.0, "LH"  # the paper's
_SEEDS, _WORST_SEEDS = 2, 20
_LOAD_AT = 4.5  # s, and up to a cycle later
_SECONDS = {True: 18.5, False: 13.0}  # with identification and without: a cycle of walking under load at least
_SMALL, _SMALL_SEEDS = 3.0 * 9.81, 12  # N
_ON, _OFF, _NOTICING = 4.5, 15.0, 19.5  # s
_QUIET, _QUIET_WALKS = 31.0, 20  # s of a walk without any load, of which all but the stand is walking
_LEAD = (
    "HyQ crawls at 10 cm/s with standard sensor errors, and a weight comes onto a corner of its back. Without "
    "identification controller and planner go on with the model file's trunk; with it, the supervisor notices, stops, "
    "weighs and walks on. A walk survives if the robot does not fall, its true centre of mass does not leave the "
    "support polygon, and it walks at the end. A step that is taken before the load can be noticed is not counted "
    "against the walk, unless the robot falls: margins count from a step's time after the load on."
)
_NOTES = (
    "Loads are bodies fixed to the trunk, cubes of a decimetre on the corners of the back, above the hips.",
    "Loads come on all over the gait, from walk to walk.",
    "Changes are noticed if a check says so within one cycle of four steps, after the load came on and after it went.",
)


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
    never = float("inf")
    outcome = loaded_walk(
        LoadedWalkCase(
            robot=_ROBOT,
            payload=payload,
            load_at=case.load_at or never,
            unload_at=case.unload_at or never,
            identification=Identification.STOPPING if case.identify else Identification.NONE,
            seconds=case.seconds,
            speed=_SPEED,
            seed=case.seed,
        )
    )
    on, off = (_noticed(outcome, time) for time in (case.load_at, case.unload_at))
    return {
        "survived": outcome.survived and outcome.state not in (State.STANDING, State.SITTING),
        "fell": None if outcome.fall is None else outcome.fall.how,
        "least_margin": None if isnan(outcome.least_margin) else outcome.least_margin,
        "least_margin_ever": None if isnan(outcome.least_margin_ever) else outcome.least_margin_ever,
        "noticed": [on, off],
        "alarms": sum(check.changed for check in outcome.checks),
        "checks": len(outcome.checks),
        "state": str(outcome.state),
        "said": outcome.transitions[-1].reason if outcome.transitions else "",
        "way": outcome.way,
        "walked": outcome.seconds - STAND,
    }


def _noticed(outcome: LoadedWalkOutcome, since: float) -> float | None:
    """Time [s] from a change to the first check after it that says so."""
    if not since:
        return None
    return next((check.time - since for check in outcome.checks if check.changed and check.time > since), None)


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """The grid of loads and corners, the paper's load over many seeds, small changes, and quiet walks."""
    grid, worst, small, quiet = _cases(settings)
    cases = list(dict.fromkeys((*grid, *worst, *small, *quiet)))
    found = dict(zip(cases, run_grid(NAME, survive, cases, progress, settings.keep), strict=True))
    return ExperimentResult(
        name=NAME,
        title="Who survives a load on the way",
        lead=_LEAD,
        records=(*_worst_records(worst, found), *_noticing_records([*grid, *worst, *small], quiet, found)),
        tables=(_table(grid, found), _failures(grid, found)),
        notes=_NOTES,
        facts={
            "Robot": _ROBOT,
            "Walks": f"{len(cases)}",
            "Sensors": "standard errors",
            "Plant": "MuJoCo, 1 kHz, crawl, controller and supervisor in the loop",
        },
    )


def _cases(settings: ReproduceSettings) -> tuple[list[SurvivalCase], ...]:
    quick, first = settings.quick, settings.seed
    loads, corners = ((50.0, 150.0), ("LH", "RF")) if quick else (LOADS, tuple(CORNERS))
    seeds, worst, small, quiet = (1, 1, 1, 1) if quick else (_SEEDS, _WORST_SEEDS, _SMALL_SEEDS, _QUIET_WALKS)

    cycle, ways = _cycle(), (False, True)

    def walk(load: float, corner: str, identify: bool, seed: int, phase: float) -> SurvivalCase:
        at = round(_LOAD_AT + phase * cycle, 3)
        return SurvivalCase(load, corner, identify, first + seed, at, 0.0, _SECONDS[identify])

    return (
        [
            walk(load, corner, way, k, (n + k / seeds) / len(loads))
            for n, load in enumerate(loads)
            for corner in corners
            for k in range(seeds)
            for way in ways
        ],
        [walk(_WORST, _WORST_CORNER, way, k, k / worst) for k in range(worst) for way in ways],
        [
            SurvivalCase(
                _SMALL, tuple(CORNERS)[k % 4], True, first + k, round(_ON + k * cycle / small, 3), _OFF, _NOTICING
            )
            for k in range(small)
        ],
        [SurvivalCase(0.0, _WORST_CORNER, True, first + k, 0.0, 0.0, _QUIET) for k in range(quiet)],
    )


def _cycle() -> float:
    """Of four steps [s]."""
    return 4.0 * CrawlSettings.of(load_robot(_ROBOT)).timing(CrawlCommand(_SPEED)).step


_Found = dict[SurvivalCase, Outcome]


def _worst_records(cases: Sequence[SurvivalCase], found: _Found) -> tuple[Record, ...]:
    case: dict[str, str | float] = {"load [N]": _WORST, "corner": _WORST_CORNER}
    by_way = {way: [found[c] for c in cases if c.identify is way] for way in (True, False)}
    count = float(len(by_way[True]))
    failed = float(sum(not o["survived"] for o in by_way[False]))
    margins = [o["least_margin"] for o in by_way[True] if o["least_margin"] is not None]
    return (
        Record(NAME, case, f"falls with identification, of {count:.0f}", "1", _falls(by_way[True]), None, 0.0),
        Record(
            NAME, case, f"did not survive with identification, of {count:.0f}", "1",
            float(sum(not o["survived"] for o in by_way[True])), None, 0.0,
        ),
        Record(
            NAME, case, f"fell or left the support polygon without, of {count:.0f}", "1", failed, None, count,
            "at least",
        ),
        Record(NAME, case, f"falls without identification, of {count:.0f}", "1", _falls(by_way[False])),
        Record(NAME, case, "least margin with identification", "cm", 100.0 * min(margins, default=0.0)),
        Record(
            NAME, case, "least margin with identification, steps before it can be noticed included", "cm",
            100.0 * min((o["least_margin_ever"] for o in by_way[True] if o["least_margin_ever"]), default=0.0),
        ),
    )  # fmt: skip


def _falls(outcomes: Iterable[Outcome]) -> float:
    return float(sum(o["fell"] is not None for o in outcomes))


def _noticing_records(
    cases: Sequence[SurvivalCase], quiet: Sequence[SurvivalCase], found: _Found
) -> tuple[Record, ...]:
    watched = [c for c in dict.fromkeys(cases) if c.identify and c.load >= _SMALL - 1e-9]
    times = [
        found[c]["noticed"][which]
        for c in watched
        for which, at in enumerate((c.load_at, c.unload_at))
        if at and found[c]["fell"] is None
    ]
    cycle, walked = _cycle(), sum(found[c]["walked"] for c in quiet)
    late = sum(time is None or time > cycle for time in times)
    case: dict[str, str | float] = {"change [kg], at least": _SMALL / 9.81}
    return (
        Record(NAME, case, f"changes not noticed within a cycle, of {len(times)}", "1", float(late), None, 0.0),
        Record(NAME, case, "longest time to notice one", "s", max((t for t in times if t), default=0.0), None, cycle),
        Record(
            NAME,
            {"walked [min]": round(walked / 60.0, 2)},
            f"false alarms in {sum(found[c]['checks'] for c in quiet)} checks",
            "1",
            float(sum(found[c]["alarms"] for c in quiet)),
            None,
            0.0,
        ),
    )


def _table(cases: Sequence[SurvivalCase], found: _Found) -> TableData:
    """Survivors by load and corner, with and without identification."""
    corners = tuple(dict.fromkeys(c.corner for c in cases))
    groups = []
    for way, heading in ((False, "without identification"), (True, "with identification")):
        rows = []
        for load in dict.fromkeys(c.load for c in cases):
            cells = [Cell(f"{load:.0f} N")]
            for corner in corners:
                walks = [found[c] for c in cases if (c.load, c.corner, c.identify) == (load, corner, way)]
                alive = sum(bool(o["survived"]) for o in walks)
                least = [o["least_margin"] for o in walks if o["least_margin"] is not None]
                margin = f"{100.0 * min(least):.1f} cm" if least else "none"
                cells.append(Cell(f"{alive} of {len(walks)}, {margin}", strong=True, good=alive == len(walks)))
            rows.append(tuple(cells))
        groups.append((heading, tuple(rows)))
    note = "How many walks survived, and the least margin of the true centre of mass to the support polygon's edge."
    return TableData("Survival", ("load", *(f"on {corner}" for corner in corners)), tuple(groups), note)


def _failures(cases: Sequence[SurvivalCase], found: _Found) -> TableData:
    """What became of walks with identification that did not survive."""
    rows = [
        (Cell(f"{c.load:.0f} N on {c.corner}, seed {c.seed}"), Cell(o["fell"] or f"{o['state']}: {o['said']}"))
        for c in cases
        if c.identify and not (o := found[c])["survived"]
    ]
    return TableData(
        "With identification, not survived", ("walk", "because"), (("", tuple(rows or [(Cell("none"), Cell(""))])),)
    )


EXPERIMENT = Experiment(NAME, "who survives a load on the way", run, study=True)
