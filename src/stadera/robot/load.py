"""Loads a robot: from a name of the catalog, or from a URDF or MJCF file."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.robot.catalog import resolve
from stadera.robot.feet import find_foot
from stadera.robot.legs import Chain, find_legs
from stadera.robot.model import Frame, JointDynamics, JointLimits, Leg, Robot, Shape, Tree
from stadera.robot.modelfile import ModelFile, joint_axis
from stadera.robot.shapes import fitted_shapes

_UNSTATED = 1e300  # Pinocchio writes the largest double where a URDF states no limit


def load_robot(source: str | Path) -> Robot:
    """The quadruped of that name or file.

    Trunk, legs, feet and joint order are found from the model itself; what had to be assumed is in `Robot.notes`.
    Joints are ordered by leg, LF, RF, LH, RH, and in each from the trunk outwards: HAA, HFE, KFE. Inertias are those
    of the moving links with everything fixed to them lumped in, as the file has them, physical or not.

    Args:
        source: a name of `stadera.robot.catalog`, or a path to a URDF or MJCF file.

    Raises:
        UnknownNameError: neither a known name nor a file.
        MissingExtraError: the package that brings this named robot is not installed.
        ModelError: the file cannot be read, or is no quadruped with point feet and three revolute joints a leg.
    """
    name, path = resolve(source)
    file = read_model_file(path)
    robot = _understand(file)
    return replace(robot, name=name) if name else robot


def read_model_file(path: Path) -> ModelFile:
    """Read a URDF or MJCF, told apart by their root element.

    Raises:
        ModelError: not a file, not XML, or XML of another kind.
    """
    from stadera.robot.read_mjcf import read_mjcf
    from stadera.robot.read_urdf import read_urdf

    root = parse_xml(path)
    return read_urdf(path, root) if root.tag == "robot" else read_mjcf(path)


def parse_xml(path: Path) -> ET.Element:
    """The root element of a robot file, <robot> or <mujoco>.

    Raises:
        ModelError: not a file, not XML, or XML of another kind.
    """
    if not path.is_file():
        raise ModelError(f"{path}: no such file")
    try:
        root = ET.parse(path).getroot()
    except (ET.ParseError, UnicodeDecodeError, ValueError) as error:
        raise ModelError(f"{path}: not XML ({error}); a robot is a URDF or an MJCF file") from error
    if root.tag not in ("robot", "mujoco"):
        raise ModelError(f"{path}: root element <{root.tag}>; a URDF has <robot>, an MJCF <mujoco>")
    return root


def _understand(file: ModelFile) -> Robot:
    import pinocchio as pin

    chains, notes = find_legs(file)
    model = file.model
    kept = {joint for chain in chains for joint in chain.joints}
    locked = [joint for joint in range(2, model.njoints) if joint not in kept]
    if locked:
        names = ", ".join(model.names[joint] for joint in locked)
        notes = (*notes, f"held at zero, their links lumped into their parents, for they belong to no leg: {names}")
        model = pin.buildReducedModel(model, locked, pin.neutral(model))
    order = [model.getJointId(file.model.names[joint]) for chain in chains for joint in chain.joints]
    tree = _tree(file, model, order)
    frames = _frames(model, _link_index(order), tree)
    shapes = tuple(_on_moving_links(file, frames))
    legs, foot_notes = _legs(file, chains, frames, shapes)
    for leg in legs:
        frames.setdefault(leg.foot, Frame(leg.links[2], np.eye(3), np.asarray(leg.foot_position)))
    limits, limit_notes = _limits(file.model, tree)
    return Robot(
        name=file.name,
        tree=tree,
        legs=legs,
        inertias=_inertias(file, model, tree, order),
        dynamics={joint: _dynamics(file.model, joint) for joint in tree.joints},
        limits=limits,
        frames=frames,
        shapes=(*shapes, *fitted_shapes(tree, legs, shapes)),
        source=file.path,
        notes=(*notes, *foot_notes, *limit_notes),
    )


def _link_index(order: list[int]) -> dict[int, int]:
    """Index in `Tree.links` of what each of Pinocchio's joints moves."""
    return {1: 0} | {joint: k + 1 for k, joint in enumerate(order)}


