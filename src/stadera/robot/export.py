"""Writes a robot's inertial parameters and joint dynamics back into a copy of its model file.

What the identification knows of a link is the lump of all that moves with it. So the whole lump is written on the
moving link, and the inertials of the bodies fixed to it are taken away; a body that hangs on a joint which belongs to
no leg (an arm) keeps its own, and its share is taken off the lump. Links and joints whose values are the file's own
are left as they are, and so is everything else in the file.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from xml.dom import minidom

import numpy as np

from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.robot.load import load_robot, parse_xml, read_model_file
from stadera.robot.model import JointDynamics, Robot
from stadera.robot.modelfile import ModelFile
from stadera.robot.payload_link import PayloadLink, add_to_mjcf, add_to_urdf
from stadera.robot.write_mjcf import write_mjcf
from stadera.robot.write_urdf import write_urdf
from stadera.robot.write_xml import named, remark

_READ_BACK = 1e-9  # relative, by the size of each link's own mass, first moment and inertia


def export_model(robot: Robot, path: str | Path, payload: PayloadLink | None = None, note: str = "") -> None:
    """Write `robot.source` with the robot's inertias and joint dynamics to `path`: URDF to URDF, MJCF to MJCF.

    A URDF has no place for rotor inertia (armature) and for torque offsets, an MJCF none for offsets: these are told
    in a comment at the file's top. Mesh paths (package://...) stay as they are; an MJCF written to another
    folder names the folder of its assets in full. The file is read back and compared before it takes its place.

    Args:
        robot: what is written.
        path: where.
        payload: a further link, fixed to the trunk; the trunk's own values do not contain it. None for none.
        note: what whoever reads the file should know; a comment at the file's top, none where empty.

    Raises:
        ModelError: the robot has no source file, the suffix is not the source's format, a value that the format
            cannot hold (mass not positive, friction negative; in MJCF an inertia that no body has), a payload's name
            that is taken, or a folder that cannot be written.
    """
    target = Path(path)
    source, is_urdf = check_export(robot, target)
    prior, file = load_robot(source), read_model_file(source)
    inertias, fixed = _changed_inertias(robot, prior, file), _fixed_bodies(prior, file)
    fixed = {link: names for link, names in fixed.items() if link in inertias}
    dynamics = {joint: d for joint, d in robot.dynamics.items() if d != prior.dynamics[joint]}
    _check_not_negative(dynamics, ("viscous", "coulomb") if is_urdf else ("viscous", "coulomb", "armature"))
    if is_urdf:
        document = write_urdf(source, inertias, fixed, dynamics)
    else:
        origins = {link: prior.frames[link].translation for link in inertias}
        document = write_mjcf(source, target, inertias, origins, fixed, dynamics)
    if payload is not None and is_urdf:
        add_to_urdf(document, prior.trunk, payload)
    elif payload is not None:
        trunk = named(document, "body", prior.trunk, source)
        add_to_mjcf(document, trunk, prior.frames[prior.trunk].translation, payload)
    if note:
        remark(document, note)
    _replace_whole(document, robot if payload is None else _with_payload(robot, payload), target)


def check_export(robot: Robot, path: str | Path) -> tuple[Path, bool]:
    """What can be known before the values are: the model file to write into, and whether it is a URDF.

    Raises:
        ModelError: the robot has no source file, or the path's suffix is not the source's format.
    """
    if robot.source is None:
        raise ModelError(f"robot {robot.name} was made in memory, there is no model file to write its values into")
    is_urdf = parse_xml(robot.source).tag == "robot"
    valid = (".urdf",) if is_urdf else (".xml", ".mjcf")
    if Path(path).suffix.lower() not in valid:
        kind = "a URDF" if is_urdf else "an MJCF"
        raise ModelError(f"{path}: the model {robot.source.name} is {kind}, it is written to {' or '.join(valid)} only")
    return robot.source, is_urdf


def _check_not_negative(dynamics: Mapping[str, JointDynamics], kinds: tuple[str, ...]) -> None:
    for joint, values in dynamics.items():
        for kind in kinds:
            if getattr(values, kind) < 0:
                raise ModelError(
                    f"joint {joint!r} has a {kind} value of {getattr(values, kind):g}, below zero, which no model file "
                    "should hold"
                )


def _changed_inertias(robot: Robot, prior: Robot, file: ModelFile) -> dict[str, InertialParameters]:
    """For each link that differs from the file: its lump without what hangs on it by locked joints."""
    changed = {}
    for k, link in enumerate(prior.tree.links):
        if robot.inertias[link] == prior.inertias[link]:
            continue
        joint = 1 if k == 0 else file.model.getJointId(prior.tree.joints[k - 1])
        alone = InertialParameters.from_pinocchio(file.model.inertias[joint])
        changed[link] = robot.inertias[link] - (prior.inertias[link] - alone)
        if not changed[link].mass > 0:
            raise ModelError(f"link {link!r} has mass {changed[link].mass:g} kg; a model file needs it positive")
    return changed


def _fixed_bodies(prior: Robot, file: ModelFile) -> dict[str, list[str]]:
    """By moving link, the names of the other bodies of the file that are fixed to it."""
    import pinocchio as pin

    joints = {1: prior.trunk} | {
        file.model.getJointId(joint): link for joint, link in zip(prior.tree.joints, prior.tree.links[1:], strict=True)
    }
    fixed: dict[str, list[str]] = {link: [] for link in prior.tree.links}
    for frame in file.model.frames:
        link = joints.get(frame.parentJoint)
        if frame.type == pin.FrameType.BODY and link and frame.name != link:
            fixed[link].append(frame.name)
    return fixed


def _with_payload(robot: Robot, payload: PayloadLink) -> Robot:
    """What the file reads back as: the payload is part of the trunk's lump."""
    return robot.with_inertias({robot.trunk: robot.inertias[robot.trunk] + payload.body})


def _replace_whole(document: minidom.Document, robot: Robot, target: Path) -> None:
    """Write beside the target, read back, compare, and only then take its place."""
    try:
        handle, name = tempfile.mkstemp(suffix=target.suffix, prefix=f".{target.stem}-", dir=target.parent)
    except OSError as error:
        raise ModelError(f"{target}: cannot be written: {error.strerror}") from error
    temporary = Path(name)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            document.writexml(stream, encoding="utf-8")
        _check_reads_back(robot, temporary, target)
        temporary.chmod(0o644)
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def _check_reads_back(robot: Robot, written: Path, target: Path) -> None:
    try:
        back = load_robot(written)
    except ModelError as error:
        raise ModelError(f"{target}: {str(error).removeprefix(f'{written}: ')}") from error
    for link in robot.tree.links:
        wanted = robot.inertias[link].vector
        size = np.repeat([np.linalg.norm(part) for part in np.split(wanted, [1, 4])], [1, 3, 6])
        wrong = np.abs(back.inertias[link].vector - wanted) > _READ_BACK * size + 1e-15
        if wrong.any():
            raise ModelError(f"{target}: link {link!r} does not read back as written; the model's format alters it")
