"""Writes a template for a map of a log's columns, filled in as far as the columns are recognised."""

from pathlib import Path

from stadera.errors import RecordingError
from stadera.files import filled
from stadera.logs.columns import IMU_COLUMNS, TIME
from stadera.logs.foreign.column_map import preset_names
from stadera.logs.foreign.translate import guessed
from stadera.logs.reader import reader_of
from stadera.logs.topics import ReadOptions
from stadera.logs.units import FACTORS

_UNITS = {"time": "s", "position": "rad", "velocity": "rad/s", "effort": "Nm", "gyro": "rad/s", "accelerometer": "m/s2"}


def template(path: Path, reading: ReadOptions) -> str:
    """Text of a map of columns for a log. Raises RecordingError: not a table, or the log cannot be read."""
    reader = reader_of(path)
    header = getattr(reader, "header", None)
    if header is None:
        raise RecordingError(f"{path}: a {reader.name} has no columns and needs no map of them")
    names: tuple[str, ...] = header(path)
    found = guessed(names, reading)
    joints = any(flat.endswith(".position") for flat in found.sources)
    nothing = "Nothing was recognised: fill in what you know."
    flat_table = "These are the flat table's own names: no map is needed."
    known = {flat: own for flat, own in found.sources.items() if flat == TIME or _is_of_robot(flat)}
    wanted = [TIME, *([] if joints else [f"FL_hip_joint.{channel}" for channel in ("position", "velocity", "effort")])]
    wanted += [column for columns in IMU_COLUMNS.values() for column in columns]
    return filled(
        Path(__file__).with_name("templates") / "map.toml.j2",
        log=path.name,
        presets=preset_names(),
        notes=found.notes or (flat_table if joints else nothing,),
        units=_UNITS,
        given=reading.units.of,
        factors=FACTORS,
        known={_quoted(flat): _quoted(own) for flat, own in known.items()},
        missing=[_quoted(flat) for flat in wanted if flat not in known],
        spare=[_quoted(name) for name in names if name not in known.values()],
    )


def _is_of_robot(flat: str) -> bool:
    return flat.startswith("imu.") or flat.rpartition(".")[-1].partition("_")[0] in ("position", "velocity", "effort")


def _quoted(name: str) -> str:
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
