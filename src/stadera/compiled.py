"""Functions compiled by numba, which the extra `fast` installs; without it the numpy code that they replace runs.

A kernel is a function of arrays and numbers, with loops over samples, in a separate module next to the numpy code. The
two give the same results up to rounding, and a test holds them equal. The numpy code stays the reference::

    @compiled("float64(float64[::1], float64[::1])")            # in stadera/legs/kernel.py
    def dot(a: Array, b: Array) -> float: ...

    fast = kernel("stadera.legs.kernel")                        # where it is used
    result = a @ b if fast is None else fast.dot(a, b)

Machine code is stored next to the source, in the user's cache folder where that cannot be written, and for the running
process alone where neither can be. Since numba compares the time of the kernel's own file only, a kernel must not call
a compiled function of another file.
"""

from collections.abc import Callable
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any, TypeVar, cast

_Function = TypeVar("_Function", bound=Callable[..., Any])


@cache
def available() -> bool:
    """True if numba is installed, fits this numpy, and is not switched off by NUMBA_DISABLE_JIT."""
    try:
        return not import_module("numba").config.DISABLE_JIT
    except ImportError:
        return False


@cache
def kernel(module: str) -> ModuleType | None:
    """A module of compiled functions, or None without numba.

    The first import on a machine compiles those with a signature, which takes seconds; later ones load them.
    """
    return import_module(module) if available() else None


def compiled(signature: str | list[str] | None = None, **options: Any) -> Callable[[_Function], _Function]:
    """Decorator that compiles a function, without changing the order of its operations; without numba it does nothing.

    Divisions by zero give infinity or NaN, as numpy's do.

    Args:
        signature: types of result and arguments, compiled for at once; None to compile at the first call for its types.
        options: of `numba.njit`, such as `inline="always"`.
    """

    def decorate(function: _Function) -> _Function:
        if not available():
            return function
        njit, signatures = import_module("numba").njit, () if signature is None else (signature,)
        settings = {"cache": True, "error_model": "numpy", **options}
        try:
            return cast(_Function, njit(*signatures, **settings)(function))
        except RuntimeError as error:  # numba: no folder for its cache can be written
            if "cannot cache" not in str(error):
                raise
            return cast(_Function, njit(*signatures, **{**settings, "cache": False})(function))

    return decorate


def part(function: _Function) -> _Function:
    """Decorator for a function that only kernels of the same file call: compiled with these, faster to compile."""
    return compiled(cache=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)


def reordered(function: _Function) -> _Function:
    """Decorator for a `part` whose sums may be formed in any order, several terms at once."""
    allowed = {"contract", "nsz", "reassoc"}
    return compiled(cache=False, no_cpython_wrapper=True, no_cfunc_wrapper=True, fastmath=allowed)(function)


def lane(function: _Function) -> _Function:
    """Decorator for a `part` without loops that is compiled into its callers, so that a loop over it uses the
    processor's vectors. A product and the sum that follows may be one operation, rounded once.
    """
    options: dict[str, Any] = {
        "no_cpython_wrapper": True,
        "no_cfunc_wrapper": True,
        "forceinline": True,
        "fastmath": {"contract"},
    }
    return compiled(cache=False, **options)(function)
