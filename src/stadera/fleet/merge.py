"""Merges the legs of each robot of a fleet from all of its logs, using the table only: no log is read again."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from stadera.errors import StaderaError
from stadera.fleet.jobs import LogJob
from stadera.fleet.table import FleetTable
from stadera.identify.merge import MergedLegs, merge_legs
from stadera.information import Information, Unknowns


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
    """Converts a row of `LEGS`."""
    R, z = np.array(row["R"], dtype=float), np.array(row["z"], dtype=float)
    unknowns, n = Unknowns.scalars(row["columns"]), len(z)
    return Information(unknowns, R.reshape(n, n), z, np.zeros((n, 0)), row["cost"], row["count"])
