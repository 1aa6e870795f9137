"""Fig. 5: torques of real legs, predicted by the identified parameters, by CAD and by CAD with friction.

The paper's HyQ logs are not public; these are a Unitree Go2 and an Aliengo on a stand, with legs in the air. Everything
is identified on the first half of a log and evaluated on the second.
"""

from __future__ import annotations

from stadera.identify.legs import identify
from stadera.identify.result import MODELS, Identification
from stadera.lab.experiments.legs.real_logs import real_log
from stadera.lab.experiments.legs.recovery import impossible_links
from stadera.lab.experiments.legs.torques import rmse_records, rmse_table, torque_figure
from stadera.lab.experiments.paper import Paper, ReproduceSettings, Steps
from stadera.lab.experiments.result import ExperimentResult, Record
from stadera.robot import load_robot
from stadera.types import Progress

PAPER = Paper.of("fig5")

_LOGS = {"go2": "go2_legs_in_air", "aliengo": "aliengo_legs_in_air"}
_LEG = "RF"  # the paper's


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """Identifies all legs of both robots."""
    step = Steps(PAPER.name, progress)
    logs = {robot: real_log(name, settings.data) for robot, name in _LOGS.items()}
    results = {}
    for robot, log in logs.items():
        step(f"identifying {robot}")
        results[robot] = identify(load_robot(robot), [log])
    step.finished()
    legs = [(robot, leg) for robot, result in results.items() for leg in result.legs]
    legs.sort(key=lambda pair: pair[1].leg.name != _LEG)  # the paper's leg of each robot first
    return PAPER.result(
        records=tuple(record for robot, result in results.items() for record in _records(robot, result)),
        tables=tuple(
            rmse_table(result, f"{robot}: torque RMSE", f"On {result.validated_on}, not used to identify.", MODELS)
            for robot, result in results.items()
        ),
        figures=tuple(
            torque_figure(
                leg, f"{robot}, leg {leg.leg.name}", "The held-out half of the log, its first minute.", MODELS
            )
            for robot, leg in legs
        ),
        facts={"Logs": ", ".join(path.name for path in logs.values()), "Identified on": "the first half of each"},
    )


def _records(robot: str, result: Identification) -> list[Record]:
    records = [r for leg in result.legs for r in rmse_records(PAPER, {"robot": robot}, leg, "prior_friction")]
    for leg in result.legs:
        case = {"robot": robot, "leg": leg.leg.name}
        records.append(PAPER.record(case, "links that no real body could be", "1", impossible_links(leg), bound=0.0))
    return records
