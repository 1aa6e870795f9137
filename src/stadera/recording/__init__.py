"""Recordings: reading, writing and preprocessing of robot logs."""

from stadera.recording.recording import Imu, Recording

__all__ = ["Imu", "Recording"]
