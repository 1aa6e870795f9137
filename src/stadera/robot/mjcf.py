"""Reads MJCF with MuJoCo's own compiler, which defines it (defaults, includes, angles, actuators)."""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator
from math import cos, sin
from pathlib import Path
from typing import Any
from xml.parsers.expat import ExpatError

import mujoco
import numpy as np

from stadera.boundary import foreign
from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.limits import Limits
from stadera.robot.model import JointDynamics, JointLimits, Shape
from stadera.robot.modelfile import FileJoint, FileLink, ModelFile
from stadera.robot.xml import read_xml
from stadera.types import Array

_PRIMITIVES = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
}
_FREE_BY_SIX = [int(mujoco.mjtJoint.mjJNT_SLIDE)] * 3 + [int(mujoco.mjtJoint.mjJNT_HINGE)] * 3  # in order


def read_mjcf(path: Path) -> ModelFile:
    """Reads an MJCF. Raises ModelError: MuJoCo cannot compile it, or it has no body with joints."""
    builder = _CompiledModel(path, compile_mjcf(path))
    links = tuple(builder.links())
    name = builder.mj.names.split(b"\0", 1)[0].decode() or path.stem
    return ModelFile(
        path, name, links, links[0].name, builder.sites(links), tuple(builder.shapes()), tuple(builder.loops())
    )


def require_size(root: ET.Element, path: Path, limits: Limits) -> None:
    """Checks the sizes that an MJCF requests from a compiler: included files, copies, arrays. Raises LimitError: too
    many elements, or an array that is too large.
    """
    total = _elements(root, path, limits, {path.resolve()})
    limits.require("elements", total, path, "elements, with all copies and included files")


def _elements(node: ET.Element, path: Path, limits: Limits, seen: set[Path]) -> float:
    """Number of elements in this one, itself included, with all copies."""
    own = 1.0 + sum(_elements(child, path, limits, seen) for child in node)
    if node.tag in ("size", "numeric", "hfield"):  # their numbers are sizes of arrays
        largest = max((_number(value) for name, value in node.items() if name != "memory"), default=0.0)
        limits.require("elements", largest / 1e6, path, f"million numbers of <{node.tag}>")
    if node.tag in ("include", "model") and (name := node.get("file")):
        own += _of_file(path.parent / name, limits, seen)
    for word in (node.get("count") or "").split():
        own *= max(_number(word), 1.0)
    return own


def _of_file(path: Path, limits: Limits, seen: set[Path]) -> float:
    """Number of elements in another file; zero if it does not exist or is not XML, which the compiler reports
    better.
    """
    if path.resolve() in seen or not path.is_file():
        return 0.0
    seen.add(path.resolve())
    try:
        root = read_xml(path, limits).root
    except (ExpatError, LookupError, ValueError):
        return 0.0
    return _elements(root, path, limits, seen)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0


def keep_quiet() -> None:
    """Discards MuJoCo's warnings, which by default are appended to MUJOCO_LOG.TXT in the working folder, unless this
    process has its own handler. Their causes are detected here: a model that does not compile, a motion that diverges.
    """
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(lambda text: None)


def compile_mjcf(path: Path) -> Any:
    """MuJoCo's compiled model. Omitted are meshes that do not affect inertias, so that their files need not exist, and
    sensors and pairs of shapes that may touch: those of a robot's file may name shapes of its scene's.
    """
    keep_quiet()
    with foreign(path, "not an MJCF that MuJoCo can compile", ModelError):
        spec = mujoco.MjSpec.from_file(str(path))
        for unused in [*spec.pairs, *spec.excludes, *spec.sensors, *spec.keys]:
            spec.delete(unused)
        if not _inertia_from_meshes(spec):
            _drop_meshes(spec)
        return spec.compile()


def _is_mesh(geom: Any) -> bool:
    return bool(geom.meshname) or geom.type in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF)


def _inertia_from_meshes(spec: Any) -> bool:
    forced = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    meshes = (geom for geom in spec.geoms if _is_mesh(geom) and geom.parent.name != "world")
    return any((forced or not g.parent.explicitinertial) and g.mass != 0 and g.density != 0 for g in meshes)


def _drop_meshes(spec: Any, kept: Collection[str] = ()) -> None:
    for geom in list(spec.geoms):
        if _is_mesh(geom) and geom.meshname not in kept:
            spec.delete(geom)
        else:
            geom.material = ""
    unused = (mesh for mesh in spec.meshes if (mesh.name or Path(mesh.file).stem) not in kept)
    for asset in [*unused, *spec.materials, *spec.textures]:
        spec.delete(asset)


