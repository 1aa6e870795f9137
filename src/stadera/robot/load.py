"""Loads a robot by name from the catalogue, or from a URDF or MJCF file; tells by its joints whose a log is."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np

from stadera.boundary import foreign, require_input
from stadera.errors import MissingExtraError, ModelError, RecordingError, StaderaError
from stadera.inertia import InertialParameters
from stadera.joint_words import words
from stadera.limits import DEFAULTS, Limits
from stadera.robot.catalog import CATALOG, resolve
from stadera.robot.extra import ExtraJoints
from stadera.robot.legs import Chain, below_a_waist, find_legs
from stadera.robot.model import Frame, JointLimits, Leg, Robot, Shape, Tree
from stadera.robot.modelfile import TURNED, ModelFile, rooted_at
from stadera.robot.shapes import FLAT, find_foot, find_sole, fitted_shapes
from stadera.robot.sole import find_wheel, with_unfelt
from stadera.robot.values import check_sense
from stadera.robot.xml import Document, read_xml
from stadera.types import Array, Progress

Carried = list[tuple[int, Array, Array]]
"""As `ModelFile.carried` gives it."""


def load_robot(
    source: Robot | str | PathLike[str], limits: Limits = DEFAULTS, feet: Sequence[str] = (), trunk: str | None = None
) -> Robot:
    """Loads the robot of that name or file; a robot is returned unchanged.

    Trunk, legs, feet and joint order are determined from the model itself; assumptions are listed in `Robot.notes`.
    Joints are ordered by leg, LF, RF, LH, RH, and in each from the trunk outwards: HAA, HFE, KFE. Inertias are those of
    the moving links including everything fixed to them, as in the file, physically possible or not.

    Args:
        source: a name of `stadera.robot.catalog`, or a path to a URDF or MJCF file.
        limits: for reading the file.
        feet: links or frames of the feet, one a leg; none to find them.
        trunk: its link; None to find it.

    Raises:
        UnknownNameError: neither a known name nor a file, or no such foot or trunk in it.
        LimitError: the file exceeds the limits.
        MissingExtraError: the package that contains this named robot, or MuJoCo for an MJCF, is not installed.
        ModelError: the file cannot be read, or no legs hang from its trunk, or from the one given: chains of two or
            more revolute joints that reach down. Legs of six joints or more, or of five without a ball at their end,
            have flat feet, others point feet, and wheels touch below their axles.
    """
    if isinstance(source, Robot):
        return source
    if not isinstance(source, str | PathLike):
        raise ModelError(f"a robot is a name, a path or a Robot, got {type(source).__name__}")
    name, path = resolve(source)
    file = read_model_file(path, limits)
    with foreign(path, "not understood as a robot", ModelError):
        robot = robot_of(file, feet, trunk)
    return replace(robot, name=name or robot.name, feet=tuple(feet))


def read_model_file(path: Path, limits: Limits = DEFAULTS) -> ModelFile:
    """Reads a URDF or MJCF, distinguished by the root element. LimitError if it exceeds the limits, ModelError if it is
    not a file, not XML, or XML of another kind.
    """
    root = parse_xml(path, limits).root
    if root.tag == "robot":
        from stadera.robot.urdf import read_urdf

        with foreign(path, "not a URDF that can be read", ModelError):
            return read_urdf(path, root, limits)
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


def robot_of(file: ModelFile, feet: Sequence[str], trunk: str | None = None) -> Robot:
    """The robot of a model file, with feet and trunk as in `load_robot`; meshes are looked for from the file's path.
    Raises as `load_robot`.
    """
    whole, file = file, file if trunk is None else rooted_at(file, trunk)
    notes: list[str] = []
    try:
        chains = find_legs(file, feet, notes)
    except ModelError:
        other = None if feet else _trunk_with_legs(whole)
        if other is None:
            raise
        if trunk is not None:
            raise ModelError(f"{file.path}: no legs hang from trunk {trunk!r}; they hang from {other!r}") from None
        robot = robot_of(file, feet, other)
        note = f"trunk {other!r}, from which the legs hang, not {file.trunk!r}"
        return replace(robot, notes=(note, *robot.notes))
    order = [k for chain in chains for k in chain.links]
    file.require_open(order)
    locked = [file.joint(k).name for k in file.joints if k not in order]
    if locked:
        held = "belong to no leg, so their links are lumped into their parents, at zero unless a log says otherwise"
        notes.append(f"{held}: {', '.join(locked)}")
    carried, names = file.carried(order), {0: file.trunk} | {k: file.links[k].name for k in order}
    tree = Tree(tuple(names.values()), tuple(file.joint(k).name for k in order), *_joints(file, carried, [0, *order]))
    frames = _frames(file, carried, names)
    there = ((shape, frames[shape.link]) for shape in file.shapes if shape.link in frames)
    shapes = tuple(shape.moved(frame.link, frame.rotation, frame.translation) for shape, frame in there)
    legs = _legs(file, chains, frames, shapes, notes)
    for leg in legs:
        frames.setdefault(leg.foot, Frame(leg.links[-1], np.eye(3), np.asarray(leg.foot_position)))
    robot = Robot(
        name=file.name,
        tree=tree,
        legs=legs,
        inertias=_inertias(file, carried, names),
        dynamics={file.joint(k).name: file.joint(k).dynamics for k in order},
        limits=_limits(file, order, notes),
        frames=frames,
        shapes=(*shapes, *fitted_shapes(tree, legs, shapes)),
        source=file.path,
        notes=tuple(notes),
        extra=_extra(file, order),
        root=trunk,
    )
    return with_unfelt(replace(robot, notes=(*robot.notes, *check_sense(robot))))


def _trunk_with_legs(file: ModelFile) -> str | None:
    """The file's trunk if legs hang from it, else the link below a waist from which they do; None for neither."""
    with suppress(ModelError):
        find_legs(file, (), [])
        return file.trunk
    return below_a_waist(file)


