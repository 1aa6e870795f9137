"""Table II: the three methods on level ground, ideal sensors, three loads; and the same on other robots."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from stadera.errors import MissingExtraError
from stadera.experiments.result import (
    Cell,
    Experiment,
    ExperimentResult,
    FigureData,
    Line,
    Panel,
    Progress,
    Record,
    ReproduceSettings,
    TableData,
)
from stadera.experiments.standing_case import StandingCase, StandingOutcome
from stadera.experiments.standing_runs import METHOD_NAMES, error_cell, run_cases
from stadera.robot import load_robot
from stadera.sim.model import GRAVITY

NAME = "table2"

LOADS = (0.0, 50.0, 100.0)
"""[N], the paper's."""

_METHODS = ("poses", "orientation", "contact")
_PAPER: Mapping[str, tuple[float, float, float]] = {
    "poses": (0.010, 0.357, 0.513),
    "orientation": (0.020, 0.049, 0.452),
    "contact": (0.006, 0.125, 0.586),
}  # cm, by load
_PAPER_HEIGHT = {"poses": 2.0, "orientation": 1.0}  # cm
_BOUND, _HEIGHT_BOUND = 0.10, 0.5  # cm
_OTHERS, _SHARES = ("go2", "anymal_c", "b1"), (0.0, 0.06, 0.12)
_LEAD = (
    "HyQ stands on level ground under its trunk controller, which begins with a centre of mass far off. A virtual "
    "force presses down at (-0.75, 0.4, 0.0) m in the trunk's frame. The mass is estimated first (eq. 7), then each of "
    "the paper's three methods finds the centre of mass of trunk and load, and the controller takes it over meanwhile. "
    "‖δ‖ is the distance in x-y between estimate and truth, which only judges."
)
_NOTES = (
    "Sensors are ideal. What error is left is of the plant's contacts, which give a little, and of the time waited.",
    "(a) and (b) find the height as well: (a) tilts the trunk from pose to pose, (b) in its second phase. Forces in "
    "one pose, (c), do not show it.",
)
_PLANE_NOTE = f"In brackets the paper's. Bound: {_BOUND:.2f} cm in every cell."
_HEIGHT_NOTE = f"In brackets the paper's, which names one figure a method. Bound: {_HEIGHT_BOUND:.1f} cm."


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """Weighs HyQ by three methods under three loads, and other robots by the last."""
    cases = [_of("contact", 100.0, settings.seed)]
    robots: tuple[str, ...] = ()
    if not settings.quick:
        cases = [_of(m, load, settings.seed) for m in _METHODS for load in LOADS]
        robots = _installed(_OTHERS)
    weights = {robot: load_robot(robot).mass * GRAVITY for robot in robots}
    others = [_of("contact", s * weights[r], settings.seed, r) for r in robots for s in _SHARES]
    outcomes = run_cases(NAME, [*cases, *others], progress)
    hyq, rest = outcomes[: len(cases)], outcomes[len(cases) :]
    shares = {id(o): o.case.load / weights[o.case.robot] for o in rest}
    plane = [_plane_record(o) for o in hyq]
    height = [_height_record(o) for o in hyq if o.case.method in _PAPER_HEIGHT]
    tables = [_by_method("Error in x-y", "‖δ‖ [cm]", plane, _PLANE_NOTE)]
    if height:
        tables.append(_by_method("Error of the height", "|δ_z| [cm]", height, _HEIGHT_NOTE))
    if rest:
        tables.append(_robots_table(rest, shares))
    return ExperimentResult(
        name=NAME,
        title="Table II: three ways to find the centre of mass",
        lead=_LEAD,
        records=(
            *plane,
            *height,
            *(_mass_record(o) for o in hyq),
            *(record for o in rest for record in _robot_records(o, shares[id(o)])),
        ),
        tables=tuple(tables),
        figures=(_convergence(hyq),),
        notes=_NOTES,
        facts={
            "Robots": ", ".join(("hyq", *robots)),
            "Start": f"the centre of mass {100 * min(o.start_error for o in hyq):.0f} to "
            f"{100 * max(o.start_error for o in hyq):.0f} cm off in x-y on HyQ",
            "Plant": "MuJoCo, 1 kHz, controller in the loop; estimators at 200 Hz",
        },
    )


