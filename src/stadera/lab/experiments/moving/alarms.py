"""False alarms of the walking estimator: changes of the load reported for unloaded robots in motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from scipy.stats import chi2

from stadera.lab.experiments.grid import Outcome, grouped, run_grid
from stadera.lab.experiments.moving.motion import Gait
from stadera.lab.experiments.moving.schedule import DOING, AlarmCase, watch
from stadera.lab.experiments.paper import Paper, ReproduceSettings
from stadera.lab.experiments.result import ExperimentResult, Record
from stadera.report.table import Cell, Row, TableData
from stadera.types import Progress

PAPER = Paper.of("alarms")

ROBOTS = ("hyq", "go2", "anymal_c", "b1")
GAITS: tuple[Gait, ...] = ("trot", "crawl", "shake")
SEEDS = {"standard": 5, "harsh": 2}

_QUICK = 6.0  # s, of a quick run

_Pairs = Sequence[tuple[AlarmCase, Outcome]]


def cases(settings: ReproduceSettings) -> list[AlarmCase]:
    """The grid, `standard` first, seed by seed; a small part of it in quick mode."""
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
    """Runs the whole grid on all cores; runs stored in `settings.keep` are not repeated."""
    grid = cases(settings)
    return summary(grid, run_grid(PAPER.name, watch, grid, progress, settings.keep, settings.pool))


def summary(grid: Sequence[AlarmCase], runs: Sequence[Outcome]) -> ExperimentResult:
    """Summarises any part of the grid."""
    pairs = list(zip(grid, runs, strict=True))
    found = grouped(pairs, lambda case: case.errors)
    by_errors = {errors: found[errors] for errors in SEEDS if errors in found}
    return PAPER.result(
        (record for errors, chosen in by_errors.items() for record in _records(errors, chosen)),
        (_by_robot(by_errors), _by_doing(by_errors), _each(pairs)),
        facts={
            "Runs": f"{len(pairs)}",
            "Robots": ", ".join(dict.fromkeys(c.robot for c in grid)),
            "Watched": "; ".join(f"{minutes(chosen):.1f} min, {errors}" for errors, chosen in by_errors.items()),
            "Plant": "MuJoCo, 1 kHz, controllers in the loop, asked every other period",
        },
    )


def highest_rate(alarms: int, minutes: float, confidence: float = 0.95) -> float:
    """Upper end of the one-sided 95 % confidence interval of a Poisson process' rate [1/h]: χ²(2 n + 2) / 2 T."""
    return float(chi2.ppf(confidence, 2 * (alarms + 1))) / 2.0 / (minutes / 60.0)


def minutes(pairs: _Pairs) -> float:
    """Simulated time [min]."""
    return sum(sum(r["seconds"].values()) for _, r in pairs) / 60.0


def _count(pairs: _Pairs, what: str) -> int:
    return sum(len(r[what]) for _, r in pairs)


def _falls(pairs: _Pairs) -> int:
    return sum(r["fell"] is not None for _, r in pairs)


def _of(pairs: _Pairs, gait: str) -> _Pairs:
    return [(c, r) for c, r in pairs if gait in ("all", c.gait)]


def _records(errors: str, pairs: _Pairs) -> Iterator[Record]:
    promised = 0.0 if errors == "standard" else None
    for gait in ("all", *GAITS):
        if not (chosen := _of(pairs, gait)):
            continue
        time, alarms = minutes(chosen), _count(chosen, "alarms")
        stepped = sum(float(r["stepped"]) for _, r in chosen) / 60.0
        case: dict[str, str | float] = {"errors": errors, "gait": gait, "watched [min]": round(time, 2)}
        rate = highest_rate(alarms, time)
        yield PAPER.record(case, "false alarms", "1", float(alarms), bound=promised)
        yield PAPER.record(case, "rate of false alarms, not above, to 95 %", "1/h", rate)
        yield PAPER.record(case, "time in which feet stepped", "min", stepped)
        yield PAPER.record(case, "falls", "1", float(_falls(chosen)))
        yield PAPER.record(case, "crawls that stopped by themselves", "1", float(_count(chosen, "halts")))


def _alarm_cell(pairs: _Pairs) -> Cell:
    """Number of alarms, and the simulated minutes."""
    if not pairs:
        return Cell("–")
    count = _count(pairs, "alarms")
    return Cell(f"{count} in {minutes(pairs):.1f} min", strong=count > 0, good=count == 0)


def _by_robot(by_errors: Mapping[str, _Pairs]) -> TableData:
    groups: dict[str, list[Row]] = {}
    for errors, pairs in by_errors.items():
        for robot, own in {**grouped(pairs, lambda case: case.robot), "all": pairs}.items():
            cells = (_alarm_cell(_of(own, gait)) for gait in (*GAITS, "all"))
            rate = highest_rate(_count(own, "alarms"), minutes(own))
            row: Row = (robot, *cells, f"{rate:.1f}", f"{_falls(own)}", f"{_count(own, 'halts')}")
            groups.setdefault(errors, []).append(row)
    head = ("robot", *GAITS, "all", "rate at most [1/h]", "falls", "crawls stopped")
    note = "Rate: exact one-sided 95 % bound. Crawls stopped: those that did so by themselves."
    return TableData.of("False alarms by robot and gait", head, groups, note)


def _by_doing(by_errors: Mapping[str, _Pairs]) -> TableData:
    groups: dict[str, list[Row]] = {}
    for errors, pairs in by_errors.items():
        for doing in DOING:
            time = sum(float(r["seconds"].get(doing, 0.0)) for _, r in pairs) / 60.0
            count = sum(alarm["doing"] == doing for _, r in pairs for alarm in r["alarms"])
            cell = Cell(f"{count}", strong=count > 0, good=count == 0)
            groups.setdefault(errors, []).append((doing, f"{time:.1f}", cell))
    return TableData.of("By what the robot did", ("", "time [min]", "false alarms"), groups)


def _each(pairs: _Pairs) -> TableData:
    rows = [
        (
            f"{c.robot}, {c.gait}, {c.errors}, seed {c.seed}",
            f"{alarm['time']:.2f}",
            f"{alarm['noticed']:.2f}",
            str(alarm["doing"]),
            f"{100.0 * alarm['mass']:+.1f}",
        )
        for c, r in pairs
        for alarm in r["alarms"]
    ]
    head = ("run", "at [s]", "named at [s]", "while", "mass [% of the robot's]")
    return TableData.of("Every false alarm", head, rows or [("none", "", "", "", "")])
