"""Weighs robots of any legs, moving and at rest: humanoids with flat feet, an arm that moves, three and six legs.

The plant is Pinocchio's inverse dynamics of the whole tree, without noise.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import make_interp_spline

from robot.robot_files import urdf, urdf_leg, wheeled, write
from stadera import identify, weigh
from stadera.errors import IdentificationError, UnknownNameError
from stadera.inertia import InertialParameters
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs import Imu, Recording, write_table
from stadera.robot import JointDynamics, Robot, load_robot
from stadera.robot.catalog import _example_robot_data
from stadera.trunk import Samples, TrunkEstimator
from stadera.types import Array

RATE, SECONDS, TARED, LOADED = 200.0, 7.0, 3.0, 3.4
FILES = {
    "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "talos": "talos_data/robots/talos_full_v2.urdf",
    "b1_z1": "b1_description/urdf/b1-z1.urdf",
    "solo8": "solo_description/robots/solo.urdf",
}

BENT = {
    "g1_29dof_rev_1_0": (-0.4, 0.0, 0.0, 0.8, -0.4, 0.0),
    "talos": (0.0, 0.0, -0.4, 0.8, -0.4, 0.0),
    "h1": (0.0, 0.0, -0.4, 0.8, -0.4),
}
"""Joint positions of a leg about which it sways [rad], by robot; else those of three joints."""


def of_file(name: str) -> Robot:
    if name not in FILES:
        return load_robot(name)
    folder = _example_robot_data()
    if folder is None:
        pytest.skip("example-robot-data is not installed")
    return load_robot(folder / FILES[name])


def with_legs(count: int, folder: Path) -> Robot:
    """A trunk on legs in a circle, or of none on wheels."""
    if not count:
        return load_robot(write(folder, wheeled(name="wheel", kind="revolute")))
    angle = 2.0 * np.pi * (np.arange(count) + 0.25) / count
    corners = [(0.3 * float(np.cos(a)), 0.3 * float(np.sin(a))) for a in angle]
    return load_robot(write(folder, urdf("".join(urdf_leg(f"leg{k}", corner) for k, corner in enumerate(corners)))))


def waves(rng: np.random.Generator, time: Array, size: Array) -> tuple[Array, Array, Array]:
    """Sums of two sines that begin within a second, with their first two derivatives, (n, channels)."""
    out = np.zeros((len(time), len(size)))
    for _ in range(2):
        w, phase = 2.0 * np.pi * rng.uniform(0.3, 1.6, len(size)), rng.uniform(0.0, 2.0 * np.pi, len(size))
        out += 0.5 * size * np.sin(time[:, None] * w + phase)
    begun = np.clip(time, 0.0, 1.0)[:, None]
    path = make_interp_spline(time, out * begun**3 * (10.0 - 15.0 * begun + 6.0 * begun**2), 5)
    return path(time), path(time, 1), path(time, 2)


def planted(model: pin.Model, robot: Robot, start: Array, poses: list[pin.SE3]) -> Array:
    """Positions (poses, joints) of the legs' joints that keep the feet where they are at `start`, the trunk at its
    origin, when the trunk moves to each pose.
    """
    data, q = model.createData(), start.copy()
    frames = [
        (model.getJointId(leg.joints[-1]), pin.SE3(np.eye(3), np.array(leg.foot_position)), leg) for leg in robot.legs
    ]
    pin.forwardKinematics(model, data, q)
    feet = [data.oMi[joint] * place for joint, place, _ in frames]
    legs = [[model.joints[model.getJointId(joint)] for joint in leg.joints] for leg in robot.legs]
    out = []
    for pose in poses:
        for _ in range(4):  # Newton, from the pose before
            pin.computeJointJacobians(model, data, q)
            for (joint, place, leg), foot, own in zip(frames, feet, legs, strict=True):
                apart = (data.oMi[joint] * place).actInv(pose.actInv(foot))
                missing = pin.log6(apart).vector if leg.contact == 6 else apart.translation
                J = place.toActionMatrixInverse() @ pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL)
                at = [joint.idx_v for joint in own]
                q[[joint.idx_q for joint in own]] += np.linalg.pinv(J[: leg.contact, at], rcond=1e-3) @ missing
        out.append([q[joint.idx_q] for own in legs for joint in own])
    return np.array(out)


def swaying(
    robot: Robot, load: InertialParameters, arms: float, at: tuple[str, ...] = (), until: float = np.inf
) -> Samples:
    """A robot that sways with its feet planted, whose other joints move by `arms` [rad], with a load from `LOADED` to
    `until` on the links that some joints move, on the trunk if none are named.
    """
    model = pin.buildModelFromUrdf(str(robot.source), pin.JointModelFreeFlyer())
    extra = robot.extra.joints if robot.extra is not None else ()
    joints = (*robot.tree.joints, *extra)
    locked = [j for j in range(2, model.njoints) if model.names[j] not in joints]
    if locked:
        model = pin.buildReducedModel(model, locked, pin.neutral(model))
    model.gravity = pin.Motion.Zero()
    order = np.array([model.joints[model.getJointId(joint)].idx_v for joint in joints])
    rng, n = np.random.default_rng(1), len(robot.tree.joints)
    time, length = np.arange(0.0, SECONDS, 1.0 / RATE), robot.leg_length
    others = waves(rng, time, np.full(len(extra), arms))
    plane = np.array([0.0, 1.0, 0.0] if len(robot.legs[0].joints) == 2 else [1.0, 1.0, 1.0])  # it pitches only
    turned, turning, _ = waves(rng, time, 0.08 * plane)
    place, _, moved = waves(rng, time, np.array([0.06, 0.06 * plane[2], 0.04]) * length)
    moved += [0.0, 0.5 * (1.0 - plane[2]), 9.81]  # and stands on a slope of three degrees
    rotations = [pin.exp3(phi) for phi in turned]
    omega = np.array([pin.Jexp3(phi) @ rate for phi, rate in zip(turned, turning, strict=True)])
    alpha = np.gradient(omega, time, axis=0, edge_order=2)
    start, coarse = pin.neutral(model), slice(None, None, 10)
    usual = {2: (0.6, -1.2), 4: (0.0, 0.5, -1.0, 0.0)}.get(len(robot.legs[0].joints), (0.0, 0.5, -1.0))
    bent = np.resize(BENT.get(robot.name, usual), n)
    start[order[:n] + 1] = bent  # a free flyer has one position more than velocities
    poses = [pin.SE3(R, p) for R, p in zip(rotations[coarse], place[coarse], strict=True)]
    legs = [joint for leg in robot.legs for joint in leg.joints]
    path = make_interp_spline(time[coarse], planted(model, robot, start, poses), 5)
    own = [legs.index(joint) for joint in robot.tree.joints]
    q, v, a = (np.hstack([path(time, nu)[:, own], other]) for nu, other in enumerate(others))
    force, effort = np.empty((len(time), 3)), np.empty((len(time), len(joints)))
    points = [(model.getJointId(leg.joints[-1]), leg) for leg in robot.legs]
    weight = 9.81 * robot.mass / len(points)
    unfelt, _, _ = waves(rng, time, np.array([0.8 * weight * leg.unfelt_bound for leg in robot.legs]))
    loaded = model.copy()
    for joint in at or (model.names[1],):
        loaded.inertias[model.getJointId(joint)] += load.to_pinocchio()
    empty, full = model.createData(), loaded.createData()
    for k, t in enumerate(time):
        up = rotations[k][2]
        force[k] = rotations[k].T @ moved[k]
        now, data = (loaded, full) if LOADED <= t < until else (model, empty)
        state, rate, more = pin.neutral(now), np.zeros(now.nv), np.zeros(now.nv)
        state[order + 1], rate[order], more[order] = q[k], v[k], a[k]
        rate[3:6], more[3:6], more[:3] = omega[k], alpha[k], force[k]
        needed = np.array(pin.rnea(now, data, state, rate, more))
        pin.computeJointJacobians(now, data, state)
        J = []
        for (joint, leg), drawn in zip(points, unfelt[k], strict=True):
            point = data.oMi[joint].act(np.array(leg.foot_position)) - leg.foot_radius * up
            whole = np.array(pin.getJointJacobian(now, data, joint, pin.ReferenceFrame.WORLD))
            whole[:3] -= pin.skew(point) @ whole[3:]
            about, last = data.oMi[joint].rotation @ np.array(leg.unfelt), whole[: leg.contact][-3:]
            needed -= drawn * about @ last
            if leg.contact == 6:  # that moment is not what is needed, but what is drawn
                last -= np.outer(about, about @ last)
            J.append(whole[: leg.contact])
        stacked = np.vstack(J)
        base = stacked[:, :6]
        needed -= stacked.T @ (base @ np.linalg.solve(base.T @ base, needed[:6]))  # by the least forces
        assert np.abs(needed[:6]).max() < 1e-8
        effort[k] = needed[order]
    extra_states = np.hstack([q[:, n:], v[:, n:], effort[:, n:]])
    return Samples(time, q[:, :n], v[:, :n], effort[:, :n], omega, force, extra_states)


@pytest.mark.parametrize(
    ("name", "arms"),
    [
        ("g1", 0.3),
        ("h1", 0.2),
        ("b1_z1", 0.4),
        ("solo8", 0.0),
        (3, 0.0),
        (6, 0.0),
        (0, 0.0),
    ],
)
def test_a_payload_is_weighed_on_any_legs(name: str | int, arms: float, tmp_path: Path) -> None:
    robot = with_legs(name, tmp_path) if isinstance(name, int) else of_file(name)
    robot = robot.with_dynamics(dict.fromkeys(robot.tree.joints, JointDynamics()))
    if isinstance(name, int):
        assert len(robot.legs) == (name or 4)
    mass = 0.1 * robot.mass
    load = InertialParameters.from_com(mass, (0.02, -0.03, 0.1), 0.01 * mass * np.eye(3))
    samples = swaying(robot, load, arms)
    estimator = TrunkEstimator(robot, imu_frame=robot.trunk)
    estimator.add(samples[samples.time < TARED])
    trunk, alone = estimator.trunk, robot.inertias[robot.trunk]
    assert abs(trunk.inertial.mass - alone.mass) < 2.0 * np.sqrt(trunk.covariance[0, 0])
    estimator.tare()
    estimator.add(samples[(samples.time >= TARED) & (samples.time < 5.4)])
    payload = estimator.payload
    assert payload is not None
    assert payload.mass == pytest.approx(mass, abs=0.005 * robot.mass)
    assert abs(payload.mass - mass) < 4.0 * payload.mass_std
    np.testing.assert_allclose(payload.com[:2], [0.02, -0.03], atol=0.02)
    assert estimator.trust.verdict == "good", estimator.trust.reasons


def test_a_log_of_a_humanoid_is_weighed_as_any_other() -> None:
    robot = of_file("g1")
    load = InertialParameters.from_com(3.0, (0.02, -0.03, 0.1), 0.03 * np.eye(3))
    samples = swaying(robot, load, 0.0)
    imu = Imu(samples.angular_velocity, samples.specific_force)
    channels = samples.position, samples.velocity
    log = Recording(samples.time, robot.tree.joints, *channels, effort=samples.effort, imu=imu)
    found = weigh(robot, log, (0.0, TARED))
    assert found.trust.verdict == "good"
    assert found.payload is not None
    assert found.payload.mass == pytest.approx(3.0, abs=0.005 * robot.mass)
    (change,) = found.changes
    assert change.time == pytest.approx(LOADED, abs=0.1)
    assert identify(robot, log).trust.verdict != "bad"


TILTS = ((0.0, 0.0), (0.08, 0.0), (0.0, 0.08), (-0.06, -0.06))
"""Roll and pitch of the trunk in each pose at rest [rad]."""


def standing(robot: Robot, load: InertialParameters, rate: float = 50.0, seconds: float = 1.6) -> Recording:
    """A robot at rest in several poses, without and then with a load, with white noise of its torques."""
    model = pin.buildModelFromUrdf(str(robot.source), pin.JointModelFreeFlyer())
    locked = [j for j in range(2, model.njoints) if model.names[j] not in robot.tree.joints]
    if locked:
        model = pin.buildReducedModel(model, locked, pin.neutral(model))
    model.gravity = pin.Motion.Zero()
    order, n = np.array([model.joints[model.getJointId(j)].idx_v for j in robot.tree.joints]), len(robot.tree.joints)
    rotations = [pin.exp3(np.array([roll, pitch, 0.0])) for roll, pitch in TILTS]
    start, legs = pin.neutral(model), [joint for leg in robot.legs for joint in leg.joints]
    start[order + 1] = np.resize(BENT.get(robot.name, (0.0, 0.5, -1.0)), n)
    poses = [pin.SE3(R, np.zeros(3)) for R in rotations]
    positions = planted(model, robot, start, poses)[:, [legs.index(joint) for joint in robot.tree.joints]]
    loaded, points = model.copy(), [(model.getJointId(leg.joints[-1]), leg) for leg in robot.legs]
    loaded.inertias[1] += load.to_pinocchio()
    rng, parts = np.random.default_rng(2), []
    for now in (model, loaded):
        data = now.createData()
        for q, R in zip(positions, rotations, strict=True):
            state, more = pin.neutral(now), np.zeros(now.nv)
            state[order + 1], more[:3] = q, 9.81 * R[2]
            needed = np.array(pin.rnea(now, data, state, np.zeros(now.nv), more))
            pin.computeJointJacobians(now, data, state)
            J = []
            for joint, leg in points:
                point = data.oMi[joint].act(np.array(leg.foot_position)) - leg.foot_radius * R[2]
                whole = np.array(pin.getJointJacobian(now, data, joint, pin.ReferenceFrame.WORLD))
                whole[:3] -= pin.skew(point) @ whole[3:]
                J.append(whole[: leg.contact])
            stacked = np.vstack(J)
            base = stacked[:, :6]
            needed -= stacked.T @ (base @ np.linalg.solve(base.T @ base, needed[:6]))  # by the least forces
            effort = needed[order] + 0.02 * rng.standard_normal((int(rate * seconds), n))
            parts.append((np.tile(q, (len(effort), 1)), effort, np.tile(9.81 * R[2], (len(effort), 1))))
    q, effort, force = (np.concatenate(values) for values in zip(*parts, strict=True))
    imu = Imu(np.zeros_like(force), force)
    time = np.arange(len(q)) / rate
    return Recording(time, robot.tree.joints, q, np.zeros_like(q), effort=effort, imu=imu)


@pytest.mark.parametrize(
    ("name", "imu"), [("g1", True), ("g1", False), ("b1_z1", True), (3, True), (3, False), (6, True)]
)
def test_a_payload_is_weighed_at_rest_on_any_legs(name: str | int, imu: bool, tmp_path: Path) -> None:
    robot = with_legs(name, tmp_path) if isinstance(name, int) else of_file(name)
    robot = robot.with_dynamics(dict.fromkeys(robot.tree.joints, JointDynamics()))
    mass = 0.1 * robot.mass
    load = InertialParameters.from_com(mass, (0.02, -0.03, 0.1), 0.01 * mass * np.eye(3))
    log = standing(robot, load)
    if not imu:
        log = replace(log, imu=None)
    half = 0.5 * (log.time[-1] + log.time[1])
    found = weigh(robot, log, (0.0, half), method="standing")
    trunk, payload = robot.inertias[robot.trunk] + load, found.payload
    assert payload is not None
    assert payload.mass == pytest.approx(mass, abs=0.002 * robot.mass)
    assert abs(payload.mass - mass) < 3.0 * payload.mass_std
    assert found.trunk.inertial.mass == pytest.approx(trunk.mass, abs=0.0005 * robot.mass)
    seen = found.trunk.observed[1:4]
    np.testing.assert_allclose(found.trunk.inertial.com[seen], trunk.com[seen], atol=1e-3)
    assert seen.sum() >= (2 if imu else 0)  # two flat feet without an IMU say little: no foot is beside their line
    assert found.balance is not None
    np.testing.assert_allclose(found.balance.force.sum(), 9.81 * (robot.mass + mass), rtol=1e-3)
    np.testing.assert_allclose(found.balance.pressure, found.balance.robot_com, atol=0.005)


def test_a_method_at_rest_says_that_five_joints_leave_a_moment_open() -> None:
    robot = of_file("h1")
    with pytest.raises(
        IdentificationError, match="of left, right are too few for a component of it, whose bound 'walking' knows"
    ):
        weigh(robot, standing(robot, InertialParameters.zero()), method="standing")


def test_torques_of_another_scale_are_no_place() -> None:
    """All torques doubled: what the legs feel of the load and what the arm's joints do not is not where it is."""
    robot = of_file("b1_z1")
    load = InertialParameters.from_com(5.0, (0.02, -0.03, 0.1), 0.05 * np.eye(3))
    samples = swaying(robot, load, 0.4)
    extra, count = samples.extra.copy(), samples.extra.shape[1] // 3
    extra[:, 2 * count :] *= 2.0
    doubled = replace(samples, effort=2.0 * samples.effort, extra=extra)
    estimator = TrunkEstimator(robot, imu_frame=robot.trunk)
    estimator.add(doubled[doubled.time < TARED])
    estimator.tare()
    estimator.add(doubled[doubled.time >= TARED])
    payload = estimator.payload
    assert payload is not None
    assert (payload.at, dict(payload.places)) == ("", {})


