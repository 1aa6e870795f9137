"""Weighs a fleet's logs into one table, on all cores or on a Dask cluster. Needs the extra `fleet`."""

from typing import TYPE_CHECKING

from stadera.lazy import lazy_names

if TYPE_CHECKING:
    from stadera.fleet.jobs import FleetOptions, LogJob, jobs_of, read_manifest
    from stadera.fleet.pool import Pool
    from stadera.fleet.run import run_fleet
    from stadera.fleet.table import FleetTable, read_fleet

__all__ = ["FleetOptions", "FleetTable", "LogJob", "Pool", "jobs_of", "read_fleet", "read_manifest", "run_fleet"]

_HOMES = {
    "jobs": "FleetOptions LogJob jobs_of read_manifest",
    "pool": "Pool",
    "run": "run_fleet",
    "table": "FleetTable read_fleet",
}

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _HOMES)
