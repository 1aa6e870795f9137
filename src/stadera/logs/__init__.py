"""Recordings: reading, writing and preprocessing of robot logs."""

from typing import TYPE_CHECKING

from stadera.lazy import lazy_names

if TYPE_CHECKING:
    from stadera.logs.cutoff import suggest_cutoff
    from stadera.logs.join import concatenate, take
    from stadera.logs.processing import Processed, preprocess, preprocess_stream
    from stadera.logs.reader import READERS, as_log, as_logs, read, reader_of, stream
    from stadera.logs.recording import Imu, Recording
    from stadera.logs.settings import Preprocessing
    from stadera.logs.smoothing import smooth_rows
    from stadera.logs.tables.write import write_table
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
    "cutoff": "suggest_cutoff",
    "join": "concatenate take",
    "processing": "Processed preprocess preprocess_stream",
    "reader": "READERS as_log as_logs read reader_of stream",
    "recording": "Imu Recording",
    "settings": "Preprocessing",
    "smoothing": "smooth_rows",
    "tables.write": "write_table",
    "topics": "LogFile Topics",
}

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _HOMES)
