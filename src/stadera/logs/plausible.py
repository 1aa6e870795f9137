"""Largest plausible values for a walking robot: far above any sensor's range, far below overflow."""

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
"""By quantity, SI units. For comparison: drives reach 50 rad/s and 500 N·m, MEMS sensors 70 rad/s and 2000 m/s². A
position may include thousands of turns, and a quaternion need not be normalised.
"""

ANY = 1e15
"""For all other quantities: time, contact."""


def largest_of(column: str) -> float:
    """Largest plausible value of a column of the flat table: `<joint>.<quantity>`, `imu.<quantity>.<axis>`, ..."""
    parts = column.split(".")
    return next((LARGEST[part] for part in reversed(parts[-2:]) if part in LARGEST), ANY)
