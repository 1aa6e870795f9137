"""Writes a robot as USD with the physics schema: links as rigid bodies, joints with limits, drives, rotor inertia and
friction of PhysX, as Isaac Sim and Isaac Lab read them. Needs the extra `usd`.

The file is made from the robot alone: it has no meshes and no collision shapes, and joints outside the legs are
lumped, with their links, into the trunk. USD holds masses, inertias and joint values as 32-bit numbers, so they are
kept to 7 digits. Angles are in degrees there, and damping in N·m·s/deg.
"""

from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.errors import of_extra
from stadera.files import written_together
from stadera.robot.kinematics import forward_kinematics
from stadera.robot.model import Robot
from stadera.types import Array

_DEGREES = 180.0 / np.pi


def write_usd(robot: Robot, path: str | PathLike[str], notes: Sequence[str] = ()) -> None:
    """Writes the robot, trunk at the origin and joints at zero, as .usda text or .usd; notes are the file's comment.

    Raises:
        MissingExtraError: usd-core is not installed. StaderaError: the path cannot be written.
    """
    require_usd()
    from pxr import Gf, Usd, UsdGeom, UsdPhysics

    with written_together([path]) as (draft,):
        stage = Usd.Stage.CreateNew(str(draft))
        stage.SetMetadata("comment", "\n".join(notes))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
        root = UsdGeom.Xform.Define(stage, f"/{_name(robot.name)}")
        stage.SetDefaultPrim(root.GetPrim())
        paths = {link: f"{root.GetPath()}/{_name(link)}" for link in robot.tree.links}
        rotations, places = forward_kinematics(robot.tree, np.zeros((1, len(robot.tree.joints))))
        for link, rotation, place in zip(robot.tree.links, rotations[0], places[0], strict=True):
            body = UsdGeom.Xform.Define(stage, paths[link])
            body.AddTranslateOp().Set(Gf.Vec3d(*place.tolist()))
            body.AddOrientOp().Set(_quaternion(Gf, rotation))
            _add_mass(Gf, UsdPhysics, body.GetPrim(), robot, link)
        UsdPhysics.ArticulationRootAPI.Apply(stage.GetPrimAtPath(paths[robot.trunk]))
        for k, joint in enumerate(robot.tree.joints):
            made = UsdPhysics.RevoluteJoint.Define(stage, f"{root.GetPath()}/joints/{_name(joint)}")
            made.CreateBody0Rel().SetTargets([paths[robot.tree.links[robot.tree.parents[k]]]])
            made.CreateBody1Rel().SetTargets([paths[robot.tree.links[k + 1]]])
            turned = _along(robot.tree.axes[k])
            made.CreateAxisAttr("X")
            made.CreateLocalPos0Attr(Gf.Vec3f(*robot.tree.translations[k].tolist()))
            made.CreateLocalRot0Attr(_quaternion(Gf, robot.tree.rotations[k] @ turned))
            made.CreateLocalPos1Attr(Gf.Vec3f(0.0, 0.0, 0.0))
            made.CreateLocalRot1Attr(_quaternion(Gf, turned))
            _add_drive(UsdPhysics, made, robot, joint)
        stage.GetRootLayer().Save()


def require_usd() -> None:
    """Raises MissingExtraError: usd-core is not installed."""
    with of_extra("usd-core", "usd", "a USD file"):
        import pxr  # noqa: F401


def _name(name: str) -> str:
    """A name that USD allows."""
    from pxr import Tf

    return str(Tf.MakeValidIdentifier(name))


def _quaternion(gf: Any, rotation: Array) -> Any:
    x, y, z, w = Rotation.from_matrix(rotation).as_quat().tolist()
    return gf.Quatf(w, x, y, z)


def _along(axis: Array) -> Array:
    """A rotation whose x axis is this one, (3, 3)."""
    turned, _ = Rotation.align_vectors(axis[None], np.eye(3)[:1])
    return np.asarray(turned.as_matrix())


def _add_mass(gf: Any, physics: Any, prim: Any, robot: Robot, link: str) -> None:
    physics.RigidBodyAPI.Apply(prim)
    mass, body = physics.MassAPI.Apply(prim), robot.inertias[link]
    moments, axes = np.linalg.eigh(body.inertia_com)
    axes[:, 2] *= np.linalg.det(axes)
    mass.CreateMassAttr(body.mass)
    mass.CreateCenterOfMassAttr(gf.Vec3f(*body.com.tolist()))
    mass.CreateDiagonalInertiaAttr(gf.Vec3f(*moments.tolist()))
    mass.CreatePrincipalAxesAttr(_quaternion(gf, axes))


def _add_drive(physics: Any, made: Any, robot: Robot, joint: str) -> None:
    """Limits, a drive without stiffness whose damping is the viscous friction, PhysX's rotor inertia and friction."""
    from pxr import Sdf

    limits, dynamics, prim = robot.limits[joint], robot.dynamics[joint], made.GetPrim()
    if np.isfinite(limits.lower):
        made.CreateLowerLimitAttr(_DEGREES * limits.lower)
    if np.isfinite(limits.upper):
        made.CreateUpperLimitAttr(_DEGREES * limits.upper)
    drive = physics.DriveAPI.Apply(prim, "angular")
    drive.CreateStiffnessAttr(0.0)
    drive.CreateDampingAttr(dynamics.viscous / _DEGREES)
    if np.isfinite(limits.effort):
        drive.CreateMaxForceAttr(limits.effort)
    prim.AddAppliedSchema("PhysxJointAPI")
    values = {"armature": dynamics.armature, "jointFriction": dynamics.coulomb}
    if np.isfinite(limits.velocity):
        values["maxJointVelocity"] = _DEGREES * limits.velocity
    for name, value in values.items():
        prim.CreateAttribute(f"physxJoint:{name}", Sdf.ValueTypeNames.Float).Set(value)
