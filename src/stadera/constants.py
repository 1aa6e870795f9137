"""Physical constants, each defined once."""

from __future__ import annotations

GRAVITY = 9.81
"""Magnitude of gravity [m/s²], as in the published experiments; within 0.3 % everywhere on Earth."""

SATURATED = 0.98
"""Share of a joint's effort limit above which its measured torque counts as saturated and is not used."""

SINGULAR = 0.01
"""det J of a leg's contact Jacobian, as a share of the leg's cubed length, below which the leg is singular: its torques
do not show one direction of the contact force."""

EPOCH = 1e8
"""s; later stamps count from 1970, earlier ones from a log's or a robot's own beginning."""

ROUNDING = 1e-9
"""Difference that is rounding of double precision after some thousand operations: relative to what is compared, or in
its SI unit where that is of the order of 1 (a robot's times, angles, masses and forces)."""

SAME = 1e-6
"""Relative difference below which two numbers that were rounded or computed in different ways are the same."""

NOTHING = 1e-12
"""Value below which a robot's quantity in SI units, or a share, is zero but for rounding."""
