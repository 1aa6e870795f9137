"""Exported models load back to the same ten numbers a link, and nothing else of the file changes."""

from __future__ import annotations

from difflib import unified_diff
from io import StringIO
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from robot_files import CORNERS, mjcf, mjcf_leg, quadruped, urdf, urdf_joint, urdf_leg, urdf_link, wheeled, write

from stadera.errors import MissingExtraError, ModelError, StaderaError
from stadera.inertia import InertialParameters
from stadera.robot import JointDynamics, Robot, load_robot
from stadera.robot.export import export_model
from stadera.robot.xml import read_xml

ROBOTS = ("hyq", "go2", "anymal_c", "b1", "aliengo", "spot")


def _random_body(rng: np.random.Generator) -> InertialParameters:
    """A physical body with all off-diagonals: point masses in a cloud."""
    points, masses = rng.normal(0.05, 0.1, (8, 3)), rng.uniform(0.1, 1.0, 8)
    clouds = [InertialParameters.from_com(m, p, np.zeros((3, 3))) for m, p in zip(masses, points, strict=True)]
    return sum(clouds, InertialParameters.zero())


def _changed(robot: Robot) -> Robot:
    rng = np.random.default_rng(11)
    bodies = {link: _random_body(rng) for link in robot.tree.links}
    dynamics = {joint: JointDynamics(*rng.uniform(0.01, 1.0, 3)) for joint in robot.tree.joints}
    return robot.with_inertias(bodies).with_dynamics(dynamics)


def _load(name: str) -> Robot:
    try:
        return load_robot(name)
    except MissingExtraError as error:
        pytest.skip(str(error))


def _suffix(robot: Robot) -> str:
    return Path(str(robot.source)).suffix


def _assert_same_inertias(back: Robot, wanted: Robot) -> None:
    for link in wanted.tree.links:
        expected, found = wanted.inertias[link].vector, back.inertias[link].vector
        for part in (slice(0, 1), slice(1, 4), slice(4, 10)):
            scale = np.abs(expected[part]).max()
            np.testing.assert_allclose(found[part], expected[part], rtol=0, atol=1e-12 * scale, err_msg=link)


@pytest.mark.parametrize("name", ROBOTS)
def test_loads_back_to_the_same_ten_numbers(name: str, tmp_path: Path) -> None:
    wanted = _changed(_load(name))
    path = tmp_path / f"out{_suffix(wanted)}"
    export_model(wanted, path)
    back = load_robot(path)
    _assert_same_inertias(back, wanted)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    for joint, d in wanted.dynamics.items():
        assert (back.dynamics[joint].viscous, back.dynamics[joint].coulomb) == (d.viscous, d.coulomb)
        assert back.dynamics[joint].armature == (d.armature if path.suffix == ".xml" else 0.0)


@pytest.mark.parametrize("name", ["go2", "b1"])
def test_pinocchio_itself_reads_the_lumps_from_a_urdf(name: str, tmp_path: Path) -> None:
    wanted = _changed(_load(name))
    export_model(wanted, tmp_path / "out.urdf")
    model = pin.buildModelFromUrdf(str(tmp_path / "out.urdf"), pin.JointModelFreeFlyer())
    for joint, link in zip(("root_joint", *wanted.tree.joints), wanted.tree.links, strict=True):
        found = InertialParameters.from_pinocchio(model.inertias[model.getJointId(joint)])
        np.testing.assert_allclose(found.vector, wanted.inertias[link].vector, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["aliengo", "spot"])
def test_mujoco_itself_reads_bodies_and_meshes_from_an_mjcf(name: str, tmp_path: Path) -> None:
    wanted = _changed(_load(name))
    export_model(wanted, tmp_path / "out.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    original = mujoco.MjModel.from_xml_path(str(wanted.source))
    assert model.nmesh == original.nmesh
    assert model.nu == original.nu
    assert model.nkey == original.nkey
    np.testing.assert_array_equal(model.jnt_range, original.jnt_range)
    np.testing.assert_array_equal(model.geom_pos, original.geom_pos)
    for link in wanted.tree.links:
        assert model.body(link).mass[0] == wanted.inertias[link].mass
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.body(link).iquat)
        turn = turn.reshape(3, 3)
        tensor = turn @ np.diag(model.body(link).inertia) @ turn.T
        np.testing.assert_allclose(tensor, wanted.inertias[link].inertia_com, rtol=0, atol=1e-12)


