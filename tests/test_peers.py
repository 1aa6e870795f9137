"""The benchmark of peers, in its quick form: two contenders on a leg, two methods on a trunk, and the reasons given."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "benchmarks"))
pytest.importorskip("mujoco")

import peer_tables  # noqa: E402
import peers  # noqa: E402
from peer_trunks import Walk, weighed  # noqa: E402

from stadera.logs import write_table  # noqa: E402
from stadera.robot import load_robot  # noqa: E402
from stadera.trunk.samples import Samples  # noqa: E402


@pytest.fixture(scope="module")
def leg_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("peers") / "hyq.parquet"
    write_table(peers.hyq_log(), path)
    return path


def test_a_leg_by_stadera_and_by_normal_equations(leg_log: Path) -> None:
    ours, theirs, truth = (
        peers.fitted(name, "hyq", leg_log) for name in ("stadera", "Pinocchio + normal equations", peers.TRUTH)
    )
    assert truth["error"] == 0.0
    assert ours["error"] < 0.6 * theirs["error"]
    assert theirs["rmse"] < truth["rmse"]  # what the explanation of a lead in it says
    assert (ours["physical"], ours["bars"], theirs["bars"]) == (True, True, False)


def test_a_peer_that_is_not_installed_is_skipped_by_name(monkeypatch: pytest.MonkeyPatch, leg_log: Path) -> None:
    monkeypatch.setitem(peers.LIBRARIES, "FIGAROH", ("no_such_library",))
    with pytest.raises(ImportError, match="no_such_library"):
        peers.fitted("FIGAROH", "hyq", leg_log)
    rows = [{"case": "hyq", "contender": "stadera", "skipped": "No module named 'x'"}]
    assert "skipped: No module named 'x'" in peer_tables.markdown({"legs": rows, "trunks": [], "cases": {"hyq": "hyq"}})


def test_a_load_on_a_robot_that_stands() -> None:
    """Of the paper's (c), on a run whose truth is known: a second of which nothing is learnt gives no figure."""
    from stadera.lab.scenarios.catalog import Load, SimulateSettings
    from stadera.lab.scenarios.run import simulate

    robot = load_robot("go2")
    load = Load(2.0, "kg", (0.05, 0.0, 0.1))
    run = simulate(robot, "stand-load", SimulateSettings("standard", load, duration=3.0, load_time=1.5, hold=2))
    walk = Walk(Samples.of_recording(run.recording, robot), 1.5, 2.0, np.array([0.05, 0.0, 0.1]))
    found = weighed("contact", robot, walk)
    assert found["mass"] < 1.0
    assert found["latency"] < 1.5


def row(case: str = "a", contender: str = "stadera", **figures: Any) -> dict[str, Any]:
    return {"case": case, "contender": contender, **figures}


def test_every_lead_is_explained_or_said_not_to_be() -> None:
    rows = [row(seconds=1.0, rmse=0.5, odd=2.0), row(contender="peer", seconds=0.5, rmse=0.6, odd=1.0)]
    ahead = peer_tables.explained(rows, ("seconds", "rmse", "odd"))[1]["ahead"]
    assert set(ahead) == {"seconds", "odd"}
    assert ahead["odd"] == "odd: no explanation"


@pytest.mark.parametrize(("wins", "expected"), [(4, True), (8, False)])
def test_a_lead_within_the_scatter_of_the_runs_is_chance(wins: int, expected: bool) -> None:
    ours = [{"mass": 1.0}] * 8
    theirs = [{"mass": 0.5 if k < wins else 1.2} for k in range(8)]
    rows = [row(mass=1.0, runs=ours), row(contender="peer", mass=0.5, runs=theirs)]
    ahead = peer_tables.explained(rows, ("mass",))[1]["ahead"]["mass"]
    assert ("by chance" in ahead) is expected


def test_sign_test_is_the_binomials() -> None:
    assert peer_tables.sign_test(4, 8) == 1.0
    assert peer_tables.sign_test(8, 8) == pytest.approx(2 / 256)
    assert peer_tables.sign_test(1, 8) == pytest.approx(2 * 9 / 256)


def test_no_row_of_the_published_table_is_ahead_without_an_explanation() -> None:
    record = json.loads((ROOT / "docs" / "results" / "peers.json").read_text(encoding="utf-8"))
    for rows, figures in (
        (record["legs"], peer_tables.LEG_FIGURES),
        (record["trunks"], peer_tables.TRUNK_FIGURES),
    ):
        said = [reason for one in peer_tables.explained(rows, figures) for reason in one["ahead"].values()]
        assert not [reason for reason in said if "no explanation" in reason]
