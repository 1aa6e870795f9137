"""`stadera simulate`: the log, the truth apart from it, and what bad requests get."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stadera.errors import StaderaError
from stadera.lab.scenarios.catalog import SCENARIOS, SWING, Load, SimulateSettings, scenario_named
from stadera.lab.scenarios.run import simulate, swing
from stadera.lab.truth import read_truth
from stadera.logs import Recording, read, write_table
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration

Run = Callable[..., Any]

SHORT = ("--duration", "0.4", "--rate", "250")


def test_log_and_truth_are_kept_apart(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "log.csv"
    finished = run("simulate", "stand", "--out", out, "--load", "5kg", "--at", "-0.2,0.1,0.1", *SHORT)
    assert finished.code == 0
    assert "kg" in finished.out
    robot, log = load_robot("hyq"), read(out, require=("velocity", "effort", "imu"))
    assert log.joints == robot.tree.joints
    np.testing.assert_allclose(np.diff(log.time), 0.004, rtol=1e-9)
    assert not log.foot_force
    assert log.imu is not None
    assert log.imu.orientation is not None
    truth, motion = json.loads((tmp_path / "log.truth.json").read_text()), read(tmp_path / "log.truth.csv")
    # by hand: the trunk of the model file with a point of 5 kg
    trunk = robot.inertias[robot.trunk]
    moment = truth["trunk"][-1]
    assert moment["payload"]["mass"] == pytest.approx(5.0)
    assert moment["mass"] == pytest.approx(trunk.mass + 5.0)
    expected = (trunk.mass * trunk.com + 5.0 * np.array([-0.2, 0.1, 0.1])) / (trunk.mass + 5.0)
    np.testing.assert_allclose(moment["com"], expected, atol=1e-9)
    total = sum(force[-1] for force in motion.foot_force.values())
    assert total[2] == pytest.approx((robot.mass + 5.0) * 9.81, rel=0.02)
    np.testing.assert_array_equal(motion.time, log.time)


def test_same_seed_same_files(run: Run, tmp_path: Path) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        command = ("simulate", "ramp", "--out", tmp_path / f"{name}.csv", "--seed", seed, "--duration", "0.1")
        assert run(*command).code == 0
    a, b, c = (read(tmp_path / f"{name}.csv") for name in "abc")
    # to rounding: sums over arrays may be taken in another order from run to run
    np.testing.assert_allclose(a.position, b.position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(a.effort, b.effort, rtol=0, atol=1e-6)
    assert np.abs(a.position - c.position).max() > 1e-5
    assert read_truth(tmp_path / "a.truth.json").slope == pytest.approx(np.deg2rad(10.0))


def test_a_load_comes_while_standing(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "log.parquet"
    assert run("simulate", "stand-load", "--out", out, "--load", "50N", "--duration", "0.5").code == 0
    truth = read_truth(tmp_path / "log.truth.json")
    assert [m.time for m in truth.moments] == pytest.approx([0.0, 0.2])
    assert truth.at(0.1).payload_com is None
    assert truth.at(0.3).payload_mass == pytest.approx(50.0 / 9.81)
    assert (tmp_path / "log.truth.parquet").exists()


def test_harsh_errors_come_with_the_wrong_model(run: Run, tmp_path: Path) -> None:
    model = tmp_path / "believed.urdf"
    command = ("simulate", "stand", "--out", tmp_path / "log.csv", "--errors", "harsh", "--believed", model)
    assert run(*command, "--duration", "0.1").code == 0
    hyq, believed = load_robot("hyq"), load_robot(str(model))
    joint, link = hyq.tree.joints[0], hyq.tree.links[-1]
    assert believed.dynamics[joint].coulomb > 0.0
    assert believed.inertias[link].mass != pytest.approx(hyq.inertias[link].mass, rel=1e-3)
    assert believed.inertias[believed.trunk].mass == pytest.approx(hyq.inertias[hyq.trunk].mass)


def test_a_leg_belongs_to_a_swing(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "log.csv"
    assert run("simulate", "trot", "--out", out, "--leg", "LF").code == 2
    done = run(
        "simulate", "swing", "--robot", "go2", "--out", out, "--leg", "LF", "--duration", "2", "--errors", "real"
    )
    assert done.code == 0
    assert "stiffness" not in done.out
    assert (tmp_path / "log.truth.json").exists()


def test_every_scenario_has_events_within_its_time() -> None:
    robot = load_robot("hyq")
    table = Recording(np.linspace(0.0, 5.0, 11), robot.tree.joints, np.zeros((11, 12)))
    for name, scenario in SCENARIOS.items():
        settings = SimulateSettings(motion=table if name == "motion" else None)
        events = scenario.script(robot, settings, scenario.duration)
        assert all(0.0 <= event.time < scenario.duration for event in events), name
    assert len(scenario_named("poses").script(robot, SimulateSettings(), 33.0)) == 11


@pytest.mark.parametrize(
    ("scenario", "settings", "said"),
    [
        (
            "stand",
            SimulateSettings(speed=0.2),
            "speed goes with the scenarios trot, trot-load, crawl, crawl-load, step",
        ),
        ("shake", SimulateSettings(turn=0.1), "turn goes with the scenarios trot, trot-load, crawl, crawl-load"),
        (
            "trot",
            SimulateSettings(amplitude=2.0),
            "amplitude goes with the scenarios errands, shake, shake-load, squat",
        ),
        ("motion", SimulateSettings(), "plays a table"),
        ("stand", SimulateSettings(load_time=1.0), "load_time needs a load"),
        ("trot-load", SimulateSettings(load_time=3.0, duration=3.0), "a load at 3 s never lands in a run of 3 s"),
        (SWING, SimulateSettings(load=Load(5.0)), "load goes with the scenarios stand,"),
    ],
)
def test_settings_that_a_scenario_does_not_use_are_refused(
    scenario: str, settings: SimulateSettings, said: str
) -> None:
    robot = load_robot("hyq")
    with pytest.raises(StaderaError, match=said):
        swing(robot, settings=settings) if scenario == SWING else simulate(robot, scenario, settings)


def test_settings_that_a_scenario_uses_are_taken() -> None:
    robot, table = load_robot("hyq"), Recording(np.array([0.0, 1.0]), ("LF_HAA",), np.zeros((2, 1)))
    given = {"speed": 0.2, "turn": 0.1, "amplitude": 2.0, "motion": table}
    used = {name: [one for one in given if one in scenario.takes] for name, scenario in SCENARIOS.items()}
    assert used["step"] == ["speed"]
    assert used["crawl"] == used["trot-load"] == ["speed", "turn"]
    assert used["errands"] == used["squat"] == ["amplitude"]
    assert used["stand"] == used["poses"] == used["ramp"] == []
    for name in ("step", "crawl", "errands", "motion"):
        settings = SimulateSettings(**{one: given[one] for one in used[name]})
        assert scenario_named(name).script(robot, settings, 3.0), name


def test_help_names_the_default_robot(run: Run) -> None:
    assert "[default: hyq]" in run("simulate", "--help").out


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("stroll", "--out", "a.csv"), 1, "unknown scenario 'stroll'; valid: stand"),
        (("stand", "--out", "a.txt"), 1, "written as one of .csv"),
        (("stand", "--out", "a.csv", "--rate", "300"), 1, "1000 Hz over a whole number"),
        (("stand", "--out", "a.csv", "--duration", "0"), 1, "duration must be positive"),
        (("stand", "--out", "a.csv", "--errors", "rough"), 1, "valid: ideal, standard, harsh"),
        (("stand", "--out", "a.csv", "--load", "0"), 1, "a load must be positive"),
        (("stand", "--out", "a.csv", "--slope", "80"), 1, "within ±60°"),
        (("stand", "--out", "a.csv", "--load", "much"), 2, "a load like 5kg or 50N"),
        (("stand", "--out", "a.csv", "--at", "0,0,0"), 2, "needs --load"),
        (("stand", "--out", "a.csv", "--turn", "5"), 1, "turn goes with the scenarios trot, trot-load, crawl"),
        (("stand", "--out", "nowhere/a.csv"), 1, "no such folder"),
        (("stand",), 2, "--out"),
    ],
)
def test_bad_requests(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], code: int, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    finished = run("simulate", *arguments)
    assert finished.code == code
    assert said in finished.err
    if code == 1:
        assert finished.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_motion_is_played_twice_with_a_load_in_between(tmp_path: Path, run: Run) -> None:
    robot = load_robot("go2")
    time = np.linspace(0.0, 2.0, 101)
    position = np.tile(standing_configuration(robot), (101, 1))
    swing = 0.08 * np.sin(2.0 * np.pi * time) * np.sin(0.5 * np.pi * time)
    position[:, 2::3] += swing[:, None]  # all knees: the trunk goes up and down
    table = write_table(Recording(time, robot.tree.joints, position, source="bounce"), tmp_path / "bounce.csv")
    out = tmp_path / "log.csv"
    ended = run("simulate", "motion", "--motion", table, "--robot", "go2", "--load", "1kg", "--out", out)
    assert ended.code == 0, ended.err
    log, truth = read(out), json.loads((tmp_path / "log.truth.json").read_text())
    assert [moment["time"] for moment in truth["trunk"]] == [0.0, pytest.approx(3.5, abs=0.01)]
    knee = log.position[:, log.joints.index(robot.tree.joints[2])]
    moving = [(log.time > begin) & (log.time < begin + 2.0) for begin in (1.0, 4.0)]
    assert all(np.ptp(knee[part]) > 0.1 for part in moving)
    assert np.ptp(knee[(log.time > 0.3) & (log.time < 0.9)]) < 0.02
    refused = run("simulate", "stand", "--motion", table, "--robot", "go2", "--out", out)
    assert refused.code == 1
    assert "motion goes with the scenarios motion" in refused.err
    without = run("simulate", "motion", "--robot", "go2", "--out", out)
    assert without.code == 1
    assert "--motion F.csv" in without.err