def test_what_was_not_changed_is_left_as_it_is(tmp_path: Path) -> None:
    robot = load_robot("hyq")
    heavier = robot.inertias["trunk"] + InertialParameters.from_com(5.0, [0.1, 0.02, 0.3], 0.1 * np.eye(3))
    export_model(robot.with_inertias({"trunk": heavier}), tmp_path / "out.urdf")
    before, after = (ElementTree.parse(p).getroot() for p in (str(robot.source), tmp_path / "out.urdf"))
    for kind in ("link", "joint"):
        for old, new in zip(before.findall(kind), after.findall(kind), strict=True):
            if old.get("name") not in ("trunk", "base_link", "trunk_imu"):
                assert ElementTree.tostring(old) == ElementTree.tostring(new)
    text = (tmp_path / "out.urdf").read_text()
    assert "Istituto Italiano di Tecnologia" in text
    assert "trunk" in text.split("<robot")[0]
    assert after.find("link[@name='trunk_imu']/inertial") is None


def test_mesh_paths_stay(tmp_path: Path) -> None:
    wanted = _changed(_load("go1"))
    export_model(wanted, tmp_path / "out.urdf")
    roots = [ElementTree.parse(p).getroot() for p in (str(wanted.source), tmp_path / "out.urdf")]
    before, after = ([mesh.get("filename") for mesh in root.iter("mesh")] for root in roots)
    assert before == after
    assert len(before) > 10


def test_a_robot_on_wheels_is_written_where_their_meshes_are_not(tmp_path: Path) -> None:
    mesh = '<collision><geometry><mesh filename="package://toy/wheel.obj"/></geometry></collision>'
    (tmp_path / "toy").mkdir()
    (tmp_path / "elsewhere").mkdir()
    write(tmp_path / "toy", "v 0.1 0 0\nv -0.1 0 0\nv 0 0.02 0.1\nv 0 0 -0.1\nf 1 2 3\nf 1 2 4\n", "wheel.obj")
    robot = load_robot(write(tmp_path / "toy", wheeled(mesh)))
    export_model(robot.with_dynamics({"LF_d": JointDynamics(viscous=0.3)}), tmp_path / "elsewhere" / "out.urdf")
    assert 'damping="0.3"' in (tmp_path / "elsewhere" / "out.urdf").read_text()


def test_a_urdf_tells_armature_and_offset_in_a_comment(tmp_path: Path) -> None:
    robot = load_robot("hyq").with_dynamics({"rh_kfe_joint": JointDynamics(0.123, 0.2, 0.1, -0.5)})
    export_model(robot, tmp_path / "out.urdf")
    head = (tmp_path / "out.urdf").read_text().split("<robot")[0]
    assert "rh_kfe_joint armature 0.123 kg m^2" in head
    assert "rh_kfe_joint offset -0.5 N m" in head


def test_an_arm_keeps_its_own_inertia(tmp_path: Path) -> None:
    arm = urdf_joint("arm_1", "base", "arm", "0 0 0.1", "0 0 1") + urdf_link("arm", 3.0)
    legs = "".join(urdf_leg(name.lower(), corner) for name, corner in CORNERS.items())
    robot = load_robot(write(tmp_path, urdf(legs + arm)))
    heavier = robot.inertias["base"] + _random_body(np.random.default_rng(3))
    wanted = robot.with_inertias({"base": heavier})
    export_model(wanted, tmp_path / "out.urdf")
    _assert_same_inertias(load_robot(tmp_path / "out.urdf"), wanted)
    root = ElementTree.parse(tmp_path / "out.urdf").getroot()
    assert root.find("link[@name='arm']/inertial/mass").get("value") == "3.0"


def test_mjcf_with_anchors_defaults_fixed_bodies_and_an_include(tmp_path: Path) -> None:
    legs = "".join(mjcf_leg(name, corner) for name, corner in CORNERS.items())
    write(tmp_path, f"<mujocoinclude>{legs}</mujocoinclude>", "legs.xml")
    robot = load_robot(write(tmp_path, mjcf('<include file="legs.xml"/>'), "toy.xml"))
    wanted = _changed(robot)
    (tmp_path / "elsewhere").mkdir()
    export_model(wanted, tmp_path / "elsewhere" / "out.xml")
    back = load_robot(tmp_path / "elsewhere" / "out.xml")
    _assert_same_inertias(back, wanted)
    assert back.dynamics == wanted.dynamics
    assert back.limits == wanted.limits
    assert "a remark to be kept" in (tmp_path / "elsewhere" / "out.xml").read_text()


def test_a_robot_of_named_feet_is_written_as_it_was_loaded(tmp_path: Path) -> None:
    """Two of four legs, the others lumped into the trunk: they keep their inertias."""
    source, feet = write(tmp_path, quadruped()), ("lf_shank", "rf_shank")
    wanted = load_robot(source, feet=feet, trunk="base")  # the file's root
    more = _random_body(np.random.default_rng(5))
    wanted = wanted.with_inertias({link: wanted.inertias[link] + more for link in wanted.tree.links})
    export_model(wanted, tmp_path / "out.urdf")
    _assert_same_inertias(load_robot(tmp_path / "out.urdf", feet=feet), wanted)
    whole, before = load_robot(tmp_path / "out.urdf"), load_robot(source)
    assert whole.inertias["lh_hip"] == before.inertias["lh_hip"]


