"""Changes of the load that the walking estimator names where there are none: robots stand, walk, turn and sway."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from scipy.stats import chi2

from stadera.experiments.alarm_runs import DOING, AlarmCase, watch
from stadera.experiments.grid import Outcome, run_grid
from stadera.experiments.motion import Gait
from stadera.experiments.result import (
    Cell,
    Experiment,
    ExperimentResult,
    Progress,
    Record,
    ReproduceSettings,
    TableData,
)

NAME = "alarms"

ROBOTS = ("hyq", "go2", "anymal_c", "b1")
GAITS: tuple[Gait, ...] = ("trot", "crawl", "shake")
SEEDS = {"standard": 5, "harsh": 2}

_QUICK = 6.0  # s
_SURE = 0.95
_LEAD = (
    "Robots stand, set out, trot or crawl at changing speeds, turn, stop and set out again, or sway where they stand, "
    "in MuJoCo at 1 kHz. Nothing is ever put on them, so that every change of the load that is named is a false "
    "alarm. The controllers walk by the walking estimator's estimate as soon as it can be trusted."
)
_NOTES = (
    "The bound of the rate is exact for alarms that come independently of each other: 95 % of studies of a process "
    "with a higher rate would have shown more of them.",
    "Feet step in trot and crawl from the first lifted to the last put down; shakes are on the spot.",
)

_Pairs = Sequence[tuple[AlarmCase, Outcome]]


def cases(settings: ReproduceSettings) -> list[AlarmCase]:
    """The grid, `standard` first, seed by seed; a small corner of it for a first look."""
    if settings.quick:
        return [AlarmCase("go2", gait, "standard", settings.seed, _QUICK) for gait in GAITS]
    return [
        AlarmCase(robot, gait, errors, settings.seed + k)
        for errors, seeds in SEEDS.items()
        for k in range(settings.seeds or seeds)
        for robot in ROBOTS
        for gait in GAITS
    ]


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """The whole grid, over the processor's cores; runs kept in `settings.keep` are not done again."""
    grid = cases(settings)
    return summary(grid, run_grid(NAME, watch, grid, progress, settings.keep))


def summary(grid: Sequence[AlarmCase], runs: Sequence[Outcome]) -> ExperimentResult:
    """What any part of the grid shows."""
    pairs = list(zip(grid, runs, strict=True))
    by_errors = {errors: [(c, r) for c, r in pairs if c.errors == errors] for errors in SEEDS}
    by_errors = {errors: chosen for errors, chosen in by_errors.items() if chosen}
    return ExperimentResult(
        name=NAME,
        title="False alarms of a robot in motion",
        lead=_LEAD,
        records=tuple(record for errors, chosen in by_errors.items() for record in _records(errors, chosen)),
        tables=(_by_robot(by_errors), _by_doing(by_errors), _each(pairs)),
        notes=_NOTES,
        facts={
            "Runs": f"{len(pairs)}",
            "Robots": ", ".join(dict.fromkeys(c.robot for c, _ in pairs)),
            "Watched": "; ".join(f"{minutes(chosen):.1f} min, {errors}" for errors, chosen in by_errors.items()),
            "Plant": "MuJoCo, 1 kHz, controllers in the loop, asked every other period",
        },
    )


def highest_rate(alarms: int, minutes: float) -> float:
    """Upper end of the one-sided 95 % confidence interval of a Poisson process' rate [1/h]: χ²(2 n + 2) / 2 T."""
    return float(chi2.ppf(_SURE, 2 * (alarms + 1))) / 2.0 / (minutes / 60.0)


def minutes(pairs: _Pairs) -> float:
    """Simulated [min]."""
    return sum(sum(r["seconds"].values()) for _, r in pairs) / 60.0


def _stepped(pairs: _Pairs) -> float:
    return sum(float(r["stepped"]) for _, r in pairs) / 60.0


def _alarms(pairs: _Pairs) -> int:
    return sum(len(r["alarms"]) for _, r in pairs)


