"""Loads a robot by name from the catalogue, or from a URDF or MJCF file; tells by its joints whose a log is."""

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from stadera.boundary import foreign, require_input
from stadera.errors import MissingExtraError, ModelError, RecordingError, StaderaError
from stadera.inertia import InertialParameters
from stadera.limits import DEFAULTS, Limits
from stadera.robot.catalog import CATALOG, resolve
from stadera.robot.extra import ExtraJoints
from stadera.robot.legs import Chain, find_legs
from stadera.robot.model import Frame, JointDynamics, JointLimits, Leg, Robot, Shape, Tree
from stadera.robot.modelfile import ModelFile, joint_axis, moving_axis
from stadera.robot.sense import check_sense, checked_limits
from stadera.robot.shapes import FLAT, find_foot, find_sole, fitted_shapes
from stadera.robot.sole import with_unfelt_moments
from stadera.robot.xml import Document, read_xml
from stadera.types import Array, Progress

_UNSTATED = 1e300  # Pinocchio writes the largest double where a URDF states no limit


def load_robot(source: Robot | str | PathLike[str], limits: Limits = DEFAULTS) -> Robot:
    """Loads the robot of that name or file; a robot is returned unchanged.

    Trunk, legs, feet and joint order are determined from the model itself; assumptions are listed in `Robot.notes`.
    Joints are ordered by leg, LF, RF, LH, RH, and in each from the trunk outwards: HAA, HFE, KFE. Inertias are those of
    the moving links including everything fixed to them, as in the file, physically possible or not.

    Args:
        source: a name of `stadera.robot.catalog`, or a path to a URDF or MJCF file.
        limits: for reading the file.

    Raises:
        UnknownNameError: neither a known name nor a file.
        LimitError: the file exceeds the limits.
        MissingExtraError: the package that contains this named robot, or MuJoCo for an MJCF, is not installed.
        ModelError: the file cannot be read, or has no legs: chains of three or more revolute joints that reach down
            from the trunk. Legs of six joints or more, or of five without a ball at their end, have flat feet, others
            point feet.
    """
    if isinstance(source, Robot):
        return source
    if not isinstance(source, str | PathLike):
        raise ModelError(f"a robot is a name, a path or a Robot, got {type(source).__name__}")
    name, path = resolve(source)
    file = read_model_file(path, limits)
    with foreign(path, "not understood as a robot", ModelError):
        robot = _understand(file)
    return replace(robot, name=name) if name else robot


def read_model_file(path: Path, limits: Limits = DEFAULTS) -> ModelFile:
    """Reads a URDF or MJCF, distinguished by the root element. LimitError if it exceeds the limits, ModelError if it is
    not a file, not XML, or XML of another kind.
    """
    root = parse_xml(path, limits).root
    if root.tag == "robot":
        from stadera.robot.urdf import read_urdf, require_depth

        require_depth(root, path, limits)
        with foreign(path, "not a URDF that can be read", ModelError):
            return read_urdf(path, root)
    try:
        from stadera.robot.mjcf import read_mjcf, require_size
    except ModuleNotFoundError as error:
        raise MissingExtraError("mujoco", "lab", f"reading the MJCF {path}") from error
    require_size(root, path, limits)
    with foreign(path, "not an MJCF that can be read", ModelError):
        return read_mjcf(path)


def parse_xml(path: Path, limits: Limits = DEFAULTS) -> Document:
    """A robot file, with the root element <robot> or <mujoco>; for a xacro its expansion. Raises as
    `read_model_file`.
    """
    require_input(path, ModelError)
    with foreign(path, "a robot is a URDF or an MJCF file, and this is not XML", ModelError):
        document = read_xml(path, limits)
    if document.root.tag not in ("robot", "mujoco"):
        raise ModelError(f"{path}: root element <{document.root.tag}>; a URDF has <robot>, an MJCF <mujoco>")
    return document


