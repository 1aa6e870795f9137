"""Recordings: reading, writing and preprocessing of robot logs."""

from stadera.recording.join import concatenate, take
from stadera.recording.reader import READERS, Reader, read, reader_of, stream
from stadera.recording.recording import Imu, Recording
from stadera.recording.writer import write_table

__all__ = ["READERS", "Imu", "Reader", "Recording", "concatenate", "read", "reader_of", "stream", "take", "write_table"]
