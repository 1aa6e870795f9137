"""A fleet's table: the same wherever it is computed, never computed twice, and no log stops it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stadera.errors import RecordingError, StaderaError, UnknownNameError
from stadera.fleet import FleetOptions, FleetTable, LogJob, Pool, jobs_of, read_fleet, read_manifest, run_fleet
from stadera.fleet import run as rows
from stadera.fleet import run as runs
from stadera.fleet.merge import merge_fleet, merge_legs
from stadera.fleet.pool import journal
from stadera.fleet.run import Done, process
from stadera.fleet.table import COLUMNS
from stadera.identify.legs import identify
from stadera.identify.settings import IdentifySettings
from stadera.robot import load_robot
from stadera.weigh.weigh import weigh

HERE = Pool(0)


def values(table: FleetTable) -> list[dict[str, Any]]:
    """Of the rows, but for how long they took."""
    return [{name: value for name, value in row.items() if name != "seconds"} for row in table.rows]


@pytest.fixture
def weighed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The logs that were really weighed."""
    seen: list[str] = []

    def watched(task: Any) -> Done:
        seen.append(Path(task.job.log).name)
        return process(task)

    monkeypatch.setattr(runs, "process", watched)
    return seen


@pytest.fixture(scope="module")
def jobs(logs: Path) -> list[LogJob]:
    return jobs_of([f"{logs}/*/*"], "hyq", names=r"(unit\d)/")


