"""Weighs a fleet's logs into one table, on all cores or on a Dask cluster. Needs the extra `fleet`."""

from typing import TYPE_CHECKING

from stadera.lazy import lazy_names

if TYPE_CHECKING:
    from stadera.fleet.jobs import FleetOptions as FleetOptions
    from stadera.fleet.jobs import LogJob as LogJob
    from stadera.fleet.jobs import jobs_of as jobs_of
    from stadera.fleet.jobs import read_manifest as read_manifest
    from stadera.fleet.pool import Pool as Pool
    from stadera.fleet.run import run_fleet as run_fleet
    from stadera.fleet.table import FleetTable as FleetTable
    from stadera.fleet.table import read_fleet as read_fleet

if not TYPE_CHECKING:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