IN_HAND = InertialParameters.from_com(2.0, (0.08, 0.01, 0.02), 0.01 * np.eye(3))


def after_tare(robot: Robot, samples: Samples, at: str | None = None) -> TrunkEstimator:
    estimator = TrunkEstimator(robot, imu_frame=robot.trunk, at=at)
    estimator.add(samples[samples.time < TARED])
    estimator.tare()
    estimator.add(samples[samples.time >= TARED])
    assert estimator.trust.verdict == "good", estimator.trust.reasons
    return estimator


@pytest.mark.parametrize(("name", "link"), [("g1", "left_wrist_yaw_link"), ("b1_z1", "link06")])
def test_a_load_in_a_hand_is_found_and_weighed_there(name: str, link: str) -> None:
    robot = of_file(name)
    extra = robot.extra
    assert extra is not None
    joint = extra.joints[extra.links.index(link)]
    samples = swaying(robot, IN_HAND, 0.2, (joint,), until=6.0)
    for at in (None, link):
        estimator = after_tare(robot, samples[samples.time < 5.6], at)
        payload = estimator.payload
        assert payload is not None
        assert payload.at == link
        assert payload.mass == pytest.approx(2.0, abs=0.003 * robot.mass)
        np.testing.assert_allclose(payload.com, IN_HAND.com, atol=3e-3)
        assert abs(estimator.trunk.inertial.mass - robot.inertias[robot.trunk].mass) < 0.003 * robot.mass
        (change,) = estimator.changes  # the arm's motion is none
        assert (change.kind, change.at) == ("on", link)
        assert at is not None or payload.places[link] > 0.99
    estimator.add(samples[samples.time >= 5.6])
    assert [(change.kind, change.at) for change in estimator.changes] == [("on", link), ("off", link)]


