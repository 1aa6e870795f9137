"""What stands out in a fleet is found, and little else."""

from __future__ import annotations

import numpy as np
import pytest

from stadera.fleet.departures import FleetSeries, departures, looks_at, scatter

RNG = np.random.default_rng


def series(value: np.ndarray, std: np.ndarray, robot: str = "a") -> FleetSeries:
    return FleetSeries(robot, "trunk mass", "kg", None, value, std, ({},) * len(value), np.arange(1, len(value) + 1))


def steady(seed: int, n: int, kappa: float = 1.0, common: float = 0.0) -> FleetSeries:
    """Nothing happens: errors `kappa` times as large as their bars say, besides one that all logs have in common."""
    rng = RNG(seed)
    std = rng.uniform(0.7, 1.4, n)
    return series(10.0 + common + kappa * std * rng.standard_normal(n), std, f"robot{seed}")


@pytest.mark.parametrize(("kappa", "n"), [(0.1, 10), (1.0, 4), (1.0, 12), (1.0, 50)])
def test_nothing_is_reported_of_a_fleet_in_which_nothing_happens(kappa: float, n: int) -> None:
    """120 fleets of 4 robots: at a chance of 5 % each, 6 are expected at most; P(more than 13) is 0.4 %."""
    reported = 0
    for fleet in range(120):
        reported += bool(departures([steady(4 * fleet + k, n, kappa) for k in range(4)], chance=0.05))
    assert reported <= 13


def test_a_battery_that_was_swapped() -> None:
    """A step of three bars, among robots to which nothing happened; 3 % that all logs have in common do not matter."""
    std = np.full(20, 0.5)
    value = 15.0 + 0.45 + 0.15 * RNG(1).standard_normal(20)
    value[12:] += 1.5  # of bars 0.5
    fleet = [steady(k, 20) for k in range(5)]
    (found,) = departures([*fleet, series(value, std, "b")])
    assert (found.series.robot, found.kind, found.first, found.last) == ("b", "since", 12, 19)
    assert found.change == pytest.approx(1.5, abs=3 * found.std)
    assert found.bars == pytest.approx(abs(found.change) / (0.5 * np.sqrt(1 / 12 + 1 / 8)))


def test_a_lidar_for_some_logs_and_a_log_gone_wrong() -> None:
    std = np.full(40, 0.1)
    value = 15.0 + 0.1 * RNG(2).standard_normal(40)
    value[10:16] += 1.0
    value[30] -= 1.5
    found = {d.kind: d for d in departures([series(value, std)])}
    assert set(found) == {"while", "once"}
    assert (found["while"].first, found["while"].last) == (10, 15)
    assert found["once"].first == 30
    assert found["while"].change == pytest.approx(1.0, abs=0.2)


def test_a_step_at_the_beginning_is_named_by_what_came_after() -> None:
    value = np.concatenate([np.full(3, 1.0), np.full(17, 2.0)]) + 0.01 * RNG(3).standard_normal(20)
    (found,) = departures([series(value, np.full(20, 0.1))])
    assert (found.kind, found.first, round(found.change, 1)) == ("since", 3, 1.0)


def test_chance_is_the_textbooks_for_two_logs() -> None:
    """Independent: two values, one difference, a z-test, and two looks."""
    from scipy.stats import norm

    (found,) = departures([series(np.array([0.0, 7.0]), np.array([0.6, 0.8]))])
    assert found.change == pytest.approx(7.0)
    assert found.std == pytest.approx(1.0)
    assert found.chance == pytest.approx(3 * 2 * 2 * norm.sf(7.0)), "three kinds, two yardsticks, two sides"


def test_logs_that_agree_better_than_their_bars_show_smaller_changes() -> None:
    """Half a bar, in sixty logs that scatter by a twentieth of it."""
    value = 15.0 + 0.025 * RNG(4).standard_normal(60)
    value[40:] += 0.25
    (found,) = departures([series(value, np.full(60, 0.5))])
    assert (found.kind, found.first) == ("since", 40)
    assert found.std == pytest.approx(0.025 * np.sqrt(1 / 40 + 1 / 20), rel=0.5)
    assert found.bars < 2.0


def test_more_looks_make_it_harder() -> None:
    std, value = np.full(12, 0.1), 15.0 + 0.02 * RNG(5).standard_normal(12)
    value[8] += 0.8
    one = series(value, std)
    alone, among = departures([one])[0], departures([one, *(steady(k, 30) for k in range(9))])[0]
    assert looks_at([one]) == 2 * 66
    assert among.chance / alone.chance == pytest.approx((10 + 9 * 28) / 10), "looks at single logs"


def test_logs_too_few_to_say_anything() -> None:
    assert departures([]) == departures([series(np.array([1.0]), np.array([0.1]))]) == []
    assert np.isnan(scatter(series(np.array([1.0]), np.array([0.1]))))
