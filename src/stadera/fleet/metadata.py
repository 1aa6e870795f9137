"""Reads the robot's name from a log's own metadata.

A Parquet table has it under the key "robot" of its metadata; a rosbag2 folder in its metadata.yaml, as written by `ros2
bag record --custom-data robot=go2`.
"""

import re
from pathlib import Path

from stadera.errors import RecordingError

KEY = "robot"
_CUSTOM = re.compile(r"^\s+" + KEY + r":\s*['\"]?([^'\"\s]+)['\"]?\s*$", re.MULTILINE)


def robot_named_in(path: Path) -> str:
    """The robot's name, or its model file's path. Raises RecordingError: the log does not name it."""
    named = _of_bag(path) if path.is_dir() else _of_table(path)
    if not named:
        raise RecordingError(
            f"{path}: which robot's log it is, its metadata do not say: name it by --robot, or in a manifest"
        )
    return named


def _of_table(path: Path) -> str | None:
    import pyarrow as pa
    from pyarrow import parquet

    try:
        metadata = parquet.read_schema(path).metadata or {}
    except (pa.ArrowException, OSError, ValueError):
        return None
    return metadata.get(KEY.encode(), b"").decode() or None


def _of_bag(path: Path) -> str | None:
    listed = path / "metadata.yaml"
    if not listed.is_file():
        return None
    _, _, custom = listed.read_text(encoding="utf-8").partition("custom_data:")
    found = _CUSTOM.search(custom)
    return found and found[1]
