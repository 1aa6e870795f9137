"""Merges the legs of one robot from several logs: each log's information is summed up separately, then solved jointly.

Links, rotor inertias and friction belong to the robot; torque offsets change from day to day, so each log's are
eliminated from its information first (`Information.marginal`). The remainders are merged (`Information.merge`), by the
triangle of

    [R_1 z_1; R_2 z_2; ...]

which equals one pass over the rows of all logs with separate offsets for each. No log is read again, and each log is
weighted by its own noise.

Contradictions between logs show in the merged fit. With x̂ the least-squares solution, merging adds the cost

    Δ = Σ_k (|R_k x̂ - z_k|² - min_x |R_k x - z_k|²),      expected: the ranks of all logs less the rank of all together

which has this expectation if one robot explains all logs. If Δ is larger, the noise is multiplied by the square root of
the ratio, so that the error bars reflect the differences between logs; if it is much larger, the result is doubtful.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from stadera.errors import IdentificationError, StaderaError
from stadera.fleet.jobs import LogJob
from stadera.fleet.table import FleetTable
from stadera.identify.job import LegTask
from stadera.identify.prior import robot_prior
from stadera.identify.result import LegIdentification
from stadera.identify.schema import UNITS, joints_dict, links_dict
from stadera.identify.settings import IdentifySettings
from stadera.identify.solutions import solve_legs, with_scale
from stadera.information import Information, Unknowns
from stadera.robot.model import Robot
from stadera.trust import Trust

_DAILY = "offset"


@dataclass(frozen=True, eq=False)
class MergedLegs:
    """Legs of one robot, merged from all of its logs."""

    robot: Robot  # the prior model
    logs: tuple[str, ...]  # names, in order
    # one entry each; without offsets, residuals and traces, which belong to a single log
    legs: tuple[LegIdentification, ...]
    trust: Trust  # the misfit is Δ divided by its expectation, 1 if one robot explains all logs

    def to_dict(self) -> dict[str, Any]:
        """Plain values as from `identify`, for `weigh --legs`: robot, source, logs, method, trust, links, joints."""
        mark = {"trusted": False} if self.trust.verdict == "bad" else {}
        return {
            "robot": self.robot.name,
            "source": f"{len(self.logs)} log{'s' * (len(self.logs) != 1)}",
            "logs": list(self.logs),
            "method": self.legs[0].estimate.method,
            "trust": self.trust.to_dict(),
            "links": links_dict(self.legs, mark),
            "joints": joints_dict(self.legs, mark),
            "units": dict(UNITS),
        }


def merge_legs(
    robot: Robot, logs: Mapping[str, Mapping[str, Information]], settings: IdentifySettings | None = None
) -> MergedLegs:
    """Merges the information of several logs, by name and by leg, on the legs of one robot, whose model is the prior;
    its rows are in units of their noise, see `LegIdentification.information`. Raises IdentificationError: no logs, or
    no leg in any of them. UnknownNameError: a log belongs to another robot.
    """
    settings = settings or IdentifySettings()
    tasks = [LegTask.of(robot, leg, settings) for leg in robot.legs if any(leg.name in log for log in logs.values())]
    if not tasks:
        raise IdentificationError("no leg was identified from any log, so there is nothing to merge")
    fits = [
        _Fit.of(robot, task, [log[task.leg.name] for log in logs.values() if task.leg.name in log]) for task in tasks
    ]
    priors = [robot_prior(robot, fit.total.names, settings.width) for fit in fits]
    informations = [with_scale(fit.widened(), settings.width.gain) for fit in fits]
    asked = [(task.leg, known, prior) for task, known, prior in zip(tasks, informations, priors, strict=True)]
    estimates = solve_legs(asked, settings.method, settings.spread, settings.solver, lambda *_: None)
    legs = tuple(
        LegIdentification(
            task.leg, task.nominal, estimate, structural_rank=estimate.observability.rank, information=fit.total
        )
        for task, fit, estimate in zip(tasks, fits, estimates, strict=True)
    )
    return MergedLegs(robot, tuple(logs), legs, _trust(tasks, fits, settings))


@dataclass(frozen=True, eq=False)
class _Fit:
    """One leg's merged information, and the misfit between the logs (1 if they agree)."""

    total: Information
    misfit: float

    @classmethod
    def of(cls, robot: Robot, task: LegTask, logs: Sequence[Information]) -> _Fit:
        columns = tuple(name for name in task.prior.columns if name.rpartition(".")[2] != _DAILY)
        alone = [log.marginal(columns) for log in logs]
        total = reduce(Information.merge, alone, Information.empty(columns))
        added = _least_cost(total) - sum(map(_least_cost, alone))
        freedom = sum(log.rank() for log in alone) - total.rank()
        return cls(total, added / freedom if freedom > 0 else 1.0)

    def widened(self) -> Information:
        return self.total.scaled_noise(float(np.sqrt(max(1.0, self.misfit))))


def _least_cost(information: Information) -> float:
    """min |R x - z|² + ρ², also if R is singular."""
    return information.residual_squared(np.array(list(information.least_squares().values())))


def _trust(tasks: Sequence[LegTask], fits: Sequence[_Fit], settings: IdentifySettings) -> Trust:
    by_leg = {task.leg.name: fit.misfit for task, fit in zip(tasks, fits, strict=True)}
    reasons = tuple(
        f"leg {name}: the logs differ {np.sqrt(misfit):.2g} times as much as their noise allows: another robot's log, "
        f"a part that was changed, or wear"
        for name, misfit in by_leg.items()
        if misfit > settings.trust.doubtful
    )
    return Trust("doubtful" if reasons else "good", float(np.mean(list(by_leg.values()))), by_leg, reasons)


def merge_fleet(table: FleetTable, jobs: Iterable[LogJob]) -> dict[str, MergedLegs]:
    """Merges the legs of each robot, by its name in the table, of the jobs' logs. Raises StaderaError: a robot has no
    usable log, or logs with several models.
    """
    of_log = {row["log"]: row["robot"] for row in table.rows if row["status"] == "ok"}
    first: dict[str, LogJob] = {}
    logs: dict[str, dict[str, dict[str, Information]]] = {}
    for job in jobs:
        if job.log not in of_log:
            continue
        robot = of_log[job.log]
        models = {first.setdefault(robot, job).robot or robot, job.robot or robot}
        if len(models) > 1:
            raise StaderaError(f"{robot}: logs of several models cannot be merged: {', '.join(sorted(models))}")
        logs.setdefault(robot, {})[job.log] = {}
    for row in table.legs:
        if row["log"] in logs.get(row["robot"], {}):
            logs[row["robot"]][row["log"]][row["leg"]] = _information(row)
    if not logs:
        raise StaderaError("no log from which legs were identified, so there is nothing to merge")
    return {robot: merge_legs(first[robot].model(robot), own) for robot, own in logs.items()}


def _information(row: dict[str, Any]) -> Information:
    R, z = np.array(row["R"], dtype=float), np.array(row["z"], dtype=float)
    unknowns, n = Unknowns.scalars(row["columns"]), len(z)
    G = np.array(row.get("G") or (), dtype=float).reshape(n, -1)
    return Information(unknowns, R.reshape(n, n), z, G, row["cost"], row["count"])