def mesh_vertices(path: Path, joint: str) -> list[Array]:
    """Vertices (k, 3) [m] of the meshes of the body that a joint moves, in its link's frame: of those that collide, or
    of all if nothing of the body does. Raises ModelError: a file of theirs is missing.
    """
    keep_quiet()
    with foreign(path, "its meshes cannot be read", ModelError):
        spec = mujoco.MjSpec.from_file(str(path))
        for unused in [*spec.pairs, *spec.excludes, *spec.sensors, *spec.keys]:
            spec.delete(unused)
        found = spec.joint(joint)
        geoms = found.parent.geoms if found is not None else []  # a joint without a name has one made for it
        own = [geom for geom in geoms if geom.contype or geom.conaffinity] or geoms
        own = [geom for geom in own if _is_mesh(geom)]
        _drop_meshes(spec, {geom.meshname for geom in own})
        mj = spec.compile()
    if not own:
        return []
    body, vertices = int(mj.jnt_bodyid[mj.joint(joint).id]), []
    for g in range(mj.body_geomadr[body], mj.body_geomadr[body] + mj.body_geomnum[body]):
        if (mesh := int(mj.geom_dataid[g])) >= 0 and mj.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH:
            begin, count = mj.mesh_vertadr[mesh], mj.mesh_vertnum[mesh]
            points = mj.mesh_vert[begin : begin + count] @ _rotation(mj.geom_quat[g]).T + mj.geom_pos[g]
            vertices.append(points - mj.jnt_pos[mj.joint(joint).id])
    return vertices