@pytest.fixture(scope="module")
def table(jobs: list[LogJob], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The fleet's table, made in this process."""
    out = tmp_path_factory.mktemp("fleet") / "runs.parquet"
    run_fleet(jobs, out, HERE)
    return out


def test_one_row_a_log_with_what_weigh_says(table: Path, logs: Path) -> None:
    found = read_fleet(table)
    assert [Path(row["log"]).relative_to(logs).as_posix() for row in found.rows] == [
        "unit1/a.parquet", "unit1/b.csv", "unit2/a.parquet", "unit2/b.parquet"]  # fmt: skip
    assert [row["robot"] for row in found.rows] == ["unit1", "unit1", "unit2", "unit2"]
    row, alone = found.rows[1], weigh("hyq", logs / "unit1/b.csv")
    assert tuple(row) == tuple(COLUMNS)
    assert (row["status"], row["error"]) == ("ok", None)
    assert (row["trunk_mass"], row["trunk_mass_std"]) == (alone.mass, alone.mass_std)
    assert [row[f"com_{axis}"] for axis in "xy"] == alone.com[:2].tolist()
    assert [row[f"com_{axis}_std"] for axis in "xy"] == alone.com_std[:2].tolist()
    assert (row["begin"], row["end"]) == (alone.begin, alone.end)
    assert (row["trust"], row["misfit"], row["changes"]) == (alone.trust.verdict, alone.trust.misfit, 0)
    assert row["payload_mass"] is None


def test_the_same_table_on_a_scheduler(table: Path, jobs: list[LogJob], cluster: Pool, tmp_path: Path) -> None:
    """To 1e-9: kernels that were just compiled and those loaded from the cache may round the last digit differently."""
    elsewhere = values(run_fleet(jobs, tmp_path / "runs.parquet", cluster))
    assert elsewhere == values(read_fleet(tmp_path / "runs.parquet"))
    for row, here in zip(elsewhere, values(read_fleet(table)), strict=True):
        assert row == {
            name: value if value is None or isinstance(value, str) else pytest.approx(value, rel=1e-9)
            for name, value in here.items()
        }


def test_a_second_call_does_nothing(table: Path, jobs: list[LogJob], weighed: list[str]) -> None:
    before = table.read_bytes()
    run_fleet(jobs, table, HERE)
    assert not weighed
    assert table.read_bytes() == before
    assert [path.name for path in table.parent.iterdir()] == ["runs.parquet"]


def test_the_table_among_its_logs_is_no_log(jobs: list[LogJob], tmp_path: Path, weighed: list[str]) -> None:
    log = tmp_path / "a.parquet"
    log.write_bytes(Path(jobs[0].log).read_bytes())
    for _ in range(2):
        found = run_fleet(jobs_of([f"{tmp_path}/*.parquet"], "hyq"), tmp_path / "runs.parquet", HERE)
    assert [row["log"] for row in found.rows] == [str(log)]
    assert weighed == ["a.parquet"]


def copied(table: Path, folder: Path) -> Path:
    return Path((folder / "runs.parquet").write_bytes(table.read_bytes()) and folder / "runs.parquet")


def test_what_has_changed_is_done_again(
    table: Path, jobs: list[LogJob], weighed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = copied(table, tmp_path)
    other = tmp_path / "b.csv"
    lines = Path(jobs[1].log).read_text().splitlines(keepends=True)
    other.write_text("".join(lines))
    run_fleet([replace(jobs[1], log=str(other))], out, HERE)
    run_fleet([replace(jobs[1], log=str(other))], out, HERE)
    assert weighed == ["b.csv"]
    other.write_text("".join(lines[:-10]))
    run_fleet([replace(jobs[1], log=str(other))], out, HERE)
    run_fleet([replace(jobs[1], log=str(other), tare="0:0.9")], out, HERE)
    assert weighed == ["b.csv"] * 3
    monkeypatch.setattr(rows.stadera, "__version__", "9.9")  # type: ignore[attr-defined]
    run_fleet([replace(jobs[1], log=str(other), tare="0:0.9")], out, HERE)
    assert weighed == ["b.csv"] * 4
    found = read_fleet(out)
    assert len(found.rows) == 5, "rows of other logs stay"
    assert found.rows[-1]["version"] == "9.9"
    assert found.rows[-1]["payload_mass"] is not None


def test_broken_off_and_gone_on(
    table: Path, jobs: list[LogJob], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, weighed: list[str]
) -> None:
    out, whole = tmp_path / "runs.parquet", runs.process

    def until_third(task: Any) -> Done:
        if len(weighed) == 2:
            raise KeyboardInterrupt
        return whole(task)

    monkeypatch.setattr(runs, "process", until_third)
    with pytest.raises(KeyboardInterrupt):
        run_fleet(jobs, out, HERE)
    assert len(read_fleet(out).rows) == 2
    monkeypatch.setattr(runs, "process", whole)
    assert values(run_fleet(jobs, out, HERE)) == values(read_fleet(table))
    assert len(weighed) == 4


def test_killed_while_it_wrote(table: Path, jobs: list[LogJob], tmp_path: Path, weighed: list[str]) -> None:
    """The table not written yet, the journal's last line incomplete."""
    done = read_fleet(table)
    lines = [
        json.dumps({"version": "0.1.0", "key": key, "row": row | {"joints": [], "legs": []}})
        for key, row in zip(done.keys, done.rows, strict=True)
    ]
    (tmp_path / ".runs.journal.jsonl").write_text("\n".join(lines)[:-30])
    found = run_fleet(jobs, tmp_path / "runs.parquet", HERE)
    assert values(found) == values(done)
    assert weighed == ["b.parquet"]
    assert [path.name for path in tmp_path.iterdir()] == ["runs.parquet"]


def test_a_table_that_another_run_writes_is_left_alone(jobs: list[LogJob], tmp_path: Path, weighed: list[str]) -> None:
    pytest.importorskip("fcntl")
    with journal(tmp_path / ".runs.journal.jsonl"):
        with pytest.raises(StaderaError, match="another run is writing there"):
            run_fleet(jobs, tmp_path / "runs.parquet", HERE)
        assert not weighed
        assert [path.name for path in tmp_path.iterdir()] == [".runs.journal.jsonl"]


def test_what_a_url_needs_is_named_with_the_line_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def needs(_: str) -> None:
        raise ImportError('HTTPFileSystem requires "requests" and "aiohttp" to be installed')

    monkeypatch.setattr(pytest.importorskip("fsspec").core, "url_to_fs", needs)
    with pytest.raises(StaderaError, match="installed: pip install requests aiohttp"):
        jobs_of(["https://robots/*.mcap"], "hyq")


def test_a_log_that_fails_is_a_row(logs: Path, tmp_path: Path, weighed: list[str]) -> None:
    (tmp_path / "corrupt.parquet").write_bytes((logs / "unit1/a.parquet").read_bytes()[:3000])
    given = [tmp_path / "corrupt.parquet", tmp_path / "nothing.csv", logs / "unit1/a.parquet"]
    out = tmp_path / "runs.parquet"
    corrupt, nothing, good = run_fleet(jobs_of(given, "hyq"), out, HERE).rows
    assert corrupt["status"] == nothing["status"] == "failed"
    assert corrupt["error"].startswith(f"{tmp_path}/corrupt.parquet: damaged Parquet file")
    assert corrupt["sha256"]
    assert corrupt["trunk_mass"] is None
    assert nothing["error"] == f"{tmp_path}/nothing.csv: no such file"
    assert good["status"] == "ok"
    run_fleet(jobs_of(given, "hyq"), out, HERE)
    assert weighed[3:] == ["nothing.csv"], "what was not there may come; what is corrupt stays so"


def test_a_fault_of_the_program_is_a_row(jobs: list[LogJob], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(rows, "_weighed", fails)
    (row,) = run_fleet(jobs[:1], tmp_path / "runs.parquet", HERE).rows
    assert row["error"] == "internal error, ZeroDivisionError: by nothing"


def test_logs_at_urls(table: Path, jobs: list[LogJob], tmp_path: Path) -> None:
    memory = pytest.importorskip("fsspec").filesystem("memory")
    for job in jobs[:2]:
        memory.put_file(job.log, f"/day/{Path(job.log).name}")
    found = run_fleet(jobs_of(["memory://day/*", "memory://day/none.csv"], "hyq"), tmp_path / "r.parquet", HERE)
    assert [row["log"] for row in found.rows] == [
        "memory:///day/a.parquet",
        "memory:///day/b.csv",
        "memory://day/none.csv",
    ]
    for there, here in zip(found.rows, read_fleet(table).rows[:2], strict=False):
        assert (there["sha256"], there["trunk_mass"]) == (here["sha256"], here["trunk_mass"])
    assert found.rows[2]["error"].startswith("memory://day/none.csv: cannot be fetched")


def test_manifest(logs: Path, tmp_path: Path) -> None:
    manifest = tmp_path / "fleet.csv"
    (tmp_path / "tare.csv").touch()
    manifest.write_text(f"log,robot,tare,legs,name\n{logs}/unit1/*,hyq,0:1,,one\n{logs}/unit2/a.parquet,,tare.csv,,\n")
    a, b, c = read_manifest(manifest, robot="go2")
    assert (a.robot, a.tare, a.legs, a.name) == (b.robot, b.tare, b.legs, b.name) == ("hyq", "0:1", None, "one")
    assert (c.robot, c.tare, c.name) == ("go2", str(tmp_path / "tare.csv"), None)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("robot\nhyq\n", "needs a column 'log'"),
        ("log,robto\nx.csv,hyq\n", "unknown column 'robto'; valid: log, robot, tare, legs, name; did you mean 'robot'"),
        ("log,tare\nx.csv,3:1\n", "line 2: '3:1' is not a range of time"),
        ("log\nx.csv\nx.csv\n", "line 3: .*x.csv is there twice"),
        ("log\nnone*.csv\n", "line 2: .*matches no log"),
        ("log,robot\n,hyq\n", "line 2: no log"),
        ("log\n", "no logs in it"),
    ],
)
def test_manifests_that_are_none(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "m.csv").write_text(text)
    with pytest.raises(StaderaError, match=said):
        read_manifest(tmp_path / "m.csv")


def test_wrong_choices_are_known_before_the_work(jobs: list[LogJob], tmp_path: Path, weighed: list[str]) -> None:
    with pytest.raises(UnknownNameError, match="unknown robot 'hqy'"):
        run_fleet([replace(jobs[0], robot="hqy")], tmp_path / "r.parquet", HERE)
    with pytest.raises(StaderaError, match="is written as"):
        run_fleet(jobs, tmp_path / "r.csv", HERE)
    (tmp_path / "other.parquet").write_bytes(Path(jobs[0].log).read_bytes())
    with pytest.raises(StaderaError, match="not a fleet's table: no column log"):
        run_fleet(jobs, tmp_path / "other.parquet", HERE)
    with pytest.raises(StaderaError, match="are of weighing"):
        FleetOptions(identify=True, method="walking")
    with pytest.raises(RecordingError, match="finds no robot's name"):
        jobs_of([jobs[0].log], "hyq", names="(robot7)")
    assert not weighed


def test_the_robot_that_a_log_names(logs: Path, tmp_path: Path) -> None:
    from pyarrow import parquet

    log = tmp_path / "named.parquet"
    parquet.write_table(parquet.read_table(logs / "unit1/a.parquet").replace_schema_metadata({"robot": "hyq"}), log)
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  custom_data:\n    robot: hyq\n")
    (bag / "walk.csv").write_bytes((logs / "unit1/b.csv").read_bytes())
    found = run_fleet(jobs_of([log, bag, logs / "unit1/a.parquet"]), tmp_path / "r.parquet", HERE).rows
    assert [row["robot"] for row in found] == ["hyq", "hyq", None]
    assert found[0]["status"] == "ok"
    assert "its metadata do not say" in found[2]["error"]


def test_legs_of_a_fleet(tmp_path: Path, swing_on_stand: Path) -> None:
    found = run_fleet(
        jobs_of([swing_on_stand], "hyq", options=FleetOptions(identify=True)), tmp_path / "r.parquet", HERE
    )
    alone = identify("hyq", swing_on_stand, IdentifySettings(legs=("RH",)))
    row = read_fleet(tmp_path / "r.parquet").rows[0]
    assert (row["status"], row["trust"], row["trunk_mass"]) == ("ok", alone.trust.verdict, None)
    assert row["end"] > row["begin"] + 3.0
    joints = read_fleet(tmp_path / "r.parquet").joints
    assert joints == found.joints
    leg = alone.legs[0]
    name = f"{leg.leg.joints[2]}.viscous"
    (value,) = [j for j in joints if f"{j['joint']}.{j['parameter']}" == name]
    assert value["value"] == leg.parameters[name].value


def test_a_robots_legs_by_all_its_logs_as_the_python_api_merges_them(tmp_path: Path, swing_on_stand: Path) -> None:
    again = tmp_path / "again.parquet"
    again.write_bytes(swing_on_stand.read_bytes())
    jobs = jobs_of([swing_on_stand, again], "hyq", options=FleetOptions(identify=True))
    run_fleet(jobs, tmp_path / "r.parquet", HERE)
    merged = merge_fleet(read_fleet(tmp_path / "r.parquet"), jobs)["hyq"]
    leg = identify("hyq", swing_on_stand, IdentifySettings(legs=("RH",))).legs[0]
    assert leg.information is not None
    direct = merge_legs(load_robot("hyq"), {"a": {"RH": leg.information}, "b": {"RH": leg.information}})
    np.testing.assert_allclose(merged.legs[0].estimate.values, direct.legs[0].estimate.values, rtol=1e-12)
    with pytest.raises(StaderaError, match="nothing to merge"):
        merge_fleet(FleetTable(()), jobs)
    with pytest.raises(StaderaError, match="logs of several models"):
        merge_fleet(read_fleet(tmp_path / "r.parquet"), [jobs[0], replace(jobs[1], robot="go2")])