def _understand(file: ModelFile) -> Robot:
    chains, notes = find_legs(file)
    of_legs = {joint for chain in chains for joint in chain.joints}
    model, locked = _with_only(file.model, of_legs)
    if locked:
        others = ", ".join(file.model.names[joint] for joint in locked)
        held = "belong to no leg, so their links are lumped into their parents, at zero unless a log says otherwise"
        notes = (*notes, f"{held}: {others}")
    order = [model.getJointId(file.model.names[joint]) for chain in chains for joint in chain.joints]
    tree = _tree(file, model, order)
    frames = _frames(model, dict(zip([1, *order], tree.links, strict=True)))
    shapes = tuple(_on_moving_links(file, frames))
    legs, foot_notes = _legs(file, chains, frames, shapes)
    for leg in legs:
        frames.setdefault(leg.foot, Frame(leg.links[-1], np.eye(3), np.asarray(leg.foot_position)))
    limits, limit_notes = _limits(file, tree)
    robot = Robot(
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
        extra=_extra(file, of_legs),
    )
    return with_unfelt_moments(replace(robot, notes=(*robot.notes, *check_sense(robot))))


def _with_only(model: Any, joints: Collection[int]) -> tuple[Any, list[int]]:
    """The model with all other joints of the trunk's fixed at zero, and these others."""
    locked = sorted(set(range(2, model.njoints)).difference(joints))
    return (pin.buildReducedModel(model, locked, pin.neutral(model)) if locked else model), locked


def _extra(file: ModelFile, of_legs: Collection[int]) -> ExtraJoints | None:
    """The joints outside the legs that hang from the trunk and turn or slide; the others among them stay at zero."""
    whole, found = file.model, _hanging(file.model, of_legs)
    if not found:
        return None
    model, _ = _with_only(whole, {*of_legs, *found})
    names = tuple(whole.names[joint] for joint in found)
    order = [model.getJointId(name) for name in names]
    rotations, translations = _placements(model, order)
    return ExtraJoints(
        joints=names,
        parents=tuple(parent - 1 for parent in _parents(model, order)),
        rotations=rotations,
        translations=translations,
        axes=np.array([moving_axis(model.joints[joint]) for joint in order]),
        sliding=tuple(joint_axis(model.joints[joint]) is None for joint in order),
        bodies=tuple(InertialParameters.from_pinocchio(model.inertias[joint]) for joint in order),
        reference=np.zeros(len(order)),
        links=tuple(file.links[name] for name in names),
        effort=tuple(_stated(model.upperEffortLimit[model.joints[joint].idx_v]) or np.inf for joint in order),
        frames=_frames(model, dict(zip(order, (file.links[name] for name in names), strict=True))),
    )


def _hanging(whole: Any, of_legs: Collection[int]) -> list[int]:
    """Joints outside the legs that turn or slide, on the trunk or on another one of them."""
    found: list[int] = []
    others = (joint for joint in range(2, whole.njoints) if joint not in of_legs)  # in topological order
    for joint in others:
        if whole.parents[joint] in (1, *found) and moving_axis(whole.joints[joint]) is not None:
            found.append(joint)
    return found


def _tree(file: ModelFile, model: Any, order: list[int]) -> Tree:
    joints = tuple(model.names[joint] for joint in order)
    rotations, translations = _placements(model, order)
    return Tree(
        links=(file.trunk, *map(file.links.__getitem__, joints)),
        joints=joints,
        parents=_parents(model, order),
        rotations=rotations,
        translations=translations,
        axes=np.array([joint_axis(model.joints[joint]) for joint in order]),
    )


def _parents(model: Any, order: list[int]) -> tuple[int, ...]:
    """For each joint, 0 if it is on the trunk, else one more than its parent's place in the order."""
    return tuple([1, *order].index(model.parents[joint]) for joint in order)


def _placements(model: Any, order: list[int]) -> tuple[Array, Array]:
    """Rotations (n, 3, 3) and translations (n, 3) [m] of the joints' frames in their parents'."""
    placements = [model.jointPlacements[joint] for joint in order]
    return np.array([pose.rotation for pose in placements]), np.array([pose.translation for pose in placements])


def _inertias(file: ModelFile, model: Any, tree: Tree, order: list[int]) -> dict[str, InertialParameters]:
    inertias = {}
    for link, joint in zip(tree.links, [1, *order], strict=True):
        mass = model.inertias[joint].mass
        if not mass > 0:
            why = "" if file.masses.get(link) else ": it has no <inertial>, nor has anything fixed to it"
            raise ModelError(f"{file.path}: moving link {link!r} has mass {mass:g} kg; it must be positive{why}")
        inertias[link] = InertialParameters.from_pinocchio(model.inertias[joint])
    return inertias


