"""Preloaded by every local worker, and by others on request (Dask's `preload`)."""

import signal

from stadera.garbage import collect_rarely


def dask_setup(worker: object) -> None:
    """Ignores Ctrl-C, so that the main process shuts the workers down in order."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    collect_rarely()
