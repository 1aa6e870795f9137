"""A payload written as a link of its own loads back to the same numbers."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from stadera.errors import MissingExtraError, ModelError
from stadera.inertia import InertialParameters
from stadera.robot import Robot, load_robot
from stadera.robot.export import PayloadLink, export_model

COM = np.array([-0.21, 0.08, 0.17])
BOX = InertialParameters.from_com(7.5, COM, [[0.03, 0.004, -0.002], [0.004, 0.05, 0.001], [-0.002, 0.001, 0.06]])
POINT = InertialParameters.from_com(7.5, COM, np.zeros((3, 3)))


def robot_named(name: str) -> Robot:
    try:
        return load_robot(name)
    except MissingExtraError as error:
        pytest.skip(str(error))


def written(robot: Robot, folder: Path, body: InertialParameters) -> Path:
    path = folder / f"loaded{Path(str(robot.source)).suffix}"
    export_model(robot, path, PayloadLink(body))
    return path


@pytest.mark.parametrize("name", ["hyq", "go2", "anymal_c", "aliengo", "spot"])
@pytest.mark.parametrize("body", [BOX, POINT], ids=["box", "point"])
def test_the_trunk_reads_back_with_the_payload_in_it(name: str, body: InertialParameters, tmp_path: Path) -> None:
    robot = robot_named(name)
    back = load_robot(written(robot, tmp_path, body))
    added = back.inertias[robot.trunk] - robot.inertias[robot.trunk]
    assert added.vector == pytest.approx(body.vector, abs=1e-9)
    assert back.tree.links == robot.tree.links
    for link in robot.tree.links[1:]:
        assert back.inertias[link].vector == pytest.approx(robot.inertias[link].vector, abs=1e-12)


@pytest.mark.parametrize("name", ["hyq", "go2"])
def test_pinocchio_sees_a_body_of_its_own(name: str, tmp_path: Path) -> None:
    robot = robot_named(name)
    model = pin.buildModelFromUrdf(str(written(robot, tmp_path, BOX)), pin.JointModelFreeFlyer())
    frame = model.frames[model.getFrameId("payload")]
    joint = model.frames[frame.parentFrame]  # Pinocchio keeps a fixed link's inertia with its joint
    assert joint.name == "payload_joint"
    assert frame.placement.translation == pytest.approx(COM, abs=1e-12)
    assert joint.inertia.mass == pytest.approx(BOX.mass)
    assert joint.inertia.lever == pytest.approx(np.zeros(3), abs=1e-12)
    assert joint.inertia.inertia == pytest.approx(BOX.inertia_com, abs=1e-12)


def test_mujoco_sees_a_body_of_its_own(tmp_path: Path) -> None:
    robot = robot_named("aliengo")
    model = mujoco.MjModel.from_xml_path(str(written(robot, tmp_path, BOX)))
    body = model.body("payload")
    assert model.body(int(body.parentid[0])).name == robot.trunk
    assert body.mass[0] == pytest.approx(BOX.mass)
    assert sorted(body.inertia) == pytest.approx(np.linalg.eigvalsh(BOX.inertia_com), abs=1e-12)


@pytest.mark.parametrize("name", ["anymal_c", "aliengo"])
def test_lines_of_the_file_stay_and_the_payload_has_its_own(name: str, tmp_path: Path) -> None:
    robot = robot_named(name)
    light = robot.with_inertias({robot.trunk: robot.inertias[robot.trunk] + POINT})  # whose file has it on other links
    path = tmp_path / f"loaded{Path(str(robot.source)).suffix}"
    export_model(light, path, PayloadLink(BOX))
    before, after = (file.read_text().splitlines() for file in (Path(str(robot.source)), path))
    own = ("inertia", "<origin", "<mass", "<compiler")
    gone = (line for line in (Counter(before) - Counter(after)) if line.strip())
    assert [line for line in gone if not any(word in line for word in own)] == []
    assert any(line.strip().startswith(('<body name="payload"', '<link name="payload"')) for line in after)


def test_a_name_that_is_taken(tmp_path: Path) -> None:
    robot = load_robot("hyq")
    with pytest.raises(ModelError, match="has a link 'trunk' already"):
        export_model(robot, tmp_path / "out.urdf", PayloadLink(BOX, name=robot.trunk))
    assert not list(tmp_path.iterdir())


def test_a_payload_without_mass() -> None:
    with pytest.raises(ModelError, match="positive mass"):
        PayloadLink(InertialParameters.zero())
