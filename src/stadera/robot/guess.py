"""Which robot a log is of, by the names of its joints."""

from collections.abc import Collection

from stadera.errors import RecordingError, StaderaError
from stadera.robot.catalog import CATALOG
from stadera.robot.load import load_robot
from stadera.types import Progress


def fitting(joints: Collection[str], progress: Progress | None = None) -> dict[str, tuple[str, ...]]:
    """Robots known by name, of those installed, of which all joints of one leg or more are there, with these legs."""
    found = {}
    for k, name in enumerate(CATALOG):
        if progress:
            progress("comparing with known robots", k, len(CATALOG))
        try:
            robot = load_robot(name)
        except StaderaError:  # not installed
            continue
        if legs := tuple(leg.name for leg in robot.legs if set(leg.joints) <= set(joints)):
            found[name] = legs
    return found


def guessed(joints: Collection[str], source: str, progress: Progress | None = None) -> str:
    """The only robot known by name that has the joints of the log `source`. Raises RecordingError: none, or several of
    which the names say nothing more; lists them.
    """
    found = fitting(joints, progress)
    most = max((len(legs) for legs in found.values()), default=0)
    names = [name for name, legs in found.items() if len(legs) == most]
    if len(names) == 1:
        return names[0]
    if not names:
        shown = ", ".join(list(joints)[:3]) or "none"
        raise RecordingError(
            f"{source}: no robot known by name has its joints ({shown}, ...): add --robot with the path of a URDF "
            f"or MJCF, or one of {', '.join(CATALOG)}, whose joints are then found by leg and part"
        )
    raise RecordingError(
        f"{source}: the joints are those of {', '.join(names)}: add --robot {names[0]}, or whichever it is"
    )
