"""Bags: topics chosen, streams that were not taken together, publishers that share a topic, and damage."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from scipy.spatial.transform import Rotation

from bags import Sent, imu, joints, text, write_folder, write_mcap, write_ros1
from stadera.errors import RecordingError
from stadera.logs import LogFile, Topics, read, stream
from stadera.logs.bags.alignment import Alignment, Track
from stadera.logs.bags.container import BagSettings, Decoded

NAMES = ("LF_HAA", "LF_HFE", "LF_KFE")
RATE = 1000.0


def state(time: float, names: tuple[str, ...] = NAMES, **options: object) -> Sent:
    """Position, velocity, effort that say when and whose they are: linear in time, other for each joint."""
    own = np.array([1.0 + NAMES.index(name) for name in names])
    return joints(time, names, own * time, own, -own * time, **options)


def moving(time: float, **options: object) -> Sent:
    """Gyro and specific force linear in time, turning evenly about z."""
    turn = Rotation.from_rotvec([0.0, 0.0, 0.4 * time]).as_quat()
    return imu(time, (time, 0.0, 0.4), (0.0, -time, 9.81), turn, **options)


def by_time(*streams: Iterator[Sent] | list[Sent]) -> list[Sent]:
    return sorted((sent for part in streams for sent in part), key=lambda sent: sent.received)


def steady(count: int = 400, rate: float = RATE, start: float = 5.0) -> list[float]:
    return [start + k / rate for k in range(count)]


def bag(folder: Path, *streams: Iterator[Sent] | list[Sent], **options: object) -> Path:
    return write_mcap(by_time(*streams), folder / "log.mcap", **options)


def add(track: Track, stamp: int, values: np.ndarray, received: int | None = None) -> None:
    times = np.array([stamp]), np.array([stamp if received is None else received])
    track.take(Decoded(track.name, times[1], times[0], "", track.columns, values[None]))


# -- topics -------------------------------------------------------------------------------------------------------


def test_topics_are_found_by_type(tmp_path: Path) -> None:
    times = steady()
    path = bag(tmp_path, map(state, times), map(moving, times), [text(t) for t in times])
    log = read(path)
    assert log.joints == NAMES
    assert log.imu is not None
    assert log.imu.frame == "imu_link"
    np.testing.assert_allclose(log.position, np.outer(times, [1, 2, 3]), atol=1e-12)


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_folders_of_both_storages(tmp_path: Path, storage: StoragePlugin) -> None:
    times = steady()
    log = read(write_folder(by_time(map(state, times), map(moving, times)), tmp_path / "bag", storage))
    assert len(log) == len(times)
    assert log.imu is not None


@pytest.mark.parametrize("compression", list(CompressionType))
def test_compressions(tmp_path: Path, compression: CompressionType) -> None:
    assert len(read(bag(tmp_path, map(state, steady()), compression=compression))) == 400


@pytest.mark.parametrize("compression", [None, *Ros1Writer.CompressionFormat])
def test_compressions_of_ros_1(tmp_path: Path, compression: Ros1Writer.CompressionFormat | None) -> None:
    path = write_ros1(by_time(map(state, steady()), map(moving, steady())), tmp_path / "x.bag", compression=compression)
    log = read(path)
    np.testing.assert_allclose(log.position, np.outer(steady(), [1, 2, 3]), atol=1e-12)
    assert log.imu is not None
    assert log.imu.frame == "imu_link"


def test_several_topics_of_a_type_are_listed(tmp_path: Path) -> None:
    times = steady()
    path = bag(tmp_path, map(state, times), (state(t, topic="/commands") for t in times))
    with pytest.raises(
        RecordingError,
        match=(
            r"/commands \(sensor_msgs/msg/JointState, 1000 Hz, 3 joints\), /joint_states .*; "
            "choose one with --joint-topic"
        ),
    ):
        read(path)
    assert len(read(LogFile(path, Topics(joint="/commands")))) == len(times)
    path = bag(tmp_path, map(state, times), map(moving, times), (moving(t, topic="/imu/raw") for t in times))
    with pytest.raises(
        RecordingError, match=r"/imu/data \(.*, 1000 Hz\), /imu/raw \(.*\); choose one with --imu-topic"
    ):
        read(path)
    assert read(LogFile(path, Topics(imu="/imu/raw"))).imu is not None


def test_a_topic_that_is_not_there_or_of_another_type(tmp_path: Path) -> None:
    path = bag(tmp_path, map(state, steady()), [text(5.0)])
    with pytest.raises(RecordingError, match="no such topic; topics of joints' states: /joint_states"):
        read(LogFile(path, Topics(joint="/nothing")))
    with pytest.raises(RecordingError, match="is a std_msgs/msg/String"):
        read(LogFile(path, Topics(imu="/chatter")))
    path = bag(tmp_path, [text(5.0)])
    with pytest.raises(RecordingError, match=r"no topic of type .*JointState, .*; topics: /chatter"):
        read(path)


def test_a_table_has_no_topics(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time,a.position\n0,1\n1,1\n")
    with pytest.raises(RecordingError, match="--imu-topic /imu: a CSV table has no topics"):
        read(LogFile(path, Topics(imu="/imu")))


def test_no_imu_where_one_is_required(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"imu\.angular_velocity"):
        read(bag(tmp_path, map(state, steady())), require=("imu",))


# -- joints -------------------------------------------------------------------------------------------------------


def test_names_in_any_order(tmp_path: Path) -> None:
    times = steady()
    mixed = [state(t, NAMES if k % 3 else NAMES[::-1]) for k, t in enumerate(times)]
    log = read(bag(tmp_path, mixed), joints=NAMES)
    np.testing.assert_allclose(log.position, np.outer(times, [1, 2, 3]), atol=1e-12)


def test_effort_left_empty_is_not_recorded(tmp_path: Path) -> None:
    path = bag(tmp_path, (joints(t, NAMES, (1.0, 2.0, 3.0)) for t in steady()))
    assert read(path).effort is None
    with pytest.raises(RecordingError, match=r"LF_HAA\.effort"):
        read(path, require=("effort",))


def test_a_channel_of_nan_is_not_recorded(tmp_path: Path) -> None:
    """What a broadcaster of ROS publishes for interfaces that are not there."""
    nothing = np.full(3, np.nan)
    assert read(bag(tmp_path, (joints(t, NAMES, (1.0, 2.0, 3.0), nothing, nothing) for t in steady()))).velocity is None


def test_publishers_with_the_same_stamps_are_joined(tmp_path: Path) -> None:
    times = steady()
    path = bag(tmp_path, (state(t, NAMES[:1]) for t in times), (state(t, NAMES[1:]) for t in times))
    log = read(path, joints=NAMES)
    np.testing.assert_allclose(log.effort, -np.outer(times, [1, 2, 3]), atol=1e-12)


def test_publishers_with_other_stamps_are_interpolated(tmp_path: Path) -> None:
    times = np.array(steady())
    path = bag(tmp_path, (state(t, NAMES[1:]) for t in times), (state(t + 3e-4, NAMES[:1]) for t in times))
    log = read(path, joints=NAMES)
    np.testing.assert_allclose(log.position, np.outer(log.time, [1, 2, 3]), atol=1e-9)
    assert any("LF_HAA" in note and "interpolated" in note for note in log.notes)


def test_publishers_that_do_not_agree_are_refused(tmp_path: Path) -> None:
    times = steady()
    path = bag(tmp_path, map(state, times), (state(t, NAMES[:1]) for t in times))
    with pytest.raises(RecordingError, match="'LF_HAA' comes in messages of 3 and in messages of 1 joints"):
        read(path)


def test_joints_of_others_do_not_matter_where_not_asked_for(tmp_path: Path) -> None:
    times = steady()
    arm = [joints(t, ("gripper",), (1.0,)) for t in times[::7]]
    log = read(bag(tmp_path, map(state, times), arm), joints=NAMES, require=("effort",))
    assert len(log) == len(times)
    assert any(f"left out {len(arm)} messages" in note for note in log.notes)


# -- stamps -------------------------------------------------------------------------------------------------------


def test_an_imu_of_another_rate_is_interpolated_at_the_joints_stamps(tmp_path: Path) -> None:
    path = bag(tmp_path, map(state, steady(2000)), map(moving, steady(800, 400.0, 5.0003)))
    log = read(path, require=("imu",))
    assert log.imu is not None
    assert log.imu.orientation is not None
    inside = (log.time > 5.01) & (log.time < 6.9)
    assert inside.sum() > 1800
    np.testing.assert_allclose(log.imu.angular_velocity[:, 0], log.time, atol=1e-9)
    np.testing.assert_allclose(log.imu.linear_acceleration[:, 1], -log.time, atol=1e-9)
    expected = Rotation.from_rotvec(np.outer(log.time, [0, 0, 0.4]))
    assert (expected.inv() * Rotation.from_quat(log.imu.orientation)).magnitude().max() < 1e-9
    assert any("/imu/data (400 Hz) interpolated at the stamps of /joint_states (1000 Hz)" in n for n in log.notes)


def test_where_the_imu_is_silent_samples_are_dropped_and_named(tmp_path: Path) -> None:
    imus = [t for t in steady(2000) if not 5.5 < t < 5.7]
    log = read(bag(tmp_path, map(state, steady(2000)), map(moving, imus)))
    assert not ((log.time > 5.5001) & (log.time < 5.7)).any()
    assert any("1 gap, the longest 0.2" in note for note in log.notes)
    assert any("blank cells" in note for note in log.notes)


def test_clocks_of_two_topics_that_are_apart_are_set_by_the_recorders(tmp_path: Path) -> None:
    times = steady()
    log = read(bag(tmp_path, map(state, times), (moving(t - 100.0, received=t) for t in times)), require=("imu",))
    assert log.imu is not None
    np.testing.assert_allclose(log.imu.angular_velocity[:, 0], log.time - 100.0, atol=1e-6)
    assert any("clock of /imu/data is up to +100 s behind that of /joint_states" in note for note in log.notes)


@pytest.mark.parametrize("batch", [4096, 20])
def test_a_clock_that_drifts_follows_that_of_the_joints(batch: int) -> None:
    """By 0.3 ms a second, 14 ms in all, messages up to 8 ms late; in batches as of bags, and some at a time."""
    rng = np.random.default_rng(0)
    reference, other = Track("joints", ("a",)), Track("imu", ("b",))
    alignment, worst, uncorrected = Alignment([reference, other]), 0.0, 0.0
    for start in range(0, 45_000, batch):
        for time in 1e-3 * np.arange(start, start + batch):
            late = time + 8e-3 * rng.uniform() ** 2
            add(reference, round(1e9 * time), np.array([time]), round(1e9 * late))
            add(other, round(1e9 * (time + 3e-4 * time)), np.array([time]), round(1e9 * late))
        _, values = alignment.rows()
        error = np.nan_to_num(values[:, 1] - values[:, 0])
        worst = max(worst, float(np.abs(error).max(initial=0.0)))
        uncorrected = 3e-4 * (start + batch) * 1e-3
    assert uncorrected > 0.013
    assert worst < 9e-3  # 5 ms count as drift; the rest comes in a window of 5 s and two batches of 4 s
    assert other.apart < -5e-3


@pytest.mark.parametrize("step", [3600.0, 0.3, -0.3, -3600.0])
@pytest.mark.parametrize("who", ["sender", "recorder"])
def test_a_step_of_a_clock_is_undone(tmp_path: Path, step: float, who: str) -> None:
    """Of the headers' by the recorder's; of the recorder's nothing is felt."""
    rng = np.random.default_rng(0)
    sent = []
    for k, t in enumerate(steady(10_000)):
        moved = step * (k >= 6000)
        header, received = (t + moved, t) if who == "sender" else (t, t + moved)
        sent.append(joints(header, NAMES, (t, t, t), received=4000.0 + received + 2e-3 * rng.uniform()))
    log = read(write_mcap(sent, tmp_path / "log.mcap"))
    assert len(log) == 10_000
    np.testing.assert_allclose(log.time, steady(10_000), atol=3e-3)
    undone = [note for note in log.notes if f"steps 1 time, by up to {abs(step):.3g} s" in note]
    assert bool(undone) == (who == "sender")


