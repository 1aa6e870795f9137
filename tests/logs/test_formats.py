"""One walk of a Go2 with a load, in the formats of others: the same signals, the same payload."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from log_formats import FORMATS, Written
from stadera.identify.legs import identify
from stadera.identify.result import Identification
from stadera.identify.settings import IdentifySettings
from stadera.inertia import InertialParameters
from stadera.lab.plant.sensors import STANDARD
from stadera.logs import LogFile, Recording, Topics, read, take
from stadera.logs.topics import ReadOptions
from stadera.robot import load_robot
from stadera.weigh import weigh
from walking import Walk, recorded, walked

LOAD = InertialParameters.from_com(4.0, [0.05, 0.02, 0.12], 0.02 * np.eye(3))
SINGLE, EXACT = 1e-6, 1e-9  # of float32 near 10, and of PlotJuggler's 9 decimals


@pytest.fixture(scope="module")
def walk() -> Recording:
    robot = load_robot("go2")
    motion = walked(robot, Walk(seconds=3.2, rate_hz=250.0, load=LOAD, loaded_at=1.6))
    return recorded(robot, motion, STANDARD, 0)


def log_of(written: Written) -> LogFile:
    said = dict(zip(written.options[::2], written.options[1::2], strict=True))
    return LogFile(written.path, Topics(), ReadOptions.of(said.get("--columns"), said.get("--units")))


@pytest.mark.parametrize("name", [name for name in FORMATS if "apart" not in name])
def test_every_format_has_the_same_signals(name: str, walk: Recording, tmp_path: Path) -> None:
    back = read(log_of(FORMATS[name](walk, tmp_path)), joints=walk.joints, require=("effort", "imu"))
    assert len(back) == len(walk)
    np.testing.assert_allclose(back.time - back.time[0], walk.time - walk.time[0], rtol=0, atol=5e-7)
    tolerance = SINGLE if "LowState" in name else EXACT
    assert back.imu is not None
    assert walk.imu is not None
    for channel in ("position", "velocity", "effort"):
        np.testing.assert_allclose(getattr(back, channel), getattr(walk, channel), rtol=2e-7, atol=tolerance)
    for quantity in ("angular_velocity", "linear_acceleration"):
        np.testing.assert_allclose(getattr(back.imu, quantity), getattr(walk.imu, quantity), rtol=2e-7, atol=tolerance)


def test_every_format_weighs_the_same_payload(walk: Recording, tmp_path: Path) -> None:
    """Of the formats that differ from the table in more than rounding; the others give bit for bit what it gives."""
    robot = load_robot("go2")

    def payload(log: LogFile | Recording) -> float:
        start = float(read(log, joints=walk.joints).time[0])
        found = weigh(robot, log, (start, start + 1.398)).payload  # between two samples
        assert found is not None
        return found.mass

    expected = payload(walk)
    assert expected == pytest.approx(4.0, abs=0.5)
    for name, tolerance in (("LowState, MCAP", 0.01), ("PlotJuggler, IMU apart", 0.03)):
        # an IMU interpolated twice is less noisy
        assert payload(log_of(FORMATS[name](walk, tmp_path))) == pytest.approx(expected, abs=tolerance)


def test_real_legs_are_identified_the_same_from_every_format(shared_data: Path) -> None:
    """Five seconds of a Go2 in the air; LowState is of single precision."""
    folder = shared_data / "real"
    settings = IdentifySettings(legs=("LF",))

    def found(log: Recording | Path) -> Identification:
        return identify("go2", [log], settings)

    table = found(take(read(folder / "go2_legs_in_air.csv"), slice(0, 1000)))
    expected = table.legs[0].estimate
    bars = np.sqrt(np.diag(expected.covariance))
    known = bars > 0.0
    for name, tolerance in (("jointstate_ros1.bag", 1e-4), ("lowstate_mcap", 1e-3)):  # in bars: stamps differ by 0.2 us
        other = found(folder / "formats" / f"go2_legs_in_air_{name}")
        off = np.abs(other.legs[0].estimate.values - expected.values)
        assert (off[known] < tolerance * bars[known]).all()
        assert (off[~known] == 0.0).all()
        assert other.torque_lag == pytest.approx(table.torque_lag, abs=1e-6)
        assert other.trust.misfit == pytest.approx(table.trust.misfit, abs=tolerance)
