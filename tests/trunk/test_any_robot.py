"""Weighs robots of any legs with one estimator: humanoids with flat feet, an arm that moves, three and six legs.

The plant is Pinocchio's inverse dynamics of the whole tree, without noise.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from robot.robot_files import urdf, urdf_leg, write
from stadera import identify, weigh
from stadera.errors import IdentificationError, RecordingError
from stadera.inertia import InertialParameters
from stadera.logs import Imu, Recording
from stadera.robot import JointDynamics, Robot, load_robot
from stadera.robot.catalog import _example_robot_data
from stadera.trunk import Samples, TrunkEstimator
from stadera.types import Array

RATE, SECONDS, TARED, LOADED = 500.0, 9.0, 4.0, 4.5
FILES = {
    "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "talos": "talos_data/robots/talos_full_v2.urdf",
    "b1_z1": "b1_description/urdf/b1-z1.urdf",
}

BENT = {
    "g1_29dof_rev_1_0": (-0.4, 0.0, 0.0, 0.8, -0.4, 0.0),
    "talos": (0.0, 0.0, -0.4, 0.8, -0.4, 0.0),
}
"""Joint positions of a leg about which it sways [rad], by robot; else those of three joints."""


def of_file(name: str) -> Robot:
    folder = _example_robot_data()
    if folder is None:
        pytest.skip("example-robot-data is not installed")
    return load_robot(folder / FILES[name])


def with_legs(count: int, folder: Path) -> Robot:
    """A trunk on legs in a circle."""
    angle = 2.0 * np.pi * (np.arange(count) + 0.25) / count
    corners = [(0.3 * float(np.cos(a)), 0.3 * float(np.sin(a))) for a in angle]
    return load_robot(write(folder, urdf("".join(urdf_leg(f"leg{k}", corner) for k, corner in enumerate(corners)))))


def waves(rng: np.random.Generator, time: Array, size: Array) -> tuple[Array, Array, Array]:
    """Sums of two sines, with their first two derivatives, (n, channels)."""
    out = np.zeros((3, len(time), len(size)))
    for _ in range(2):
        w, phase = 2.0 * np.pi * rng.uniform(0.3, 1.6, len(size)), rng.uniform(0.0, 2.0 * np.pi, len(size))
        along = time[:, None] * w + phase
        out += 0.5 * size * np.array([np.sin(along), w * np.cos(along), -(w**2) * np.sin(along)])
    return out[0], out[1], out[2]


def swaying(robot: Robot, load: InertialParameters, arms: float) -> Samples:
    """A robot that sways, whose other joints move by `arms` [rad], with a load from `LOADED` on."""
    model = pin.buildModelFromUrdf(str(robot.source), pin.JointModelFreeFlyer())
    extra = robot.extra.joints if robot.extra is not None else ()
    joints = (*robot.tree.joints, *extra)
    locked = [j for j in range(2, model.njoints) if model.names[j] not in joints]
    if locked:
        model = pin.buildReducedModel(model, locked, pin.neutral(model))
    model.gravity = pin.Motion.Zero()
    order = np.array([model.joints[model.getJointId(joint)].idx_v for joint in joints])
    rng, n = np.random.default_rng(1), len(robot.tree.joints)
    time = np.arange(0.0, SECONDS, 1.0 / RATE)
    size = np.concatenate([np.full(n, 0.06), np.full(len(extra), arms)])
    q, v, a = waves(rng, time, size)
    q[:, :n] += np.resize(BENT.get(robot.name, (0.0, 0.3, -0.54)), n)
    _, omega, alpha = waves(rng, time, np.full(3, 0.06))
    _, _, moved = waves(rng, time, np.full(3, 0.015))
    up, force = np.array([0.0, 0.0, 1.0]), np.empty((len(time), 3))
    effort = np.empty((len(time), n))
    points = [(model.getJointId(leg.joints[-1]), np.array(leg.foot_position), leg.contact) for leg in robot.legs]
    radii = [leg.foot_radius for leg in robot.legs]
    loaded = model.copy()
    loaded.inertias[1] += load.to_pinocchio()
    empty, full = model.createData(), loaded.createData()
    for k, t in enumerate(time):
        force[k] = 9.81 * up + moved[k]
        now, data = (model, empty) if t < LOADED else (loaded, full)
        state, rate, more = pin.neutral(now), np.zeros(now.nv), np.zeros(now.nv)
        for j, at in enumerate(order):
            joint = now.joints[now.getJointId(joints[j])]
            state[joint.idx_q] = q[k, j]
            rate[at], more[at] = v[k, j], a[k, j]
        rate[3:6], more[3:6], more[:3] = omega[k], alpha[k], force[k]
        needed = np.array(pin.rnea(now, data, state, rate, more))
        pin.computeJointJacobians(now, data, state)
        J = []
        for (joint, place, contact), radius in zip(points, radii, strict=True):
            point = data.oMi[joint].act(place) - radius * up
            whole = np.array(pin.getJointJacobian(now, data, joint, pin.ReferenceFrame.WORLD))
            whole[:3] -= pin.skew(point) @ whole[3:]
            J.append(whole[:contact])
        stacked = np.vstack(J)
        needed -= stacked.T @ (np.linalg.pinv(stacked[:, :6].T) @ needed[:6])
        assert np.abs(needed[:6]).max() < 1e-8
        effort[k] = needed[order[:n]]
        up = up - np.cross(omega[k], up) / RATE
        up /= np.linalg.norm(up)
    others = np.hstack([q[:, n:], v[:, n:]])
    return Samples(time, q[:, :n], v[:, :n], effort, omega, force, others)


@pytest.mark.parametrize(
    ("name", "arms"), [("g1", 0.0), ("g1", 0.3), ("talos", 0.1), ("b1_z1", 0.4), (3, 0.0), (6, 0.0)]
)
def test_a_payload_is_weighed_on_any_legs(name: str | int, arms: float, tmp_path: Path) -> None:
    robot = with_legs(name, tmp_path) if isinstance(name, int) else of_file(name)
    robot = robot.with_dynamics(dict.fromkeys(robot.tree.joints, JointDynamics()))
    if isinstance(name, int):
        assert len(robot.legs) == name
    mass = 0.1 * robot.mass
    load = InertialParameters.from_com(mass, (0.02, -0.03, 0.1), 0.01 * mass * np.eye(3))
    samples = swaying(robot, load, arms)
    estimator = TrunkEstimator(robot)
    estimator.add(samples[samples.time < TARED])
    trunk, alone = estimator.trunk, robot.inertias[robot.trunk]
    assert abs(trunk.inertial.mass - alone.mass) < 2.0 * np.sqrt(trunk.covariance[0, 0])
    estimator.tare()
    estimator.add(samples[samples.time >= TARED])
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
    with pytest.raises(IdentificationError, match="at rest, is for four legs of three joints"):
        weigh(robot, log, method="poses")
    with pytest.raises(RecordingError, match=r"feet carry a share of the robot's weight \(left"):
        identify(robot, log)
