"""Table II: the three methods on level ground, ideal sensors, three loads; and the same on other robots."""

from collections.abc import Iterator, Sequence

from stadera.constants import GRAVITY
from stadera.errors import MissingExtraError
from stadera.lab.experiments.runner import ExperimentResult, Paper, Record, ReproduceSettings, crossed
from stadera.lab.experiments.standing import METHOD_NAMES, StandingCase, StandingOutcome, stand, start_range
from stadera.report.table import TableData
from stadera.robot import load_robot

PAPER = Paper.of("table2")

_LOADS = (0.0, 50.0, 100.0)  # N, the paper's
_OTHERS, _SHARES = ("go2", "anymal_c", "b1"), (0.0, 0.06, 0.12)


def cases(settings: ReproduceSettings) -> list[StandingCase]:
    """HyQ with every method and load, and other robots with (c), their loads as shares of their weights."""
    seed = settings.seed
    if settings.quick:
        return [_case("contact", 100.0, seed)]
    weights = {name: weight for name in _OTHERS if (weight := _weight(name)) is not None}
    return [
        *(_case(method, load, seed) for method in PAPER.values["plane"] for load in _LOADS),
        *(_case("contact", share * weight, seed, name) for name, weight in weights.items() for share in _SHARES),
    ]


def summary(_: Sequence[StandingCase], outcomes: Sequence[StandingOutcome]) -> ExperimentResult:
    hyq = [o for o in outcomes if o.case.robot == "hyq"]
    others = [o for o in outcomes if o.case.robot != "hyq"]
    plane, height, values, bounds = list[Record](), list[Record](), PAPER.values, PAPER.bounds
    for o in hyq:
        paper = values["plane"][o.case.method][_LOADS.index(o.case.load)]
        plane.append(PAPER.record(_named(o), "‖δ‖ in x-y", "cm", 100 * o.in_plane, paper, bounds["plane"]))
        if o.case.height:
            paper = values["height"][o.case.method]
            height.append(PAPER.record(_named(o), "|δ_z|", "cm", 100 * o.height, paper, bounds["height"]))
    note = f"In brackets the paper's. Bound: {bounds['plane']:.2f} cm in every cell."
    tables = [_table("Error in x-y", "‖δ‖ [cm]", plane, note)]
    if height:
        note = f"In brackets the paper's, which names one figure a method. Bound: {bounds['height']:.1f} cm."
        tables.append(_table("Error of the height", "|δ_z| [cm]", height, note))
    more = [record for o in others for record in _robot_records(o)]
    if more:
        note = "Method (c). The load presses at HyQ's point, scaled with the distances between the hips."
        tables.append(crossed("Other robots", more, lambda r: str(r.case["robot"]), _load, Record.label, "load", note))
    masses = [PAPER.record(_named(o), "error of the trunk's mass", "kg", abs(o.mass_error)) for o in hyq]
    return PAPER.result(
        [*plane, *height, *masses, *more],
        tables,
        facts={
            "Robots": ", ".join(dict.fromkeys(o.case.robot for o in outcomes)),
            "Start": f"{start_range(hyq)} on HyQ",
            "Plant": "MuJoCo, 1 kHz, controller in the loop; estimators at 200 Hz",
        },
    )


EXPERIMENT = PAPER.experiment(cases, stand, summary)


def _case(method: str, load: float, seed: int, robot: str = "hyq") -> StandingCase:
    return StandingCase(robot, method, load, seed=seed, height=method in PAPER.values["height"])


def _weight(name: str) -> float | None:
    """Weight of a robot [N]; None if its model is not installed."""
    try:
        return load_robot(name).mass * GRAVITY
    except MissingExtraError:
        return None


def _named(outcome: StandingOutcome) -> dict[str, str | float]:
    case = outcome.case
    return {"robot": case.robot, "method": METHOD_NAMES[case.method], "load [N]": round(case.load, 1)}


def _load(record: Record) -> str:
    share = float(record.case["load, share of the weight"])
    return f"{record.case['load [N]']} N, {100 * share:.0f} % of the weight"


def _robot_records(o: StandingOutcome) -> Iterator[Record]:
    share = o.case.load / (load_robot(o.case.robot).mass * GRAVITY)
    case = {**_named(o), "load, share of the weight": round(share, 3)}
    yield PAPER.record(case, "‖δ‖ in x-y", "cm", 100 * o.in_plane)
    yield PAPER.record(case, "‖δ‖ in x-y at the start", "cm", 100 * o.start_error)
    yield PAPER.record(case, "error of the trunk's mass", "kg", abs(o.mass_error))


def _table(title: str, error: str, records: list[Record], note: str) -> TableData:
    return crossed(
        title,
        records,
        group=lambda r: "",
        row=lambda r: str(r.case["method"]),
        column=lambda r: f"{r.case['load [N]']:g} N",
        corner=error,
        note=note,
    )
