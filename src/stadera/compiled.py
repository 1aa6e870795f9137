"""Functions compiled by numba: of arrays and numbers, with loops over samples.

    @compiled("float64(float64[::1], float64[::1])")
    def dot(a: Array, b: Array) -> float: ...

Machine code is stored next to the source, in the user's cache folder where that cannot be written, and for the running
process alone where neither can be. Since numba compares the time of the function's own file only, a compiled function
must not call one of another file.
"""

from collections.abc import Callable
from functools import cache, wraps
from typing import Any, TypeVar, cast

import numba

_Function = TypeVar("_Function", bound=Callable[..., Any])


def compiled(signature: str) -> Callable[[_Function], _Function]:
    """Decorator of a function that is compiled at its first call, without changing the order of its operations.

    Divisions by zero give infinity or NaN, as numpy's do.

    Args:
        signature: types of result and arguments.
    """

    def decorate(function: _Function) -> _Function:
        @cache
        def made() -> _Function:
            try:
                return _njit(function, signature, cache=True)
            except RuntimeError as error:  # no folder for the cache can be written
                if "cannot cache" not in str(error):
                    raise
                return _njit(function, signature)

        @wraps(function)
        def call(*arguments: Any) -> Any:
            return made()(*arguments)

        cast(Any, call).made = made
        return cast(_Function, call)

    return decorate


def load(*functions: Callable[..., Any]) -> None:
    """Loads compiled functions, or compiles them, so that their first calls take no longer than others."""
    for function in functions:
        cast(Any, function).made()


def _njit(function: _Function, *signature: str, **options: Any) -> _Function:
    make: Any = numba.njit
    return cast(_Function, make(*signature, error_model="numpy", **options)(function))


def part(function: _Function) -> _Function:
    """Decorator for a function that only compiled ones of the same file call: compiled with these."""
    return _njit(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True)
