"""Bad logs: each is weighed right or refused in one line, and weighed right by the option named in that line.

The robot is a HyQ that stands in six attitudes, worked out by Pinocchio (`standing.static_log`).
"""

from __future__ import annotations

import json
import pickle
import re
import sys
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bags import Sent, of_recording, write_mcap
from checks.test_diagnosis import flipped, legs_swapped, with_imu
from robot.robot_files import quadruped
from stadera.logs import Imu, Recording, take, write_table
from stadera.robot import Robot, load_robot
from standing import GRAVITY, StandingRobot, static_log

DEGREE = np.pi / 180.0
ALL = ("position", "velocity", "effort")
SIDES = (("LF", "RF"), ("LH", "RH"))
ENDS = (("LF", "LH"), ("RF", "RH"))


@pytest.fixture(scope="module")
def hyq() -> Robot:
    return load_robot("hyq")


@pytest.fixture(scope="module")
def clean(hyq: Robot) -> Recording:
    return static_log(hyq)


def scaled(log: Recording, **factors: float) -> Recording:
    return replace(log, **{name: factor * getattr(log, name) for name, factor in factors.items()})


def _mirrored(log: Recording, robot: Robot) -> Recording:
    right = [joint for leg in ("RF", "RH") for joint in robot.leg(leg).joints]
    sign = np.where(np.isin(log.joints, right), -1.0, 1.0)
    return replace(log, **{channel: getattr(log, channel) * sign for channel in ALL})


def _without_gravity(log: Recording, robot: Robot) -> Recording:
    assert log.imu is not None
    assert log.imu.orientation is not None
    up = Rotation.from_quat(log.imu.orientation).inv().apply([0.0, 0.0, GRAVITY])
    return with_imu(log, linear_acceleration=log.imu.linear_acceleration - up)


def _hanging(log: Recording, robot: Robot) -> Recording:
    plant = StandingRobot(robot)
    held = np.array([plant.holding(q, np.eye(3)) for q in log.position[::50]]).repeat(50, axis=0)
    rng = np.random.default_rng(0)
    still = np.array([0.0, 0.0, GRAVITY]) + 0.02 * rng.normal(size=(len(log), 3))
    assert log.imu is not None
    return replace(
        log,
        effort=held + 0.01 * rng.normal(size=held.shape),
        imu=Imu(log.imu.angular_velocity, still, None, robot.trunk),
    )


Case = tuple[Callable[[Recording, Robot], Recording], str, tuple[str, ...]]
GALLERY: dict[str, Case] = {
    "degrees": (lambda log, r: scaled(log, position=1 / DEGREE), "in degrees", ("--units", "deg")),
    "milliseconds": (lambda log, r: scaled(log, time=1e3), "time seems to be in ms", ("--units", "ms")),
    "microseconds": (lambda log, r: scaled(log, time=1e6), "time seems to be in us", ("--units", "us")),
    "degrees and milliseconds": (
        lambda log, r: scaled(log, time=1e3, position=1 / DEGREE),
        "time seems to be in ms",
        ("--fix",),
    ),
    "g": (
        lambda log, r: with_imu(log, linear_acceleration=log.imu.linear_acceleration / 9.80665),
        "units of g",
        ("--units", "g"),
    ),
    "g without an orientation": (
        lambda log, r: with_imu(log, linear_acceleration=log.imu.linear_acceleration / 9.80665, orientation=None),
        "units of g",
        ("--fix",),
    ),
    "gyro in deg/s": (
        lambda log, r: with_imu(log, angular_velocity=log.imu.angular_velocity / DEGREE),
        "the gyro contradicts the feet that stand, which turn less, as one in deg/s would",
        ("--units gyro=deg/s",),
    ),
    "gyro in deg/s with an offset": (
        lambda log, r: with_imu(log, angular_velocity=(log.imu.angular_velocity + 0.004) / DEGREE, orientation=None),
        "the gyro seems to be in deg/s",
        ("--units gyro=deg/s",),
    ),
    "gravity removed": (_without_gravity, "gravity seems to have been taken out", ("--fix",)),
    "left and right legs swapped": (
        lambda log, r: legs_swapped(log, r, SIDES, *ALL),
        "left and right legs are swapped",
        (),
    ),
    "front and hind legs swapped": (
        lambda log, r: legs_swapped(log, r, ENDS, *ALL),
        "front and hind legs are swapped",
        ("--fix",),
    ),
    "torques of front and hind legs swapped": (
        lambda log, r: legs_swapped(log, r, ENDS, "effort"),
        "the torques of front and hind legs are swapped",
        (),
    ),
    "mirrored side": (_mirrored, "of the right legs have the other sign", ()),
    "torques reversed": (lambda log, r: flipped(log, log.joints), "signs of all torques", ()),
    "torques of motors": (lambda log, r: scaled(log, effort=1 / 9.0), "--gear RATIO", ("--gear", "9")),
    "in the air": (_hanging, "a log for `stadera identify`", ()),
}
"""By name: how the log is made wrong, what is said, and the options with which it is weighed right; none: there are
none."""


