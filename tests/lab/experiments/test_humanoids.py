"""The study of humanoids: its grid, one run of it, and its summary."""

from __future__ import annotations

import pytest

from stadera import weigh
from stadera.errors import MissingExtraError
from stadera.lab.experiments.humanoids import MOTIONS, CarryCase, cases, hand_of, summary, weighed
from stadera.lab.experiments.runner import ReproduceSettings
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.robot import load_robot


def test_every_motion_has_loads_on_trunk_and_hand() -> None:
    grid = cases(ReproduceSettings(seeds=2))
    assert len(set(grid)) == len(grid) == 2 * len(MOTIONS) * 4
    assert {(case.robot, case.scenario) for case in cases(ReproduceSettings(quick=True))} >= {
        ("g1", "step"),
        ("talos", "step"),
    }


def test_errors_are_counted_by_load() -> None:
    good = {"fell": None, "verdict": "good", "robot_mass": 30.0, "true_mass": 3.0, "mass": 3.03, "std": 0.03}
    runs = [good | {"at": "", "found_at": ""}, good | {"at": "hand", "found_at": "", "mass": 3.3}, {"fell": "fell"}]
    grid = [CarryCase("g1", "shake", "trunk", "real", 0), CarryCase("g1", "step", "hand", "real", 0)]
    found = summary([*grid, CarryCase("g1", "squat", "hand", "real", 0)], runs)
    values = {(*record.case.values(), record.metric): record.value for record in found.records}
    assert values["shake", "trunk", "real", "payload's mass, median"] == pytest.approx(0.1)
    assert values["step", "hand", "real", "payload's mass, median"] == pytest.approx(1.0)
    assert found.facts["Robots that fell"] == "1"


def test_a_load_in_the_hand_of_a_g1_is_weighed() -> None:
    try:
        robot = load_robot("g1")
    except MissingExtraError as error:
        pytest.skip(str(error))
    outcome = weighed(CarryCase("g1", "shake", "hand", "ideal", 0, duration=4.0))
    assert outcome["at"] == hand_of(robot)
    assert outcome["mass"] == pytest.approx(outcome["true_mass"], abs=0.005 * robot.mass)


@pytest.mark.parametrize("seed", [4, 6])
def test_friction_that_holds_most_joints_in_a_sway_is_no_misfit(seed: int) -> None:
    """Harmonic gears, velocities of 0.17 and 0.04 rad/s noise: which way friction acts is not known."""
    try:
        robot = load_robot("g1")
    except MissingExtraError as error:
        pytest.skip(str(error))
    run = simulate(robot, "shake", SimulateSettings(errors="real", seed=seed, duration=5.0))
    found = weigh(robot, run.recording)
    assert found.trust.verdict == "good", found.trust.reasons
    assert found.trust.misfit < 1.5
    assert not found.changes
    assert found.trunk.observed[0] == (seed == 6)  # the louder noise hides the mass, and no other is shown for it
    assert seed == 4 or abs(found.mass - run.truth.moments[-1].mass) < 2.5 * found.mass_std
