"""Tables of others: names that are recognised, presets, maps, units, and what is said of the rest."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv as pacsv

from log_formats import plotjuggler
from stadera.errors import RecordingError, StaderaError
from stadera.joint_words import matched, places
from stadera.logs import Imu, LogFile, Recording, Topics, read, stream
from stadera.logs.foreign.column_map import column_map, parsed, preset, preset_names
from stadera.logs.foreign.template import template
from stadera.logs.topics import ReadOptions
from stadera.logs.units import Units, unix_unit

UNITREE = [f"{leg}_{part}_joint" for leg in ("FR", "FL", "RR", "RL") for part in ("hip", "thigh", "calf")]
BY_LEG = [f"{leg}_{part}_joint" for leg in ("FL", "FR", "RL", "RR") for part in ("hip", "thigh", "calf")]
BY_PART = [f"{leg}_{part}_joint" for part in ("hip", "thigh", "calf") for leg in ("FL", "FR", "RL", "RR")]
ANYMAL = ("LF_HAA", "LF_HFE", "LF_KFE")


def table(folder: Path, *columns: str, name: str = "log.csv", step: float = 0.01, first: float = 0.0) -> Path:
    """A table of whose columns the first is time, and each of the others holds its own number."""
    values = {column: np.full(5, float(k)) for k, column in enumerate(columns)}
    values[columns[0]] = first + step * np.arange(5)
    pacsv.write_csv(pa.table(values), folder / name)
    return folder / name


def read_as(path: Path, joints: list[str] | None = None, **reading: str) -> Recording:
    return read(LogFile(path, Topics(), ReadOptions.of(**reading)), joints=joints)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("columns", "joint"),
    [
        (("__time", "/joint_states/FL_hip_joint/position", "/joint_states/FL_hip_joint/effort"), "FL_hip_joint"),
        (
            ("__time", "/go2/joint_states/FL_hip_joint/position", "/go2/joint_states/FL_hip_joint/effort"),
            "FL_hip_joint",
        ),
        (("timestamp", "motor_state_3_q", "motor_state_3_tau_est"), "FL_hip_joint"),
        (("t", "motorState[3].q", "motorState[3].tauEst"), "FL_hip_joint"),
        (("__time", "/lowstate/motor_state[3]/q", "/lowstate/motor_state[3]/tau_est"), "FL_hip_joint"),
        (("t", "FL_hip_q", "FL_hip_tau"), "FL_hip"),
        (("time", "q_FL_hip", "tau_FL_hip"), "FL_hip"),
        (("time_s", "FL_hip_joint_pos", "FL_hip_joint_torque"), "FL_hip_joint"),
        (("Time", "FL_hip.position [rad]", "FL_hip.effort (Nm)"), "FL_hip"),
    ],
)
def test_names_that_are_recognised(columns: tuple[str, ...], joint: str, tmp_path: Path) -> None:
    log = read(table(tmp_path, *columns))
    assert log.joints == (joint,)
    assert log.effort is not None
    assert (log.position[0, 0], log.effort[0, 0]) == (1.0, 2.0)
    assert any("columns read by the preset" in note for note in log.notes)


@pytest.mark.parametrize("torques", [("fl_hip_tau", "fl_hip_tau_est"), ("tau_fl_hip", "tau_est_fl_hip")])
def test_the_measured_torque_is_read_beside_the_commanded_one(torques: tuple[str, str], tmp_path: Path) -> None:
    log = read(table(tmp_path, "time", "fl_hip_q", *torques))
    assert log.effort is not None
    assert log.effort[0, 0] == 3.0


@pytest.mark.parametrize(
    ("chosen", "columns", "order"),
    [
        ("unitree", [f"q_{k}" for k in range(12)], UNITREE),
        ("isaac", [f"dof_pos_{k}" for k in range(12)], BY_LEG),
        ("isaac", [f"q_{k}" for k in range(12)], BY_LEG),
        ("isaaclab", [f"joint_pos[{k}]" for k in range(12)], BY_PART),
        ("cheetah", [f"data_q_{k}" for k in range(12)], UNITREE),
    ],
)
def test_presets_number_the_joints(chosen: str, columns: list[str], order: list[str], tmp_path: Path) -> None:
    path = table(tmp_path, "time", *columns)
    with pytest.raises(RecordingError, match=rf"no column '<joint>\.position'.*--columns.* {chosen}\b"):
        read(path)
    assert list(read_as(path, columns=chosen).joints) == order
    log = read_as(path, order[::-1], columns=chosen)
    assert log.position[0].tolist() == [float(k) for k in range(12, 0, -1)]


def test_names_of_other_things_are_no_joints(tmp_path: Path) -> None:
    log = read(table(tmp_path, "t", "q_FL_hip", "q_des_FL_hip", "q_cmd_FL_hip", "FL_foot_pos", "base_pos", "pos_x"))
    assert log.joints == ("FL_hip",)
    assert any("q_cmd_FL_hip" in note for note in log.notes)


def test_joints_are_found_by_leg_and_part(tmp_path: Path) -> None:
    path = table(tmp_path, "t", "q_fl_hip", "q_fl_thigh", "q_fl_calf", "q_fr_hip", "q_fr_thigh", "q_fr_calf")
    log = read(path, joints=ANYMAL)
    assert log.position[0].tolist() == [1.0, 2.0, 3.0]
    assert any("joints found by leg and part, 'fl_hip' as 'LF_HAA'" in note for note in log.notes)
    with pytest.raises(RecordingError, match=r"no column 'LH_HAA\.position'"):
        read(path, joints=("LH_HAA", "LH_HFE", "LH_KFE"))


def test_leg_and_part_of_a_name() -> None:
    names = ("front_left_hip_x", "RR_2", "hl.kn", "LF_KFE", "rightHindThigh", "arm_joint_1", "FL_foot")
    assert places(names) == {
        "front_left_hip_x": ("LF", 0),
        "RR_2": ("RH", 2),
        "hl.kn": ("LH", 2),
        "LF_KFE": ("LF", 2),
        "rightHindThigh": ("RH", 1),
    }
    cheetah = ("fl_abad", "fl_hip", "fl_knee")
    assert matched(ANYMAL, cheetah) == dict(zip(ANYMAL, cheetah, strict=True))
    assert matched(ANYMAL, (*cheetah, "FL_calf")) is None


@pytest.mark.parametrize(("unit", "factor"), [("ns", 1e9), ("us", 1e6), ("ms", 1e3)])
def test_unix_stamps_are_recognised(unit: str, factor: float, tmp_path: Path) -> None:
    log = read(table(tmp_path, "time", "a.position", first=1.7e9 * factor, step=0.002 * factor))
    np.testing.assert_allclose(log.time, 1.7e9 + 0.002 * np.arange(5), atol=5e-7)
    assert any(f"Unix time in {unit}" in note for note in log.notes)


def test_stamps_of_another_clock_are_not_unix() -> None:
    for first, step in ((1.7e9, 0.002), (1.7e12, 2e6), (5.0, 2.0), (0.0, 2e6)):
        assert unix_unit(first + step * np.arange(9)) == ""


def test_units_are_converted_and_noted(tmp_path: Path) -> None:
    imu = [f"imu.{quantity}.{axis}" for quantity in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
    path = table(tmp_path, "time", "a.position", "a.velocity", "a.effort", *imu, step=2.0)
    log = read_as(path, units="deg, rpm, gyro=deg/s, effort=mNm, g, ms")
    assert log.velocity is not None
    assert log.effort is not None
    assert log.imu is not None
    assert log.time[1] == pytest.approx(0.002)
    assert log.position[0, 0] == pytest.approx(np.pi / 180)
    assert log.velocity[0, 0] == pytest.approx(2 * 2 * np.pi / 60)
    assert log.effort[0, 0] == pytest.approx(3e-3)
    assert log.imu.angular_velocity[0, 0] == pytest.approx(4 * np.pi / 180)
    assert log.imu.linear_acceleration[0, 0] == pytest.approx(7 * 9.80665)
    (note,) = log.notes
    assert note == (
        "converted to SI units: time ms, position deg, velocity rpm, effort mNm, gyro deg/s, accelerometer g"
    )


def test_units_in_the_names_yield_to_those_asked_for(tmp_path: Path) -> None:
    path = table(tmp_path, "time [ms]", "a.position [deg]", "b.position", step=2.0)
    log = read(path)
    assert log.time[1] == pytest.approx(0.002)
    assert log.position[0].tolist() == pytest.approx([np.pi / 180, 2.0])
    assert read_as(path, units="rad").position[0].tolist() == pytest.approx([1.0, 2.0])


def test_a_bag_is_converted_and_has_stamps_of_its_own(tmp_path: Path) -> None:
    from bags import of_recording, write_mcap

    given = Recording(np.arange(5) * 0.01, ("a",), np.ones((5, 1)))
    bag = write_mcap(of_recording(given), tmp_path / "x.mcap")
    assert read_as(bag, units="deg").position[0, 0] == pytest.approx(np.pi / 180)
    with pytest.raises(RecordingError, match="messages have stamps: leave out --units ms,200Hz"):
        read_as(bag, units="deg,ms,200Hz")


@pytest.mark.parametrize(("units", "step", "unit"), [("ms", 0.004, "s"), ("us", 4.0, "ms"), ("ns", 4e3, "us")])
def test_a_unit_of_time_that_is_too_short_is_named(tmp_path: Path, units: str, step: float, unit: str) -> None:
    path = table(tmp_path, "time", "a.position", step=step)
    with pytest.raises(RecordingError, match=f"'time' seems to be in {unit}, not in {units}; add"):
        read_as(path, units=units)
    assert read_as(path, units=unit).time[1] == pytest.approx(0.004)


def test_rows_without_time_have_a_rate(tmp_path: Path) -> None:
    path = table(tmp_path, "a.position", "a.effort")
    with pytest.raises(RecordingError, match=r"no column 'time'.*--units 200Hz"):
        read(path)
    chunks = list(stream(LogFile(path, Topics(), ReadOptions.of(units="50Hz")), rows=2))
    assert [time for chunk in chunks for time in chunk.time] == pytest.approx([0, 0.02, 0.04, 0.06, 0.08])
    with pytest.raises(RecordingError, match="is a column of time, 't': leave out --units 50Hz"):
        read_as(table(tmp_path, "t", "a_pos"), units="50Hz")


MAP = """
joints = ["a", "b"]
[units]
position = "deg"
[columns]
time = "stamp"
"{joint}.position" = "p{n}"
"{joint}.effort" = ["torque {n}", "t{n}"]
"a.velocity" = { column = "va", unit = "rpm", factor = -2 }
"b.velocity" = "vb"
"""


def test_a_map_names_numbers_converts_and_flips(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(MAP)
    path = table(tmp_path, "stamp", "p1", "p2", "p3", "t1", "t2", "va", "vb")
    log = read_as(path, columns=str(tmp_path / "map.toml"))
    assert log.joints == ("a", "b")
    assert log.position[0].tolist() == pytest.approx([np.pi / 180, 2 * np.pi / 180])
    assert log.effort is not None
    assert log.velocity is not None
    assert log.effort[0].tolist() == [4.0, 5.0]
    assert log.velocity[0].tolist() == pytest.approx([6 * -2 * np.pi / 30, 7.0])
    assert any("p3" in note for note in log.notes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[colums]", "unknown key 'colums'; valid: about, base, joints"),
        ("columns = 3", r"\[columns\] needs to be a table"),
        ("time = ", "not a map of columns"),
        ('joints = "a"', "joints needs a list of names"),
        ('[columns]\ntime = "t"\n"a.position" = "nosuch"', r"no column 'nosuch', which .*map.toml has as 'a.position'"),
        ('[columns]\ntime = "time"', r"no column is a joint's position by .*; `stadera inspect LOG --columns` writes"),
        ('[columns]\n"{joint}.position" = "q{i}"', r'numbered joints need their order: joints = \["\.\.\."\]'),
        ('[columns]\n"{joint}.position" = "q"', r"\{joint\} and one of \{joint\}, \{i\}, \{n\} go together"),
        ('[columns]\n"{joint}.position" = "q{k}"', r"go together"),
        ('[columns]\n"a.position" = { column = "q0", unit = "Nm" }', "'a.position' has no unit 'Nm'; valid: rad, deg"),
        ('[columns]\n"a.position" = { column = "q0", factor = 0 }', "needs a factor that is a number and not 0"),
        ('[columns]\n"a.position" = { col = "q0" }', "needs the name of a column"),
        ('[units]\nposition = "furlong"', "unknown unit of position 'furlong'; valid: rad, deg"),
        ('base = "nosuch"', "no preset 'nosuch'; presets: cheetah, isaac"),
    ],
)
def test_a_map_that_does_not_fit_is_named(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(StaderaError, match=message) as caught:
        read_as(table(tmp_path, "time", "q0", "q1"), columns=str(tmp_path / "map.toml"))
    assert "\n" not in str(caught.value)


def test_a_map_may_build_on_a_preset(tmp_path: Path) -> None:
    joints = '["b", "a"]'
    (tmp_path / "map.toml").write_text(f'base = "plotjuggler"\njoints = {joints}')
    path = table(tmp_path, "__time", "/joint_states/position[0]", "/joint_states/position[1]")
    with pytest.raises(RecordingError, match=r'MAP\.toml, in which base = "plotjuggler" and joints = \["\.\.\."\] say'):
        read(path)
    assert read_as(path, columns=str(tmp_path / "map.toml")).joints == ("b", "a")


def test_every_preset_is_a_map() -> None:
    for name in preset_names():
        assert preset(name).about
        assert column_map(name).columns
    assert parsed("", "empty").joints == ()


def test_topics_of_a_table_are_asked_about(tmp_path: Path) -> None:
    path = table(tmp_path, "__time", "/state/a/position", "/command/a/position")
    with pytest.raises(RecordingError, match="joints of several topics: /state, /command; choose one with --joint-t"):
        read(path)
    assert read(LogFile(path, Topics(joint="/command"))).position[0, 0] == 2.0
    with pytest.raises(RecordingError, match="--joint-topic /no: no such topic; valid: /state, /command"):
        read(LogFile(path, Topics(joint="/no")))


def test_a_slower_imu_of_plotjuggler_is_interpolated(tmp_path: Path) -> None:
    """Rows of joints and IMU are their own; across a gap of the IMU there are no samples."""
    time = np.arange(400) * 0.005
    ramp = np.outer(time, [1.0, 2.0, 3.0])
    given = Recording(time, ("a",), np.sin(time)[:, None], effort=np.ones((400, 1)), imu=Imu(ramp, ramp + 9.81))
    path = plotjuggler(given, tmp_path / "pj.csv", imu_late=0.002)
    whole = read(path)
    assert len(whole) == 399
    assert whole.imu is not None
    np.testing.assert_allclose(whole.imu.angular_velocity[:-1], ramp[1:-1], atol=1e-6)  # stamps are whole µs
    np.testing.assert_allclose(whole.position[:, 0], np.sin(time[1:]), atol=1e-9)
    assert any("the IMU is interpolated" in note for note in whole.notes)
    parts = list(stream(path, rows=100))
    np.testing.assert_array_equal(np.concatenate([part.time for part in parts]), whole.time)


def test_the_template_reads_the_log_that_it_was_made_of(tmp_path: Path) -> None:
    path = table(tmp_path, "timestamp", *(f"motor_state_{k}_q" for k in range(12)), "battery")
    (tmp_path / "map.toml").write_text(template(path, ReadOptions()))
    assert 'not used: "battery"' in (tmp_path / "map.toml").read_text()
    np.testing.assert_array_equal(read_as(path, columns=str(tmp_path / "map.toml")).position, read(path).position)
    numbered = table(tmp_path, "time", *(f"q_{k}" for k in range(12)), name="numbered.csv")
    assert '"FL_hip_joint.position" = "q_' in template(numbered, ReadOptions())
    assert "check that this is their order" in template(numbered, ReadOptions())
    strange = table(tmp_path, "x", "y", name="strange.csv")
    assert "Nothing was recognised" in template(strange, ReadOptions())


def test_units_are_named() -> None:
    for text, message in (("furlong", "unknown unit 'furlong'; valid: s, ms"), ("gyro=g", "unknown unit of gyro 'g'")):
        with pytest.raises(StaderaError, match=message):
            Units.parse(text)
    with pytest.raises(StaderaError, match="unknown quantity with a unit 'speed'"):
        Units.parse("speed=deg/s")
    with pytest.raises(RecordingError, match="above 0 Hz"):
        Units.parse("0Hz")


def test_a_packed_table_that_is_cut_off_is_named(tmp_path: Path) -> None:
    whole = gzip.compress(table(tmp_path, "time", "a.position").read_bytes() + b"1,1\n" * 99999)
    (tmp_path / "cut.csv.gz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(RecordingError, match=r"cut\.csv\.gz: "):
        read(tmp_path / "cut.csv.gz")


def test_a_log_without_torques_says_what_would_do(tmp_path: Path) -> None:
    with pytest.raises(
        RecordingError, match=r"no torque is recorded: record it, or <joint>\.position_desired for --pd"
    ):
        read(table(tmp_path, "time", "a.position"), require=("effort",))
