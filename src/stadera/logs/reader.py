"""Opens a log of any known format, a file or a recording in memory.

A new file format is one module with a reader and one line in READERS.
"""

import zipfile
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path

from stadera.boundary import foreign, require_input
from stadera.errors import RecordingError
from stadera.logs.bags.files import McapFile, Ros1File, SqliteFile
from stadera.logs.bags.log import BagLog
from stadera.logs.batches import MOST_ROWS
from stadera.logs.columns import layout
from stadera.logs.frames import columns_of
from stadera.logs.mend import changed, sources_of
from stadera.logs.recording import Recording, concatenate, take
from stadera.logs.stamps import with_steps_of_motion, without_repeats
from stadera.logs.tables import TableReader
from stadera.logs.tables.arrays import MAT, NPZ
from stadera.logs.tables.arrow import CSV, PARQUET
from stadera.logs.topics import EXAMPLES, LogFile

Log = str | PathLike[str] | Recording
"""A log as accepted everywhere: a path, a LogFile (a path with topics), or a recording in memory; a data frame too."""


Reader = TableReader | BagLog
"""Reader of one format: its name for messages and lower-case suffixes of its files, whether it accepts a file by its
content, and the recordings in it.
"""

# The first reader that accepts is used: formats with magic bytes come before those that accept any text.
READERS: tuple[Reader, ...] = (
    PARQUET,
    BagLog(McapFile()),
    BagLog(SqliteFile()),
    BagLog(Ros1File()),
    NPZ,
    MAT,
    CSV,
)


def as_log(log: Log) -> LogFile | Recording:
    """Converts a log to one of two forms, each of which has `source` and `name` for messages; else RecordingError."""
    if isinstance(log, Recording):
        return log
    if isinstance(log, str | PathLike):
        return LogFile.of(log)
    if _is_frame(log):
        return Recording.from_dataframe(log)
    raise RecordingError(f"a log is a path, a LogFile, a Recording or a data frame, got {type(log).__name__}")


def _is_frame(log: object) -> bool:
    return hasattr(type(log), "columns") or isinstance(log, Mapping)


def as_logs(logs: Log | Iterable[Log]) -> tuple[LogFile | Recording, ...]:
    """Converts one log or several to a tuple. RecordingError: none given, or one of another type."""
    if isinstance(logs, str | PathLike | Recording | bytes) or _is_frame(logs) or not isinstance(logs, Iterable):
        return (as_log(logs),)  # type: ignore[arg-type]
    if not (found := tuple(as_log(log) for log in logs)):
        raise RecordingError("no log given")
    return found


def stream(
    log: Log, *, joints: Sequence[str] | None = None, require: Collection[str] = (), rows: int | None = MOST_ROWS
) -> Iterator[Recording]:
    """Reads a log as consecutive recordings of `rows` samples each (the last one shorter; None: a single one). Memory
    does not grow with the length of a file.

    Args:
        log: a path, a LogFile, which selects topics of a bag, or a recording in memory.
        joints: the joints to read, in this order; None for all.
        require: what each of these joints needs: velocity, acceleration, effort; and "imu".

    Raises:
        RecordingError: immediately if the file does not exist, has an unknown format or lacks a column; during
            iteration if a value is not finite or time does not increase. Names file, column and sample.
    """
    log = as_log(log)
    if isinstance(log, Recording):
        return with_steps_of_motion(without_repeats(_chunks(_chosen(log, joints, require), rows)))
    changes, reader = log.reading.changes, reader_of(log.path)
    chunks = reader.stream(log, joints=sources_of(changes, joints), require=require, rows=rows)
    if changes:
        chunks = (changed(chunk, changes, joints, first=k == 0) for k, chunk in enumerate(chunks))
    # messages of a bag are those that a running robot sends; rows of a table may repeat, or have stamps of arrival
    return chunks if isinstance(reader, BagLog) else with_steps_of_motion(without_repeats(chunks))


def read_head(log: Log, joints: Sequence[str] | None = None, rows: int = 256) -> Recording:
    """The first samples of a log, enough for its channels and rate. RecordingError as `stream`."""
    return next(stream(log, joints=joints, rows=rows))


def read(log: Log, *, joints: Sequence[str] | None = None, require: Collection[str] = ()) -> Recording:
    """Reads a whole log as one recording. Arguments and errors as `stream`."""
    log = as_log(log)
    if isinstance(log, Recording):
        return _chosen(log, joints, require)
    return concatenate(tuple(stream(log, joints=joints, require=require, rows=None)))