class _CompiledModel:
    """Takes links, sites and shapes from a compiled model; a link's frame has its body's axes and its origin at the
    joint's anchor. Of several joints of a body all but the last have links of their own, without mass.
    """

    def __init__(self, path: Path, mj: Any) -> None:
        self.path, self.mj = path, mj
        self.bodies = self._robot_bodies()

    # -- names and order ------------------------------------------------------------------------------------------
    def _body_name(self, body: int) -> str:
        return str(self.mj.body(body).name) or f"body_{body}"

    def _robot_bodies(self) -> list[int]:
        """Bodies of the tree with the most hinges, its root first."""
        mj = self.mj
        roots = mj.body_rootid[mj.jnt_bodyid[mj.jnt_type == mujoco.mjtJoint.mjJNT_HINGE]]
        if not len(roots):
            raise ModelError(f"{self.path}: no body has a hinge joint, this is no robot")
        found: list[int] = np.flatnonzero(mj.body_rootid == np.bincount(roots).argmax()).tolist()
        return found

    # -- bodies and joints ----------------------------------------------------------------------------------------
    def links(self) -> Iterator[FileLink]:
        """The links, body by body."""
        mj, trunk, count = self.mj, self.bodies[0], 0
        kinds = sorted(mj.jnt_type[mj.jnt_bodyid == trunk].tolist())
        if kinds not in ([], [int(mujoco.mjtJoint.mjJNT_FREE)], _FREE_BY_SIX):
            raise ModelError(f"{self.path}: body {self._body_name(trunk)!r} is neither free nor fixed to the world")
        places: dict[int, tuple[int, Array]] = {}  # by body, of its link, and its origin there
        for body in self.bodies:
            at, place, turn = -1, np.zeros(3), np.eye(3)
            if body != trunk:
                at, origin = places[int(mj.body_parentid[body])]
                place, turn = origin + mj.body_pos[body], _rotation(mj.body_quat[body])
            origin, joint = np.zeros(3), None  # of the body, from the last joint's anchor
            for j in np.flatnonzero(mj.jnt_bodyid == body).tolist() if body != trunk else ():
                if joint is not None:
                    yield FileLink(f"{joint.name}_link", at, turn, place, InertialParameters.zero(), joint)
                    at, count, place, turn = count, count + 1, np.zeros(3), np.eye(3)
                joint, back, way = self._joint(j)
                place, turn, origin = place + turn @ (origin + mj.jnt_pos[j] + way), turn @ back, -mj.jnt_pos[j]
            axes = _rotation(mj.body_iquat[body])
            tensor, com = axes @ np.diag(mj.body_inertia[body]) @ axes.T, mj.body_ipos[body] + origin
            inertia = InertialParameters.from_com(mj.body_mass[body], com, tensor)
            yield FileLink(self._body_name(body), at, turn, place, inertia, joint, origin)
            places[body], count = (count, origin), count + 1

    def sites(self, links: tuple[FileLink, ...]) -> dict[str, tuple[int, Array, Array]]:
        """The named sites: place of their link, and pose in it."""
        mj, place = self.mj, {link.name: k for k, link in enumerate(links)}
        found = {}
        for site in range(mj.nsite):
            name, body = mj.site(site).name, int(mj.site_bodyid[site])
            if name and body in self.bodies:
                at = place[self._body_name(body)]
                found[name] = at, _rotation(mj.site_quat[site]), links[at].origin + mj.site_pos[site]
        return found

    def loops(self) -> Iterator[tuple[str, str]]:
        """Pairs of bodies that are tied to each other besides by the tree."""
        mj, ties = self.mj, (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
        for e in np.flatnonzero(np.isin(mj.eq_type, [int(tie) for tie in ties])):
            ends = [int(mj.eq_obj1id[e]), int(mj.eq_obj2id[e])]
            if mj.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
                ends = [int(mj.site_bodyid[end]) for end in ends]
            if all(end in self.bodies for end in ends):
                yield self._body_name(ends[0]), self._body_name(ends[1])

    def _joint(self, j: int) -> tuple[FileJoint, Array, Array]:
        """A joint, and the turn and way by which its zero becomes MuJoCo's zero (the file's pose is at `ref`)."""
        mj, axis, dof = self.mj, np.array(self.mj.jnt_axis[j]), int(self.mj.jnt_dofadr[j])
        kinds = {int(mujoco.mjtJoint.mjJNT_HINGE): "turns", int(mujoco.mjtJoint.mjJNT_SLIDE): "slides"}
        kind: Any = kinds.get(int(mj.jnt_type[j]), "other")
        ref = float(mj.qpos0[mj.jnt_qposadr[j]]) if kind != "other" else 0.0
        lower, upper = mj.jnt_range[j].tolist() if mj.jnt_limited[j] else (-np.inf, np.inf)
        limits = JointLimits(lower, upper, effort=self._effort(j))
        values = (float(x[dof]) for x in (mj.dof_armature, mj.dof_damping, mj.dof_frictionloss))
        name = str(mj.joint(j).name) or f"{self._body_name(int(mj.jnt_bodyid[j]))}_joint"
        joint = FileJoint(name, kind, axis, limits, JointDynamics(*values))
        if kind == "turns":
            return joint, _rotation(np.array([cos(0.5 * ref), *(-sin(0.5 * ref) * axis)])), np.zeros(3)
        return joint, np.eye(3), -ref * axis

    def _effort(self, j: int) -> float:
        """Largest torque [N·m] allowed by the joint's own limit and its actuators' ranges."""
        mj = self.mj
        limit = float(np.abs(mj.jnt_actfrcrange[j]).max()) if mj.jnt_actfrclimited[j] else np.inf
        own = (mj.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (mj.actuator_trnid[:, 0] == j)
        forces = [self._actuator_force(a) * abs(float(mj.actuator_gear[a, 0])) for a in np.flatnonzero(own).tolist()]
        return min(limit, sum(forces)) if forces else limit

    def _actuator_force(self, a: int) -> float:
        mj = self.mj
        force = float(np.abs(mj.actuator_forcerange[a]).max()) if mj.actuator_forcelimited[a] else np.inf
        fixed_gain = mj.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_FIXED
        if fixed_gain and mj.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_NONE and mj.actuator_ctrllimited[a]:
            force = min(force, float(np.abs(mj.actuator_ctrlrange[a]).max() * abs(mj.actuator_gainprm[a, 0])))
        return force

    # -- shapes ---------------------------------------------------------------------------------------------------
    def shapes(self) -> Iterator[Shape]:
        """Primitive shapes: a body's colliding ones, or all if none collides."""
        mj = self.mj
        for body in self.bodies:
            geoms = [g for g in np.flatnonzero(mj.geom_bodyid == body) if int(mj.geom_type[g]) in _PRIMITIVES]
            colliding = [g for g in geoms if mj.geom_contype[g] or mj.geom_conaffinity[g]]
            for g in colliding or geoms:
                kind: Any = _PRIMITIVES[int(mj.geom_type[g])]
                size = np.array(mj.geom_size[g])
                full = {"sphere": size[:1], "box": 2 * size}.get(kind, np.array([size[0], 2 * size[1]]))
                turn, place = _rotation(mj.geom_quat[g]), np.array(mj.geom_pos[g])
                yield Shape(self._body_name(body), kind, tuple(map(float, full)), turn, place)


def _rotation(quaternion_wxyz: Array) -> Array:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.array(quaternion_wxyz))
    return matrix.reshape(3, 3)
