"""Four short logs of two robots, quickly made, and a cluster with two workers that several tests share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import dask
import numpy as np
import pytest

from logs_to_play import Swing
from stadera.fleet.pool import _CONFIG, Pool
from stadera.lab.plant.leg import simulate_leg
from stadera.lab.plant.sensors import STANDARD
from stadera.logs import write_table
from stadera.robot import load_robot
from walking import Walk, recorded, walked


@pytest.fixture(scope="session")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder: unit1/a.parquet, unit1/b.csv, unit2/a.parquet, unit2/b.parquet; 1.5 s of a HyQ that walks."""
    folder, robot = tmp_path_factory.mktemp("logs"), load_robot("hyq")
    for k, name in enumerate(("unit1/a.parquet", "unit1/b.csv", "unit2/a.parquet", "unit2/b.parquet")):
        (folder / name).parent.mkdir(exist_ok=True)
        motion = walked(robot, Walk(seconds=1.5, rate_hz=100.0, seed=k))
        write_table(recorded(robot, motion, STANDARD, k), folder / name)
    return folder


@pytest.fixture(scope="session")
def cluster() -> Iterator[Pool]:
    """A scheduler of its own with two workers, on loopback."""
    distributed = pytest.importorskip("distributed")
    patient = {**_CONFIG, "distributed.scheduler.allowed-failures": 1}
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "silence_logs": 50}
    with dask.config.set(patient), distributed.LocalCluster(**options) as local:
        yield Pool(scheduler=local.scheduler_address)


@pytest.fixture
def swing_on_stand(tmp_path: Path) -> Path:
    """A log of a HyQ's right hind leg that swings for five seconds."""
    robot = load_robot("hyq")
    limits = [robot.limits[joint] for joint in robot.leg("RH").joints]
    middle = np.array([(limit.lower + limit.upper) / 2 for limit in limits])
    return write_table(simulate_leg(robot, "RH", Swing(middle, 5.0)), tmp_path / "swing.parquet")
