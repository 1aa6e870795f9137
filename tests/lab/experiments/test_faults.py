"""The study of faulty logs: its grid, what its summary says of outcomes, and a part of it run."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stadera.errors import MissingExtraError, StaderaError, UnknownNameError
from stadera.fleet.pool import Pool
from stadera.lab.experiments import faults
from stadera.lab.experiments.fault_kinds import FORCES, SIGNAL_FAULTS
from stadera.lab.experiments.faults import CLEAN, HOW, FaultCase, FaultyLog, LogCase, cases, weigh_faulty
from stadera.lab.experiments.runner import ExperimentResult, ReproduceSettings, chosen, run_grid
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs import Recording
from stadera.robot import load_robot

LOG = LogCase("go2", "stand", 0, duration=2.0)


def outcome(status: str, error: float = 0.0, **more: Any) -> dict[str, Any]:
    """A weighing of a robot of 50 kg, off by `error` [kg], 1 σ a kilogram."""
    return {
        "status": status,
        "said": "",
        "mass": 50.0,
        "errors": {"trunk mass": [error, 1.0]},
        "left_out": False,
        **more,
    }


def summary(*entries: tuple[str, dict[str, Any]]) -> dict[str, float]:
    grid = [FaultyLog(LOG, (fault,)) for fault, _ in entries]
    found = faults.summary(grid, [{"fell": None, "faults": {fault: o}} for fault, o in entries])
    return {f"{record.case['faults']}, {record.metric}": record.value for record in found.records}


def test_the_grid_has_every_fault_for_every_robot_motion_and_seed() -> None:
    grid = cases(ReproduceSettings())
    weighings = [FaultCase(case.log, fault) for case in grid for fault in case.faults]
    logs = (7 * 4 + 2 * 3) * 8
    assert len(weighings) == len(set(weighings)) == logs * (1 + len(SIGNAL_FAULTS) + len(FORCES)) > 10_000
    assert {case.log.share for case in weighings} == {0.0, HOW.load}
    assert sum(len(case.faults) for case in cases(ReproduceSettings(quick=True))) > 200
    pushed = [case for case in weighings if case.fault in FORCES]
    assert all(case.log.force == case.fault and not case.log.share for case in pushed)


def test_only_faults_that_a_log_can_show_are_counted_against_it() -> None:
    hidden = "all torques x1.15"
    found = summary(
        (CLEAN, outcome("right")),
        (CLEAN, outcome("named")),
        (hidden, outcome("silent", 8.0)),
        ("one torque x2", outcome("silent", 4.0)),
        ("one torque x2", outcome("silent", -6.0)),
        ("gyro zero", outcome("refused")),
        ("gyro zero", outcome("right", 1.0)),
    )
    shown = "that a log can show"
    assert found[f"{shown}, share silent"] == pytest.approx(0.5)
    assert found[f"{shown}, share refused"] == found[f"{shown}, share right"] == pytest.approx(0.25)
    assert found[f"{shown}, silent beyond 5 σ"] == 1
    assert found["none, share called faulty"] == pytest.approx(0.5)


def test_sides_are_hidden_where_nothing_moves_alone() -> None:
    swapped, swaying = "whole left and right legs swapped", LogCase("go2", "shake", 0)
    assert FaultCase(LOG, swapped).hidden
    assert not FaultCase(swaying, swapped).hidden
    assert FaultCase(swaying, "a person carries a tenth").hidden
    assert not FaultCase(LOG).hidden


def test_a_part_of_it_is_run_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    grid, weigh = [FaultyLog(LOG, (CLEAN, "accelerometer in g"))], partial(weigh_faulty, logs=tmp_path / "logs")

    def run() -> ExperimentResult:
        return faults.summary(grid, run_grid("faults", weigh, grid, lambda *_: None, tmp_path, Pool(0)))

    first = run()
    rows = {row[0].text: [cell.text for cell in row[1:]] for _, group in first.tables[3].groups for row in group}
    assert rows[CLEAN][:2] == ["1", "1"]
    assert rows["accelerometer in g"][3] == "1"
    assert len(list((tmp_path / "logs").iterdir())) == 2
    monkeypatch.setattr(faults, "weigh", None)  # nothing is weighed again
    assert [record.value for record in run().records] == [record.value for record in first.records]
    again = weigh(FaultyLog(LOG, (CLEAN,)))  # by what is no stadera error
    assert again["faults"][CLEAN]["status"] == "crashed"


@pytest.mark.parametrize("name", ["go2", "g1"])
def test_a_case_is_faulty_in_the_same_way_every_time(name: str) -> None:
    """A robot without arms, or without hind legs, does not have their faults."""
    try:
        robot = load_robot(name)
    except MissingExtraError as error:
        pytest.skip(str(error))
    log = simulate(robot, "shake", SimulateSettings("standard", duration=1.0, arms=0.3)).recording
    for fault_name, fault in SIGNAL_FAULTS.items():
        one, other = (fault.spoil(log, robot, np.random.default_rng(3)) for _ in range(2))
        assert len(one) == len(other)
        assert one.joints == other.joints
        assert (one.position == other.position).all(), fault_name
        changed = any(_differs(one, log, channel) for channel in ("time", "position", "velocity", "effort", "imu"))
        lacks = ("arm",) if robot.extra is None else ("hind", "two legs")
        assert (changed or fault.model(robot) is not robot) is not any(part in fault_name for part in lacks), fault_name


def test_the_faults_of_other_robots_are_not_weighed() -> None:
    outcome = weigh_faulty(FaultyLog(LOG, ("arms not in the log", "model without arms", "model of legs 15 % larger")))
    assert list(outcome["faults"]) == ["model of legs 15 % larger"]


def test_robots_are_chosen_by_name() -> None:
    def run(*robots: str) -> set[str]:
        return {case.robot for case in chosen(cases(ReproduceSettings()), "faults", robots)}

    assert run() == set(faults.ROBOTS)
    assert run("g1", "talos") == {"g1", "talos"}
    with pytest.raises(UnknownNameError, match="unknown robot 'nao'; valid: hyq"):
        run("nao")
    with pytest.raises(StaderaError, match="table1 does not run robot by robot"):
        chosen([LogCase("go2", "stand", 0), HOW], "table1", ("go2",))


def _differs(one: Recording, other: Recording, channel: str) -> bool:
    if len(one) != len(other) or one.joints != other.joints:
        return True
    if channel == "imu":
        names = ("angular_velocity", "linear_acceleration")
        return any((getattr(one.imu, name) != getattr(other.imu, name)).any() for name in names)
    return bool((getattr(one, channel) != getattr(other, channel)).any())
