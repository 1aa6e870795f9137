"""Writes a robot's inertial parameters and joint dynamics back into a copy of its model file.

Identification determines the sum of all bodies that move with a link. So this sum is written to the moving link, and
the inertials of the bodies fixed to it are removed. A body behind a joint that belongs to no leg (an arm) keeps its
inertial, which is subtracted from the sum. Links and joints with unchanged values, and everything else in the file,
stay as they are.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stadera.constants import NOTHING, ROUNDING
from stadera.errors import ModelError
from stadera.files import written_together
from stadera.inertia import InertialParameters
from stadera.limits import UNLIMITED
from stadera.robot.load import parse_xml, read_model_file, robot_of
from stadera.robot.model import JointDynamics, Robot
from stadera.robot.modelfile import ModelFile
from stadera.robot.xml import plain, read_xml
from stadera.types import Array

_URDF = {"viscous": "damping", "coulomb": "friction"}
_MJCF = {"viscous": "damping", "coulomb": "frictionloss", "armature": "armature"}
"""Attributes of a joint's dynamics, by term; in a URDF those of its element <dynamics>."""
_UNITS = {"armature": "kg m^2", "offset": "N m"}


@dataclass(frozen=True, eq=False)
class PayloadLink:
    """The link to add: its ten parameters in the trunk frame (with a zero tensor about its centre of mass a point
    mass), its name, and one sentence on the accuracy of the values for readers of the file, or empty. Raises
    ModelError: the mass is not positive.
    """

    body: InertialParameters
    name: str = "payload"
    note: str = ""

    def __post_init__(self) -> None:
        if not self.body.mass > 0:
            raise ModelError(f"a payload needs a positive mass to be a link, got {self.body.mass:.6g} kg")

    @property
    def tensor(self) -> Array:
        """Inertia about its centre of mass, trunk axes, (3, 3) [kg·m²]; zero of a point mass."""
        tensor = self.body.inertia_com
        return np.where(np.abs(tensor) < 1e-12 * np.abs(self.body.inertia).max(), 0.0, tensor)


def export_model(robot: Robot, path: str | Path, payload: PayloadLink | None = None, note: str = "") -> None:
    """Writes `robot.source` with the robot's inertias and joint dynamics to `path`: URDF to URDF, MJCF to MJCF. The
    payload is an additional link fixed to the trunk, not included in the trunk's values; the note a comment at the top
    of the file.

    URDF cannot represent rotor inertia (armature) and torque offsets, MJCF cannot represent offsets: a comment at the
    top of the file lists them. Mesh paths (package://...) are unchanged; an MJCF has its included files merged, and
    written to another folder states the absolute path of its assets. The file is read back and compared before it
    replaces an existing one.

    Raises:
        ModelError: as of `check_export`; a value that the format cannot represent (mass not positive, friction
            negative; in MJCF an impossible inertia, or inertias that all come from its shapes); a payload whose name is
            taken.
        StaderaError: the folder does not exist or is not writable.
    """
    target = Path(path)
    source, is_urdf = check_export(robot, target)
    file, document = read_model_file(source, UNLIMITED), parse_xml(source, UNLIMITED)
    prior = _loaded_as(robot, file)
    inertias = _changed_inertias(robot, prior, file)
    dynamics = {joint: d for joint, d in robot.dynamics.items() if d != prior.dynamics[joint]}
    origins = {link: prior.frames[link].translation for link in prior.tree.links}
    if not is_urdf:
        _prepare_mjcf(document.root, source, target)
    own = {link: body.shifted(-origins[link]) for link, body in inertias.items()}
    _put_inertias(document.root, source, own, _fixed_bodies(prior, file), is_urdf=is_urdf)
    _put_dynamics(document.root, source, dynamics, is_urdf=is_urdf)
    document.remark(_description(inertias, dynamics, is_urdf=is_urdf))
    if payload is not None:
        add = _add_urdf_payload if is_urdf else _add_mjcf_payload
        add(document.root, source, prior.trunk, payload, payload.body.com - origins[prior.trunk])
        robot = robot.with_inertias({robot.trunk: robot.inertias[robot.trunk] + payload.body})  # as it reads back
    if note:
        document.remark(note)
    with written_together([target]) as (draft,):
        with draft.open("w", encoding="utf-8") as stream:
            document.write(stream)
        _check_reads_back(robot, draft, target, source)


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
            "trunk is the root, or is found fixed to it, is written to a model file"
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


def _loaded_as(robot: Robot, file: ModelFile) -> Robot:
    """A file's robot with the feet and the trunk of this one, and the joints outside its legs where this one's are."""
    other, extra = robot_of(file, robot.feet, robot.root), robot.extra
    return other if extra is None else other.posed(dict(zip(extra.joints, extra.reference, strict=True)))


