"""Recordings: reading, writing and preprocessing of robot logs."""

from typing import TYPE_CHECKING

from stadera.lazy import lazy_names

if TYPE_CHECKING:
    from stadera.logs.filters import smooth_rows, suggest_cutoff
    from stadera.logs.frames import write_table
    from stadera.logs.processing import Preprocessing, Processed, preprocess, preprocess_stream
    from stadera.logs.reader import READERS, as_log, as_logs, read, reader_of, stream
    from stadera.logs.recording import Imu, Recording, concatenate, take
    from stadera.logs.topics import LogFile, Topics

__all__ = [
    "READERS",
    "Imu",
    "LogFile",
    "Preprocessing",
    "Processed",
    "Recording",
    "Topics",
    "as_log",
    "as_logs",
    "concatenate",
    "preprocess",
    "preprocess_stream",
    "read",
    "reader_of",
    "smooth_rows",
    "stream",
    "suggest_cutoff",
    "take",
    "write_table",
]

_HOMES = {
    "filters": "smooth_rows suggest_cutoff",
    "frames": "write_table",
    "processing": "Preprocessing Processed preprocess preprocess_stream",
    "reader": "READERS as_log as_logs read reader_of stream",
    "recording": "Imu Recording concatenate take",
    "topics": "LogFile Topics",
}

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _HOMES)
