"""Numbers that no quadruped has, and files that are made by a macro."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from robot_files import CORNERS, SPHERE, mjcf, quadruped, urdf_joint, urdf_leg, urdf_link, write

from stadera.errors import MissingExtraError, ModelError
from stadera.robot import load_robot
from stadera.robot.export import export_model

LEG = urdf_leg("lf", CORNERS["LF"])
LIMIT = '<limit lower="-2" upper="2" velocity="10" effort="50"/>'
INERTIAL = LEG[LEG.index("<inertial>") : LEG.index("</inertial>") + len("</inertial>")]


@pytest.mark.parametrize(
    ("good", "bad", "named"),
    [
        ('lower="-2" upper="2"', 'lower="2" upper="-2"', "joint 'lf_a': its lower limit 2 rad is above its upper"),
        (INERTIAL, "", "moving link 'lf_hip' has mass 0 kg; it must be positive: it has no <inertial>"),
        ('mass value="1.0"', 'mass value="2100"', "heaviest link 'lf_hip' 2.1e+03 kg: masses are in kg, not in grams"),
        ('xyz="0 0 -0.1"', 'xyz="0 0 -100"', "the centre of mass of link 'lf_hip' is 100 m from its joint"),
        (
            'xyz="0.3 0.2 0"',
            'xyz="300 200 0"',
            "joint 'lf_a' is 361 m from the one before: distances are in m, not",
        ),
        ('ixx="0.01"', 'ixx="10000"', "link 'lf_hip' of 1 kg has moments of inertia of 1e+04, as a body"),
    ],
)
def test_what_no_quadruped_has_is_named_with_the_unit(tmp_path: Path, good: str, bad: str, named: str) -> None:
    assert good in LEG
    path = write(tmp_path, quadruped(LF=LEG.replace(good, bad, 1)))
    with pytest.raises(ModelError) as caught:
        load_robot(path)
    assert str(caught.value).startswith(str(path))
    assert named in str(caught.value)


def test_a_model_in_millimetres_and_one_made_too_small(tmp_path: Path) -> None:
    legs = {name: urdf_leg(name.lower(), corner).replace("0 0 -0.3", "0 0 -0.0003") for name, corner in CORNERS.items()}
    legs = {name: text.replace("0.05 0", "0.0005 0") for name, text in legs.items()}
    with pytest.raises(ModelError, match="m long from hip to foot: distances are in m"):
        load_robot(write(tmp_path, quadruped(**legs)))


def test_an_mjcf_is_held_to_the_same(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="masses are in kg, not in grams"):
        load_robot(write(tmp_path, mjcf().replace('mass="1.5"', 'mass="1500"'), "toy.xml"))


def test_limits_that_leave_no_room_or_are_in_degrees(tmp_path: Path) -> None:
    none = LEG.replace(LIMIT, '<limit velocity="10" effort="50"/>', 1)
    robot = load_robot(write(tmp_path, quadruped(LF=none)))
    assert robot.limits["lf_a"].lower == -np.inf
    assert "joint lf_a: limits 0 to 0 rad leave no room and are read as none" in robot.notes
    degrees = LEG.replace('lower="-2" upper="2"', 'lower="-120" upper="120"')
    (note,) = [n for n in load_robot(write(tmp_path, quadruped(LF=degrees))).notes if "degrees" in n]
    assert note.startswith("joints lf_a, lf_b, lf_c: position limits beyond")


def test_meshes_that_are_not_there_are_not_needed(tmp_path: Path) -> None:
    mesh = '<visual><geometry><mesh filename="package://not/there.dae"/></geometry></visual>'
    assert load_robot(write(tmp_path, quadruped(LF=urdf_leg("lf", CORNERS["LF"], SPHERE + mesh)))).mass == 32.0


# -- xacro ----------------------------------------------------------------------------------------------------------
def macro(argument: str = '<xacro:arg name="trunk" default="20"/>') -> str:
    text = quadruped().replace(urdf_link("base", 20.0), urdf_link("base", "$(arg trunk)"))
    return text.replace(
        '<robot name="toy">', f'<robot name="toy" xmlns:xacro="http://www.ros.org/wiki/xacro">{argument}'
    )


@pytest.mark.parametrize("name", ["toy.urdf.xacro", "toy.urdf"])
def test_a_xacro_is_its_expansion_also_where_values_are_written_back(tmp_path: Path, name: str) -> None:
    robot, plain = load_robot(write(tmp_path, macro(), name)), load_robot(write(tmp_path, quadruped(), "plain.urdf"))
    assert robot.mass == plain.mass == 32.0
    assert robot.tree.joints == plain.tree.joints
    heavier = robot.with_inertias({robot.trunk: robot.inertias[robot.trunk] + plain.inertias["lf_hip"]})
    export_model(heavier, tmp_path / "out.urdf")
    assert load_robot(tmp_path / "out.urdf").mass == pytest.approx(33.0)


def test_what_xacro_cannot_expand_is_one_line_that_says_how(tmp_path: Path) -> None:
    package = '<xacro:include filename="$(find no_such_pkg)/x.xacro"/>'
    for argument, named in (("", "trunk"), (package, "ament_index_python")):
        with pytest.raises(ModelError) as caught:
            load_robot(write(tmp_path, macro(argument), "toy.xacro"))
        assert "\n" not in str(caught.value)
        assert named in str(caught.value)
        assert "expand it where its packages are: xacro toy.xacro > toy.urdf" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "out"), [("toy.xacro", "toy.urdf"), ("toy.urdf.xacro", "toy.urdf"), ("toy.urdf", "toy_expanded.urdf")]
)
def test_without_xacro_its_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, out: str) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(MissingExtraError) as caught:
        load_robot(write(tmp_path, macro(), name))
    assert f"xacro {name} > {out};" in str(caught.value)
    assert "stadera[xacro]" in str(caught.value)


def test_an_expanded_file_needs_no_xacro_and_keeps_its_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    begin = '<robot name="toy" xmlns:xacro="http://www.ros.org/wiki/xacro">\n  <!-- <xacro:arg name="a"/> ${a} -->'
    path = write(tmp_path, quadruped().replace('<robot name="toy">', begin), "toy.urdf")
    robot = load_robot(path)
    assert robot.mass == 32.0
    export_model(robot, tmp_path / "out.urdf")
    assert begin in (tmp_path / "out.urdf").read_text()


def test_a_joint_between_links_far_apart_that_is_no_legs_is_no_matter(tmp_path: Path) -> None:
    far = urdf_joint("mast", "base", "camera", "0 0 1.5", "0 0 1", "fixed") + urdf_link("camera", 0.2)
    assert load_robot(write(tmp_path, quadruped().replace("</robot>", far + "</robot>"))).mass == pytest.approx(32.2)
