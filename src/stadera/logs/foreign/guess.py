"""Suggests assignments for unrecognised columns, for errors and templates."""

from collections.abc import Sequence
from dataclasses import replace

from stadera.errors import RecordingError
from stadera.logs.foreign.column_map import TEMPLATE_HINT, ColumnMap, preset, preset_names
from stadera.logs.foreign.translate import Translation, translated
from stadera.logs.reading import Reading
from stadera.logs.topics import Topics
from stadera.logs.units import Units

_NUMBERED = tuple(f"joint_{k}" for k in range(32))
"""Names for joints in a preset that does not define their order."""


def guessed(names: Sequence[str], reading: Reading) -> Translation:
    """Translates columns with the first preset that fits, including those that apply on request only.

    Joints of unknown order are called joint_0, joint_1 and so on.
    """
    found = translated(names, "", reading, Topics())
    if found.recognised:
        return found
    fitting = [one for name in preset_names() if (one := _fitting(preset(name), names, reading)) is not None]
    if fitting:
        return replace(fitting[0], notes=(*fitting[0].notes, "the joints are numbered: check that this is their order"))
    return Translation({"time": own} if (own := found.sources.get("time")) else {})


def hint(names: Sequence[str], reading: Reading) -> str:
    """Advice for unrecognised columns, as the end of an error message."""
    fitting = {name: one for name in preset_names() if (one := _fitting(preset(name), names, reading)) is not None}
    chosen = [preset(name) for name in fitting if preset(name).chosen]
    ways = []
    if asked := [one.name for one in chosen if one.joints]:
        order = " (joints by number: these differ in their order)" if len(asked) > 1 else ""
        ways.append(f"--columns {' or '.join(asked)}{order}")
    positions = fitting or any(name.endswith(".position") for name in names)
    if positions and not any(map(_timed, fitting.values())):
        ways.append("--units 200Hz for a steady rate without a column of time")
    unordered = next((one.name for one in chosen if not one.joints), None)
    order = f', in which base = "{unordered}" and joints = ["..."] say their order' if unordered else ""
    return f"; {', '.join([*ways, f'--columns MAP.toml{order} ({TEMPLATE_HINT})'])}"


def _timed(found: Translation) -> bool:
    return "time" in found.sources or found.rate_hz is not None


def _fitting(chosen: ColumnMap, names: Sequence[str], reading: Reading) -> Translation | None:
    """Translates columns with a requested preset; None if it does not fit."""
    asked = replace(chosen.asked(), joints=chosen.joints or _NUMBERED)
    try:
        return translated(names, "", Reading(asked, reading.units.over(Units())), Topics())
    except RecordingError:
        return None