def _chosen(recording: Recording, joints: Sequence[str] | None, require: Collection[str]) -> Recording:
    """Selects the requested joints, with the same checks and by the same names as for a table's columns."""
    if len(recording) < 2:
        raise RecordingError(f"{recording.source}: too few samples: {len(recording)}, at least 2 are needed")
    found = layout(tuple(columns_of(recording)), recording.source, joints, require)
    columns = {joint: f"{joint}.position" for joint in found.joints}
    names = {found.sources.get(column, column).removesuffix(".position"): joint for joint, column in columns.items()}
    if any(own != joint for own, joint in names.items()):
        named = tuple(names.get(own, own) for own in recording.joints)
        recording = replace(recording, joints=named, notes=(*recording.notes, *found.notes))
    return recording.of_joints(found.joints)


def _chunks(recording: Recording, rows: int | None) -> Iterator[Recording]:
    if rows is None or len(recording) <= rows:
        yield recording
        return
    for start in range(0, len(recording), rows):
        chunk = take(recording, slice(start, start + rows))
        yield chunk if start == 0 else replace(chunk, notes=())


def reader_of(path: Path) -> Reader:
    """Finds the reader for a path by its content. Raises RecordingError: the path does not exist, is empty, has an
    unknown format, or another one than its name says.
    """
    accepted = "accepted: " + ", ".join(f"{reader.name} ({', '.join(reader.suffixes)})" for reader in READERS)
    require_input(path, folder=True, hint=f"; logs that come with stadera: {', '.join(EXAMPLES)}")
    with foreign(path, "cannot be read"):
        if path.is_file() and not path.stat().st_size:
            raise RecordingError(f"{path}: the file is empty; {accepted}")
        if refused := _refusal(path):
            raise RecordingError(f"{path}: {refused}")
        found = next((reader for reader in READERS if reader.accepts(path)), None)
    named = next((reader for reader in READERS if path.name.lower().endswith(reader.suffixes)), None)
    if found is not None and named in (None, found):
        return found
    why = "no log that can be read"
    if found is not None:
        why = f"not what its name says: content is {found.name}"
    elif path.is_dir():
        why = "a directory, not a log"
        suffixes = tuple(suffix for reader in READERS for suffix in reader.suffixes)
        if any(file.name.lower().endswith(suffixes) for file in path.glob("*")):
            accepted += f"; for the logs in it give `stadera fleet` '{path}/*'"
    elif named:
        why = f"not what its name says, no {named.name} that can be read"
    raise RecordingError(f"{path}: {why}; {accepted}")


_PICKLED = (b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05")
_UNSAFE = "a pickle can run any code and is not read; where you trust it, make a table of it in Python: import numpy"
_REFUSED: dict[str, str] = {
    "pickle": _UNSAFE + ", pickle; numpy.savez({npz!r}, **pickle.load(open({name!r}, 'rb')))",
    "objects": _UNSAFE + "; numpy.savez({npz!r}, **numpy.load({name!r}, allow_pickle=True).item())",
    "torch": _UNSAFE + ", torch; numpy.savez({npz!r}, **{{k: v.numpy() for k, v in torch.load({name!r}, "
    "weights_only=True).items()}})",
    "array": "an array without names of columns; give it some in Python: import numpy; a = numpy.load({name!r}); "
    "numpy.savez({npz!r}, time=a[:, 0], position=a[:, 1:13], joints=['FL_hip_joint', ...])",
    "matlab": "MATLAB's version 7.3 is not read; save it again in MATLAB: save({mat!r}, ..., '-v7')",
    "hdf5": "HDF5 is not read; make a table of it in Python: import h5py, numpy; numpy.savez({npz!r}, "
    "**{{k: v[()] for k, v in h5py.File({name!r}).items()}})",
    "zip": "a zip archive; unpack it and give the log in it: {inside}",
}
"""By kind of file, why it is not read, and the code that converts it."""


def _refusal(path: Path) -> str:
    """Why a file is not read, a pickle, unnamed arrays, an archive, with code that converts it; empty for others."""
    if not path.is_file():
        return ""
    with path.open("rb") as file:
        head = file.read(128)
    inside: list[str] = []
    if head.startswith(b"PK") and zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            inside = archive.namelist()
    kinds = {
        "pickle": head.startswith(_PICKLED) or path.suffix.lower() in (".pkl", ".pickle"),
        "objects": head.startswith(b"\x93NUMPY") and b"'|O'" in head,
        "array": head.startswith(b"\x93NUMPY"),
        "matlab": b"MATLAB 7.3" in head[:16],
        "hdf5": head.startswith(b"\x89HDF"),
        "torch": any(name.endswith("data.pkl") for name in inside),
        "zip": head.startswith(b"PK\x05\x06") or (inside and not any(name.endswith(".npy") for name in inside)),
    }
    kind = next((kind for kind, is_it in kinds.items() if is_it), None)
    said = ", ".join(inside[:3]) + " ..." * (len(inside) > 3) or "it is empty"
    names = {"name": str(path), "npz": f"{path.stem}.npz", "mat": f"{path.stem}_7.mat", "inside": said}
    return "" if kind is None else _REFUSED[kind].format(**names)
