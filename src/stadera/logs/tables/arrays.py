"""Reads named arrays as a table: NumPy's .npz and MATLAB's .mat.

An array of shape (samples,) is a column. One of shape (samples, k) is k columns: of the joints that the array `joints`
names for position, velocity, acceleration, effort and their desired values; x, y, z (w) for an IMU's vectors and a
foot's force; else they are numbered, name[0] to name[k-1], and any array of k texts may name their joints. Pickled
objects are never read.
"""

import subprocess
import sys
import zipfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from stadera.boundary import begins_with, foreign
from stadera.errors import RecordingError
from stadera.limits import Budget
from stadera.logs.batches import rows_at_once
from stadera.logs.columns import CHANNELS
from stadera.logs.tables import OpenTable, TableReader
from stadera.logs.topics import DESIRED
from stadera.types import Array

_AXES = {"angular_velocity": "xyz", "linear_acceleration": "xyz", "force": "xyz", "orientation": "xyzw"}
_JOINTS = "joints"
_NUMBERS = "fiub"
_DAMAGED_NPZ = "damaged NumPy file"


Column = tuple[str, int | None]
"""Location of a column: an array's name, and the index in it; None for a one-dimensional array."""


def columns_of_arrays(
    shapes: Mapping[str, tuple[int, ...]], joints: Sequence[str], budget: Budget
) -> dict[str, Column]:
    """Names of the columns in arrays of these shapes. Samples are along the longer side."""
    found: dict[str, Column] = {}
    for name, shape in shapes.items():
        sizes = [size for size in shape if size != 1]
        budget.require_columns(range(min(sizes) if len(sizes) == 2 else 1))
        if len(sizes) == 1:
            found[name] = name, None
        elif len(sizes) == 2:
            found |= {column: (name, k) for k, column in enumerate(_split(name, min(sizes), joints))}
    return found


def _split(name: str, width: int, joints: Sequence[str]) -> list[str]:
    axes = _AXES.get(name.rpartition(".")[-1], "")
    if name in (*CHANNELS, *DESIRED) and width == len(joints):
        return [f"{joint}.{name}" for joint in joints]
    return [f"{name}.{axis}" for axis in axes] if width == len(axes) else [f"{name}[{k}]" for k in range(width)]


def _is_npz(path: Path) -> bool:
    """True for a zip file of arrays."""
    if not path.is_file() or not zipfile.is_zipfile(path):
        return False
    with zipfile.ZipFile(path) as archive:
        return any(name.endswith(".npy") for name in archive.namelist())


def _opened_npz(budget: Budget) -> OpenTable:
    shapes, lists = _npz_header(budget)
    columns = columns_of_arrays(shapes, lists.get(_JOINTS, ()), budget)

    def batches(names: tuple[str, ...], rows: int | None) -> Iterator[Array]:
        return _batches(_npz_arrays({columns[name][0] for name in names}, budget), columns, names, budget.path)

    return OpenTable(tuple(columns), batches, orders=tuple(lists.values()))


def _opened_mat(budget: Budget) -> OpenTable:
    arrays = _mat_arrays(budget)
    shapes = {name: array.shape for name, array in arrays.items() if array.dtype.kind in _NUMBERS}
    texts = {name: array.ravel() for name, array in arrays.items() if array.dtype.kind == "U"}
    lists = {name: tuple(str(text).strip() for text in found) for name, found in texts.items()}
    columns = columns_of_arrays(shapes, lists.get(_JOINTS, ()), budget)
    orders = tuple(lists.values())
    return OpenTable(tuple(columns), lambda names, rows: _batches(arrays, columns, names, budget.path), orders=orders)


NPZ = TableReader("NumPy table", (".npz",), _is_npz, _opened_npz)
"""Unpacked on disk while it is read, with memory independent of its length."""
MAT = TableReader("MATLAB table", (".mat",), lambda path: begins_with(path, b"MATLAB 5.0"), _opened_mat)
"""MATLAB's up to version 7, as a whole; fields of structs are named struct.field."""