def test_pauses_and_queues_that_empty_are_no_steps(tmp_path: Path) -> None:
    """A pause of a second; half a second held up and then sent at once; a queue that loses its oldest messages."""
    times = np.array([t for t in steady(9000) if not 7.0 < t < 8.0])
    received = times.copy()
    received[3000:3500] = times[3500]
    kept = np.ones(len(times), dtype=bool)
    kept[6000:6400] = False
    received[5900:6000] = times[6400]
    sent = [joints(t, NAMES, (t, t, t), received=r) for t, r in zip(times[kept], received[kept], strict=True)]
    log = read(write_mcap(sent, tmp_path / "log.mcap"))
    np.testing.assert_allclose(log.time, times[kept], atol=1e-9)
    assert not any("steps" in note for note in log.notes)


def test_stamps_that_repeat_or_run_back_are_left_out_and_counted(tmp_path: Path) -> None:
    times = steady()
    late = [state(times[100], received=times[102]), state(times[200] - 0.05, received=times[200])]
    log = read(bag(tmp_path, map(state, times), late))
    assert len(log) == len(times)
    assert any("left out 2 of 402 messages" in note for note in log.notes)


@pytest.mark.parametrize("resolution", [0.01, 1e9])
def test_where_stamps_stand_still_messages_are_as_late_as_recorded(tmp_path: Path, resolution: float) -> None:
    sent = [joints(t // resolution * resolution, NAMES, (t, t, t), received=t) for t in steady()]
    log = read(bag(tmp_path, sent))
    np.testing.assert_allclose(log.time, steady(), atol=1e-9)
    assert any("stamps of /joint_states repeat or run back: times of recording are used" in note for note in log.notes)


def test_stamps_that_stop_to_be_a_clock(tmp_path: Path) -> None:
    """They repeat from the middle on, after the beginning has shown a clock."""
    sent = [joints(min(t, 15.0), NAMES, (t, t, t), received=t) for t in steady(20_000)]
    with pytest.raises(RecordingError, match=r"/joint_states: the stamps .* are no clock"):
        read(bag(tmp_path, sent))


@settings(max_examples=30, deadline=None)
@given(
    steps=st.lists(st.integers(500_000, 1_500_000), min_size=4, max_size=40),
    at=st.lists(st.integers(0, 30_000_000), min_size=1, max_size=20),
)
def test_interpolation_is_numpys(steps: list[int], at: list[int]) -> None:
    stamps = np.cumsum(steps)
    values = np.sin(np.arange(len(stamps) * 2.0)).reshape(-1, 2)
    track = Track("any", ("a", "b"))
    for stamp, value in zip(stamps.tolist(), values, strict=True):
        add(track, stamp, value)
    track.settle()
    wanted = np.array(sorted(at))
    found = track.at(wanted)
    inside = (wanted >= stamps[0]) & (wanted <= stamps[-1])
    assert np.isnan(found[~inside]).all()
    for k in range(2):
        np.testing.assert_allclose(found[inside, k], np.interp(wanted[inside], stamps, values[:, k]), atol=1e-12)


# -- IMU ----------------------------------------------------------------------------------------------------------


def test_an_imu_without_orientation(tmp_path: Path) -> None:
    times = steady()
    log = read(bag(tmp_path, map(state, times), (imu(t, known=(False, True, True)) for t in times)))
    assert log.imu is not None
    assert log.imu.orientation is None
    log = read(bag(tmp_path, map(state, times), (imu(t, orientation=(0, 0, 0, 0), frame="/base") for t in times)))
    assert log.imu is not None
    assert log.imu.orientation is None
    assert log.imu.frame == "base"


def test_an_imu_without_acceleration_is_left_out(tmp_path: Path) -> None:
    times = steady()
    path = bag(tmp_path, map(state, times), (imu(t, known=(True, True, False)) for t in times))
    assert any("it has no linear_acceleration.x" in note for note in read(path).notes)


def test_an_imu_in_two_frames_is_left_out(tmp_path: Path) -> None:
    times = steady()
    path = bag(tmp_path, map(state, times), (imu(t, frame=f"imu_{k % 2}") for k, t in enumerate(times)))
    assert any("two frames, 'imu_0' and 'imu_1'" in note for note in read(path).notes)


# -- damage -------------------------------------------------------------------------------------------------------


def test_a_file_that_is_cut_off_is_read_up_to_there(tmp_path: Path) -> None:
    times = steady(4000)
    path = bag(tmp_path, map(state, times))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    log = read(path)
    assert 1000 < len(log) < 2600
    np.testing.assert_allclose(log.time, times[: len(log)], atol=1e-9)
    assert any("cut off or damaged after" in note for note in log.notes)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.9])
