"""Joints that are held between readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera import identify
from stadera.identify.settings import IdentifySettings
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import swing
from stadera.logs.recording import Recording, take
from stadera.logs.stamps import without_repeats
from stadera.robot import load_robot

JOINTS = ("a", "b", "c")


def log(count: int = 600, rate: float = 500.0) -> Recording:
    rng = np.random.default_rng(0)
    return Recording(
        np.arange(count) / rate, JOINTS, *rng.standard_normal((2, count, 3)), effort=rng.random((count, 3))
    )


def held(plain: Recording, times: int) -> Recording:
    """Joints that are read every so many samples."""
    at = np.arange(len(plain)) // times * times
    channels = {name: getattr(plain, name)[at] for name in ("position", "velocity", "effort")}
    return replace(plain, **channels)


@pytest.mark.parametrize("times", [2, 5])
@pytest.mark.parametrize("rows", [100, 600])
def test_what_is_left_are_the_readings(times: int, rows: int) -> None:
    plain = log()
    whole = held(plain, times)
    parts = list(without_repeats([take(whole, slice(begin, begin + rows)) for begin in range(0, len(whole), rows)]))
    np.testing.assert_array_equal(np.concatenate([part.time for part in parts]), plain.time[::times])
    np.testing.assert_array_equal(np.concatenate([part.effort for part in parts]), plain.effort[::times])  # type: ignore[index,type-var,misc]
    assert [len(part.notes) for part in parts] == [1] + [0] * (len(parts) - 1)


def test_joints_at_rest_and_single_repeats_stay() -> None:
    plain = log()
    assert next(without_repeats([plain])) is plain
    at = np.arange(600) // 100
    rest = replace(plain, **{name: getattr(plain, name)[at] for name in ("position", "velocity", "effort")})
    assert next(without_repeats([rest])) is rest
    some = held(plain, 2)
    every = np.arange(600) % 20 == 1
    names = ("position", "velocity", "effort")
    few = replace(plain, **{c: np.where(every[:, None], getattr(some, c), getattr(plain, c)) for c in names})
    assert next(without_repeats([few])) is few
    blind = replace(held(plain, 2), effort=None)
    assert next(without_repeats([blind])) is blind


def test_drives_are_identified_from_joints_that_are_held() -> None:
    """Without their repeats left out the fit is nine times worse than the noise, and rotors are lost."""
    robot = load_robot("go2")
    run = swing(robot, "LF", SimulateSettings(errors="standard", seed=3, duration=8.0, rate=500.0))
    found = identify(robot, held(run.recording, 3), IdentifySettings(legs=("LF",)))
    assert found.trust.verdict == "good"