def _check_reads_back(robot: Robot, written: Path, target: Path, source: Path) -> None:
    try:
        file = read_model_file(written, UNLIMITED)
        back = _loaded_as(robot, replace(file, path=source))  # where its meshes are
    except ModelError as error:
        raise ModelError(f"{target}: {str(error).removeprefix(f'{written}: ').removeprefix(f'{source}: ')}") from error
    for link in robot.tree.links:
        wanted = robot.inertias[link].vector
        size = np.repeat([np.linalg.norm(part) for part in np.split(wanted, [1, 4])], [1, 3, 6])
        wrong = np.abs(back.inertias[link].vector - wanted) > ROUNDING * size + 1e-15
        if wrong.any():
            raise ModelError(f"{target}: link {link!r} does not read back as written; the model's format alters it")


# -- elements --------------------------------------------------------------------------------------------------------
def _put_inertias(
    root: ET.Element,
    source: Path,
    inertias: Mapping[str, InertialParameters],
    fixed: Mapping[str, list[str]],
    *,
    is_urdf: bool,
) -> None:
    """Writes inertias, each in the file's own frame of its link, and takes away those of the bodies fixed to it."""
    tag, made = ("link", _urdf_inertial) if is_urdf else ("body", _mjcf_inertial)
    for link, body in inertias.items():
        if not is_urdf:
            _check_possible(link, body)
        _put_child(_named(root, tag, link, source), made(body.mass, body.com, body.inertia_com))
        for owner in (_named(root, tag, name, source) for name in fixed[link]):
            if is_urdf:
                for inertial in owner.findall("inertial"):
                    _remove(owner, inertial)
            else:
                _put_child(owner, _element("inertial", {"pos": "0 0 0", "mass": "0", "diaginertia": "0 0 0"}))


def _put_dynamics(root: ET.Element, source: Path, dynamics: Mapping[str, JointDynamics], *, is_urdf: bool) -> None:
    for joint, values in dynamics.items():
        owner = _named(root, "joint", joint, source)
        target = owner.find("dynamics") if is_urdf else owner
        if target is None:
            _append(owner, target := ET.Element("dynamics"))
        for term, name in (_URDF if is_urdf else _MJCF).items():
            if (value := getattr(values, term)) < 0:
                wrong = f"joint {joint!r} has a {term} value of {value:g}, below zero"
                raise ModelError(f"{wrong}, which no model file should hold")
            target.set(name, _numbers(value))


def _add_urdf_payload(root: ET.Element, source: Path, trunk: str, payload: PayloadLink, place: Array) -> None:
    joint = f"{payload.name}_joint"
    _check_free(root, "link", payload.name)
    _check_free(root, "joint", joint)
    parts = (
        _element("origin", {"xyz": _numbers(place), "rpy": "0 0 0"}),
        _element("parent", {"link": trunk}),
        _element("child", {"link": payload.name}),
    )
    link = _element("link", {"name": payload.name}, _urdf_inertial(payload.body.mass, np.zeros(3), payload.tensor))
    _add_nodes(root, payload, link, _element("joint", {"name": joint, "type": "fixed"}, *parts))


def _add_mjcf_payload(root: ET.Element, source: Path, trunk: str, payload: PayloadLink, place: Array) -> None:
    _check_free(root, "body", payload.name)
    inertial = _mjcf_inertial(payload.body.mass, np.zeros(3), payload.tensor)
    body = _element("body", {"name": payload.name, "pos": _numbers(place)}, inertial)
    _add_nodes(_named(root, "body", trunk, source), payload, body)


def _add_nodes(parent: ET.Element, payload: PayloadLink, *nodes: ET.Element) -> None:
    """Appends the elements of the payload after a comment, each on its own line where the others are."""
    _append(parent, ET.Comment(plain(f" {payload.name}: the load that was weighed. {payload.note} ")))
    for node in nodes:
        _append(parent, node)


def _urdf_inertial(mass: float, com: Array, tensor: Array) -> ET.Element:
    """The inertia about the centre of mass, in the link's own axes."""
    components = {f"i{'xyz'[i]}{'xyz'[j]}": _numbers(tensor[i, j]) for i in range(3) for j in range(i, 3)}
    return _element(
        "inertial",
        {},
        _element("origin", {"xyz": _numbers(com), "rpy": "0 0 0"}),
        _element("mass", {"value": _numbers(mass)}),
        _element("inertia", components),
    )


def _mjcf_inertial(mass: float, com: Array, tensor: Array) -> ET.Element:
    """Principal moments about the centre of mass, and the rotation to their axes (quaternion wxyz)."""
    from scipy.spatial.transform import Rotation

    moments, axes = np.linalg.eigh(tensor)
    axes[:, 2] *= np.linalg.det(axes)
    quaternion = Rotation.from_matrix(axes).as_quat(scalar_first=True)
    values = {"pos": com, "quat": quaternion, "mass": mass, "diaginertia": np.maximum(moments, 0.0)}
    return _element("inertial", {name: _numbers(value) for name, value in values.items()})


