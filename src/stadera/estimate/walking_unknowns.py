"""What weighing in motion seeks, where it stands among the unknowns, and how little is known of it at first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stadera.estimate.square_root import SquareRoot
from stadera.estimate.walking_noise import WalkingNoise
from stadera.inertia import InertialParameters

Array = NDArray[np.float64]

THETA, OFFSETS, BIAS, LAG, SOLE, RATES = slice(0, 10), slice(10, 22), slice(22, 25), 25, 26, 27
UNKNOWNS = 28
"""The unknowns' places: ten parameters, twelve torque offsets (by leg), accelerometer bias, two lags, soles."""

ALWAYS, MODEL = 15, 60
"""How many errors are not sought: how strongly the trunk turned about three axes, and twelve torques' gains; where the
model is doubted, twelve links' masses, three components of their centres, and twelve joints' friction besides.
"""

CONSTANTS = slice(10, UNKNOWNS)


def widest(mass: float, length: float) -> Array:
    """(10,) [kg, kg·m, kg·m²]: standard deviations of a trunk that nothing is known of."""
    return mass * np.array([1.0, *[0.5 * length] * 3, *[0.5 * length**2] * 6])


def constants_of(noise: WalkingNoise) -> Array:
    """Standard deviations of what is constant over a run, in the unknowns' order."""
    std = np.empty(UNKNOWNS)
    std[OFFSETS] = noise.torque_constant.ravel()
    std[BIAS], std[LAG], std[SOLE] = noise.accelerometer_constant, noise.torque_lag, noise.sole
    std[RATES] = noise.velocity_lag
    return std[CONSTANTS]


def unknowns(start: InertialParameters, wide: Array, constants: Array, considered: int) -> SquareRoot:
    """What is known at first: the ten about the start, as wide as they can be, and the constants about zero."""
    mean = np.concatenate([start.vector, np.zeros(len(constants))])
    return SquareRoot.prior(mean, np.concatenate([wide, constants]), considered)
