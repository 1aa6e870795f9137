"""The study of identified robots: its grid, one short run, and its summary."""

from __future__ import annotations

import pytest

from stadera.lab.experiments.identified import ROBOTS, IdentifiedCase, cases, identified, summary
from stadera.lab.experiments.runner import ReproduceSettings


def test_each_robot_is_identified_with_and_without_legs_in_the_air() -> None:
    grid = cases(ReproduceSettings(seeds=2))
    assert len(set(grid)) == len(grid) == 4 * len(ROBOTS)
    assert {case.seconds for case in grid} == {30.0}


def test_errors_are_compared_with_what_was_drawn() -> None:
    drives = {term: [[0.1, 0.05, 1.0, 50.0], [0.2, None, 1.0, 50.0]] for term in ("armature", "viscous", "coulomb")}
    good = {"refused": None, "drives": drives | {"offset": [[0.1, 0.1, 0.0, 50.0]]}, "trunk_mass": 10.0, "robot": -0.02}
    good |= {
        "links": [[0.1, 0.4, 1.0], [0.3, 0.3, 0.0]],
        "trunk": [[0.1, 0.1], [0.001, 0.001], [0.0, 0.001], [0.0, 0.1]],
    }
    grid = [IdentifiedCase("hyq", 8.0, air, 0) for air in (False, True)]
    found = summary(grid, [good, {"refused": "it fell"}])
    values = {(*record.case.values(), record.metric): record.value for record in found.records}
    assert values["trot, sway", "coulomb: median error, relative"] == pytest.approx(10.0)
    assert values["trot, sway", "coulomb: determined"] == pytest.approx(50.0)
    assert values["trot, sway", "coulomb: NEES/n"] == pytest.approx(4.0)
    assert values["trot, sway", "offset: median error, of the limit"] == pytest.approx(0.2)
    assert values["trot, sway", "link masses called observable: error over the model's"] == pytest.approx(0.25)
    assert values["trot, sway", "trunk: median error of the mass"] == pytest.approx(1.0)
    assert values["trot, sway", "robot: median error of the whole mass"] == pytest.approx(2.0)
    assert values["trot, sway, legs in the air", "refused or fallen"] == 1.0


def test_a_short_run_has_all_figures() -> None:
    outcome = identified(IdentifiedCase("go2", 3.0, True, 0))
    assert outcome["refused"] is None
    assert len(outcome["drives"]["coulomb"]) == len(outcome["links"]) == 12
    assert len(outcome["trunk"]) == 4
    assert min(abs(before) for _, before, _ in outcome["links"]) > 0.0
