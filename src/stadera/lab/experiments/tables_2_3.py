"""Tables II and III: ideal sensors and three loads, on level ground by each method and on ramps by contact forces.

On level ground other robots than the paper's are weighed too.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence

from stadera.constants import GRAVITY
from stadera.errors import MissingExtraError
from stadera.lab.experiments.runner import ExperimentResult, Paper, Record, ReproduceSettings, crossed
from stadera.lab.experiments.standing import METHOD_NAMES, StandingCase, StandingOutcome, stand, start_range
from stadera.report.table import TableData
from stadera.robot import load_robot

LEVEL, RAMPS = Paper.of("table2"), Paper.of("table3")

_LOADS = (0.0, 50.0, 100.0)  # N, the paper's


def _by_load(title: str, corner: str, records: Iterable[Record], row: Callable[[Record], str], note: str) -> TableData:
    return crossed(title, records, lambda r: "", row, lambda r: f"{r.case['load [N]']:g} N", corner, note)


# -- Table II ---------------------------------------------------------------------------------------------------------
_OTHERS, _SHARES = ("go2", "anymal_c", "b1"), (0.0, 0.06, 0.12)


def _level_cases(settings: ReproduceSettings) -> list[StandingCase]:
    """HyQ with every method and load, and other robots with (c), their loads as shares of their weights."""
    seed = settings.seed
    if settings.quick:
        return [_case("contact", 100.0, seed)]
    weights = {name: weight for name in _OTHERS if (weight := _weight(name)) is not None}
    return [
        *(_case(method, load, seed) for method in LEVEL.values["plane"] for load in _LOADS),
        *(_case("contact", share * weight, seed, name) for name, weight in weights.items() for share in _SHARES),
    ]


def _level(_: Sequence[StandingCase], outcomes: Sequence[StandingOutcome]) -> ExperimentResult:
    hyq = [o for o in outcomes if o.case.robot == "hyq"]
    others = [o for o in outcomes if o.case.robot != "hyq"]
    plane, height, values, bounds = list[Record](), list[Record](), LEVEL.values, LEVEL.bounds
    for o in hyq:
        paper = values["plane"][o.case.method][_LOADS.index(o.case.load)]
        plane.append(LEVEL.record(_named(o), "‖δ‖ in x-y", "cm", 100 * o.in_plane, paper, bounds["plane"]))
        if o.case.height:
            paper = values["height"][o.case.method]
            height.append(LEVEL.record(_named(o), "|δ_z|", "cm", 100 * o.height, paper, bounds["height"]))
    note = f"In brackets the paper's. Bound: {bounds['plane']:.2f} cm in every cell."
    tables = [_by_load("Error in x-y", "‖δ‖ [cm]", plane, _method, note)]
    if height:
        note = f"In brackets the paper's, which names one figure a method. Bound: {bounds['height']:.1f} cm."
        tables.append(_by_load("Error of the height", "|δ_z| [cm]", height, _method, note))
    more = [record for o in others for record in _robot_records(o)]
    if more:
        note = "Method (c). The load presses at HyQ's point, scaled with the distances between the hips."
        tables.append(crossed("Other robots", more, lambda r: str(r.case["robot"]), _load, Record.label, "load", note))
    masses = [LEVEL.record(_named(o), "error of the trunk's mass", "kg", abs(o.mass_error)) for o in hyq]
    return LEVEL.result(
        [*plane, *height, *masses, *more],
        tables,
        facts={
            "Robots": ", ".join(dict.fromkeys(o.case.robot for o in outcomes)),
            "Start": f"{start_range(hyq)} on HyQ",
            "Plant": "MuJoCo, 1 kHz, controller in the loop; estimators at 200 Hz",
        },
    )


TABLE2 = LEVEL.experiment(_level_cases, stand, _level)


def _case(method: str, load: float, seed: int, robot: str = "hyq") -> StandingCase:
    return StandingCase(robot, method, load, seed=seed, height=method in LEVEL.values["height"])


def _weight(name: str) -> float | None:
    """Weight of a robot [N]; None if its model is not installed."""
    try:
        return load_robot(name).mass * GRAVITY
    except MissingExtraError:
        return None


def _named(outcome: StandingOutcome) -> dict[str, str | float]:
    case = outcome.case
    return {"robot": case.robot, "method": METHOD_NAMES[case.method], "load [N]": round(case.load, 1)}


def _method(record: Record) -> str:
    return str(record.case["method"])


def _load(record: Record) -> str:
    share = float(record.case["load, share of the weight"])
    return f"{record.case['load [N]']} N, {100 * share:.0f} % of the weight"


def _robot_records(o: StandingOutcome) -> Iterator[Record]:
    share = o.case.load / (load_robot(o.case.robot).mass * GRAVITY)
    case = {**_named(o), "load, share of the weight": round(share, 3)}
    yield LEVEL.record(case, "‖δ‖ in x-y", "cm", 100 * o.in_plane)
    yield LEVEL.record(case, "‖δ‖ in x-y at the start", "cm", 100 * o.start_error)
    yield LEVEL.record(case, "error of the trunk's mass", "kg", abs(o.mass_error))


# -- Table III --------------------------------------------------------------------------------------------------------
_START = (0.3, -0.3, 0.0)
_WORLD, _ONE_POSE = "‖δ‖ in the world's x-y, one pose", "‖δ‖ in the trunk's x-y, one pose"
_TRUNK = "‖δ‖ in the trunk's x-y, two poses"


def _ramp_cases(settings: ReproduceSettings) -> list[StandingCase]:
    """HyQ on three slopes under three loads."""
    grid = [(float(slope), load) for slope in RAMPS.values for load in _LOADS]
    return [
        StandingCase("hyq", "contact", load, slope, seed=settings.seed, start=_START)
        for slope, load in (grid[-1:] if settings.quick else grid)
    ]


def _ramps(_: Sequence[StandingCase], outcomes: Sequence[StandingOutcome]) -> ExperimentResult:
    records = [record for outcome in outcomes for record in _ramp_records(outcome)]
    return RAMPS.result(
        records,
        (
            _ramp_table(_WORLD, records, "In brackets the paper's, which does not say whose x-y it means."),
            _ramp_table(_ONE_POSE, records, "The same poses."),
            _ramp_table(_TRUNK, records, "The same runs, after the trunk has pitched."),
        ),
        facts={
            "Robot": "hyq",
            "Start": start_range(outcomes),
            "Plant": "MuJoCo, 1 kHz, controller in the loop; estimator at 200 Hz",
        },
    )


TABLE3 = RAMPS.experiment(_ramp_cases, stand, _ramps)


def _ramp_records(o: StandingOutcome) -> Iterator[Record]:
    case: dict[str, str | float] = {"slope [deg]": o.case.slope, "load [N]": o.case.load}
    paper, bound = RAMPS.values[f"{o.case.slope:g}"][_LOADS.index(o.case.load)], RAMPS.bounds["plane"]
    yield RAMPS.record(case, _WORLD, "cm", 100 * o.level, paper, bound)
    yield RAMPS.record(case, _ONE_POSE, "cm", 100 * o.in_plane_of_one_pose, paper, bound)
    yield RAMPS.record(case, _TRUNK, "cm", 100 * o.in_plane, paper, bound)
    yield RAMPS.record(case, "|δ_z| in the trunk, two poses", "cm", 100 * o.height)
    yield RAMPS.record(case, "error of the trunk's mass", "kg", abs(o.mass_error))


def _ramp_table(metric: str, records: Sequence[Record], note: str) -> TableData:
    note = f"{note} Bound: {RAMPS.bounds['plane']:.2f} cm in every cell."
    own = (record for record in records if record.metric == metric)
    return _by_load(metric, "slope, ‖δ‖ [cm]", own, lambda r: f"{r.case['slope [deg]']:g}°", note)
