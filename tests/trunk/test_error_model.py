"""How errors of the model enter the rows, against motions worked out by Pinocchio with those errors in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from layout import ERRORS, PLACES
from stadera.body.friction import direction
from stadera.inertia import InertialParameters
from stadera.robot import JointDynamics, Robot, load_robot
from stadera.robot.imu import ImuMount
from stadera.robot.kinematics import forward_kinematics
from stadera.trunk.block_rows import BlockRows
from stadera.trunk.error_model import ErrorLayout, ErrorModel, limb_limits
from stadera.trunk.noise import mean_third_differences_squared
from stadera.trunk.rows import RowMaker
from stadera.trunk.samples import Samples
from stadera.trunk.settings import ModelErrors, SwingDetection
from stadera.trunk.window import window_of
from walking import Motion, Walk, walked

RATE = 1000.0
BLOCK = 20  # samples
WALK = Walk(seconds=0.6, rate_hz=RATE, speed=0.3)
DYNAMICS = JointDynamics(0.02, 0.3, 0.0, 0.0)
UP = np.array([0.0, 0.0, 1.0])


@cache
def robot() -> Robot:
    plain = load_robot("hyq")
    return plain.with_dynamics(dict.fromkeys(plain.tree.joints, DYNAMICS))


def columns() -> np.ndarray:
    return np.array([[robot().tree.joints.index(j) for j in leg.joints] for leg in robot().legs]).ravel()


@cache
def motion() -> Motion:
    return walked(robot(), WALK)


def by_joint(values: np.ndarray) -> np.ndarray:
    """(12,) by leg and joint, in the tree's order."""
    out = np.zeros(12)
    out[columns()] = values
    return out


def samples(m: Motion, **changed: np.ndarray) -> Samples:
    """As sensors without errors give them, but for what is changed."""
    mount = ImuMount.of(robot())
    w, r = m.angular_velocity, mount.translation
    at_imu = m.specific_force + np.cross(m.angular_acceleration, r) + np.cross(w, np.cross(w, r))
    values = {"position": m.position, "velocity": m.velocity, "effort": m.effort}
    values |= {"angular_velocity": w, "specific_force": at_imu}
    return Samples(m.time, **(values | changed))


