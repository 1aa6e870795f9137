"""Functions compiled by numba: of arrays and numbers, with loops over samples.

    @compiled("float64(float64[::1], float64[::1])")
    def dot(a: Array, b: Array) -> float: ...

Machine code is stored next to the source, in the user's cache folder where that cannot be written, and for the running
process alone where neither can be. Since numba compares the time of the function's own file only, a compiled function
must not call one of another file.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

_Function = TypeVar("_Function", bound=Callable[..., Any])


def compiled(signature: str | None = None, **options: Any) -> Callable[[_Function], _Function]:
    """Decorator that compiles a function, without changing the order of its operations.

    Divisions by zero give infinity or NaN, as numpy's do.

    Args:
        signature: types of result and arguments, compiled for at import; None to compile at the first call.
        options: of `numba.njit`.
    """

    def decorate(function: _Function) -> _Function:
        settings, signatures = (
            {"cache": True, "error_model": "numpy", **options},
            () if signature is None else (signature,),
        )
        try:
            return cast(_Function, numba.njit(*signatures, **settings)(function))
        except RuntimeError as error:  # no folder for the cache can be written
            if "cannot cache" not in str(error):
                raise
            return cast(_Function, numba.njit(*signatures, **{**settings, "cache": False})(function))

    return decorate


def part(function: _Function) -> _Function:
    """Decorator for a function that only compiled ones of the same file call: compiled with these."""
    return compiled(cache=False, no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True)(function)


def reordered(function: _Function) -> _Function:
    """Decorator for a `part` whose sums may be formed in any order, several terms at once."""
    allowed = {"contract", "nsz", "reassoc"}
    return compiled(cache=False, no_cpython_wrapper=True, no_cfunc_wrapper=True, fastmath=allowed)(function)
