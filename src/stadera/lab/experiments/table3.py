"""Table III: the centre of mass from contact forces, on ramps."""

from collections.abc import Iterator, Sequence

from stadera.lab.experiments.runner import ExperimentResult, Paper, Record, ReproduceSettings, crossed
from stadera.lab.experiments.standing import StandingCase, StandingOutcome, stand, start_range
from stadera.report.table import TableData

PAPER = Paper.of("table3")

_LOADS = (0.0, 50.0, 100.0)  # N, the paper's
_START = (0.3, -0.3, 0.0)
_LEVEL, _ONE_POSE = "‖δ‖ in the world's x-y, one pose", "‖δ‖ in the trunk's x-y, one pose"
_TRUNK = "‖δ‖ in the trunk's x-y, two poses"


def cases(settings: ReproduceSettings) -> list[StandingCase]:
    """HyQ on three slopes under three loads."""
    grid = [(float(slope), load) for slope in PAPER.values for load in _LOADS]
    return [
        StandingCase("hyq", "contact", load, slope, seed=settings.seed, start=_START)
        for slope, load in (grid[-1:] if settings.quick else grid)
    ]


def summary(_: Sequence[StandingCase], outcomes: Sequence[StandingOutcome]) -> ExperimentResult:
    records = [record for outcome in outcomes for record in _records(outcome)]
    return PAPER.result(
        records,
        (
            _table(_LEVEL, records, "In brackets the paper's, which does not say whose x-y it means."),
            _table(_ONE_POSE, records, "The same poses."),
            _table(_TRUNK, records, "The same runs, after the trunk has pitched."),
        ),
        facts={
            "Robot": "hyq",
            "Start": start_range(outcomes),
            "Plant": "MuJoCo, 1 kHz, controller in the loop; estimator at 200 Hz",
        },
    )


EXPERIMENT = PAPER.experiment(cases, stand, summary)


def _records(o: StandingOutcome) -> Iterator[Record]:
    case: dict[str, str | float] = {"slope [deg]": o.case.slope, "load [N]": o.case.load}
    paper, bound = PAPER.values[f"{o.case.slope:g}"][_LOADS.index(o.case.load)], PAPER.bounds["plane"]
    yield PAPER.record(case, _LEVEL, "cm", 100 * o.level, paper, bound)
    yield PAPER.record(case, _ONE_POSE, "cm", 100 * o.in_plane_of_one_pose, paper, bound)
    yield PAPER.record(case, _TRUNK, "cm", 100 * o.in_plane, paper, bound)
    yield PAPER.record(case, "|δ_z| in the trunk, two poses", "cm", 100 * o.height)
    yield PAPER.record(case, "error of the trunk's mass", "kg", abs(o.mass_error))


def _table(metric: str, records: list[Record], note: str) -> TableData:
    return crossed(
        metric,
        (r for r in records if r.metric == metric),
        group=lambda r: "",
        row=lambda r: f"{r.case['slope [deg]']:g}°",
        column=lambda r: f"{r.case['load [N]']:g} N",
        corner="slope, ‖δ‖ [cm]",
        note=f"{note} Bound: {PAPER.bounds['plane']:.2f} cm in every cell.",
    )
