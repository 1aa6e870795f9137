"""A load in a humanoid's hand that comes some time after the tare, lost in the bars of what its legs tell."""

from __future__ import annotations

import numpy as np
import pytest

from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.robot import load_robot
from stadera.weigh import weigh

LOADED = 3.0  # s


@pytest.fixture(scope="module")
def settings() -> SimulateSettings:
    load = Load(2.0, "kg", (0.0, 0.0, 0.0), on="left_rubber_hand")
    return SimulateSettings("real", load, duration=6.5, rate=200.0, seed=3, load_time=LOADED, arms=0.3)


def test_what_only_the_arm_feels_is_a_change(settings: SimulateSettings) -> None:
    """The arm's joints rub with 3 to 8 % of their limits. Taken for a load since the tare, it would be a tenth lighter
    and its centre a decimetre higher, by ten standard deviations.
    """
    robot = load_robot("g1")
    made = simulate(robot, "shake", settings)
    found = weigh(robot, made.recording, (0.0, LOADED - 0.5))
    payload, true = found.payload, made.truth.moments[-1]
    assert payload is not None
    assert payload.at == "left_wrist_yaw_link"
    assert repr(payload).endswith("at and in the frame of left_wrist_yaw_link")
    assert abs(payload.mass - true.payload_mass) < 3.0 * payload.mass_std
    np.testing.assert_array_less(np.abs(payload.com - [0.0415, 0.003, 0.0]), 3.0 * payload.com_std)
    assert [change.at for change in found.changes][-1] == payload.at
    assert abs(found.changes[-1].time - LOADED) < 0.7
