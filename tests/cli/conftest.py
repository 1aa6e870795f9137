"""The command line, run in this process: what it prints, and its exit code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from stadera.cli import main
from stadera.lab.plant.leg import simulate_leg
from stadera.logs import Recording, write_table
from stadera.robot import load_robot


@dataclass(frozen=True)
class Finished:
    code: int
    out: str
    err: str


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., Finished]:
    def _run(*arguments: object) -> Finished:
        with pytest.raises(SystemExit) as exit_info:
            main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Finished(int(exit_info.value.code or 0), captured.out, captured.err)

    return _run


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
