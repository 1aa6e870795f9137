"""Formats numbers: significant digits, values with standard deviations, changes in percent."""

from collections.abc import Sequence
from math import floor, isfinite, log10


def number(value: float, digits: int = 4, without: str = "none") -> str:
    """Formats a number with significant digits, without exponents; `without` replaces values that are not finite."""
    if not isfinite(value):
        return without
    if value == 0.0:
        return "0"
    mantissa, power = f"{value:.{digits - 1}e}".split("e")
    exponent = int(power)
    if -4 < exponent < 6:
        return _minus(f"{value:.{max(digits - 1 - exponent, 0)}f}")
    return f"{_minus(mantissa)}·10{_superscript(exponent)}"


def short(value: float) -> str:
    """Formats a number with three significant digits, a whole one as it is."""
    return _minus(f"{value:g}") if float(value).is_integer() and abs(value) < 1e6 else number(value, 3)


def fixed(value: float, decimals: int) -> str:
    """Formats a number with so many decimals; zero has no sign."""
    return _minus(f"{round(value, decimals) + 0.0:.{decimals}f}")


def with_std(value: float, std: float) -> str:
    """Formats a number with its standard deviation, both to the deviation's second significant digit.

    A value without a positive standard deviation is shown alone, one that is not finite as "not observed".
    """
    if not (isfinite(value) and isfinite(std)):
        return "not observed"
    if std <= 0.0:
        return number(value)
    largest = max(abs(value), std)
    exponent = floor(log10(largest))
    scale = 10.0**exponent if not -4 < exponent < 6 else 1.0
    decimals = min(max(1 - floor(log10(std / scale)), 0), 9)
    text = f"{fixed(value / scale, decimals)} ± {std / scale:.{decimals}f}"
    return text if scale == 1.0 else f"({text})·10{_superscript(exponent)}"


def with_scale(mass: float, std: float, without: float | None) -> str:
    """Formats a mass [kg] with its standard deviation, and apart from it what the torques' common scale brings.

    Args:
        without: standard deviation without the scale [kg]; None if it is not known.
    """
    if without is None or not (isfinite(mass) and isfinite(std) and mass):
        return f"{with_std(mass, std)} kg" if isfinite(std) else "mass not observed"
    scale = (max(std**2 - without**2, 0.0)) ** 0.5 / abs(mass)
    if not 5e-4 <= scale < 1.0:  # a share of next to nothing says nothing
        return f"{with_std(mass, std)} kg"
    return f"{with_std(mass, without)} kg, and ± {number(100.0 * scale, 2)} % of it for the torques' scale"


def compared(new: float, old: float, words: tuple[str, str, str] = ("better", "worse", "the same")) -> str:
    """How much smaller or larger an error is than another, as "26 % better"; the last word below half a percent."""
    if not old:
        return "none"
    share = f"{100.0 * abs(new / old - 1.0):.0f}"
    return words[2] if share == "0" else f"{share} % {words[0] if new <= old else words[1]}"


def counted(count: int, noun: str) -> str:
    """A number of things, as "1 log" and "2 logs"."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def listed(words: Sequence[str]) -> str:
    """Words as "a, b and c"."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def _minus(text: str) -> str:
    return text.replace("-", "−")


def _superscript(exponent: int) -> str:
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