def _frames(model: Any, link_of_joint: Mapping[int, str]) -> dict[str, Frame]:
    """Every link and site of the file on these moving links, by the joint that moves it, as a frame on it."""
    frames = {}
    for frame in model.frames:
        if frame.type in (pin.FrameType.BODY, pin.FrameType.OP_FRAME) and frame.parentJoint in link_of_joint:
            pose = frame.placement
            frames[frame.name] = Frame(link_of_joint[frame.parentJoint], pose.rotation.copy(), pose.translation.copy())
    return frames


def _on_moving_links(file: ModelFile, frames: dict[str, Frame]) -> list[Shape]:
    """The file's shapes, each moved from its own link to its moving link."""
    there = ((shape, frames[shape.link]) for shape in file.shapes if shape.link in frames)
    return [shape.moved(frame.link, frame.rotation, frame.translation) for shape, frame in there]


def _legs(
    file: ModelFile, chains: tuple[Chain, ...], frames: dict[str, Frame], shapes: tuple[Shape, ...]
) -> tuple[tuple[Leg, ...], list[str]]:
    legs: list[Leg] = []
    feet_by_note: dict[str, list[str]] = {}
    for chain in chains:
        joints = tuple(file.model.names[joint] for joint in chain.joints)
        links = tuple(file.links[joint] for joint in joints)
        balls = any(shape.link == links[-1] and shape.kind == "sphere" for shape in shapes)
        flat = len(joints) >= FLAT or (len(joints) == FLAT - 1 and not balls)
        try:
            foot = find_sole(links[-1], frames, shapes) if flat else find_foot(links[-1], frames, shapes)
        except ModelError as error:
            raise ModelError(f"{file.path}: leg {chain.name}: {error}") from error
        legs.append(Leg(chain.name, joints, links, foot.frame, foot.position, foot.radius, FLAT if flat else 3))
        feet_by_note.setdefault(foot.note, []).append(foot.frame)
    return tuple(legs), [f"foot {', '.join(feet)}: {note}" for note, feet in feet_by_note.items() if note]


def _limits(file: ModelFile, tree: Tree) -> tuple[dict[str, JointLimits], list[str]]:
    limits: dict[str, JointLimits] = {}
    notes: list[str] = []
    model = file.model
    for name in tree.joints:
        joint = model.joints[model.getJointId(name)]
        try:
            lower, upper, note = _position_limits(model, joint, name)
        except ModelError as error:
            raise ModelError(f"{file.path}: {error}") from error
        notes += [note] if note else []
        velocity = _stated(model.upperVelocityLimit[joint.idx_v])
        effort = _stated(model.upperEffortLimit[joint.idx_v])
        if velocity <= 0 or effort <= 0:
            notes.append(f"joint {name}: a limit of zero velocity or effort is read as none")
            velocity, effort = velocity if velocity > 0 else np.inf, effort if effort > 0 else np.inf
        limits[name] = JointLimits(lower, upper, velocity, effort)
    return limits, notes


def _position_limits(model: Any, joint: Any, name: str) -> tuple[float, float, str]:
    """Lower and upper limit [rad], and a note on them or none; a joint without end has none."""
    if joint.nq != 1:
        return -np.inf, np.inf, ""
    lower, upper = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
    return checked_limits(name, _stated(lower), _stated(upper))


def _stated(limit: float) -> float:
    return float(limit) if abs(limit) < _UNSTATED else float(np.copysign(np.inf, limit))


def _dynamics(model: Any, name: str) -> JointDynamics:
    v = model.joints[model.getJointId(name)].idx_v
    armature, damping, coulomb = model.armature[v], model.damping[v], model.upperDryFrictionLimit[v]
    return JointDynamics(armature=float(armature), viscous=float(damping), coulomb=float(coulomb))


def known_robots(progress: Progress | None = None) -> Iterator[Robot]:
    """The robots known by name, of those installed."""
    for k, name in enumerate(CATALOG):
        if progress:
            progress("comparing with known robots", k, len(CATALOG))
        with suppress(StaderaError):  # not installed
            yield load_robot(name)


def fitting(joints: Collection[str], progress: Progress | None = None) -> dict[str, tuple[str, ...]]:
    """Robots known by name, of those installed, of which all joints of one leg or more are there, with these legs."""
    own, there = known_robots(progress), set(joints)
    legs = {robot.name: tuple(leg.name for leg in robot.legs if set(leg.joints) <= there) for robot in own}
    return {name: found for name, found in legs.items() if found}


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
