"""Settings of this process: how often Python collects cyclic garbage, in the command and a fleet's workers; one thread
for linear algebra on small matrices.
"""

from __future__ import annotations

import atexit
import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

_NEW = 50_000  # objects more than at the last collection, before the next one; Python's own is 700


def collect_rarely() -> None:
    """Makes collections rare, and leaves out those at the process's end. Each looks through all new objects, or through
    all there are, and packages that are imported bring 150,000, of which none is garbage: of the time of `stadera
    weigh` on a short log, an eighth before the end and a fifth at it.

    Arrays and what holds them are freed when the last reference goes; what refers to itself waits for a collection.
    """
    gc.set_threshold(_NEW)
    atexit.register(gc.freeze)


def keep_loaded() -> None:
    """Leaves all objects that there are out of later collections; at the first call only, after a first task has loaded
    modules, compiled functions and models. Does nothing in a process without `collect_rarely`, such as a worker of
    somebody else's scheduler.
    """
    if gc.get_threshold()[0] == _NEW and not gc.get_freeze_count():
        gc.freeze()


@contextmanager
def one_thread() -> Iterator[None]:
    """Limits BLAS of this process to one thread, as a context or a decorator; then the limit before holds again.

    BLAS starts as many threads as there are cores for products from some 50 x 50 on, and each waits for the others by
    spinning. On matrices of this size that gains nothing on an idle machine, and where other processes run it costs a
    multiple: weighing 100 s of HyQ at 1 kHz took 25 s of processor time on two busy cores, and 4.3 s with one thread.
    """
    with _blas().limit(limits=1, user_api="blas"):
        yield


@cache
def _blas() -> ThreadpoolController:
    """Of numpy and of scipy, which have a library each."""
    import scipy.linalg  # noqa: F401  loads its library, which is looked for once
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
