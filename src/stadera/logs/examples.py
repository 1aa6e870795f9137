"""Real logs included in the package, by name; `logs/data/README.md` states their sources and licences."""

from importlib import resources
from pathlib import Path

EXAMPLES: tuple[str, ...] = ("go2_legs_in_air", "aliengo_legs_in_air", "aliengo_steps", "go2_trot")
"""Their names, which are accepted as logs if no file has that name."""


def example(name: str) -> Path:
    """Path of a log included in the package."""
    return Path(str(resources.files("stadera.logs") / "data" / f"{name}.parquet"))