def test_a_ros_1_bag_that_is_cut_off_is_read_up_to_there(tmp_path: Path, share: float) -> None:
    times = steady(4000)
    path = write_ros1(by_time(map(state, times)), tmp_path / "log.bag")
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    log = read(path)
    assert 0.7 * share * 4000 < len(log) < 1.2 * share * 4000
    np.testing.assert_allclose(log.time, times[: len(log)], atol=1e-9)
    assert any("cut off or damaged after" in note for note in log.notes)


def test_a_damaged_chunk_of_a_ros_1_bag_is_left_out(tmp_path: Path) -> None:
    bz2 = Ros1Writer.CompressionFormat.BZ2
    path = write_ros1(by_time(map(state, steady(4000))), tmp_path / "log.bag", compression=bz2)
    content = bytearray(path.read_bytes())
    content[len(content) // 4] ^= 0xFF
    path.write_bytes(content)
    log = read(path)
    assert 3500 < len(log) < 4000
    assert any("1 damaged chunk" in note for note in log.notes)


def test_a_damaged_chunk_is_left_out(tmp_path: Path) -> None:
    times = steady(4000)
    path = bag(tmp_path, map(state, times), compression=CompressionType.NONE)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    log = read(path)
    assert 3500 < len(log) < 4000
    assert any("1 damaged chunk" in note for note in log.notes)


def test_a_database_that_is_cut_off_is_read_up_to_there(tmp_path: Path) -> None:
    times = steady(4000)
    (database,) = write_folder(by_time(map(state, times)), tmp_path / "bag").glob("*.db3")
    database.write_bytes(database.read_bytes()[: database.stat().st_size // 2 // 4096 * 4096])
    log = read(tmp_path / "bag")
    assert 1000 < len(log) < 4000
    np.testing.assert_allclose(log.time, times[: len(log)], atol=1e-9)
    assert any("cut off or damaged" in note for note in log.notes)


def test_damaged_messages_are_left_out_and_counted(tmp_path: Path) -> None:
    sent = [state(t) for t in steady()]
    sent[50] = sent[50]._replace(data=sent[50].data[:60])
    log = read(bag(tmp_path, sent))
    assert len(log) == 399
    assert any("left out 1 damaged message of /joint_states" in note for note in log.notes)


@pytest.mark.parametrize(
    "content", [b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + bytes(500), b"SQLite format 3\0" + bytes(500), b"#ROSBAG V2.0\n"]
)
def test_nothing_to_be_read_is_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "log"
    path.write_bytes(content)
    with pytest.raises(RecordingError) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_sqlite_database_that_is_no_bag(tmp_path: Path) -> None:
    import sqlite3
    from contextlib import closing

    with closing(sqlite3.connect(tmp_path / "x.db3")) as database:
        database.execute("CREATE TABLE notes (text)")
        database.commit()
    with pytest.raises(RecordingError, match="no bag that can be read"):
        read(tmp_path / "x.db3")


def test_files_of_a_folder_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    times = steady(1200)
    folder = tmp_path / "bag"
    folder.mkdir()
    for part in (0, 1, 2, 10):
        at = {10: 3}.get(part, part)
        write_mcap(by_time(map(state, times[300 * at : 300 * at + 300])), folder / f"bag_{part}.mcap")
    log = read(folder)
    np.testing.assert_allclose(log.time, times, atol=1e-9)
    assert any("number 3, 4, 5, 6, 7, 8, 9" in note for note in log.notes)


def test_a_folder_without_logs_and_one_packed_whole(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="a directory, not a log"):
        read(tmp_path)
    (tmp_path / "bag_0.db3.zstd").write_bytes(b"x")
    with pytest.raises(RecordingError, match="compressed as a whole; unpack it first"):
        read(tmp_path)


def test_another_encoding_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no topics in CDR"):
        read(bag(tmp_path, map(state, steady()), encoding="ros1"))


# -- memory -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("silent", [False, True])
def test_memory_does_not_grow_with_the_log(silent: bool) -> None:
    """However long the log is, and though the other stream falls silent."""
    reference, other = Track("joints", ("a",)), Track("imu", ("b",))
    alignment = Alignment([reference, other])
    rows = 0
    for start in range(0, 80_000, 4000):
        for k in range(start, start + 4000):
            add(reference, k * 1_000_000, np.zeros(1))
            if not (silent and k > 10_000):
                add(other, k * 1_000_000 + 300_000, np.zeros(1))
        stamps, _ = alignment.rows()
        rows += len(stamps)
        assert len(reference.stamps) <= (1000 * BagSettings().patience if silent else 4000)
        assert len(other.stamps) <= 4001
    assert rows >= 80_000 - len(reference.stamps)


def test_chunks_are_the_whole_for_streams_not_taken_together(tmp_path: Path) -> None:
    path = bag(tmp_path, map(state, steady(5000)), map(moving, steady(1800, 400.0, 5.2)))
    whole, parts = read(path), list(stream(path, rows=613))
    np.testing.assert_array_equal(np.concatenate([part.time for part in parts]), whole.time)
    assert whole.imu is not None
    gyro = np.concatenate([part.imu.angular_velocity for part in parts if part.imu is not None])
    np.testing.assert_array_equal(gyro, whole.imu.angular_velocity)