def test_noise_of_an_arms_velocities_does_not_move_its_load() -> None:
    """0.2 rad/s, ten times a data sheet's; with plain means of the arm's rows the load is 2.4 % too light."""
    robot = of_file("b1_z1")
    assert robot.extra is not None
    link, joints = "link06", len(robot.extra.joints)
    samples = swaying(robot, IN_HAND, 0.2, (robot.extra.joints[robot.extra.links.index(link)],))
    extra = samples.extra.copy()
    extra[:, joints : 2 * joints] += 0.2 * np.random.default_rng(0).standard_normal((len(extra), joints))
    noisy = replace(samples, extra=extra)
    payload = after_tare(robot, noisy[noisy.time < 5.6], link).payload
    assert payload is not None
    assert payload.mass == pytest.approx(2.0, abs=0.02)
    np.testing.assert_allclose(payload.com[:2], IN_HAND.com[:2], atol=8e-3)
    assert abs(payload.com[2] - IN_HAND.com[2]) < 2.0 * payload.com_std[2]  # along the arm, shown by its swings alone


def test_friction_of_the_legs_and_noise_of_an_arm_do_not_hide_what_it_holds() -> None:
    """Knees and hips of a humanoid hold with more than the load's weight, now one way and now the other, and an arm
    that moves slowly has accelerations that are noise in single blocks.
    """
    robot, rng = of_file("g1"), np.random.default_rng(4)
    extra = robot.extra
    assert extra is not None
    link, n = "left_wrist_yaw_link", len(extra.joints)
    samples = swaying(robot, IN_HAND, 0.3, (extra.joints[extra.links.index(link)],))
    limits = np.array([robot.limits[joint].effort for joint in robot.tree.joints])
    held = 0.04 * limits * np.sign(waves(rng, samples.time, np.ones(len(limits)))[0])
    noisy = samples.extra + np.repeat([0.0, 0.06, 0.0], n) * rng.standard_normal(samples.extra.shape)
    found = after_tare(robot, replace(samples, effort=samples.effort + held, extra=noisy)).payload
    assert found is not None
    assert found.at == link
    assert found.mass == pytest.approx(IN_HAND.mass, abs=0.004 * robot.mass)
    assert abs(found.mass - IN_HAND.mass) < 3.0 * found.mass_std


