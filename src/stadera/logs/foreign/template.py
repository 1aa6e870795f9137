"""Writes a template for a map of a log's columns, filled in as far as the columns are recognised."""

from collections.abc import Sequence
from pathlib import Path

from stadera.errors import RecordingError
from stadera.logs.columns import IMU_COLUMNS, TIME
from stadera.logs.foreign.column_map import preset_names
from stadera.logs.foreign.translate import Translation, guessed
from stadera.logs.reader import reader_of
from stadera.logs.topics import ReadOptions
from stadera.logs.units import FACTORS

_HEAD = """\
# What the columns of {log} are, for --columns. To the left the flat table's name, to the right the log's column;
# a line with the sign # in front is not read. A column with another unit or sign:
# "FL_hip_joint.effort" = {{ column = "tau_0", unit = "mNm", factor = -1.0 }}
# {{joint}} stands for any joint, {{i}} for its number in joints = ["FR_hip_joint", ...]; presets: {presets}.
{recognised}"""
_UNITS = {"time": "s", "position": "rad", "velocity": "rad/s", "effort": "Nm", "gyro": "rad/s", "accelerometer": "m/s2"}


def template(path: Path, reading: ReadOptions) -> str:
    """Text of a map of columns for a log. Raises RecordingError: not a table, or the log cannot be read."""
    reader = reader_of(path)
    header = getattr(reader, "header", None)
    if header is None:
        raise RecordingError(f"{path}: a {reader.name} has no columns and needs no map of them")
    names: tuple[str, ...] = header(path)
    found = guessed(names, reading)
    return "\n".join([_head(path, found), *_units(reading), "", "[columns]", *_lines(names, found), ""])


def _head(path: Path, found: Translation) -> str:
    nothing = "Nothing was recognised: fill in what you know."
    flat = "These are the flat table's own names: no map is needed."
    said = found.notes or (flat if any(flat.endswith(".position") for flat in found.sources) else nothing,)
    recognised = "".join(f"# {note}\n" for note in said)
    return _HEAD.format(log=path.name, presets=", ".join(preset_names()), recognised=recognised)


def _units(reading: ReadOptions) -> list[str]:
    lines = ["[units]", "# rate_hz = 200  # of the rows, where there is no column of time"]
    for quantity, si in _UNITS.items():
        unit = reading.units.of.get(quantity)
        lines.append(f'{"" if unit else "# "}{quantity} = "{unit or si}"  # {", ".join(FACTORS[quantity])}')
    return lines


def _lines(names: Sequence[str], found: Translation) -> list[str]:
    known = {flat: own for flat, own in found.sources.items() if flat == TIME or _is_of_robot(flat)}
    lines = [f"{_quoted(flat)} = {_quoted(own)}" for flat, own in known.items()]
    wanted = [TIME, "FL_hip_joint.position", "FL_hip_joint.velocity", "FL_hip_joint.effort"]
    joints = any(flat.endswith(".position") for flat in known)
    imu = [column for columns in IMU_COLUMNS.values() for column in columns]
    missing = [flat for flat in (*(wanted[:1] if joints else wanted), *imu) if flat not in known]
    lines += [f'# {_quoted(flat)} = "..."' for flat in missing]
    spare = [name for name in names if name not in known.values()]
    return [*lines, *(f"# not used: {_quoted(name)}" for name in spare)]


def _is_of_robot(flat: str) -> bool:
    return flat.startswith("imu.") or flat.rpartition(".")[-1].partition("_")[0] in ("position", "velocity", "effort")


def _quoted(name: str) -> str:
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
