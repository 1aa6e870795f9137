"""Recordings: reading, writing and preprocessing of robot logs."""

from stadera.recording.cutoff import suggest_cutoff
from stadera.recording.join import concatenate, take
from stadera.recording.preprocess import Processed, ProcessedImu, preprocess, preprocess_stream
from stadera.recording.reader import READERS, Reader, read, reader_of, stream
from stadera.recording.recording import Imu, Recording
from stadera.recording.sampling import split_gaps
from stadera.recording.settings import Preprocessing, PreprocessingReport
from stadera.recording.smoothing import smooth_rows
from stadera.recording.topics import LogFile, Topics
from stadera.recording.writer import write_table

__all__ = [
    "READERS",
    "Imu",
    "LogFile",
    "Preprocessing",
    "PreprocessingReport",
    "Processed",
    "ProcessedImu",
    "Reader",
    "Recording",
    "Topics",
    "concatenate",
    "preprocess",
    "preprocess_stream",
    "read",
    "reader_of",
    "smooth_rows",
    "split_gaps",
    "stream",
    "suggest_cutoff",
    "take",
    "write_table",
]
