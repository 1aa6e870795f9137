"""The built-in HyQ against the published figures and the file they are from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from stadera.robot import load_robot
from stadera.robot.catalog import _example_robot_data, find_file


@pytest.fixture(scope="module")
def published() -> Path:
    pytest.importorskip("cmeel", reason="example-robot-data is not installed")
    folder = _example_robot_data()
    assert folder is not None
    return folder / "hyq_description/robots/hyq_no_sensors.urdf"


def test_masses_are_the_published_ones() -> None:
    robot = load_robot("hyq")
    assert robot.trunk == "trunk"
    assert robot.inertias["trunk"].mass == pytest.approx(60.96 + 0.018 + 1e-6, rel=1e-12)
    for leg, mass in (("hipassembly", 2.93), ("upperleg", 2.638), ("lowerleg", 0.881 + 1e-6)):
        assert robot.inertias[f"rh_{leg}"].mass == pytest.approx(mass, rel=1e-12)


def test_is_the_published_model(published: Path) -> None:
    ours = pin.buildModelFromUrdf(str(find_file("hyq")), pin.JointModelFreeFlyer())
    theirs = pin.buildModelFromUrdf(str(published), pin.JointModelFreeFlyer())
    assert list(ours.names) == list(theirs.names)
    assert {(f.name, str(f.type)) for f in ours.frames} == {(f.name, str(f.type)) for f in theirs.frames}
    for mine, his in zip(ours.inertias, theirs.inertias, strict=True):
        np.testing.assert_allclose(mine.toDynamicParameters(), his.toDynamicParameters(), rtol=1e-14, atol=1e-18)
    for kind in ("PositionLimit", "VelocityLimit", "EffortLimit"):
        for side in ("lower", "upper"):
            np.testing.assert_array_equal(getattr(ours, side + kind), getattr(theirs, side + kind))
    np.testing.assert_array_equal(ours.damping, theirs.damping)
    mine_data, his_data, rng = ours.createData(), theirs.createData(), np.random.default_rng(3)
    for angles in rng.uniform(-2, 2, (5, 12)):
        q = np.concatenate([pin.neutral(ours)[:7], angles])
        pin.framesForwardKinematics(ours, mine_data, q)
        pin.framesForwardKinematics(theirs, his_data, q)
        for frame in ours.frames:
            k = ours.getFrameId(frame.name, frame.type), theirs.getFrameId(frame.name, frame.type)
            np.testing.assert_allclose(
                mine_data.oMf[k[0]].homogeneous, his_data.oMf[k[1]].homogeneous, rtol=0, atol=1e-14
            )


def test_shapes_lie_about_the_links_centres_of_mass() -> None:
    robot = load_robot("hyq")
    for leg in ("lf", "rf", "lh", "rh"):
        hip = next(shape for shape in robot.shapes if shape.link == f"{leg}_hipassembly" and shape.kind == "cylinder")
        assert np.linalg.norm(hip.translation - robot.inertias[hip.link].com) < 0.05
        thigh = next(shape for shape in robot.shapes if shape.link == f"{leg}_upperleg")
        assert np.linalg.norm(thigh.translation - robot.inertias[thigh.link].com) < 0.05


def test_has_no_meshes() -> None:
    assert "<mesh" not in find_file("hyq").read_text()
