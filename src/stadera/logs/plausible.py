"""The largest value that a quantity of a walking robot can have: far above any sensor's range, far below overflow."""

from __future__ import annotations

LARGEST: dict[str, float] = {
    "position": 1e5,
    "velocity": 1e4,
    "acceleration": 1e7,
    "effort": 1e6,
    "angular_velocity": 1e4,
    "linear_acceleration": 1e6,
    "orientation": 1e3,
    "force": 1e7,
}
"""By quantity, SI units. For comparison: drives turn at 50 rad/s and give 500 N·m, MEMS sensors end at 70 rad/s and
2000 m/s². A position may have counted thousands of turns, a quaternion need not be normalised."""

ANY = 1e15
"""Of whatever else: time, contact."""


def largest_of(column: str) -> float:
    """The largest value of a column of the flat table: `<joint>.<quantity>`, `imu.<quantity>.<axis>`, ..."""
    parts = column.split(".")
    return next((LARGEST[part] for part in reversed(parts[-2:]) if part in LARGEST), ANY)
