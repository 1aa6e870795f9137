"""Two model files are compared value by value; drives are written for simulators."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from robot_files import quadruped, write

from stadera.inertia import InertialParameters
from stadera.robot import JointDynamics, load_robot
from stadera.robot.actuators import actuators_yaml
from stadera.robot.export import export_model
from stadera.robot.model import Frame
from stadera.robot.values import differences


def test_a_robot_equals_itself_and_its_copy(tmp_path: Path) -> None:
    robot = load_robot("hyq")
    assert not list(differences(robot, robot))
    export_model(robot, tmp_path / "copy.urdf")
    assert not list(differences(robot, load_robot(tmp_path / "copy.urdf")))


def test_each_changed_value_is_named(tmp_path: Path, run: Any) -> None:
    robot = load_robot("hyq")
    link, joint = robot.tree.links[3], robot.tree.joints[4]
    body = robot.inertias[link]
    heavier = InertialParameters.from_com(1.1 * body.mass, body.com, body.inertia_com)
    other = robot.with_inertias({link: heavier}).with_dynamics({joint: JointDynamics(viscous=0.3)})
    found = list(differences(robot, other))
    assert [(d.of, d.value.split()[0]) for d in found] == [(link, "mass"), (joint, "viscous")]
    np.testing.assert_allclose(found[0].second, 1.1 * body.mass)
    export_model(other, tmp_path / "other.urdf")
    ended = run("inspect", "hyq", tmp_path / "other.urdf")
    assert ended.code == 1
    assert link in ended.out
    assert "differ in 2 values" in ended.err
    assert run("inspect", "hyq", "hyq").code == 0


def test_models_of_one_name_are_told_apart_and_a_fixed_link_is_named(tmp_path: Path, run: Any) -> None:
    robot, path = load_robot("hyq"), tmp_path / "loaded.urdf"
    body = '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
    fixed = f'<joint name="j" type="fixed"><parent link="{robot.trunk}"/><child link="payload"/></joint></robot>'
    export_model(robot, path)
    path.write_text(path.read_text().replace("</robot>", f'<link name="payload">{body}</link>{fixed}'))
    said = run("inspect", "hyq", path).out
    assert f"hyq.urdf: {robot.mass:.4f} kg; loaded.urdf: {robot.mass + 2:.4f} kg" in said
    assert f"note: loaded.urdf: mass, centre and inertia of {robot.trunk} are with what is fixed to it: payload" in said
    assert "payload" in run("inspect", path).out


def test_limits_places_feet_and_imu_are_compared_each_in_its_own_size() -> None:
    robot = load_robot("hyq")
    joint, foot = robot.tree.joints[4], robot.legs[0]
    limits = {**robot.limits, joint: replace(robot.limits[joint], lower=robot.limits[joint].lower + 1e-5)}
    moved = robot.tree.translations.copy()
    moved[4, 2] += 1e-4
    changed = replace(
        robot,
        limits=limits,
        tree=replace(robot.tree, translations=moved),
        legs=(replace(foot, foot_radius=foot.foot_radius + 1e-3), *robot.legs[1:]),
        frames={"my_imu": Frame(robot.trunk, np.eye(3), np.array([0.0, 0.0, 0.1]))},
    )
    found = {(d.of, d.value) for d in differences(robot, changed)}
    expected = {(joint, "origin z [m]"), (joint, "lower [rad]"), (f"foot {foot.name}", "radius [m]")}
    assert expected <= found
    assert {of for of, _ in found - expected} == {"IMU"}


def test_a_link_and_a_joint_of_one_name_are_both_compared(tmp_path: Path) -> None:
    text = quadruped().replace('<joint name="lf_b"', '<joint name="lf_thigh"')
    robot = load_robot(write(tmp_path, text))
    body = robot.inertias["lf_thigh"]
    other = robot.with_inertias({"lf_thigh": InertialParameters.from_com(1.1 * body.mass, body.com, body.inertia_com)})
    other = other.with_dynamics({"lf_thigh": JointDynamics(viscous=0.3)})
    names = [(d.of, d.value.split()[0]) for d in differences(robot, other)]
    assert names[0] == ("lf_thigh", "mass")
    assert names[-1] == ("lf_thigh", "viscous")


def test_a_foots_radius_is_compared_in_its_own_size() -> None:
    robot = load_robot("hyq")
    foot, radius = robot.legs[0], 0.02
    robot = replace(robot, legs=(replace(foot, foot_radius=radius), *robot.legs[1:]))
    for share, count in ((5e-7, 0), (2e-6, 1)):
        other = replace(robot, legs=(replace(foot, foot_radius=radius * (1.0 + share)), *robot.legs[1:]))
        assert len(list(differences(robot, other))) == count


def test_the_named_feet_and_trunk_are_those_of_both_models(run: Any) -> None:
    for option, said in (("--feet", "unknown foot 'nonsense'"), ("--trunk", "unknown link 'nonsense'")):
        ended = run("inspect", "hyq", "hyq", option, "nonsense")
        assert ended.code == 1
        assert said in ended.err


def test_a_missing_leg_is_one_line_for_each_part() -> None:
    robot = load_robot("hyq")
    leg = robot.legs[-1]
    tree = robot.tree.restricted(tuple(j for j in robot.tree.joints if j not in leg.joints))
    three = replace(robot, tree=tree, legs=robot.legs[:-1])
    found = list(differences(robot, three))
    assert [d.of for d in found] == [*leg.links, *leg.joints, f"foot {leg.name}"]
    assert all(d.second is None and d.first is not None for d in found)


def test_drives_are_yaml_with_ranges_of_what_was_determined() -> None:
    robot = load_robot("hyq")
    joint, rest = robot.tree.joints[0], robot.tree.joints[1]
    found = JointDynamics(armature=0.02, viscous=0.1, coulomb=0.5)
    known = JointDynamics(armature=0.004, viscous=float("nan"), coulomb=0.4)
    robot = robot.with_dynamics({joint: found}, {joint: known})
    text = actuators_yaml(robot, 0.012, "swing.csv")
    read = yaml.safe_load(text)
    isaac, mjlab, ranges = read["isaac_lab"], read["mjlab"], read["randomisation"]
    assert isaac["class"].startswith("isaaclab.actuators.")
    first, *others = mjlab["actuators"]
    assert isaac["joint_names_expr"] == [joint, *(name for each in others for name in each["target_names_expr"])]
    assert isaac["joint_names_expr"] == list(robot.tree.joints)
    assert isaac["armature"][joint] == first["armature"] == 0.02
    assert isaac["friction"][joint] == isaac["dynamic_friction"][joint] == first["frictionloss"] == 0.5
    assert first["viscous_damping"] == 0.1
    assert first["effort_limit"] == robot.limits[joint].effort
    assert isaac["effort_limit"][joint] == robot.limits[joint].effort
    np.testing.assert_allclose(ranges["armature"][joint], [0.012, 0.028])
    np.testing.assert_allclose(ranges["coulomb"][joint], [0.0, 1.3])  # friction is not below zero
    assert not ranges["viscous"]
    assert f"{joint}: viscous" in text
    assert f"{rest}: armature, viscous, coulomb" in text
    assert "12.0 ms" in text
