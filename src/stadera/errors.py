"""The errors a caller can expect: one base class, and messages that name the bad thing and the valid choices."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from math import isfinite


class StaderaError(Exception):
    """Base of every error that stadera raises on purpose. Its text is one line, fit to be shown to a user."""


class UnknownNameError(StaderaError):
    """A name (robot, joint, leg, method, column...) that is not among the valid ones."""

    def __init__(self, kind: str, name: str, valid: Iterable[str], where: str = "") -> None:
        self.kind, self.name, self.valid = kind, name, tuple(valid)
        close = get_close_matches(name, self.valid, n=1)
        hint = f"; did you mean {close[0]!r}?" if close else ""
        place = f"{where}: " if where else ""
        choices = ", ".join(self.valid) if self.valid else "none"
        super().__init__(f"{place}unknown {kind} {name!r}; valid: {choices}{hint}")


def require_known(kind: str, names: Iterable[str], valid: Iterable[str], where: str = "") -> None:
    """Checks that names are among the valid ones.

    Raises:
        UnknownNameError: one is not.
    """
    valid = tuple(valid)
    for name in names:
        if name not in valid:
            raise UnknownNameError(kind, name, valid, where)


def require_positive(what: str, values: object, names: Iterable[str]) -> None:
    """Checks that these attributes are positive and finite numbers.

    Raises:
        StaderaError: one is not; `what` says what it is a value of.
    """
    for name in names:
        value = getattr(values, name)
        if not (isfinite(value) and value > 0):
            raise StaderaError(f"{what} {name!r} must be positive, got {value}")


class ModelError(StaderaError):
    """A robot model that cannot be read, or that is not a quadruped this package understands."""


class RecordingError(StaderaError):
    """A log that cannot be read or that breaks the contract of a recording."""


class IdentificationError(StaderaError):
    """An estimation problem that has no meaningful answer (no data, contradictory constraints)."""


class UntrustedError(IdentificationError):
    """A result whose figures are not to be trusted: model and log contradict each other. Names the likeliest cause."""


class MissingExtraError(StaderaError):
    """An optional package is not installed; names the extra that brings it."""

    def __init__(self, package: str, extra: str, purpose: str) -> None:
        super().__init__(f"{purpose} needs the package {package!r}: pip install 'stadera[{extra}]'")
