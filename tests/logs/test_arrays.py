"""NumPy's and MATLAB's arrays as tables; pickles are never read."""

from __future__ import annotations

import pickle
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import io

from stadera.errors import RecordingError
from stadera.logs import LogFile, Topics, read, stream
from stadera.logs.topics import ReadOptions

TIME = np.arange(40) * 0.01
MANY = np.arange(480.0).reshape(40, 12)


def npz(folder: Path, **arrays: Any) -> Path:
    np.savez(folder / "log.npz", **arrays)
    return folder / "log.npz"


def test_columns_may_be_arrays_of_their_own(tmp_path: Path) -> None:
    log = read(npz(tmp_path, time=TIME, **{"a.position": TIME.astype(np.float32), "b.position": np.arange(40)}))
    assert log.joints == ("a", "b")
    np.testing.assert_array_equal(log.position[:, 1], np.arange(40))


@pytest.mark.parametrize(
    "array", [MANY, np.asfortranarray(MANY), MANY.T, MANY.astype(">f4")], ids=lambda a: str(a.flags.f_contiguous)
)
def test_arrays_in_any_order(array: np.ndarray, tmp_path: Path) -> None:
    joints = [f"j{k}" for k in range(12)]
    log = read(npz(tmp_path, time=TIME[:, None], position=array, joints=joints))
    np.testing.assert_array_equal(log.position, MANY)


def test_numbered_arrays_need_their_order(tmp_path: Path) -> None:
    path = npz(tmp_path, t=TIME, q=MANY, dq=MANY, tau=MANY, gyro=MANY[:, :3], acc=MANY[:, :3])
    with pytest.raises(RecordingError, match=r"no column '<joint>\.position'.*isaac or isaaclab or unitree.*differ in"):
        read(path)
    log = read(LogFile(path, Topics(), ReadOptions.of("unitree")))
    assert log.joints[:2] == ("FR_hip_joint", "FR_thigh_joint")
    np.testing.assert_array_equal(log.effort, MANY)
    assert log.imu is not None


def test_any_list_of_as_many_names_is_that_of_the_joints(tmp_path: Path) -> None:
    joints = [f"left_{k}_joint" for k in range(12)]
    feet, acted = ["left", "right"], joints[:6]
    path = npz(
        tmp_path, t=TIME, q=MANY, tau_est=MANY + 1, gyro=MANY[:, :3], acc=MANY[:, :3], action=MANY[:, :6],
        feet=feet, acted=acted, joint_order=joints,
    )  # fmt: skip
    log = read(path)
    assert log.joints == tuple(joints)
    np.testing.assert_array_equal(log.effort, MANY + 1)
    assert log.imu is not None
    assert any("order of the log's list" in note for note in log.notes)
    assert read(LogFile(path, Topics(), ReadOptions.of("unitree"))).joints[0] == "FR_hip_joint"
    with pytest.raises(RecordingError, match=r"no column '<joint>\.position'"):
        read(npz(tmp_path, t=TIME, q=MANY, tau=MANY, acted=acted))


def test_nan_is_a_dropout(tmp_path: Path) -> None:
    holed = TIME.copy()
    holed[7] = np.nan
    log = read(npz(tmp_path, time=TIME, **{"a.position": holed}))
    assert len(log) == 39
    assert "dropped 1 of 40 samples" in log.notes[0]


def test_lengths_that_differ_are_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"'a\.position' has 39 values, 'time' has 40"):
        read(npz(tmp_path, time=TIME, **{"a.position": TIME[1:]}))


def test_memory_is_flat_in_the_length_of_a_numpy_table(tmp_path: Path) -> None:
    joints = [f"j{k}" for k in range(12)]
    peaks = []
    for samples in (50_000, 400_000):
        path = npz(tmp_path, time=np.arange(samples) * 1e-3, position=np.zeros((samples, 12)), joints=joints)
        tracemalloc.start()
        assert sum(len(chunk) for chunk in stream(path, rows=10_000)) == samples
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]


def test_structs_of_matlab_are_flattened(tmp_path: Path) -> None:
    """As the Cheetah's logs are converted: a struct a channel, samples along the rows, a clock of its own each."""
    data = {"lcm_timestamp": TIME[None, :], "q": MANY, "qd": MANY, "tau_est": MANY}
    other = {"lcm_timestamp": np.arange(90.0)[None, :], "omega": np.zeros((90, 3))}
    io.savemat(tmp_path / "log.mat", {"leg_control_data": data, "microstrain": other})
    log = read(tmp_path / "log.mat")
    assert log.joints[:4] == ("FR_hip_joint", "FR_thigh_joint", "FR_calf_joint", "FL_hip_joint")
    np.testing.assert_array_equal(log.effort, MANY)
    np.testing.assert_array_equal(log.time, TIME)


def test_columns_of_matlab(tmp_path: Path) -> None:
    io.savemat(tmp_path / "log.mat", {"t": TIME, "FL_hip_joint_position": TIME, "note": "walk 3"})
    assert read(tmp_path / "log.mat").joints == ("FL_hip_joint",)


def _pickled(path: Path) -> None:
    path.write_bytes(pickle.dumps({"time": TIME}))


def _torch(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("log/data.pkl", pickle.dumps(TIME))


def _objects(path: Path) -> None:
    np.save(path, {"time": TIME}, allow_pickle=True)  # type: ignore[arg-type]


def _objects_in_npz(path: Path) -> None:
    np.savez(path, time=TIME, q=np.array([{"a": 1}], dtype=object))


def _hdf5_of_matlab(path: Path) -> None:
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n")


@pytest.mark.parametrize(
    ("name", "make", "message"),
    [
        (
            "log.pkl",
            _pickled,
            r"pickle can run any code.*import numpy, pickle; numpy\.savez\('log\.npz', \*\*pickle\.load",
        ),
        ("log.csv", _pickled, "pickle can run any code"),
        ("log.pt", _torch, r"import numpy, torch; numpy\.savez\('log\.npz', .*weights_only=True"),
        ("log.npy", _objects, r"numpy\.savez\('log\.npz', \*\*numpy\.load\(.*allow_pickle=True\)\.item\(\)\)"),
        ("log.npz", _objects_in_npz, "array 'q' holds pickled objects, which can run any code and are not read"),
        ("log.npy", lambda path: np.save(path, MANY), r"an array without names of columns.*position=a\[:, 1:13\]"),
        ("log.mat", _hdf5_of_matlab, r"MATLAB's version 7\.3 is not read; .*'-v7'"),
        ("log.h5", lambda path: path.write_bytes(b"\x89HDF\r\n\x1a\n0000"), "HDF5 is not read.*import h5py"),
        ("log.npz", lambda path: path.write_bytes(b"PK\x03\x04 and no more"), "not what its name says"),
        ("log.mat", lambda path: path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(200)), "damaged MATLAB file"),
    ],
)
def test_what_is_not_read_says_how_to_convert_it(name: str, make: Any, message: str, tmp_path: Path) -> None:
    make(tmp_path / name)
    with pytest.raises(RecordingError, match=message) as caught:
        read(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_the_lines_that_convert_a_pickle_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("log.pkl").write_bytes(pickle.dumps({"time": TIME, "a.position": TIME}))
    with pytest.raises(RecordingError) as caught:
        read("log.pkl")
    exec(str(caught.value).partition("in Python: ")[2], {})
    assert read("log.npz").joints == ("a",)
