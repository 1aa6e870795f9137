"""Real logs that come with the package, by name; `logs/data/README.md` says where they are from and their licences."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

EXAMPLES: tuple[str, ...] = ("go2_legs_in_air", "aliengo_legs_in_air", "aliengo_steps", "go2_trot")
"""Their names: a log is taken by one of these where there is no file of that name."""


def example(name: str) -> Path:
    """The file of a log that comes with the package."""
    return Path(str(resources.files("stadera.logs") / "data" / f"{name}.parquet"))