def _check_possible(link: str, inertia: InertialParameters) -> None:
    moments = np.linalg.eigvalsh(inertia.inertia_com)
    if not (moments > 0).all() or moments[0] + moments[1] < moments[2]:
        raise ModelError(
            f"link {link!r} has principal moments {', '.join(f'{m:.6g}' for m in moments)} kg·m², which no body has "
            "and MJCF does not hold; identify it physically consistent"
        )


def _prepare_mjcf(root: ET.Element, source: Path, target: Path) -> None:
    """Merges included files, and makes folders of assets absolute if the target is in another folder. Default classes
    stay: values are written to the elements themselves, which overrides them.
    """
    _draw_in_includes(root, source.parent)
    for compiler in root.iter("compiler"):
        if compiler.get("inertiafromgeom") == "true" or "settotalmass" in compiler.attrib:
            raise ModelError(f"{source}: its compiler makes inertias itself (inertiafromgeom or settotalmass)")
    if target.resolve().parent == source.resolve().parent or root.find(".//asset") is None:
        return
    if root.find("compiler") is None:
        _put_child(root, ET.Element("compiler"))
    compilers = root.findall("compiler")
    said = {name: value for compiler in compilers for name, value in compiler.items()}
    for name in ("meshdir", "texturedir"):  # both default to the model's own folder
        for compiler in compilers:
            compiler.set(name, str(source.resolve().parent / said.get(name, said.get("assetdir", ""))))


def _draw_in_includes(root: ET.Element, folder: Path) -> None:
    for parent in list(root.iter()):
        for include in parent.findall("include"):
            inner, at = read_xml(folder / include.get("file", "")).root, list(parent).index(include)
            _draw_in_includes(inner, folder)
            parent[at : at + 1] = list(inner)


def _description(links: Iterable[str], dynamics: Mapping[str, JointDynamics], *, is_urdf: bool) -> str:
    """Comment on the links and joints written, and on joint values that the format cannot represent."""
    lines = [
        "Written by stadera. Inertial values of these links are those of all that moves with the link, and the "
        f"inertials of the bodies fixed to it were taken away: {', '.join(links) or 'none'}.",
        f"Joint friction written for: {', '.join(dynamics) or 'none'}.",
    ]
    without = [term for term in _UNITS if term not in (_URDF if is_urdf else _MJCF)]
    every = ((joint, term, getattr(d, term)) for joint, d in dynamics.items() for term in without)
    left = [(joint, term, value) for joint, term, value in every if abs(value) > NOTHING]
    if left:
        listed = "; ".join(f"{joint} {term} {value:.6g} {_UNITS[term]}" for joint, term, value in left)
        lines.append(f"Values that this format has no place for: {listed}.")
    return "\n  ".join(lines)


def _named(root: ET.Element, tag: str, name: str, source: Path) -> ET.Element:
    """The element with that tag and name. Raises ModelError: there is none, as for bodies that a model attaches from
    another file.
    """
    for found in root.iter(tag):
        if found.get("name") == name:
            return found
    raise ModelError(f"{source}: no <{tag} name={name!r}> in the file itself to write the values into")


def _check_free(root: ET.Element, tag: str, name: str) -> None:
    """Checks that no element of that tag has this name. Raises ModelError: there is one."""
    if any(found.get("name") == name for found in root.iter(tag)):
        raise ModelError(f"the model has a {tag} {name!r} already; a payload needs another name")


def _put_child(parent: ET.Element, child: ET.Element) -> None:
    """Replaces the first child of the same tag, or inserts the child first, on its own line where the others are;
    further children of its tag are removed.
    """
    present = parent.findall(child.tag)
    child.tail = present[0].tail if present else parent.text
    if present and len(child) and len(present[0]):  # on lines as those that are replaced
        child.text = present[0].text
        for one in child:
            one.tail = child.text
        child[-1].tail = present[0][-1].tail
    at = list(parent).index(present[0]) if present else 0
    for one in present:
        parent.remove(one)
    parent.insert(at, child)


def _remove(parent: ET.Element, child: ET.Element) -> None:
    """Takes a child out with its line."""
    at = list(parent).index(child)
    if at == len(parent) - 1 and at:
        parent[at - 1].tail = child.tail
    elif at == len(parent) - 1:
        parent.text = child.tail
    parent.remove(child)


def _append(parent: ET.Element, child: "ET.Element[Any]") -> None:
    """Adds a last child, on its own line where the others are."""
    if len(parent):
        child.tail, parent[-1].tail = parent[-1].tail, parent.text
    parent.append(child)


def _element(tag: str, attributes: Mapping[str, str], *inside: ET.Element) -> ET.Element:
    """A new element with these attributes and children."""
    made = ET.Element(tag, dict(attributes))
    made.extend(inside)
    return made


def _numbers(values: ArrayLike) -> str:
    """In full precision."""
    return " ".join(repr(float(value)) for value in np.ravel(values))
