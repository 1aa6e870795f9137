"""Weighs arrays of one's own, and the same sample by sample; writes a figure, JSON and the headline."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np

import stadera


def main() -> None:
    with Path("walk.csv").open(newline="") as file:
        names, *rows = csv.reader(file)
    table = dict(zip(names, np.array(rows, dtype=float).T, strict=True))
    joints = [name.removesuffix(".position") for name in names if name.endswith(".position")]
    position, velocity, effort = (stacked(table, f"{{}}.{kind}", joints) for kind in ("position", "velocity", "effort"))
    gyro, force = (stacked(table, f"imu.{kind}.{{}}", "xyz") for kind in ("angular_velocity", "linear_acceleration"))
    log = stadera.Recording.from_arrays(
        table["time"], position, velocity=velocity, effort=effort, joints=joints, imu=stadera.Imu(gyro, force)
    )
    result = stadera.weigh("robot.urdf", log, tare=(0.0, 2.5))
    result.save_json("arrays.json")
    result.save_figure("payload.pdf", "payload")
    estimator = stadera.TrunkEstimator("robot.urdf", joints=joints)
    for k, time in enumerate(table["time"]):
        estimator.update(time, position[k], velocity[k], effort[k], gyro[k], force[k])
        if estimator.payload is None and time >= 2.5:
            estimator.tare()
    assert estimator.payload is not None
    online = {"mass": estimator.payload.mass, "std": estimator.payload.mass_std}
    Path("online.json").write_text(json.dumps(online))


def stacked(table: dict[str, np.ndarray], pattern: str, names: Iterable[str]) -> np.ndarray:
    """Columns (samples, names) by the pattern of their names."""
    return np.column_stack([table[pattern.format(name)] for name in names])


if __name__ == "__main__":
    main()
