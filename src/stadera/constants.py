"""Physical constants, each defined once."""

from __future__ import annotations

GRAVITY = 9.81
"""m/s², the magnitude of gravity: what the published experiments use, within 0.3 % of it anywhere on Earth."""

SATURATED = 0.98
"""Share of a joint's effort limit from which its torque counts as saturated, hence not as measured."""