def rows_of(data: Samples, known: Robot, normal: np.ndarray, block: int = BLOCK) -> list[BlockRows]:
    """Rows of all complete windows, the ground's normal given."""
    maker, trunk = RowMaker(known, ImuMount.of(known), SwingDetection()), robot().inertias[robot().trunk]
    sizes = (block,) * len(range(0, len(data) - block - 2, block))
    window, data = window_of(sizes), data[: block * len(sizes) + 2]
    squares = mean_third_differences_squared(data.table[:, 1:], window) if block > 1 else None
    at = normal[window.edges[:-1] + block // 2][window.block]
    made = maker.blocks(data, sizes, maker.motion(data)._replace(normal=at), trunk, squares)[0]
    return [rows for rows in made if rows is not None][2:]


def test_joints_slide_against_a_friction_that_grows_with_their_torque() -> None:
    """Of rows in joint space: s |τ| has the sign of s, and the size of the torques of the two blocks."""
    data, seen = samples(motion()), 0
    for rows in rows_of(data, robot(), motion().normal):
        end = int(np.searchsorted(data.time, rows.time))
        effort = np.abs(data.effort[end - 2 * BLOCK : end + 2])
        _, _, sign, by_load, _ = rows.swing.terms
        slides = np.abs(sign) > 0.99
        ratio = (by_load / sign)[slides]
        assert (ratio > 0.9 * effort.min(axis=0)[slides]).all()
        assert (ratio < 1.1 * effort.max(axis=0)[slides]).all()
        seen += int(slides.sum())
    assert seen > 100


def dynamics_with(**more: np.ndarray) -> Robot:
    """The robot with other joint dynamics, (12,) by leg and joint."""
    joints = [joint for leg in robot().legs for joint in leg.joints]
    added = [{name: float(value[k]) for name, value in more.items()} for k in range(12)]
    old = {j: robot().dynamics[j] for j in joints}
    return robot().with_dynamics(
        {
            j: replace(old[j], **{n: getattr(old[j], n) + v for n, v in a.items()})
            for j, a in zip(joints, added, strict=True)
        }
    )


def of_joints(name: str, attribute: str) -> Callable[[np.ndarray], tuple[Samples, Robot]]:
    del name
    return lambda p: (samples(walked(dynamics_with(**{attribute: p}), WALK)), robot())


def links_changed(p: np.ndarray, which: str) -> Robot:
    links = [link for leg in robot().legs for link in leg.links]
    changed = {}
    for k, link in enumerate(links):
        body = robot().inertias[link]
        if which == "mass":
            changed[link] = InertialParameters(body.vector * (1.0 + p[k]))
        else:
            # matter that lies elsewhere by δ and is turned no differently
            changed[link] = InertialParameters.from_com(body.mass, body.com + p.reshape(3, 12)[:, k], body.inertia_com)
    return robot().with_inertias(changed)


def feet_moved(p: np.ndarray) -> Robot:
    """The model's feet lie elsewhere by -p, (leg, axis), in the last links' axes."""
    legs = []
    for leg, shift in zip(robot().legs, p.reshape(4, 3), strict=True):
        place = np.array(leg.foot_position) - shift
        legs.append(replace(leg, foot_position=tuple(place.tolist())))
    return replace(robot(), legs=tuple(legs))


def imu_elsewhere(p: np.ndarray) -> Samples:
    """The IMU is off its place by p, trunk axes."""
    m, w = motion(), motion().angular_velocity
    true = samples(m)
    return replace(
        true, specific_force=true.specific_force + np.cross(m.angular_acceleration, p) + np.cross(w, np.cross(w, p))
    )


def biased(p: np.ndarray) -> Samples:
    true = samples(motion())
    return replace(true, specific_force=true.specific_force + p)


def exaggerated(p: np.ndarray) -> Samples:
    """The accelerometer shows more of what differs from its average over the last second, in the world's axes."""
    true, R = samples(motion()), motion().rotation
    force = np.einsum("nij,nj->ni", R, motion().specific_force)
    keep = np.exp(-np.gradient(motion().time))
    average, weight, total = np.empty_like(force), 0.0, np.zeros(3)
    for k, now in enumerate(force):
        weight, total = keep[k] * weight + 1.0 - keep[k], keep[k] * total + (1.0 - keep[k]) * now
        average[k] = total / weight
    moved = np.einsum("nji,nj->ni", R, force - average)
    return replace(true, specific_force=true.specific_force + p * moved)


def imu_turned(p: np.ndarray) -> Samples:
    """True values are the measured ones turned by the rotation vector -p: a_true = a - p x a."""
    true, turn = samples(motion()), Rotation.from_rotvec(p)
    return replace(
        true,
        angular_velocity=turn.apply(true.angular_velocity),
        specific_force=turn.apply(true.specific_force),
    )


def lossy(share: np.ndarray) -> np.ndarray:
    """Torques of motors whose gears lose this share of what the joints carry, against the motion."""
    return np.asarray(motion().effort + share * np.abs(motion().effort) * np.sign(motion().velocity))


def resting(torque: np.ndarray) -> np.ndarray:
    """Torques with what holds joints while they hardly move: √(1 - s²) of it, s averaged over two blocks."""
    window = np.hanning(2 * BLOCK + 1) / BLOCK
    mean = np.stack([np.convolve(s, window, mode="same") for s in direction(motion().velocity).T], axis=1)
    return motion().effort + torque * np.sqrt(np.maximum(1.0 - mean**2, 0.0))


def shifted(values: np.ndarray, seconds: float) -> np.ndarray:
    """Values that come so much later."""
    time = motion().time
    return np.stack([np.interp(time - seconds, time, v) for v in values.T], axis=1)


CASES: dict[str, Callable[[np.ndarray], tuple[Samples, Robot]]] = {
    "rotor": of_joints("rotor", "armature"),
    "viscous": of_joints("viscous", "viscous"),
    "offset": lambda p: (samples(motion(), effort=motion().effort + by_joint(p)), robot()),
    "gain": lambda p: (samples(motion(), effort=motion().effort * (1.0 + by_joint(p))), robot()),
    "load_friction": lambda p: (samples(motion(), effort=lossy(by_joint(p))), robot()),
    "standstill": lambda p: (samples(motion(), effort=resting(by_joint(p))), robot()),
    "common_gain": lambda p: (samples(motion(), effort=motion().effort * (1.0 + p[0])), robot()),
    "torque_lag": lambda p: (samples(motion(), effort=shifted(motion().effort, p[0])), robot()),
    "encoder": lambda p: (samples(motion(), position=motion().position + by_joint(p)), robot()),
    "link_mass": lambda p: (samples(motion()), links_changed(-p, "mass")),
    "link_com": lambda p: (samples(motion()), links_changed(-p, "com")),
    "imu_lever": lambda p: (imu_elsewhere(p), robot()),
    "imu_rotation": lambda p: (imu_turned(p), robot()),
    "accelerometer": lambda p: (
        replace(samples(motion()), specific_force=samples(motion()).specific_force + p),
        robot(),
    ),
    "imu_response": lambda p: (exaggerated(p), robot()),
}
SIZES = {"rotor": 0.02, "viscous": 0.5, "offset": 1.0, "gain": 0.01, "common_gain": 0.01, "torque_lag": 1e-3}
SIZES |= {
    "load_friction": 0.05,
    "standstill": 1.0,
    "encoder": 2e-3,
    "link_mass": 0.05,
    "link_com": 5e-3,
    "imu_lever": 0.01,
}
SIZES |= {"imu_rotation": 2e-3, "accelerometer": 0.05, "imu_response": 0.05}


@cache
def clean() -> list[BlockRows]:
    return rows_of(samples(motion()), robot(), motion().normal)


def unexplained(rows: list[BlockRows]) -> np.ndarray:
    """b - A θ at the true trunk."""
    theta = robot().inertias[robot().trunk].vector
    return np.array([r.target - r.matrix @ theta for r in rows])


def agree(left: np.ndarray, said: np.ndarray, tolerance: float) -> None:
    size = np.sqrt((said**2).mean())
    assert size > 0.0
    assert np.sqrt(((left - said) ** 2).mean()) < tolerance * size


@pytest.mark.parametrize("name", CASES)
def test_an_error_moves_the_rows_as_its_columns_say(name: str) -> None:
    """A θ + C p = b, each entry of p drawn."""
    place, rng = PLACES[name], np.random.default_rng(1)
    p = SIZES[name] * rng.uniform(-1.0, 1.0, place.stop - place.start)
    data, known = CASES[name](p)
    left = unexplained(rows_of(data, known, motion().normal)) - unexplained(clean())
    said = np.array([rows.errors[:, place] @ p for rows in clean()])
    # the products of angular velocity are left out of the IMU's axes, and encoders are evaluated at a block's middle
    # the averages over a second and over two blocks are taken over samples here, over windows there
    rough = {"imu_rotation": 0.2, "encoder": 0.08, "imu_response": 0.2, "standstill": 0.2}
    agree(left, said, rough.get(name, 0.04))


def test_late_joint_velocities_move_the_rows_as_their_column_says() -> None:
    """Velocities of joints and trunk come late, torques and specific force do not: sign and size."""
    late = 1e-3
    turned = shifted(motion().velocity, late)
    m, w = motion(), shifted(motion().angular_velocity, late)
    r, alpha = ImuMount.of(robot()).translation, shifted(motion().angular_acceleration, late)
    at_imu = m.specific_force + np.cross(alpha, r) + np.cross(w, np.cross(w, r))
    data = samples(motion(), velocity=turned, angular_velocity=w, specific_force=at_imu)
    left = unexplained(rows_of(data, robot(), motion().normal)) - unexplained(clean())
    said = np.array([rows.errors[:, PLACES["velocity_lag"].start] * late for rows in clean()])
    agree(left, said, 0.5)
    assert (left * said).sum() > 0.8 * np.sqrt((left**2).sum() * (said**2).sum())


def test_a_contact_point_elsewhere_moves_the_rows_as_its_columns_say() -> None:
    """Against a model whose feet are elsewhere, fixed to the last links."""
    p = 2e-3 * np.random.default_rng(2).uniform(-1.0, 1.0, 12)
    left = unexplained(rows_of(samples(motion()), feet_moved(p), motion().normal)) - unexplained(clean())
    turn, _ = forward_kinematics(robot().tree, motion().position)
    last = [robot().tree.links.index(leg.links[-1]) for leg in robot().legs]
    said = []
    for rows in clean():
        k = int(np.searchsorted(motion().time, rows.time)) - BLOCK  # the middle of the window
        shift = np.einsum("lij,lj->li", turn[k, last], p.reshape(4, 3))
        said.append(rows.errors[:, PLACES["contact"]] @ shift.ravel())
    agree(left, np.array(said), 0.05)


def test_sampling_is_half_the_difference_between_rows_of_every_other_sample() -> None:
    """Noise of torques and accelerometer, which are not differentiated; windows of both at the same times."""
    m, rng, place = motion(), np.random.default_rng(3), PLACES["sampling"].start
    noisy = samples(m, effort=m.effort + rng.standard_normal(m.effort.shape))
    noisy = replace(noisy, specific_force=noisy.specific_force + rng.standard_normal((len(m.time), 3)))
    column, smooth = (
        np.array([rows.errors[:, place] for rows in rows_of(data, robot(), m.normal)]) for data in (noisy, samples(m))
    )
    assert np.abs(smooth).max() < 0.01 * np.abs(column).max()
    odd, even = (unexplained(rows_of(noisy[k::2], robot(), m.normal[k::2], BLOCK // 2)) for k in (0, 1))
    n = min(len(odd), len(even), len(column))
    assert n > 15
    half = 0.5 * (odd[:n] - even[:n])
    # one begins half a sample earlier than the other, so some of the motion is left
    agree(np.sign((half * column[:n]).sum()) * half, column[:n], 0.3)


@pytest.mark.parametrize("block", [BLOCK, BLOCK // 2 + 1])
def test_sampling_errors_that_repeat_add_up(block: int) -> None:
    """Every other sample reads more: the column is the same in all windows, of even and odd numbers of samples."""
    m, place = motion(), PLACES["sampling"].start
    more = np.where(np.arange(len(m.time)) % 2, 1.0, -1.0)[:, None] * [0.0, 0.0, 0.5]
    made = rows_of(samples(m, specific_force=samples(m).specific_force + more), robot(), m.normal, block)
    column = np.array([rows.errors[2, place] for rows in made])
    # the legs' own inertia is felt by their joints in part
    assert np.abs(np.abs(column) - 0.5 * robot().mass).max() < 0.1 * 0.5 * robot().mass
    assert abs(np.sign(column).sum()) == len(column)


def test_few_samples_a_block_tell_no_sampling_errors() -> None:
    """At 50 and 100 Hz the difference between two samples is motion, and would explain any residual."""
    m, place = motion(), PLACES["sampling"].start
    for step, block in ((20, 1), (10, 2)):
        made = rows_of(samples(m)[::step], robot(), m.normal[::step], block)
        assert made
        assert not any(rows.errors[:, place].any() for rows in made)


def test_a_joint_that_turns_back_does_not_stand() -> None:
    """The joints of a walk, which stop at every turn, slide in all rows; none sticks."""
    later = clean()[25:]
    for name, there in (("coulomb", True), ("stiction", False)):
        used = np.array([rows.errors[:, PLACES[name]].any(axis=0) for rows in later])
        assert (used == there).all(), name


def test_places_fill_the_vector() -> None:
    covered = np.concatenate([np.arange(p.start, p.stop) for p in PLACES.values()])
    np.testing.assert_array_equal(covered, np.arange(ERRORS))


def test_drives_of_one_kind_are_alike() -> None:
    model = ErrorModel(robot(), ModelErrors())
    place = PLACES["coulomb"]
    block = model.covariance[place, place]
    std = np.sqrt(np.diag(block))
    correlation = block / np.outer(std, std)
    assert correlation[0, 3] == pytest.approx(0.7)
    assert correlation[0, 1] == 0.0
    assert np.linalg.eigvalsh(model.covariance).min() >= -1e-12


def test_identified_joints_are_as_uncertain_as_identified_and_may_drift() -> None:
    model, sizes = load_robot("hyq"), ModelErrors()
    leg = model.legs[1]
    usual = ErrorModel(model, sizes)
    values, std = JointDynamics(0.1, 1.0, 3.0, -2.0), JointDynamics(0.04, 0.05, 0.4, np.nan)
    known = ErrorModel(model.with_dynamics(dict.fromkeys(leg.joints, values), dict.fromkeys(leg.joints, std)), sizes)
    before, after = (
        {name: np.sqrt(errors.variance[PLACES[name]]) for name in ("rotor", "viscous", "coulomb", "offset")}
        for errors in (usual, known)
    )
    for name in before:
        np.testing.assert_array_equal(np.delete(after[name], [3, 4, 5]), np.delete(before[name], [3, 4, 5]))
    np.testing.assert_allclose(after["rotor"][3:6], np.hypot(0.04, sizes.rotor_drift * 0.1))
    np.testing.assert_allclose(after["viscous"][3:6], np.hypot(0.05, sizes.friction_drift * 1.0))
    np.testing.assert_allclose(after["coulomb"][3:6], np.hypot(0.4, sizes.friction_drift * 3.0))
    np.testing.assert_array_equal(after["offset"][3:6], before["offset"][3:6])  # the log did not determine it
    for name in ("rotor", "viscous", "coulomb", "stiction"):  # a change since then tells nothing about other joints
        place = PLACES[name]
        between = known.covariance[place, place][3:6][:, [0, 1, 2, 6, 7, 8, 9, 10, 11]]
        assert not between.any()
        np.testing.assert_array_equal(known.covariance[place, place][:3, 6:], usual.covariance[place, place][:3, 6:])
    wide = JointDynamics(9.0, 9.0, 99.0, 99.0)
    same = ErrorModel(model.with_dynamics(dict.fromkeys(leg.joints, values), dict.fromkeys(leg.joints, wide)), sizes)
    np.testing.assert_array_equal(same.variance[: PLACES["gain"].start], usual.variance[: PLACES["gain"].start])


def test_friction_that_a_file_states_may_be_a_simulators() -> None:
    robot, sizes = load_robot("go2"), ModelErrors()
    leg, usual = robot.legs[0], ErrorModel(robot, ModelErrors())
    stable = JointDynamics(armature=0.1, viscous=2.0, coulomb=0.01, offset=0.0)
    model = ErrorModel(robot.with_dynamics(dict.fromkeys(leg.joints, stable), {}), sizes)
    for name, stated in (("rotor", 0.1), ("viscous", 2.0)):
        np.testing.assert_allclose(np.sqrt(model.variance[PLACES[name]][:3]), sizes.stated * stated)
        np.testing.assert_array_equal(model.variance[PLACES[name]][3:], usual.variance[PLACES[name]][3:])
    np.testing.assert_array_equal(model.variance[PLACES["coulomb"]], usual.variance[PLACES["coulomb"]])


def test_gears_of_arms_have_more_friction() -> None:
    sizes, robot = ModelErrors(), load_robot("b1_z1")
    model = ErrorModel(robot, sizes)
    std = {name: np.sqrt(model.variance[place]) for name, place in model.layout.places.items()}
    for name in ("viscous", "coulomb"):
        np.testing.assert_allclose(std[name], getattr(sizes, name) * model.limit)
        np.testing.assert_allclose(std[f"limb_{name}"], sizes.limbs * getattr(sizes, name) * limb_limits(robot))
    np.testing.assert_allclose(std["limb_stiction"], sizes.limbs * sizes.coulomb * limb_limits(robot) / np.sqrt(3.0))


def test_gears_on_flat_feet_may_be_of_either_kind() -> None:
    """Sliding friction is wider, and alike in all joints but identified ones; what holds a joint is as elsewhere."""
    sizes, robot = ModelErrors(), load_robot("bolt")
    assert {leg.contact for leg in robot.legs} == {3}
    flat = replace(robot, legs=tuple(replace(leg, contact=6) for leg in robot.legs))
    joint = robot.legs[0].joints[0]
    known = flat.with_dynamics({joint: DYNAMICS}, {joint: JointDynamics(1e-3, 1e-3, 1e-3, 1e-3)})
    point, both, found = (ErrorModel(each, sizes) for each in (robot, flat, known))
    place, held = point.layout.places["coulomb"], point.layout.places["stiction"]
    np.testing.assert_allclose(both.variance[place], sizes.gears**2 * point.variance[place])
    np.testing.assert_allclose(both.variance[held], point.variance[held])
    correlation = both.covariance[place, place] / np.sqrt(np.outer(both.variance[place], both.variance[place]))
    least = correlation[~np.eye(len(correlation), dtype=bool)]
    assert least.min() == pytest.approx(2.0 / np.pi)
    assert least.max() == pytest.approx(sizes.alike)
    assert not found.covariance[place, place][0, 1:].any()


def test_friction_of_slow_joints_changes_with_the_load_on_flat_feet() -> None:
    robot = load_robot("bolt")
    flat = replace(robot, legs=tuple(replace(leg, contact=6) for leg in robot.legs))
    for each, changes in ((robot, False), (flat, True)):
        layout = ErrorLayout.of(each)
        assert layout.flat == changes
        assert (layout.places["standstill"] in layout.changing) == changes
        assert layout.places["stiction"] in layout.changing


def test_other_dynamics_have_no_old_standard_deviations() -> None:
    model, std = load_robot("hyq"), JointDynamics(0.01, 0.1, 0.1, 0.1)
    joint, other = model.tree.joints[:2]
    known = model.with_dynamics(dict.fromkeys((joint, other), DYNAMICS), dict.fromkeys((joint, other), std))
    assert dict(known.with_dynamics({joint: DYNAMICS}).dynamics_std) == {other: std}
