"""Reads named arrays as a table: NumPy's .npz, row by row, and MATLAB's .mat.

An array of shape (samples,) is a column. One of shape (samples, k) is k columns: of the joints that the array `joints`
names for position, velocity, acceleration, effort and their desired values; x, y, z (w) for an IMU's vectors and a
foot's force; else they are numbered, name[0] to name[k-1]. Pickled objects are never read.
"""

import subprocess
import sys
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from stadera.boundary import begins_with, foreign
from stadera.errors import RecordingError
from stadera.limits import Budget
from stadera.logs.batches import Batch, rows_at_once
from stadera.logs.columns import CHANNELS
from stadera.logs.tables.rows import OpenTable, TableReader
from stadera.logs.topics import DESIRED
from stadera.types import Array

_AXES = {"angular_velocity": "xyz", "linear_acceleration": "xyz", "force": "xyz", "orientation": "xyzw"}
_JOINTS = "joints"
_NUMBERS = "fiub"
_DAMAGED_NPZ = "damaged NumPy file"


@dataclass(frozen=True)
class Column:
    """Location of a column: an array's name, and the index in it; None for a one-dimensional array."""

    array: str
    index: int | None = None


def columns_of_arrays(
    shapes: Mapping[str, tuple[int, ...]], joints: Sequence[str], budget: Budget
) -> dict[str, Column]:
    """Names of the columns in arrays of these shapes. Samples are along the longer side."""
    found: dict[str, Column] = {}
    for name, shape in shapes.items():
        sizes = [size for size in shape if size != 1]
        budget.require_columns(range(min(sizes) if len(sizes) == 2 else 1))
        if len(sizes) == 1:
            found[name] = Column(name)
        elif len(sizes) == 2:
            found |= {column: Column(name, k) for k, column in enumerate(_split(name, min(sizes), joints))}
    return found


def _split(name: str, width: int, joints: Sequence[str]) -> list[str]:
    axes = _AXES.get(name.rpartition(".")[-1], "")
    if name in (*CHANNELS, *DESIRED) and width == len(joints):
        return [f"{joint}.{name}" for joint in joints]
    return [f"{name}.{axis}" for axis in axes] if width == len(axes) else [f"{name}[{k}]" for k in range(width)]


class NpzTable(TableReader):
    """Reads NumPy's .npz, with memory independent of its length for arrays in C order."""

    name = "NumPy table"
    suffixes = (".npz",)

    def accepts(self, path: Path) -> bool:
        """True for a zip file of arrays."""
        if not path.is_file() or not zipfile.is_zipfile(path):
            return False
        with zipfile.ZipFile(path) as archive:
            return any(name.endswith(".npy") for name in archive.namelist())

    def opened(self, budget: Budget) -> OpenTable:
        """See `TableReader`."""
        columns = _npz_columns(budget)
        return OpenTable(tuple(columns), lambda names, rows: _npz_batches([columns[n] for n in names], budget))


class MatTable(TableReader):
    """Reads MATLAB's .mat up to version 7, as a whole; fields of structs are named struct.field."""

    name = "MATLAB table"
    suffixes = (".mat",)

    def accepts(self, path: Path) -> bool:
        """True for a file with the header of MATLAB version 5 to 7."""
        return begins_with(path, b"MATLAB 5.0")

    def opened(self, budget: Budget) -> OpenTable:
        """See `TableReader`."""
        arrays = _mat_arrays(budget)
        joints = [str(joint).strip() for joint in arrays.get(_JOINTS, np.array([])).ravel()]
        shapes = {name: array.shape for name, array in arrays.items() if array.dtype.kind in _NUMBERS}
        columns = columns_of_arrays(shapes, joints, budget)

        def whole(names: tuple[str, ...], rows: int | None) -> list[Batch]:
            values = {name: _column(arrays[columns[name].array], columns[name].index) for name in names}
            _check_lengths({name: len(value) for name, value in values.items()}, str(budget.path))
            return [_batch(np.stack(tuple(values.values())))]

        return OpenTable(tuple(columns), whole)