def _falls(pairs: _Pairs) -> int:
    return sum(r["fell"] is not None for _, r in pairs)


def _halts(pairs: _Pairs) -> int:
    return sum(len(r["halts"]) for _, r in pairs)


def _records(errors: str, pairs: _Pairs) -> Iterator[Record]:
    promised = 0.0 if errors == "standard" else None
    for gait in ("all", *GAITS):
        chosen = [(c, r) for c, r in pairs if gait in ("all", c.gait)]
        if not chosen:
            continue
        time = minutes(chosen)
        case: dict[str, str | float] = {"errors": errors, "gait": gait, "watched [min]": round(time, 2)}
        yield Record(NAME, case, "false alarms", "1", float(_alarms(chosen)), bound=promised)
        yield Record(NAME, case, "rate of false alarms, not above, to 95 %", "1/h", highest_rate(_alarms(chosen), time))
        yield Record(NAME, case, "time in which feet stepped", "min", _stepped(chosen))
        yield Record(NAME, case, "falls", "1", float(_falls(chosen)))
        yield Record(NAME, case, "crawls that stopped by themselves", "1", float(_halts(chosen)))


def _counted(pairs: _Pairs) -> Cell:
    """Alarms in how many minutes."""
    if not pairs:
        return Cell("–")
    count = _alarms(pairs)
    return Cell(f"{count} in {minutes(pairs):.1f} min", strong=count > 0, good=count == 0)


def _by_robot(by_errors: Mapping[str, _Pairs]) -> TableData:
    groups = []
    for errors, pairs in by_errors.items():
        rows = []
        for robot in (*dict.fromkeys(c.robot for c, _ in pairs), "all"):
            own = [(c, r) for c, r in pairs if robot in ("all", c.robot)]
            cells = (_counted([(c, r) for c, r in own if c.gait == gait]) for gait in GAITS)
            rate = Cell(f"{highest_rate(_alarms(own), minutes(own)):.1f}")
            rows.append((Cell(robot), *cells, _counted(own), rate, Cell(f"{_falls(own)}"), Cell(f"{_halts(own)}")))
        groups.append((errors, tuple(rows)))
    head = ("robot", *GAITS, "all", "rate at most [1/h]", "falls", "crawls stopped")
    note = "Rate: exact one-sided 95 % bound. Crawls stopped: those that did so by themselves."
    return TableData("False alarms by robot and gait", head, tuple(groups), note)


def _by_doing(by_errors: Mapping[str, _Pairs]) -> TableData:
    groups = []
    for errors, pairs in by_errors.items():
        rows = []
        for doing in DOING:
            time = sum(float(r["seconds"].get(doing, 0.0)) for _, r in pairs) / 60.0
            count = sum(alarm["doing"] == doing for _, r in pairs for alarm in r["alarms"])
            rows.append((Cell(doing), Cell(f"{time:.1f}"), Cell(f"{count}", strong=count > 0, good=count == 0)))
        groups.append((errors, tuple(rows)))
    return TableData("By what the robot did", ("", "time [min]", "false alarms"), tuple(groups))


def _each(pairs: _Pairs) -> TableData:
    """Every false alarm, to be looked at."""
    rows = [
        (
            Cell(f"{c.robot}, {c.gait}, {c.errors}, seed {c.seed}"),
            Cell(f"{alarm['time']:.2f}"),
            Cell(f"{alarm['noticed']:.2f}"),
            Cell(alarm["doing"]),
            Cell(f"{100.0 * alarm['mass']:+.1f}"),
        )
        for c, r in pairs
        for alarm in r["alarms"]
    ]
    head = ("run", "at [s]", "named at [s]", "while", "mass [% of the robot's]")
    return TableData("Every false alarm", head, (("", tuple(rows or [(Cell("none"), *[Cell("")] * 4)])),))


EXPERIMENT = Experiment(NAME, "Changes of the load named where there are none, in motion", run, study=True, seeded=True)
