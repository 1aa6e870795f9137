"""Weighs legged robots with their own legs."""

from typing import TYPE_CHECKING, Any

from stadera.errors import StaderaError

if TYPE_CHECKING:
    from stadera.inertia import InertialParameters

__all__ = ["InertialParameters", "StaderaError"]
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """What needs NumPy is imported when first asked for, so that the command line's help need not wait for it."""
    if name == "InertialParameters":
        from stadera.inertia import InertialParameters

        return InertialParameters
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
