"""Physical constants, each defined once."""

GRAVITY = 9.81
"""Magnitude of gravity [m/s²], as in the published experiments; within 0.3 % everywhere on Earth."""

SATURATED = 0.98
"""Share of a joint's effort limit above which its measured torque counts as saturated and is not used."""

SINGULAR = 0.01
"""det J of a leg's contact Jacobian, as a share of the leg's cubed length, below which the leg is near-singular: its
torques do not determine one direction of the contact force.
"""

MEDIAN_OF_CHI2 = 0.455
"""Median of χ² with one degree of freedom: of the square of a Gaussian number of unit variance."""

DAY = 86400.0
"""Length of a day [s]."""

EPOCH = 1e8
"""Stamps above this [s] count from 1970, smaller ones from the start of the log or of the robot."""

ROUNDING = 1e-9
"""Rounding error in double precision after some thousand operations: relative to the compared values, or in SI units
for values of the order of 1 (a robot's times, angles, masses and forces).
"""

SAME = 1e-6
"""Relative difference below which two numbers that were rounded or computed differently are equal."""

NOTHING = 1e-12
"""Magnitude below which a quantity in SI units, or a share, is zero except for rounding."""