def _tree(file: ModelFile, model: Any, order: list[int]) -> Tree:
    index = _link_index(order)
    joints = tuple(model.names[joint] for joint in order)
    return Tree(
        links=(file.trunk, *(file.links[name] for name in joints)),
        joints=joints,
        parents=tuple(index[model.parents[joint]] for joint in order),
        rotations=np.array([model.jointPlacements[joint].rotation for joint in order]),
        translations=np.array([model.jointPlacements[joint].translation for joint in order]),
        axes=np.array([joint_axis(model.joints[joint]) for joint in order]),
    )


def _inertias(file: ModelFile, model: Any, tree: Tree, order: list[int]) -> dict[str, InertialParameters]:
    inertias = {}
    for link, joint in zip(tree.links, [1, *order], strict=True):
        mass = model.inertias[joint].mass
        if not mass > 0:
            raise ModelError(f"{file.path}: moving link {link!r} has mass {mass:g} kg; it must be positive")
        inertias[link] = InertialParameters.from_pinocchio(model.inertias[joint])
    return inertias


def _frames(model: Any, link_of_joint: dict[int, int], tree: Tree) -> dict[str, Frame]:
    """Every link and site of the file as a frame on the moving link that carries it."""
    import pinocchio as pin

    frames = {}
    for frame in model.frames:
        if frame.type in (pin.FrameType.BODY, pin.FrameType.OP_FRAME) and frame.parentJoint in link_of_joint:
            link = tree.links[link_of_joint[frame.parentJoint]]
            frames[frame.name] = Frame(link, frame.placement.rotation.copy(), frame.placement.translation.copy())
    return frames


def _on_moving_links(file: ModelFile, frames: dict[str, Frame]) -> list[Shape]:
    """The file's shapes, each moved from its own link to the moving link that carries it."""
    moved = []
    for shape in file.shapes:
        frame = frames.get(shape.link)
        if frame is not None:
            rotation = frame.rotation @ shape.rotation
            translation = frame.rotation @ shape.translation + frame.translation
            moved.append(replace(shape, link=frame.link, rotation=rotation, translation=translation))
    return moved


def _legs(
    file: ModelFile, chains: tuple[Chain, ...], frames: dict[str, Frame], shapes: tuple[Shape, ...]
) -> tuple[tuple[Leg, ...], list[str]]:
    legs: list[Leg] = []
    feet_by_note: dict[str, list[str]] = {}
    for chain in chains:
        a, b, c = (file.model.names[joint] for joint in chain.joints)
        links = (file.links[a], file.links[b], file.links[c])
        try:
            foot = find_foot(links[2], frames, shapes)
        except ModelError as error:
            raise ModelError(f"{file.path}: leg {chain.name}: {error}") from error
        legs.append(Leg(chain.name, (a, b, c), links, foot.frame, foot.position, foot.radius))
        feet_by_note.setdefault(foot.note, []).append(foot.frame)
    return tuple(legs), [f"foot {', '.join(feet)}: {note}" for note, feet in feet_by_note.items() if note]


def _limits(model: Any, tree: Tree) -> tuple[dict[str, JointLimits], list[str]]:
    limits, notes = {}, []
    for name in tree.joints:
        joint = model.joints[model.getJointId(name)]
        lower, upper = -np.inf, np.inf
        if joint.nq == 1:
            lower = _stated(model.lowerPositionLimit[joint.idx_q])
            upper = _stated(model.upperPositionLimit[joint.idx_q])
        velocity = _stated(model.upperVelocityLimit[joint.idx_v])
        effort = _stated(model.upperEffortLimit[joint.idx_v])
        if velocity <= 0 or effort <= 0:
            notes.append(f"joint {name}: a limit of zero velocity or effort is read as none")
            velocity, effort = velocity if velocity > 0 else np.inf, effort if effort > 0 else np.inf
        limits[name] = JointLimits(lower, upper, velocity, effort)
    return limits, notes


def _stated(limit: float) -> float:
    return float(limit) if abs(limit) < _UNSTATED else float(np.copysign(np.inf, limit))


def _dynamics(model: Any, name: str) -> JointDynamics:
    v = model.joints[model.getJointId(name)].idx_v
    armature, damping, coulomb = model.armature[v], model.damping[v], model.upperDryFrictionLimit[v]
    return JointDynamics(armature=float(armature), viscous=float(damping), coulomb=float(coulomb))
