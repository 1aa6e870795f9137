"""Writes a robot's inertial parameters and joint dynamics back into a copy of its model file.

Identification determines the sum of all bodies that move with a link. So this sum is written to the moving link, and
the inertials of the bodies fixed to it are removed. A body behind a joint that belongs to no leg (an arm) keeps its
inertial, which is subtracted from the sum. Links and joints with unchanged values, and everything else in the file,
stay as they are.
"""

from itertools import product
from pathlib import Path

import numpy as np

from stadera.constants import ROUNDING
from stadera.errors import ModelError
from stadera.files import written_together
from stadera.inertia import InertialParameters
from stadera.limits import UNLIMITED
from stadera.robot import urdf
from stadera.robot.load import load_robot, parse_xml, read_model_file
from stadera.robot.model import Robot
from stadera.robot.modelfile import ModelFile
from stadera.robot.xml import PayloadLink, named


def export_model(robot: Robot, path: str | Path, payload: PayloadLink | None = None, note: str = "") -> None:
    """Writes `robot.source` with the robot's inertias and joint dynamics to `path`: URDF to URDF, MJCF to MJCF. The
    payload is an additional link fixed to the trunk, not included in the trunk's values; the note a comment at the top
    of the file.

    URDF cannot represent rotor inertia (armature) and torque offsets, MJCF cannot represent offsets: a comment at the
    top of the file lists them. Mesh paths (package://...) are unchanged; an MJCF written to another folder states the
    absolute path of its assets. The file is read back and compared before it replaces an existing one.

    Raises:
        ModelError: as of `check_export`; a value that the format cannot represent (mass not positive, friction
            negative; in MJCF an impossible inertia); a payload whose name is taken.
        StaderaError: the folder does not exist or is not writable.
    """
    target = Path(path)
    source, is_urdf = check_export(robot, target)
    prior, file = _loaded_as(robot, source), read_model_file(source, UNLIMITED)
    inertias = _changed_inertias(robot, prior, file)
    fixed = {link: names for link, names in _fixed_bodies(prior, file).items() if link in inertias}
    dynamics = {joint: d for joint, d in robot.dynamics.items() if d != prior.dynamics[joint]}
    for joint, kind in product(dynamics, ("viscous", "coulomb") if is_urdf else ("viscous", "coulomb", "armature")):
        if (value := getattr(dynamics[joint], kind)) < 0:
            wrong = f"joint {joint!r} has a {kind} value of {value:g}, below zero"
            raise ModelError(f"{wrong}, which no model file should hold")
    origins = {link: prior.frames[link].translation for link in prior.tree.links}
    document = parse_xml(source, UNLIMITED)
    if is_urdf:
        urdf.write_urdf(document, source, inertias, fixed, dynamics)
    else:
        from stadera.robot import mjcf  # with MuJoCo, by which the model was read

        mjcf.write_mjcf(document, source, target, inertias, origins, fixed, dynamics)
    if payload is not None:
        if is_urdf:
            urdf.add_payload(document.root, prior.trunk, payload)
        else:
            trunk = named(document.root, "body", prior.trunk, source)
            mjcf.add_payload(document.root, trunk, origins[prior.trunk], payload)
        robot = robot.with_inertias({robot.trunk: robot.inertias[robot.trunk] + payload.body})  # as it reads back
    if note:
        document.remark(note)
    with written_together([target]) as (draft,):
        with draft.open("w", encoding="utf-8") as stream:
            document.write(stream)
        _check_reads_back(robot, draft, target)


def check_export(robot: Robot, path: str | Path) -> tuple[Path, bool]:
    """Checks what does not depend on the values: returns the model file to use, and True if it is a URDF. Raises
    ModelError: the robot has no source file, the path's suffix is not the source's format, or the named trunk is not
    the file's root, so that its links' frames are not all the file's.
    """
    if robot.source is None:
        raise ModelError(f"robot {robot.name} was made in memory, there is no model file to write its values into")
    is_urdf = parse_xml(robot.source, UNLIMITED).root.tag == "robot"
    valid = (".urdf",) if is_urdf else (".xml", ".mjcf")
    if Path(path).suffix.lower() not in valid:
        kind = "a URDF" if is_urdf else "an MJCF"
        raise ModelError(f"{path}: the model {robot.source.name} is {kind}, it is written to {' or '.join(valid)} only")
    root = read_model_file(robot.source, UNLIMITED).links[0].name
    if robot.root not in (None, root):
        raise ModelError(
            f"{path}: the trunk {robot.root!r} is not the root {root!r} of {robot.source.name}; only a robot whose "
            "trunk is the root, or is found without --trunk, is written to a model file"
        )
    return robot.source, is_urdf


def _changed_inertias(robot: Robot, prior: Robot, file: ModelFile) -> dict[str, InertialParameters]:
    """For each link that differs from the file: its combined inertia without the bodies behind locked joints."""
    changed, own = {}, file.lumped(file.carried(file.joints))
    places = {file.joint(k).name: k for k in file.joints}
    for k, link in enumerate(prior.tree.links):
        if robot.inertias[link] == prior.inertias[link]:
            continue
        alone = own[0 if k == 0 else places[prior.tree.joints[k - 1]]]
        changed[link] = robot.inertias[link] - (prior.inertias[link] - alone)
        if not changed[link].mass > 0:
            raise ModelError(f"link {link!r} has mass {changed[link].mass:g} kg; a model file needs it positive")
    return changed


def _fixed_bodies(prior: Robot, file: ModelFile) -> dict[str, list[str]]:
    """By moving link, the names of the other bodies in the file that are fixed to it."""
    fixed: dict[str, list[str]] = {link: [] for link in prior.tree.links}
    for link, (at, _, _) in zip(file.links, file.carried(file.joints), strict=True):
        moved = file.links[at].name if at else prior.trunk
        if link.name != moved and moved in fixed:
            fixed[moved].append(link.name)
    return fixed


def _loaded_as(robot: Robot, path: Path) -> Robot:
    """A file's robot with the feet and the trunk of this one, and the joints outside its legs where this one's are."""
    other, extra = load_robot(path, UNLIMITED, robot.feet, robot.root), robot.extra
    return other if extra is None else other.posed(dict(zip(extra.joints, extra.reference, strict=True)))


def _check_reads_back(robot: Robot, written: Path, target: Path) -> None:
    try:
        back = _loaded_as(robot, written)
    except ModelError as error:
        raise ModelError(f"{target}: {str(error).removeprefix(f'{written}: ')}") from error
    for link in robot.tree.links:
        wanted = robot.inertias[link].vector
        size = np.repeat([np.linalg.norm(part) for part in np.split(wanted, [1, 4])], [1, 3, 6])
        wrong = np.abs(back.inertias[link].vector - wanted) > ROUNDING * size + 1e-15
        if wrong.any():
            raise ModelError(f"{target}: link {link!r} does not read back as written; the model's format alters it")
