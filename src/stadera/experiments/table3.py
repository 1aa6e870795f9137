"""Table III: the centre of mass from contact forces, on ramps."""

from __future__ import annotations

from collections.abc import Iterator

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
from stadera.experiments.standing_case import START, StandingCase, StandingOutcome
from stadera.experiments.standing_runs import error_cell, run_cases

NAME = "table3"

_SLOPES, _LOADS = (0.0, 10.0, 15.0), (0.0, 50.0, 100.0)  # deg, N
_PAPER = {
    (0.0, 0.0): 0.082,
    (0.0, 50.0): 0.104,
    (0.0, 100.0): 0.864,
    (10.0, 0.0): 0.294,
    (10.0, 50.0): 0.621,
    (10.0, 100.0): 0.904,
    (15.0, 0.0): 0.429,
    (15.0, 50.0): 0.528,
    (15.0, 100.0): 0.773,
}  # cm, by slope and load
_BOUND = 0.30  # cm
_START = (START[0], START[1], 0.0)
_LEVEL, _ONE_POSE = "‖δ‖ in the world's x-y, one pose", "‖δ‖ in the trunk's x-y, one pose"
_TRUNK = "‖δ‖ in the trunk's x-y, two poses"
_LEAD = (
    "HyQ stands on a ramp that rises ahead of it, its trunk parallel to the ramp, and weighs itself by contact forces, "
    "method (c), as in Table II: the mass first, then the centre of mass, begun far off in x and y. Then it pitches by "
    "10° and looks for what is left."
)
_NOTES = (
    "Forces at rest in one pose show the centre of mass normal to the vertical, the world's x-y. Of the line that is "
    "left the law keeps the point at the height in the trunk that was believed first, CAD's; the load shifts the true "
    "one, and in the trunk's x that shows by the tangent of the slope. No law can tell that from one pose.",
    "Pitched by 10° the trunk's vertical is another, and the two lines of action meet in the centre of mass.",
)


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """Weighs HyQ on three slopes under three loads."""
    grid = [(slope, load) for slope in _SLOPES for load in _LOADS]
    if settings.quick:
        grid = grid[-1:]
    cases = [StandingCase("hyq", "contact", load, slope, seed=settings.seed, start=_START) for slope, load in grid]
    outcomes = run_cases(NAME, cases, progress)
    records = [record for outcome in outcomes for record in _records(outcome)]
    return ExperimentResult(
        name=NAME,
        title="Table III: the centre of mass from contact forces, on ramps",
        lead=_LEAD,
        records=tuple(records),
        tables=(
            _table(_LEVEL, records, "In brackets the paper's, which does not say whose x-y it means."),
            _table(_ONE_POSE, records, "The same poses."),
            _table(_TRUNK, records, "The same runs, after the trunk has pitched."),
        ),
        figures=(_figure(outcomes[-1]),),
        notes=_NOTES,
        facts={
            "Robot": "hyq",
            "Start": f"the centre of mass {100 * min(o.start_error for o in outcomes):.0f} to "
            f"{100 * max(o.start_error for o in outcomes):.0f} cm off in x-y",
            "Plant": "MuJoCo, 1 kHz, controller in the loop; estimator at 200 Hz",
        },
    )


def _records(o: StandingOutcome) -> Iterator[Record]:
    case: dict[str, str | float] = {"slope [deg]": o.case.slope, "load [N]": o.case.load}
    paper = _PAPER[o.case.slope, o.case.load]
    yield Record(NAME, case, _LEVEL, "cm", 100 * o.level, paper, _BOUND)
    yield Record(NAME, case, _ONE_POSE, "cm", 100 * o.in_plane_of_one_pose, paper, _BOUND)
    yield Record(NAME, case, _TRUNK, "cm", 100 * o.in_plane, paper, _BOUND)
    yield Record(NAME, case, "|δ_z| in the trunk, two poses", "cm", 100 * o.height)
    yield Record(NAME, case, "error of the trunk's mass", "kg", abs(o.mass_error))


def _table(metric: str, records: list[Record], note: str) -> TableData:
    mine = [r for r in records if r.metric == metric]
    loads = tuple(dict.fromkeys(r.case["load [N]"] for r in mine))
    rows = tuple(
        (Cell(f"{slope:g}°"), *(error_cell(r) for r in mine if r.case["slope [deg]"] == slope))
        for slope in dict.fromkeys(r.case["slope [deg]"] for r in mine)
    )
    head = ("slope, ‖δ‖ [cm]", *(f"{load:g} N" for load in loads))
    return TableData(metric, head, (("", rows),), f"{note} Bound: {_BOUND:.2f} cm in every cell.")


def _figure(o: StandingOutcome) -> FigureData:
    lines = []
    for name, role, axis in (("x", "identified", 0), ("y", "measured", 1)):
        lines.append(Line(f"{name}, estimate − truth", role, o.trace_time, 100 * (o.trace_com - o.true_com)[:, axis]))
    panel = Panel("trunk's centre of mass", "time [s]", "error [cm]", tuple(lines))
    title = f"On the way, slope {o.case.slope:g}°, load {o.case.load:g} N"
    return FigureData(title, (panel,), "At first the mass alone is weighed.")


EXPERIMENT = Experiment(NAME, "Table III, the centre of mass from contact forces on ramps", run)