def _of(method: str, load: float, seed: int, robot: str = "hyq") -> StandingCase:
    return StandingCase(robot, method, load, seed=seed, height=method in _PAPER_HEIGHT)


def _installed(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(name for name in names if _is_installed(name))


def _is_installed(name: str) -> bool:
    try:
        load_robot(name)
    except MissingExtraError:
        return False
    return True


def _case(outcome: StandingOutcome) -> dict[str, str | float]:
    case = outcome.case
    return {"robot": case.robot, "method": METHOD_NAMES[case.method], "load [N]": round(case.load, 1)}


def _plane_record(o: StandingOutcome) -> Record:
    paper = _PAPER[o.case.method][LOADS.index(o.case.load)]
    return Record(NAME, _case(o), "‖δ‖ in x-y", "cm", 100 * o.in_plane, paper, _BOUND)


def _height_record(o: StandingOutcome) -> Record:
    return Record(NAME, _case(o), "|δ_z|", "cm", 100 * o.height, _PAPER_HEIGHT[o.case.method], _HEIGHT_BOUND)


def _mass_record(o: StandingOutcome) -> Record:
    return Record(NAME, _case(o), "error of the trunk's mass", "kg", abs(o.mass_error))


def _robot_records(o: StandingOutcome, share: float) -> Iterator[Record]:
    case = {**_case(o), "load, share of the weight": round(share, 3)}
    yield Record(NAME, case, "‖δ‖ in x-y", "cm", 100 * o.in_plane)
    yield Record(NAME, case, "‖δ‖ in x-y at the start", "cm", 100 * o.start_error)
    yield Record(NAME, case, "error of the trunk's mass", "kg", abs(o.mass_error))


def _by_method(title: str, error: str, records: list[Record], note: str) -> TableData:
    """A row a method, a column a load."""
    loads = tuple(dict.fromkeys(r.case["load [N]"] for r in records))
    rows = tuple(
        (Cell(str(method)), *(error_cell(r) for r in records if r.case["method"] == method))
        for method in dict.fromkeys(r.case["method"] for r in records)
    )
    return TableData(title, (error, *(f"{load:g} N" for load in loads)), (("", rows),), note)


def _robots_table(outcomes: list[StandingOutcome], shares: Mapping[int, float]) -> TableData:
    head = ("load", "load [N]", "‖δ‖ at the start [cm]", "‖δ‖ [cm]", "mass of trunk and load [kg]", "mass error [kg]")
    groups = []
    for robot in dict.fromkeys(o.case.robot for o in outcomes):
        rows = tuple(
            (
                Cell(f"{100 * shares[id(o)]:.0f} % of the weight"),
                Cell(f"{o.case.load:.1f}"),
                Cell(f"{100 * o.start_error:.1f}"),
                Cell(f"{100 * o.in_plane:.4f}", strong=True),
                Cell(f"{o.true_mass:.3f}"),
                Cell(f"{o.mass_error:+.4f}"),
            )
            for o in outcomes
            if o.case.robot == robot
        )
        groups.append((robot, rows))
    note = "Method (c). The load presses at HyQ's point, scaled with the distances between the hips."
    return TableData("Other robots", head, tuple(groups), note)


def _convergence(outcomes: list[StandingOutcome]) -> FigureData:
    """How each method gets there under the largest load."""
    most = max(o.case.load for o in outcomes)
    panels = []
    for o in (o for o in outcomes if o.case.load == most):
        error = 100 * np.linalg.norm((o.trace_com - o.true_com)[:, :2], axis=1)
        line = Line("‖δ‖", "identified", o.trace_time, np.maximum(error, 1e-4))
        panels.append(Panel(METHOD_NAMES[o.case.method], "time [s]", "‖δ‖ [cm]", (line,), log_y=True))
    return FigureData(f"Error in x-y on the way, load {most:g} N", tuple(panels), "At first the mass alone is weighed.")


EXPERIMENT = Experiment(NAME, "Table II, three ways to find the centre of mass", run)