def _extra(file: ModelFile, of_legs: Collection[int]) -> ExtraJoints | None:
    """The joints outside the legs that turn or slide, on the trunk or on another one of them; others stay at zero."""
    order: list[int] = []
    for k in (k for k in file.joints if k not in of_legs):
        if file.above(k) in (0, *order) and file.joint(k).kind != "other":
            order.append(k)
    if not order:
        return None
    carried, names = file.carried({*of_legs, *order}), {k: file.links[k].name.removeprefix(TURNED) for k in order}
    parents, rotations, translations, axes = _joints(file, carried, [0, *order])
    bodies, joints = file.lumped(carried), [file.joint(k) for k in order]
    return ExtraJoints(
        joints=tuple(joint.name for joint in joints),
        parents=tuple(parent - 1 for parent in parents),
        rotations=rotations,
        translations=translations,
        axes=axes,
        sliding=tuple(joint.kind == "slides" for joint in joints),
        bodies=tuple(bodies[k] for k in order),
        reference=np.zeros(len(order)),
        links=tuple(names.values()),
        effort=tuple(joint.limits.effort or np.inf for joint in joints),
        frames=_frames(file, carried, names),
    )


def _joints(file: ModelFile, carried: Carried, order: list[int]) -> tuple[tuple[int, ...], Array, Array, Array]:
    """For the joint of each link of an order but the first: the place of its parent in the order; pose of its frame in
    the parent's (n, 3, 3) and (n, 3) [m]; axis (n, 3).
    """
    poses = [file.placed(carried, k) for k in order[1:]]
    parents = tuple(order.index(at) for at, _, _ in poses)
    axes = np.array([file.joint(k).axis for k in order[1:]])
    return parents, np.array([R for _, R, _ in poses]), np.array([p for _, _, p in poses]), axes