@pytest.mark.parametrize(("on", "seed"), [(None, 3), ("left_wrist_yaw_link", 1)])
def test_noise_of_a_g1_that_stands_is_no_load_elsewhere(on: str | None, seed: int) -> None:
    """With errors as of real robots: rows at rest share one friction, and noise of accelerations tells no place."""
    load = Load(2.67, at=(0.0, 0.03, 0.1) if on is None else (0.05, 0.0, 0.02), on=on)
    robot = of_file("g1")
    made = simulate(
        robot, "stand-load", SimulateSettings("real", load, duration=5.2, rate=250.0, seed=seed, hold=2, load_time=2.6)
    )
    found = weigh(robot, made.recording, (0.0, 2.4))
    payload = found.payload
    assert payload is not None
    assert payload.at == (on or "")
    assert abs(payload.mass - 2.67) < 2.0 * payload.mass_std


def test_one_load_in_both_hands_is_told_from_one_in_either() -> None:
    robot = of_file("g1")
    samples = swaying(robot, IN_HAND, 0.2, ("left_wrist_yaw_joint", "right_wrist_yaw_joint"))
    payload = after_tare(robot, samples).payload
    assert payload is not None
    assert payload.at == "left_wrist_yaw_link + right_wrist_yaw_link"
    assert payload.mass == pytest.approx(4.0, abs=0.003 * robot.mass)


