"""A robot as USD has the masses, places, axes and drives of the robot; without usd-core the extra is named."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from stadera.errors import MissingExtraError
from stadera.robot import JointDynamics, load_robot
from stadera.robot.kinematics import forward_kinematics
from stadera.robot.usd import write_usd


def test_without_the_package_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(MissingExtraError, match=r"stadera\[usd\]"):
        write_usd(load_robot("hyq"), tmp_path / "hyq.usda")
    assert not list(tmp_path.iterdir())


def test_a_usd_has_the_robots_values(tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="usd-core is not installed")
    from pxr import Usd, UsdGeom, UsdPhysics

    robot = load_robot("hyq")
    joint = robot.tree.joints[1]
    robot = robot.with_dynamics({joint: JointDynamics(0.03, 0.5, 1.2)})
    write_usd(robot, tmp_path / "hyq.usda", ["first note"])
    stage = Usd.Stage.Open(str(tmp_path / "hyq.usda"))
    assert "first note" in stage.GetMetadata("comment")
    prims = {prim.GetName(): prim for prim in stage.Traverse()}
    masses = [UsdPhysics.MassAPI(prims[link]).GetMassAttr().Get() for link in robot.tree.links]
    assert sum(masses) == pytest.approx(robot.mass, rel=1e-6)
    _, places = forward_kinematics(robot.tree, np.zeros((1, len(robot.tree.joints))))
    for k, link in enumerate(robot.tree.links):
        pose = UsdGeom.Xformable(prims[link]).ComputeLocalToWorldTransform(Usd.TimeCode.Default())
        np.testing.assert_allclose(pose.ExtractTranslation(), places[0, k], atol=1e-6)
        mass = UsdPhysics.MassAPI(prims[link])
        q = mass.GetPrincipalAxesAttr().Get()
        from scipy.spatial.transform import Rotation

        axes = Rotation.from_quat([*q.GetImaginary(), q.GetReal()]).as_matrix()
        tensor = axes @ np.diag(mass.GetDiagonalInertiaAttr().Get()) @ axes.T
        size = np.abs(robot.inertias[link].inertia_com).max()
        np.testing.assert_allclose(tensor, robot.inertias[link].inertia_com, atol=1e-5 * size)
    made = UsdPhysics.RevoluteJoint(prims[joint])
    assert made.GetLowerLimitAttr().Get() == pytest.approx(np.degrees(robot.limits[joint].lower), rel=1e-6)
    assert made.GetBody1Rel().GetTargets()[0].name == robot.tree.links[2]
    assert prims[joint].GetAttribute("physxJoint:armature").Get() == pytest.approx(0.03)
    assert prims[joint].GetAttribute("physxJoint:jointFriction").Get() == pytest.approx(1.2)
    drive = UsdPhysics.DriveAPI(prims[joint], "angular")
    assert drive.GetDampingAttr().Get() == pytest.approx(0.5 * np.pi / 180.0)
