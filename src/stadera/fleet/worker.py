"""Loaded by every local worker before it begins (Dask's `preload`)."""

from __future__ import annotations

import signal


def dask_setup(worker: object) -> None:
    """Leaves Ctrl-C to the process that a person started: it ends its workers in order."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
