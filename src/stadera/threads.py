"""One thread for linear algebra on small matrices.

BLAS starts as many threads as there are cores for products from some 50 x 50 on, and each waits for the others by
spinning. On matrices of this size that gains nothing on an idle machine, and where other processes run it costs a
multiple: weighing 100 s of HyQ at 1 kHz took 25 s of processor time on two busy cores, and 4.3 s with one thread.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController


@contextmanager
def one_thread() -> Iterator[None]:
    """Limits BLAS of this process to one thread, as a context or a decorator; then the limit before holds again."""
    with _blas().limit(limits=1, user_api="blas"):
        yield


@cache
def _blas() -> ThreadpoolController:
    """Of numpy and of scipy, which have a library each."""
    import scipy.linalg  # noqa: F401  loads its library, which is looked for once

    return ThreadpoolController()
