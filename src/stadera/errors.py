"""Exceptions raised by stadera. Messages name the faulty value and list the valid choices."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from math import isfinite
from numbers import Real


class StaderaError(Exception):
    """Base class of all errors that stadera raises deliberately. The message is one line, suitable for a user."""


class UnknownNameError(StaderaError):
    """A name (robot, joint, leg, method, column...) that is not one of the valid ones."""

    def __init__(self, kind: str, name: str, valid: Iterable[str], where: str = "") -> None:
        self.kind, self.name, self.valid = kind, name, tuple(valid)
        close = get_close_matches(name, self.valid, n=1)
        hint = f"; did you mean {close[0]!r}?" if close else ""
        place = f"{where}: " if where else ""
        choices = ", ".join(self.valid) if self.valid else "none"
        super().__init__(f"{place}unknown {kind} {name!r}; valid: {choices}{hint}")


def listed(names: Sequence[str], most: int) -> str:
    """Names with commas between, at most so many, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def require_known(kind: str, names: Iterable[str], valid: Iterable[str], where: str = "") -> None:
    """Checks that names are among the valid ones.

    Raises:
        UnknownNameError: a name is not valid.
    """
    valid = tuple(valid)
    for name in names:
        if name not in valid:
            raise UnknownNameError(kind, name, valid, where)


def number(what: str, value: object, unit: str = "", error: type[StaderaError] = StaderaError) -> None:
    """Checks that a value is a number.

    Raises:
        error: it is not; `what` names it in the message.
    """
    if not isinstance(value, Real):
        raise error(f"{what} must be a number{unit and f' of {unit}'}, got {value!r}")


def positive(what: str, value: float, unit: str = "", error: type[StaderaError] = StaderaError) -> float:
    """Returns a number that is positive and finite.

    Raises:
        error: it is not; `what` names it in the message.
    """
    number(what, value, unit, error)
    if not (isfinite(value) and value > 0):
        raise error(f"{what} must be positive, got {value}{unit and f' {unit}'}")
    return value


def require_positive(what: str, values: object, names: Iterable[str], or_zero: Collection[str] = ()) -> None:
    """Checks that these attributes are positive, finite numbers; those of `or_zero` may be zero.

    Raises:
        StaderaError: an attribute is not; `what` names the object in the message.
    """
    for name in names:
        value = getattr(values, name)
        if name in or_zero and not (isfinite(value) and value >= 0):
            raise StaderaError(f"{what} {name!r} must not be negative, got {value}")
        if name not in or_zero:
            positive(f"{what} {name!r}", value)


class ModelError(StaderaError):
    """The robot model cannot be read, or is not of a robot that this package supports."""


class RecordingError(StaderaError):
    """The log cannot be read, or does not meet the requirements of a recording."""


class IdentificationError(StaderaError):
    """The estimation problem has no meaningful answer (no data, contradictory constraints)."""


class ClosedLoopError(RecordingError):
    """A log has motors of a closed loop, whose joints it does not resolve."""


class UntrustedError(IdentificationError):
    """The result cannot be trusted: model and log contradict each other. The message names the likeliest cause."""


class MissingExtraError(StaderaError):
    """An optional package, or several separated by blanks, is not installed. The message names their extra."""

    def __init__(self, package: str, extra: str, purpose: str) -> None:
        names = package.split()
        what = f"package{'s'[: len(names) - 1]} {' and '.join(map(repr, names))}"
        super().__init__(f"{purpose} needs the {what}, of the extra stadera[{extra}]: pip install {package}")


@contextmanager
def of_extra(package: str, extra: str, purpose: str) -> Iterator[None]:
    """Context for importing an optional package. Raises MissingExtraError: it is not installed."""
    try:
        yield
    except ImportError:
        raise MissingExtraError(package, extra, purpose) from None
