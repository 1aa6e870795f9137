"""Physical constants, each defined once."""

from __future__ import annotations

GRAVITY = 9.81
"""Magnitude of gravity [m/s²], as in the published experiments; within 0.3 % everywhere on Earth."""

SATURATED = 0.98
"""Share of a joint's effort limit above which its measured torque counts as saturated and is not used."""
