"""Each experiment run whole in its quick version."""

from __future__ import annotations

from pathlib import Path

import pytest

from stadera.errors import MissingExtraError
from stadera.identify.observability import Identifiability
from stadera.lab.experiments import EXPERIMENTS, ExperimentResult, ReproduceSettings
from stadera.lab.experiments.legs import MissingDataError
from stadera.robot import load_robot

QUICK = ReproduceSettings(quick=True)


@pytest.fixture(scope="module")
def table1() -> ExperimentResult:
    return EXPERIMENTS["table1"].run(QUICK, lambda *_: None)


@pytest.fixture(scope="module")
def fig4() -> ExperimentResult:
    return EXPERIMENTS["fig4"].run(QUICK, lambda *_: None)


def test_table_1_is_met_without_noise(table1: ExperimentResult) -> None:
    exact = [r for r in table1.records if r.case.get("sensor errors") == "none"]
    assert len(exact) == 9
    assert [r.metric for r in exact if not r.met] == []
    rank = next(r for r in exact if r.metric.startswith("rank"))
    assert (rank.value, rank.paper) == (17, 12)


def test_table_1_shows_simulated_identified_and_cad_of_each_link(table1: ExperimentResult) -> None:
    moments, inertias = table1.tables[:2]
    for table, columns in ((moments, 5), (inertias, 7)):
        assert len(table.head) == columns
        assert len(table.groups) == 3
        for _, (simulated, identified, cad) in table.groups:
            for truth, found, prior in zip(simulated[1:], identified[1:], cad[1:], strict=True):
                if found.verdict is Identifiability.OBSERVABLE:
                    assert found.text == truth.text
                if found.verdict is Identifiability.UNOBSERVABLE:
                    assert found.text == prior.text


def test_optimised_motion_tells_more_than_the_random_draw(table1: ExperimentResult) -> None:
    gains = [r.value for r in table1.records if r.metric == "information gain"]
    assert len(gains) == 2
    assert gains[1] > gains[0]


def test_same_seed_same_figures_and_another_seed_others(fig4: ExperimentResult) -> None:
    again = EXPERIMENTS["fig4"].run(QUICK, lambda *_: None)
    other = EXPERIMENTS["fig4"].run(ReproduceSettings(seed=1, quick=True), lambda *_: None)
    assert [r.to_dict() for r in again.records] == [r.to_dict() for r in fig4.records]
    assert [r.value for r in other.records] != [r.value for r in fig4.records]


def test_identified_leg_predicts_a_second_motion_better_than_cad(fig4: ExperimentResult) -> None:
    exact = {(r.case["joint"], r.metric): r for r in fig4.records if r.case["sensor errors"] == "none"}
    joints = {joint for joint, _ in exact}
    assert len(joints) == 3
    for joint in joints:
        identified, cad = exact[joint, "torque RMSE, identified"], exact[joint, "torque RMSE, CAD"]
        assert identified.met is True
        assert identified.value < 1e-6 * cad.value


def test_sensor_errors_leave_a_better_model_than_cad_with_offsets(fig4: ExperimentResult) -> None:
    noisy = [r for r in fig4.records if r.case["sensor errors"] == "standard" and r.bound is not None]
    assert len(noisy) == 3
    assert all(r.value > 0.01 for r in noisy)  # what noise leaves
    assert sum(r.value for r in noisy) < sum(r.bound or 0.0 for r in noisy)


def test_fig_4_has_three_torque_panels_and_the_errors_of_the_first_joint(fig4: ExperimentResult) -> None:
    panels = fig4.figures[0].panels
    assert [p.y.title for p in panels] == ["torque [N·m]"] * 3 + ["error [N·m]"]
    measured, cad, identified = panels[0].marks
    assert [line.name for line in (measured, cad, identified)] == [line.name for line in panels[1].marks]
    off_cad, off_identified = panels[3].marks
    assert off_cad.y == pytest.approx(measured.y - cad.y)
    assert off_identified.y == pytest.approx(measured.y - identified.y)


def test_real_legs_are_predicted_no_worse_than_by_cad_with_friction(shared_data: Path) -> None:
    for name in ("go2", "aliengo"):
        try:
            load_robot(name)
        except MissingExtraError as error:
            pytest.skip(str(error))
    result = EXPERIMENTS["fig5"].run(ReproduceSettings(data=shared_data), lambda *_: None)
    judged = [r for r in result.records if r.metric == "torque RMSE, identified"]
    assert len(judged) == 24
    assert [r.case for r in result.missed] == []


def test_fig_5_says_what_it_lacks(tmp_path: Path) -> None:
    with pytest.raises(MissingDataError, match=r"go2_legs_in_air\.csv: no such log"):
        EXPERIMENTS["fig5"].run(ReproduceSettings(data=tmp_path), lambda *_: None)
    with pytest.raises(MissingDataError, match="no real logs"):
        EXPERIMENTS["fig5"].run(ReproduceSettings(data=tmp_path / "none"), lambda *_: None)
