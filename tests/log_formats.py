"""One recording in the formats of others, as their tools write them."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow import csv as pacsv
from scipy import io

from bags import low_state, of_recording, write_folder, write_mcap, write_ros1
from stadera.logs import Recording, write_table
from stadera.logs.bags.unitree import MOTORS
from stadera.logs.frames import columns_of

Rows = list[list[float | str]]


class Written(NamedTuple):
    """A log, and the options that it needs."""

    path: Path
    options: tuple[str, ...] = ()


def low_states(recording: Recording) -> list[Any]:
    """LowState, 12 motors in Unitree's order, its tick in ms."""
    assert recording.velocity is not None
    assert recording.effort is not None
    assert recording.imu is not None
    order = [recording.joints.index(motor) for motor in MOTORS]
    made = []
    for k, time in enumerate(recording.time):
        values = (channel[k, order] for channel in (recording.position, recording.velocity, recording.effort))
        unit = (recording.imu.angular_velocity[k], recording.imu.linear_acceleration[k])
        made.append(low_state(1.7e9 + float(time), *values, tick=round(1e3 * float(time)), imu=unit))
    return made


def plotjuggler(recording: Recording, path: Path, imu_late: float = 0.0) -> Path:
    """As its CSV exporter does: series sorted by name, stamps with 6 decimals, values with 9, a row for each stamp.

    Args:
        imu_late: of the IMU's stamps after the joints' [s]; not 0: rows of their own, at values interpolated there.
    """
    assert recording.imu is not None
    columns = columns_of(recording)
    series: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for name, values in columns.items():
        if name == "time":
            continue
        owner, _, channel = name.rpartition(".")
        if owner.startswith("imu"):
            time = recording.time + imu_late
            series[f"/imu/data/{owner.removeprefix('imu.')}/{channel}"] = time, np.interp(time, recording.time, values)
        else:
            series[f"/joint_states/{owner}/{channel}"] = recording.time, values
    series["/joint_states/header/stamp"] = recording.time, recording.time
    rows: dict[str, dict[str, str]] = {}
    for name, (time, values) in series.items():
        for stamp, value in zip(time, values, strict=True):
            rows.setdefault(f"{1.7e9 + stamp:.6f}", {})[name] = f"{value:.9f}"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, ["__time", *sorted(series)], restval="")
        writer.writeheader()
        writer.writerows({"__time": stamp} | rows[stamp] for stamp in sorted(rows))
    return path


def own_names(recording: Recording, path: Path) -> tuple[Path, Path]:
    """A table whose names say nothing, the hips' torques with the other sign, and the map of them."""
    columns, lines = columns_of(recording), []
    table = {}
    for k, (name, values) in enumerate(columns.items()):
        flipped = name.endswith("hip_joint.effort")
        table[f"col {k}"] = -values if flipped else values
        source = f'{{ column = "col {k}", factor = -1 }}' if flipped else f'"col {k}"'
        lines.append(f'"{name}" = {source}')
    path.with_suffix(".toml").write_text("[columns]\n" + "\n".join(lines) + "\n")
    pacsv.write_csv(pa.table(table), path)
    return path, path.with_suffix(".toml")


def in_other_units(recording: Recording, path: Path) -> Path:
    """Degrees, milliseconds and g."""
    table = dict(columns_of(recording))
    for name, values in table.items():
        factor = 1e3 if name == "time" else 1.0
        if name.endswith((".position", ".velocity")) or "angular" in name:
            factor = 180.0 / np.pi
        elif "linear" in name:
            factor = 1.0 / 9.80665
        table[name] = values * factor
    pacsv.write_csv(pa.table(table), path)
    return path


def arrays_of(recording: Recording) -> dict[str, Any]:
    """For npz and mat: whole arrays, and the joints' names."""
    return {**recording.arrays(), "joints": list(recording.joints)}


def mat(recording: Recording, path: Path) -> Path:
    """As MATLAB has it: a struct for the IMU, a cell array of the joints' names, a column of stamps."""
    arrays = arrays_of(recording)
    unit = {name.removeprefix("imu."): arrays.pop(name) for name in list(arrays) if name.startswith("imu.")}
    joints = np.array(arrays.pop("joints"), dtype=object)
    io.savemat(path, {**arrays, "imu": unit, "joints": joints}, oned_as="column")
    return path


def npz(recording: Recording, path: Path) -> Path:
    np.savez_compressed(path, **arrays_of(recording))
    return path


def packed(recording: Recording, path: Path) -> Path:
    """The flat table in gzip."""
    plain = write_table(recording, path.with_suffix(""))
    with pa.OSFile(str(path), "wb") as raw, pa.CompressedOutputStream(raw, "gzip") as out:
        out.write(plain.read_bytes())
    plain.unlink()
    return path


def _own_names(recording: Recording, folder: Path) -> Written:
    path, given = own_names(recording, folder / "own.csv")
    return Written(path, ("--columns", str(given)))


FORMATS: dict[str, Callable[[Recording, Path], Written]] = {
    "LowState, MCAP": lambda r, folder: Written(write_mcap(low_states(r), folder / "low.mcap")),
    "LowState, sqlite3": lambda r, folder: Written(write_folder(low_states(r), folder / "low")),
    "JointState, MCAP": lambda r, folder: Written(write_mcap(of_recording(r), folder / "joint.mcap")),
    "JointState, sqlite3": lambda r, folder: Written(write_folder(of_recording(r), folder / "joint")),
    "ROS 1": lambda r, folder: Written(write_ros1(of_recording(r), folder / "ros1.bag")),
    "PlotJuggler": lambda r, folder: Written(plotjuggler(r, folder / "pj.csv")),
    "PlotJuggler, IMU apart": lambda r, folder: Written(plotjuggler(r, folder / "apart.csv", 0.0007)),
    "own names": _own_names,
    "degrees and ms": lambda r, folder: Written(in_other_units(r, folder / "deg.csv"), ("--units", "deg,deg/s,ms,g")),
    "csv.gz": lambda r, folder: Written(packed(r, folder / "log.csv.gz")),
    "npz": lambda r, folder: Written(npz(r, folder / "log.npz")),
    "mat": lambda r, folder: Written(mat(r, folder / "log.mat")),
}
