"""Recordings: reading, writing and preprocessing of robot logs."""

from typing import TYPE_CHECKING

from stadera.lazy import lazy_names

if TYPE_CHECKING:
    from stadera.logs.filters import smooth_rows as smooth_rows
    from stadera.logs.filters import suggest_cutoff as suggest_cutoff
    from stadera.logs.frames import write_table as write_table
    from stadera.logs.processing import Preprocessing as Preprocessing
    from stadera.logs.processing import Processed as Processed
    from stadera.logs.processing import preprocess as preprocess
    from stadera.logs.processing import preprocess_stream as preprocess_stream
    from stadera.logs.reader import READERS as READERS
    from stadera.logs.reader import as_log as as_log
    from stadera.logs.reader import as_logs as as_logs
    from stadera.logs.reader import read as read
    from stadera.logs.reader import reader_of as reader_of
    from stadera.logs.reader import stream as stream
    from stadera.logs.recording import Imu as Imu
    from stadera.logs.recording import Recording as Recording
    from stadera.logs.recording import concatenate as concatenate
    from stadera.logs.recording import take as take
    from stadera.logs.topics import LogFile as LogFile
    from stadera.logs.topics import Topics as Topics

if not TYPE_CHECKING:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