def _batch(values: Array) -> Batch:
    """Makes a batch; NaN marks a blank cell, since arrays have no other mark."""
    blank = np.isnan(values)
    return Batch(values, blank if blank.any() else None)


def _column(array: NDArray[Any], index: int | None) -> Array:
    array = np.squeeze(array)
    if index is not None:
        array = array[:, index] if array.shape[0] >= array.shape[1] else array[index]
    return array.astype(np.float64)


def _check_lengths(lengths: Mapping[str, int], path: str) -> None:
    (first, samples), *others = lengths.items()
    if wrong := next(((name, length) for name, length in others if length != samples), None):
        raise RecordingError(f"{path}: {wrong[0]!r} has {wrong[1]} values, {first!r} has {samples}; both need as many")


# -- NumPy ------------------------------------------------------------------------------------------------------------
def _read_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, whether the order is Fortran's, and type of the numbers of an array."""
    version = np.lib.format.read_magic(file)  # type: ignore[no-untyped-call]
    read: Any = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = read(file)
    return shape, fortran, dtype


def _npz_columns(budget: Budget) -> dict[str, Column]:
    shapes: dict[str, tuple[int, ...]] = {}
    joints: list[str] = []
    path = budget.path
    with foreign(path, _DAMAGED_NPZ), zipfile.ZipFile(path) as archive:
        for member in archive.namelist():
            name = member.removesuffix(".npy")
            with archive.open(member) as file:
                shape, _, dtype = _read_header(file)
            if dtype.hasobject:
                raise RecordingError(
                    f"{path}: array {name!r} holds pickled objects, which can run any code and are not read; save it "
                    f"as numbers or as names: import numpy; numpy.savez(..., {name}=list_of_them)"
                )
            if name == _JOINTS and dtype.kind == "U":
                budget.require_unpacked(archive.getinfo(member).file_size, "an array")
                with archive.open(member) as file:
                    joints = [str(joint) for joint in np.lib.format.read_array(file, allow_pickle=False)]  # type: ignore[no-untyped-call]
            elif dtype.kind in _NUMBERS:
                shapes[name] = shape
    return columns_of_arrays(shapes, joints, budget)


class _Member:
    """One array of an archive, read sequentially."""

    def __init__(self, archive: zipfile.ZipFile, name: str, stack: ExitStack, budget: Budget) -> None:
        self._file = stack.enter_context(archive.open(f"{name}.npy"))
        shape, fortran, self._dtype = _read_header(self._file)
        sizes = [size for size in shape if size != 1] or [1]
        self.samples, self.width = max(sizes), min(sizes) if len(sizes) == 2 else 1
        self._whole: NDArray[Any] | None = None
        if len(sizes) == 2 and (fortran or sizes[0] < sizes[1]):  # a sample's values are not contiguous
            budget.require_unpacked(archive.getinfo(f"{name}.npy").file_size, "an array")
            array = np.frombuffer(self._file.read(), self._dtype).reshape(sizes, order="F" if fortran else "C")
            self._whole = array if sizes[0] >= sizes[1] else array.T

    def rows(self, first: int, count: int) -> NDArray[Any]:
        """Reads the next samples, (count, width)."""
        if self._whole is not None:
            return self._whole[first : first + count]
        count = min(count, self.samples - first)
        data = self._file.read(count * self.width * self._dtype.itemsize)
        return np.frombuffer(data, self._dtype).reshape(count, self.width)


def _npz_batches(columns: Sequence[Column], budget: Budget) -> Iterator[Batch]:
    path = budget.path
    with foreign(path, _DAMAGED_NPZ), ExitStack() as stack:
        archive = stack.enter_context(zipfile.ZipFile(path))
        members = {name: _Member(archive, name, stack, budget) for name in dict.fromkeys(c.array for c in columns)}
        _check_lengths({name: member.samples for name, member in members.items()}, str(path))
        count = min(16384, rows_at_once(sum(member.width for member in members.values())))
        for first in range(0, members[columns[0].array].samples, count):
            rows = {name: member.rows(first, count) for name, member in members.items()}
            yield _batch(np.array([rows[c.array][:, c.index or 0] for c in columns], dtype=np.float64))


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