def _inertias(file: ModelFile, carried: Carried, names: Mapping[int, str]) -> dict[str, InertialParameters]:
    bodies = file.lumped(carried)
    for k, name in names.items():
        if not bodies[k].mass > 0:
            mass = next(link.body.mass for link in file.links if link.name == name)
            why = "" if mass else ": it has no <inertial>, nor has anything fixed to it"
            raise ModelError(
                f"{file.path}: moving link {name!r} has mass {bodies[k].mass:g} kg; it must be positive{why}"
            )
    return {name: bodies[k] for k, name in names.items()}


def _frames(file: ModelFile, carried: Carried, names: Mapping[int, str]) -> dict[str, Frame]:
    """Every link and site of the file on these moving links, by the name of the link that moves it."""
    own = {link.name: (k, np.eye(3), link.origin) for k, link in enumerate(file.links)}
    frames = {}
    for name, (k, turn, place) in (own | dict(file.sites)).items():
        at, R, p = carried[k]
        if at in names:
            frames[name] = Frame(names[at], R @ turn, p + R @ place)
    return frames


def _legs(
    file: ModelFile, chains: tuple[Chain, ...], frames: dict[str, Frame], shapes: tuple[Shape, ...], notes: list[str]
) -> tuple[Leg, ...]:
    legs: list[Leg] = []
    feet_by_note: dict[str, list[str]] = {}
    for chain in chains:
        joints, links = tuple(file.joint(k).name for k in chain.links), tuple(file.links[k].name for k in chain.links)
        balls = any(shape.link == links[-1] and shape.kind == "sphere" for shape in shapes)
        wheel = _is_wheel(file, chain)
        flat = not wheel and (len(joints) >= FLAT or (len(joints) == FLAT - 1 and not balls))
        named = chain.foot if chain.foot != links[-1] else None
        try:
            if wheel:
                foot = find_wheel(file.path, links[-1], file.joint(chain.links[-1]), shapes)
            else:
                foot = (find_sole if flat else find_foot)(links[-1], frames, shapes, named)
        except ModelError as error:
            raise ModelError(f"{file.path}: leg {chain.name}: {error}") from error
        legs.append(Leg(chain.name, joints, links, foot.frame, foot.position, foot.radius, FLAT if flat else 3))
        feet_by_note.setdefault(foot.note, []).append(foot.frame)
    notes += [f"foot {', '.join(feet)}: {note}" for note, feet in feet_by_note.items() if note]
    return tuple(legs)


def _is_wheel(file: ModelFile, chain: Chain) -> bool:
    """True if a leg's last link is called a wheel, or is a fourth one or further that turns without limits, unlike the
    others.
    """
    *others, last = (file.joint(k) for k in chain.links)
    endless = last.limits.upper == np.inf and all(joint.limits.upper < np.inf for joint in others)
    return (endless and len(others) >= 3) or any(
        "wheel" in words(name) for name in (last.name, file.links[chain.links[-1]].name)
    )


def _limits(file: ModelFile, order: list[int], notes: list[str]) -> dict[str, JointLimits]:
    limits: dict[str, JointLimits] = {}
    for joint in map(file.joint, order):
        found = joint.limits
        if found.lower > found.upper:
            wrong = f"its lower limit {found.lower:g} rad is above its upper limit {found.upper:g} rad"
            raise ModelError(f"{file.path}: joint {joint.name!r}: {wrong}")
        if found.lower == found.upper:
            room = f"limits {found.lower:g} to {found.upper:g} rad leave no room"
            notes.append(f"joint {joint.name}: {room} and are read as none")
            found = replace(found, lower=-np.inf, upper=np.inf)
        if found.velocity <= 0 or found.effort <= 0:
            notes.append(f"joint {joint.name}: a limit of zero velocity or effort is read as none")
            velocity, effort = (limit if limit > 0 else np.inf for limit in (found.velocity, found.effort))
            found = replace(found, velocity=velocity, effort=effort)
        limits[joint.name] = found
    return limits


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