def mass_of(run: Callable[..., object], log: Path, folder: Path, *options: str) -> float:
    out = folder / "out.json"
    finished = run("weigh", log, "--robot", "hyq", "--json", out, *options)
    assert finished.code == 0, finished.err
    return float(json.loads(out.read_text())["trunk"]["mass"]["value"])


@pytest.fixture(scope="module")
def right(clean: Recording, hyq: Robot) -> float:
    """kg, by the log as it should be."""
    from stadera.weigh import weigh

    return float(weigh(hyq, clean).mass)


@pytest.mark.parametrize("name", GALLERY)
def test_a_bad_log_is_refused_in_one_line(
    run, hyq: Robot, clean: Recording, right: float, name: str, tmp_path: Path
) -> None:
    corrupt, words, options = GALLERY[name]
    log = write_table(corrupt(clean, hyq), tmp_path / "log.parquet")
    finished = run("weigh", log, "--robot", "hyq")
    assert finished.code == 1
    assert re.fullmatch(r"stadera: error: [^\n]+\n", finished.err), finished.err
    assert words in finished.err
    if options:
        assert options[0] in finished.err
        assert mass_of(run, log, tmp_path, *" ".join(options).split()) == pytest.approx(right, rel=2e-3)


def test_inspect_names_what_weigh_refuses(run, hyq: Robot, clean: Recording, tmp_path: Path) -> None:
    log = write_table(legs_swapped(clean, hyq, ENDS, *ALL), tmp_path / "log.parquet")
    shown = " ".join(run("inspect", log, "--robot", "hyq").out.split())
    assert "front and hind legs are swapped" in shown
    assert "nothing wrong" not in shown
    assert "swapped: as recorded" not in " ".join(run("inspect", log, "--robot", "hyq", "--fix").out.split())


