"""A walk's rows tell the errors of the model for as long as a few strides, those of a sway for longer."""

from __future__ import annotations

import numpy as np
import pytest

from stadera import load_robot
from stadera.body import Body
from stadera.constants import GRAVITY
from stadera.trunk.segment import RowSums
from stadera.trunk.settings import SwingDetection
from stadera.trunk.swing import Lifted

GO2 = load_robot("go2")
EDGES = np.array([0, 10, 20, 30])


def paces(seed: int) -> np.ndarray:
    """Feet (30, 4, 3) that stand, of a trunk that moves, with noise of the joints' velocities [m/s]."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.5, 0.5, 3) + 0.02 * rng.standard_normal((30, 4, 3))


@pytest.mark.parametrize("seed", range(5))
def test_a_foot_that_moves_relative_to_the_others_is_a_step(seed: int) -> None:
    lifted = Lifted(Body.of(GO2), SwingDetection(), GO2.mass * GRAVITY, GO2.leg_length)
    still = paces(seed)
    assert lifted.stepping(still, EDGES).tolist() == [False, False, False]
    moving = still.copy()
    moving[10:20, 2, 0] += 0.6  # a swing of a slow walk
    assert lifted.stepping(moving, EDGES).tolist() == [False, True, False]


def test_rows_of_a_walk_return_after_a_few_strides() -> None:
    def repeats(weight: float, stepped: float) -> float:
        nothing = np.zeros((1, 1))
        return RowSums(nothing, nothing, weight, 10.0, 0.0, 200.0, 50.0, stepped).repeats

    assert repeats(40.0, 40.0) == 10.0
    assert repeats(400.0, 0.0) == 20.0
    assert repeats(400.0, 400.0) == 80.0
    assert repeats(400.0, 200.0) == 50.0