def test_without_torques_and_motion_of_its_arm_a_load_in_a_hand_is_not_told_from_one_on_the_trunk() -> None:
    robot = of_file("b1_z1")
    samples = swaying(robot, IN_HAND, 0.0, ("joint6",))
    k = samples.extra.shape[1] // 3
    samples = replace(samples, extra=np.hstack([samples.extra[:, : 2 * k], np.zeros((len(samples), k))]))
    payload = after_tare(robot, samples).payload
    assert payload is not None
    assert max(payload.places.values()) < 0.95
    assert payload.mass == pytest.approx(2.0, abs=0.01 * robot.mass)
    with pytest.raises(UnknownNameError, match=r"unknown link 'hand'; valid: .*link06"):
        TrunkEstimator(robot, at="hand")
    with pytest.raises(UnknownNameError, match=r"unknown place of a load 'FL_calf'; valid: trunk, .*link06"):
        TrunkEstimator(robot, at="FL_calf")


def test_a_g1s_log_is_weighed_by_the_command_line_and_live(run, tmp_path: Path) -> None:
    robot = of_file("g1")
    extra = robot.extra
    assert extra is not None
    samples = swaying(robot, IN_HAND, 0.3, ("left_wrist_yaw_joint",))
    samples = samples[samples.time < 5.6]
    others, imu = np.split(samples.extra, 3, axis=1), Imu(samples.angular_velocity, samples.specific_force)
    own = samples.position, samples.velocity, samples.effort
    q, v, effort = (np.hstack(pair) for pair in zip(own, others, strict=True))
    write_table(
        Recording(samples.time, (*robot.tree.joints, *extra.joints), q, v, effort=effort, imu=imu), tmp_path / "log.csv"
    )
    given = "weigh", tmp_path / "log.csv", "--robot", "g1", "--imu-frame", "imu_in_pelvis", "--tare", f"0:{TARED}"
    for at in ((), ("--at", "left_rubber_hand")):
        shown = " ".join(run(*given, *at, "--json", tmp_path / "out.json").out.split())
        payload = json.loads((tmp_path / "out.json").read_text())["payload"]
        where = at[1] if at else "left_wrist_yaw_link"
        assert payload["at"] == payload["frame"] == where
        assert payload["mass"]["value"] == pytest.approx(2.0, abs=0.1)
        assert f"Payload at {where}" in shown
        assert ("by odds of" in shown) == (not at)
    centre = np.array(payload["com"]["value"])  # of the rubber hand, 41.5 mm before the wrist's link
    np.testing.assert_allclose(centre, IN_HAND.com - [0.0415, 0.003, 0.0], atol=3e-3)
    replayed = run("live", f"replay:{tmp_path / 'log.csv'}", "--robot", "g1", "--tare", TARED, "--rate", "inf")
    assert "at left_wrist_yaw_link" in " ".join(replayed.out.split())
