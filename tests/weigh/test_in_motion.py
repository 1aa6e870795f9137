"""A log of a robot that walks, weighed as the command line does: which logs are quick enough."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stadera.errors import RecordingError
from stadera.lab.plant.sensors import STANDARD
from stadera.logs import write_table
from stadera.robot import load_robot
from stadera.weigh import weigh
from walking import Walk, recorded, walked

HYQ = load_robot("hyq")


def log(rate_hz: float, folder: Path) -> Path:
    walk = walked(HYQ, Walk(seconds=2.0, rate_hz=rate_hz))
    return write_table(recorded(HYQ, walk, STANDARD, 0), folder / "walk.csv")


def test_fifty_samples_a_second_are_enough(tmp_path: Path) -> None:
    """However their stamps are rounded: half of the steps are longer than 20 ms then."""
    found = weigh(HYQ, log(50.0, tmp_path)).trunk
    assert found.observed[0]
    assert abs(found.inertial.mass - HYQ.inertias[HYQ.trunk].mass) < 4.0 * np.sqrt(found.covariance[0, 0])


def test_twenty_are_not(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"20 samples a second.* 50 are needed"):
        weigh(HYQ, log(20.0, tmp_path), method="walking")