def test_force_marks_what_is_wrong(run, hyq: Robot, clean: Recording, tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    log = write_table(legs_swapped(clean, hyq, SIDES, *ALL), tmp_path / "log.parquet")
    assert run("weigh", log, "--robot", "hyq", "--force", "--json", out).code == 0
    trust = json.loads(out.read_text())["trust"]
    assert trust["verdict"] == "bad"
    assert any("left and right legs are swapped" in reason for reason in trust["reasons"])


def test_a_bag_that_is_cut_off_is_weighed_to_its_end(run, clean: Recording, right: float, tmp_path: Path) -> None:
    log = write_mcap(of_recording(clean), tmp_path / "log.mcap")
    whole = log.read_bytes()
    log.write_bytes(whole[: round(0.8 * len(whole))])
    assert mass_of(run, log, tmp_path) == pytest.approx(right, rel=2e-3)


def of_stamps(log: Recording, stamps: np.ndarray) -> list[Sent]:
    """Messages, one by one, for stamps that no recording could have."""
    joined = []
    for k, stamp in enumerate(stamps):
        one = take(log, slice(k, k + 1))
        joined += of_recording(replace(one, time=np.array([stamp])))
    return joined


@pytest.mark.parametrize("clock", ["jumps", "stands still"])
def test_a_clock_is_repaired_by_the_second_one(run, clean: Recording, right: float, clock: str, tmp_path: Path) -> None:
    """Header stamps that are wrong, times of recording that are right."""
    stamps = clean.time.copy()
    if clock == "jumps":
        stamps[150:] += 3600.0
    else:
        stamps[150:170] = stamps[150]
    wrong = of_stamps(clean, stamps)
    sent = [s._replace(received=r.received) for s, r in zip(wrong, of_recording(clean), strict=True)]
    assert mass_of(run, write_mcap(sent, tmp_path / "log.mcap"), tmp_path) == pytest.approx(right, rel=2e-3)


IN_THE_AIR: dict[str, tuple[Callable[[Recording], Recording], str, tuple[str, ...]]] = {
    "degrees": (lambda log: scaled(log, position=1 / DEGREE), "in degrees", ("--units", "deg")),
    "milliseconds": (lambda log: scaled(log, time=1e3), "time seems to be in ms", ("--units", "ms")),
    "velocities in deg/s": (lambda log: scaled(log, velocity=1 / DEGREE), "in deg/s", ("--fix",)),
    "knee mirrored": (lambda log: flipped_knee(log), "with the other sign", ()),
}


def flipped_knee(log: Recording) -> Recording:
    sign = np.array([1.0, 1.0, -1.0])
    return replace(log, **{channel: getattr(log, channel) * sign for channel in ALL})


@pytest.mark.parametrize("name", IN_THE_AIR)
def test_bad_logs_of_legs_in_the_air(run, swing: Recording, name: str, tmp_path: Path) -> None:
    corrupt, words, options = IN_THE_AIR[name]
    log = write_table(corrupt(swing), tmp_path / "log.parquet")
    finished = run("identify", log, "--robot", "hyq", "--legs", "RH")
    assert finished.code == 1
    assert re.fullmatch(r"stadera: error: [^\n]+\n", finished.err), finished.err
    assert words in finished.err
    if options:
        assert run("identify", log, "--robot", "hyq", "--legs", "RH", *options).code == 0


def test_a_robot_on_its_feet_tells_drives_and_trunk(run, clean: Recording, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    finished = run("identify", write_table(clean, tmp_path / "log.parquet"), "--robot", "hyq", "--report", page)
    assert finished.code == 0, finished.err
    assert "by a robot on its feet: rotor inertia of " in " ".join(finished.out.split())
    assert "RMSE" not in finished.out, "torques carry the robot: no errors, and no empty table of them"
    assert 'id="errors"' not in (shown := page.read_text(encoding="utf-8"))
    assert "nothing was held out" not in shown


def test_a_tare_before_the_log_counts_from_its_beginning(run, clean: Recording, tmp_path: Path) -> None:
    log = write_table(replace(clean, time=clean.time + 1.7e9), tmp_path / "log.parquet")
    found = []
    for tare in ("0:1", "1700000000:1700000001"):
        finished = run("weigh", log, "--robot", "hyq", "--tare", tare, "--json", tmp_path / "out.json")
        assert finished.code == 0, finished.err
        found.append(json.loads((tmp_path / "out.json").read_text())["payload"]["mass"])
        told = " ".join(finished.out.split())
        assert told.count("1700000000") == 1, "the log's own clock is named once"
        assert "times count from the log's beginning, 1700000000.000 s" in told
    assert found[0] == found[1]
    finished = run("weigh", log, "--robot", "hyq", "--tare", "100:101")
    assert finished.code == 1
    assert "100 to 101 s, lies outside the log, which is 2.99 s long" in finished.err


# -- models and files ----------------------------------------------------------------------------------------------

MODELS: dict[str, tuple[Callable[[str], str], str]] = {
    "no inertial.urdf": (
        lambda text: re.sub(r'(<link name="lf_shank">)<inertial>.*?</inertial>', r"\1", text, count=1),
        "'lf_shank' has mass 0 kg; it must be positive: it has no <inertial>",
    ),
    "decimal comma.urdf": (
        lambda text: text.replace('ixx="0.01"', 'ixx="0,05"', 1),
        "<inertia ixx='0,05'> needs 1 number(s), with decimal points",
    ),
    "limits.urdf": (
        lambda text: text.replace('lower="-2" upper="2"', 'lower="2" upper="-2"', 1),
        "joint 'lf_a': its lower limit 2 rad is above its upper limit -2 rad",
    ),
    "grams.urdf": (lambda text: text.replace('mass value="20.0"', 'mass value="20000"', 1), "in kg, not in grams"),
    "empty.urdf": (lambda text: "", "a robot is a URDF or an MJCF file, and this is not XML"),
    "without its packages.urdf.xacro": (
        lambda text: text.replace(
            '<robot name="toy">', '<robot name="toy" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include '
            'filename="$(find elsewhere)/x.xacro"/>'
        ),
        "xacro without its packages.urdf.xacro > without its packages.urdf",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MODELS)
def test_a_bad_model_is_refused_in_one_line(run, clean: Recording, name: str, tmp_path: Path) -> None:
    corrupt, words = MODELS[name]
    model = tmp_path / name
    model.write_text(corrupt(quadruped()))
    log = write_table(clean, tmp_path / "log.parquet")
    for finished in (run("inspect", model), run("weigh", log, "--robot", model)):
        assert finished.code == 1
        assert re.fullmatch(r"stadera: error: [^\n]+\n", finished.err), finished.err
        assert words in finished.err


def test_without_xacro_its_extra_is_named(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    model = tmp_path / "robot.urdf.xacro"
    model.write_text(quadruped())
    finished = run("inspect", model)
    assert finished.code == 1
    assert re.fullmatch(r"stadera: error: [^\n]+\n", finished.err), finished.err
    assert "stadera[xacro]" in finished.err


def _zipped(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("walk.csv", "time,a.position\n0,1\n")


FILES: dict[str, tuple[Callable[[Path], object], str]] = {
    "log.pkl": (lambda path: path.write_bytes(pickle.dumps({"a": 1})), "numpy.savez('log.npz', **pickle.load(open("),
    "log.zip": (_zipped, "a zip archive; unpack it and give the log in it: walk.csv"),
    "folder": (lambda path: path.mkdir(), "a directory, not a log; accepted:"),
    **{
        f"empty.{kind}": (lambda path: path.write_bytes(b""), "the file is empty; accepted:")
        for kind in ("csv", "parquet", "mcap", "db3", "bag", "npz")
    },
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_is_no_log_is_refused_in_one_line(run, name: str, tmp_path: Path) -> None:
    make, words = FILES[name]
    make(tmp_path / name)
    for finished in (run("weigh", tmp_path / name, "--robot", "hyq"), run("inspect", tmp_path / name)):
        assert finished.code == 1
        assert re.fullmatch(r"stadera: error: [^\n]+\n", finished.err), finished.err
        assert words in finished.err


def test_two_topics_are_listed_and_one_is_chosen(run, clean: Recording, right: float, tmp_path: Path) -> None:
    sent = list(of_recording(clean))
    both = sorted([*sent, *(s._replace(topic=f"/other{s.topic}") for s in sent)], key=lambda s: s.received)
    log = write_mcap(both, tmp_path / "log.mcap")
    finished = run("weigh", log, "--robot", "hyq")
    assert finished.code == 1
    assert re.fullmatch(r"stadera: error: [^\n]+\n", finished.err), finished.err
    assert "100 Hz, 12 joints), /other/joint_states" in finished.err
    assert "choose one with --joint-topic" in finished.err
    chosen = ("--joint-topic", "/joint_states", "--imu-topic", "/imu/data")
    assert mass_of(run, log, tmp_path, *chosen) == pytest.approx(right, rel=2e-3)