def _batches(
    arrays: Mapping[str, NDArray[Any]], columns: Mapping[str, Column], names: Sequence[str], path: Path
) -> Iterator[Array]:
    """The named columns, some rows at a time; NaN marks a blank cell, since arrays have no other mark."""
    places = {name: columns[name] for name in names}
    found = {name: _column(arrays[array], index) for name, (array, index) in places.items()}
    (first, samples), *others = ((name, len(column)) for name, column in found.items())
    if wrong := next(((name, length) for name, length in others if length != samples), None):
        raise RecordingError(f"{path}: {wrong[0]!r} has {wrong[1]} values, {first!r} has {samples}; both need as many")
    count = min(16384, rows_at_once(len(names)))
    for start in range(0, samples, count):
        yield np.array([column[start : start + count] for column in found.values()], dtype=np.float64)


def _column(array: NDArray[Any], index: int | None) -> NDArray[Any]:
    """A view of one column; samples are along the longer side."""
    array = np.squeeze(array)
    if index is None:
        return array.reshape(-1)
    return array[:, index] if array.shape[0] >= array.shape[1] else array[index]


# -- NumPy ------------------------------------------------------------------------------------------------------------
def _read_header(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape of an array, and type of its numbers."""
    version = np.lib.format.read_magic(file)  # type: ignore[no-untyped-call]
    read: Any = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(file)
    return shape, dtype


def _npz_header(budget: Budget) -> tuple[dict[str, tuple[int, ...]], dict[str, tuple[str, ...]]]:
    """Shapes of the arrays of numbers, and the lists of texts that could name joints."""
    shapes: dict[str, tuple[int, ...]] = {}
    lists: dict[str, tuple[str, ...]] = {}
    path = budget.path
    with foreign(path, _DAMAGED_NPZ), zipfile.ZipFile(path) as archive:
        for member in archive.namelist():
            name = member.removesuffix(".npy")
            with archive.open(member) as file:
                shape, dtype = _read_header(file)
            if dtype.hasobject:
                raise RecordingError(
                    f"{path}: array {name!r} holds pickled objects, which can run any code and are not read; save it "
                    f"as numbers or as names: import numpy; numpy.savez(..., {name}=list_of_them)"
                )
            if dtype.kind == "U" and len(shape) == 1 and shape[0] <= budget.limits.columns:
                budget.require_unpacked(archive.getinfo(member).file_size, "an array")
                with archive.open(member) as file:
                    lists[name] = tuple(map(str, np.lib.format.read_array(file, allow_pickle=False)))  # type: ignore[no-untyped-call]
            elif dtype.kind in _NUMBERS:
                shapes[name] = shape
    return shapes, lists


def _npz_arrays(names: Collection[str], budget: Budget) -> dict[str, NDArray[Any]]:
    """Maps arrays of an archive into memory. Their files are deleted at once, and the space is free with the arrays."""
    path, found = budget.path, dict[str, NDArray[Any]]()
    with foreign(path, _DAMAGED_NPZ), zipfile.ZipFile(path) as archive, TemporaryDirectory() as folder:
        if (size := sum(archive.getinfo(f"{name}.npy").file_size for name in names)) > budget.most_bytes:
            budget.require_unpacked(size, "the archive")
        for name in names:
            file = archive.extract(f"{name}.npy", folder)
            found[name] = np.load(file, mmap_mode="r", allow_pickle=False)
    return found


# -- MATLAB -----------------------------------------------------------------------------------------------------------
def _mat_arrays(budget: Budget) -> dict[str, NDArray[Any]]:
    """Reads the arrays in another process, which a damaged file may crash (see `unpack_mat`)."""
    path = budget.path
    script = Path(__file__).with_name("unpack_mat.py")
    with foreign(path, "damaged MATLAB file"), TemporaryDirectory() as folder:
        archive = Path(folder) / "arrays.npz"
        copies = 4  # of the arrays in memory while unpacking
        limits = (str(copies * budget.most_bytes), str(max(1, budget.most_seconds)))
        done = subprocess.run(
            [sys.executable, "-P", str(script), str(path), str(archive), *limits],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            said = done.stderr.splitlines()[-1] if done.returncode > 0 and done.stderr else "its reader was ended by it"
            raise RecordingError(f"{path}: damaged MATLAB file: {said[:200]}")
        with np.load(archive, allow_pickle=False) as arrays:
            return dict(arrays)