# -- what it refuses, leaving nothing behind ------------------------------------------------------------------------
def _refused(robot: Robot, path: Path) -> str:
    before = sorted(p.name for p in path.parent.iterdir()) if path.parent.is_dir() else []
    with pytest.raises(ModelError) as caught:
        export_model(robot, path)
    after = sorted(p.name for p in path.parent.iterdir()) if path.parent.is_dir() else []
    assert before == after
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_the_other_format_is_refused(tmp_path: Path) -> None:
    assert ".urdf" in _refused(load_robot("hyq"), tmp_path / "out.xml")
    toy = load_robot(write(tmp_path, mjcf(), "toy.xml"))
    assert ".xml" in _refused(toy, tmp_path / "out.urdf")


def test_a_trunk_that_is_not_the_files_root_is_refused(tmp_path: Path) -> None:
    joint = urdf_joint("swivel", "mast", "base", "0.1 -0.2 -0.3", "0 0 1")
    path = write(tmp_path, quadruped().replace("</robot>", urdf_link("mast", 3.0) + joint + "</robot>"))
    told = _refused(load_robot(path, trunk="base"), tmp_path / "out.urdf")
    assert "the trunk 'base' is not the root 'mast' of toy.urdf" in told


def test_mjcf_refuses_an_inertia_that_no_body_has(tmp_path: Path) -> None:
    toy = load_robot(write(tmp_path, mjcf(), "toy.xml"))
    odd = InertialParameters.from_com(1.0, [0, 0, 0], np.diag([1.0, 1.0, 3.0]))
    told = _refused(toy.with_inertias({"LF_thigh": odd}), tmp_path / "out.xml")
    assert "LF_thigh" in told
    assert "physically" in told


def test_a_mass_that_is_not_positive_is_refused(tmp_path: Path) -> None:
    robot = load_robot(write(tmp_path, quadruped()))
    told = _refused(robot.with_inertias({"lf_hip": InertialParameters.zero()}), tmp_path / "out.urdf")
    assert "lf_hip" in told


def test_negative_friction_is_refused(tmp_path: Path) -> None:
    robot = load_robot("hyq").with_dynamics({"rh_kfe_joint": JointDynamics(viscous=-0.1)})
    told = _refused(robot, tmp_path / "out.urdf")
    assert "rh_kfe_joint" in told
    assert "viscous" in told


def test_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StaderaError, match="no such folder"):
        export_model(load_robot("hyq"), tmp_path / "nowhere" / "out.urdf")


def test_what_is_there_stays_when_the_writing_fails(tmp_path: Path) -> None:
    toy = load_robot(write(tmp_path, mjcf(), "toy.xml"))
    write(tmp_path, "precious", "out.xml")
    huge = toy.with_inertias({"LF_thigh": InertialParameters.from_com(1e300, [0, 0, 0], 1e-300 * np.eye(3))})
    _refused(huge, tmp_path / "out.xml")
    assert (tmp_path / "out.xml").read_text() == "precious"


def test_lines_that_do_not_change_stay_as_they_are(tmp_path: Path) -> None:
    for name, suffix in (("go2", "urdf"), ("hyq", "urdf")):
        robot = load_robot(name)
        link, joint = robot.tree.links[2], robot.tree.joints[4]
        body = robot.inertias[link]
        heavier = InertialParameters.from_com(1.1 * body.mass, body.com, body.inertia_com)
        export_model(robot.with_inertias({link: heavier}).with_dynamics({joint: JointDynamics(viscous=0.3)}),
                     tmp_path / f"{name}.{suffix}")  # fmt: skip
        assert robot.source is not None
        before, after = (p.read_text().splitlines() for p in (robot.source, tmp_path / f"{name}.{suffix}"))
        changed = [line for line in unified_diff(before, after, n=0) if line.startswith("-") and line[1:].strip()]
        assert len(changed) <= 14, changed  # the declaration, two inertials (of link and rotor), a joint's dynamics


def test_a_tag_over_several_lines_stays(tmp_path: Path) -> None:
    source = tmp_path / "odd.xml"
    source.write_text(
        "<robot name='a'>\n  <link   name = \"b\"\n         kind='x>y' />\n  <!-- c & d --><e>&lt;f&#65;</e>\n</robot>"
    )
    document = read_xml(source)
    document.root[0].append(ElementTree.Element("g"))
    out = StringIO()
    document.write(out)
    assert "<link   name = \"b\"\n         kind='x>y'><g/></link>" in out.getvalue()
    assert "<!-- c & d --><e>&lt;fA</e>" in out.getvalue()
    (tmp_path / "again.xml").write_text(out.getvalue())
    assert read_xml(tmp_path / "again.xml").root[0].attrib == {"name": "b", "kind": "x>y"}
