"""A log that commands of legs read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from stadera.lab.plant.leg import simulate_leg
from stadera.logs import Recording, write_table
from stadera.robot import load_robot


@dataclass(frozen=True)
class _Swing:
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray


@pytest.fixture(scope="session")
def swing() -> Recording:
    """The HyQ's RH leg swung for eight seconds at 250 Hz."""
    robot = load_robot("hyq")
    limits = [robot.limits[joint] for joint in robot.leg("RH").joints]
    middle = np.array([(limit.lower + limit.upper) / 2 for limit in limits])
    time = np.arange(0.0, 8.0, 0.004)
    speed = 2 * np.pi * np.array([0.5, 0.7, 0.9])
    angle = speed * time[:, None] + np.array([0.0, 1.0, 2.0])
    return simulate_leg(robot, "RH", _Swing(time, middle + 0.3 * np.sin(angle), 0.3 * speed * np.cos(angle)))


@pytest.fixture(scope="session")
def log(swing: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """That swing as a CSV."""
    return write_table(swing, tmp_path_factory.mktemp("log") / "swing.csv")
