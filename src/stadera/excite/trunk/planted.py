"""Motion and torques of a robot whose trunk moves while its feet stay where they are, or walk.

With the trunk at p and rotation R (world, in which the robot stands at the origin with R = 1), a foot that is at r_0 in
the world is at r = Rᵀ (r_0 - p) in trunk axes; the joints follow by Newton's method on all samples at once. The trunk's
specific force is a = Rᵀ (p̈ + g e_z), and with roll φ, pitch θ and yaw ψ, R = R_z(ψ) R_y(θ) R_x(φ),

    ω = (φ̇ - ψ̇ sin θ,  θ̇ cos φ + ψ̇ cos θ sin φ,  ψ̇ cos θ cos φ - θ̇ sin φ)

The contacts together carry the wrench that trunk and links need, G f = w; of all such forces those of least norm are
taken, each counted by the share W that its foot carries, f = W Gᵀ (G W Gᵀ)⁻¹ w. Torques are then τ = h - Jᵀ f, see
`stadera.body.tree`.

What a motion tells of a payload are the error bars of `TrunkEstimator` on a made log. The log is that of the robot as
it may be: its errors are drawn from the estimator's own prior (`ModelErrors`), its sensors have the noise of the
paper's test-bed. The robot does the motion without a load, is tared, and does it again with one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import add

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from stadera.body import Body, Motion, State
from stadera.body.friction import FRICTION_TERMS, direction
from stadera.constants import GRAVITY
from stadera.errors import IdentificationError
from stadera.excite.sinusoids import Sinusoids, smooth_step
from stadera.inertia import InertialParameters, skews
from stadera.robot.kinematics import leg_kinematics
from stadera.robot.model import JointDynamics, Robot
from stadera.robot.stance import StanceSettings, reached, standing_configuration
from stadera.trunk import Samples, TrunkEstimator
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.settings import ModelErrors
from stadera.trunk.wrench import TRUNK_MAP, trunk_signals
from stadera.types import Array

AXES = ("roll", "pitch", "yaw", "x", "y", "z")
"""Coordinates of the trunk's motion [rad, m], in this order."""


@dataclass(frozen=True)
class Steps:
    """Steps of a walk, slow enough that no foot has to pull. Times are in √(leg's length / g), 0.2 s of a Go2."""

    seconds: float = 5.0  # of each [1]
    shifted: float = 3.2  # of these for moving the trunk, before the foot is lifted [1]
    unloading: float = 0.5  # within which the foot's load goes to the others, before it is lifted and after [1]
    height: float = 0.15  # of the foot, share of the leg's length [1]
    stride: float = 0.2  # of a foot, likewise
    above: float = 0.9  # how far the trunk moves from above the middle of all feet to that of those that stand [1]


@dataclass(frozen=True, eq=False)
class Planted:
    """A standing robot in motion, N samples of n joints and L legs."""

    robot: Robot  # the robot
    time: Array  # (N,) [s]
    pose: Array  # (N, 6) [rad, m], coordinates `AXES` of the trunk relative to the stance
    motion: Motion  # of its joints and trunk
    carries: Array  # (N, L), share of its usual part that each foot carries [1]; zero in the air

    @classmethod
    def of(cls, robot: Robot, path: Sinusoids, rate: float) -> Planted:
        """The robot's motion for a path of the trunk with the coordinates `AXES`, sampled at `rate` [Hz]. Raises
        IdentificationError: a foot cannot stay where it is. ModelError: the robot has no nominal stance.
        """
        moved = path.sample(rate)
        legs = np.ones((len(moved), len(robot.legs)))
        pose = moved.position, moved.velocity, moved.acceleration
        return cls._of(robot, moved.time, pose, np.zeros((*legs.shape, 3)), legs)

    @classmethod
    def stepping(cls, robot: Robot, steps: int, rate: float) -> Planted:
        """A robot that walks so many steps forwards, a foot after the other, its trunk above the feet that stand.
        Raises IdentificationError: a foot cannot be where it should, or too few stand while one steps. ModelError: the
        robot has no nominal stance.
        """
        how, legs, still = Steps(), len(robot.legs), np.zeros((2, 6))
        unit = float(np.sqrt(robot.leg_length / GRAVITY))
        seconds, shifted, unloading = unit * how.seconds, unit * how.shifted, unit * how.unloading
        order = range(legs) if legs < 4 else (2, 0, 3, 1, *range(4, legs))
        rest = cls._of(robot, np.arange(2) / rate, (still, still, still), np.zeros((2, legs, 3)), np.ones((2, legs)))
        if legs < 4 and max(rest._body.sizes) < 6:
            raise IdentificationError(f"{robot.name} has {legs} point feet: it cannot stand while one of them steps")
        force, feet = rest.torques(robot.inertias[robot.trunk])[1][0, :, 2], rest.contacts[0, :, :2]
        time = np.arange(round((steps * seconds + shifted) * rate) + 1) / rate
        stride = how.stride * robot.leg_length
        path = [np.zeros((len(time), 6)) for _ in range(3)]
        carries, moved = np.ones((len(time), legs)), np.zeros((len(time), legs, 3))

        def go(to: Array, column: slice, begin: float, within: float) -> None:
            for n, curve in enumerate(smooth_step((time - begin) / within)):
                path[n][:, column] += curve[:, None] / within**n * to

        go(np.array([steps / legs * stride]), slice(3, 4), 0.0, float(time[-1]))
        forwards, at = path[0][:, 3].copy(), np.zeros(2)
        for step in range(steps + 1):
            begin, leg = step * seconds, order[step % legs]
            standing = np.delete(feet, leg, axis=0).mean(axis=0) - force @ feet / force.sum()
            target = how.above * standing if step < steps else np.zeros(2)
            go(target - at, slice(3, 5), begin, shifted)
            at = target
            if step == steps:
                break
            lifted, down = begin + shifted, begin + seconds
            u = (time - lifted) / (seconds - shifted)
            within = np.clip(u, 0.0, 1.0)
            ahead = float(np.interp(down + 0.5 * legs * seconds, time, forwards)) - moved[-1, leg, 0]
            moved[:, leg, 0] += smooth_step(u)[0] * ahead
            moved[:, leg, 2] += how.height * robot.leg_length * 64.0 * (within * (1.0 - within)) ** 3
            without = np.minimum((time - lifted) / unloading + 1.0, (down - time) / unloading + 1.0)
            carries[:, leg] *= 1.0 - np.clip(without, 0.0, 1.0)
        return cls._of(robot, time, (path[0], path[1], path[2]), moved, carries)

    @classmethod
    def _of(
        cls, robot: Robot, time: Array, path: tuple[Array, Array, Array], moved: Array, carries: Array, every: int = 4
    ) -> Planted:
        """From the trunk's coordinates and their first and second derivatives (N, 6), and the feet's displacements
        (N, L, 3) [m]. The joints are solved for at one of `every` samples; a spline gives those between.
        """
        pose, slope, curve = path
        turn = Rotation.from_euler("ZYX", pose[:, [2, 1, 0]]).as_matrix()
        (sin_roll, sin_pitch, _), (cos_roll, cos_pitch, _) = np.sin(pose[:, :3]).T, np.cos(pose[:, :3]).T
        roll, pitch, yaw = slope[:, :3].T
        omega = np.column_stack(
            [
                roll - yaw * sin_pitch,
                pitch * cos_roll + yaw * cos_pitch * sin_roll,
                yaw * cos_pitch * cos_roll - pitch * sin_roll,
            ]
        )
        degree = min(5, len(time) - 1)
        alpha = make_interp_spline(time, omega, degree)(time, 1)
        force = np.einsum("nji,nj->ni", turn, curve[:, 3:] + [0.0, 0.0, GRAVITY])
        coarse = np.unique(np.append(np.arange(0, len(time), every), len(time) - 1))
        joints = planted_joints(robot, turn[coarse], pose[coarse, 3:], moved[coarse])
        angles = make_interp_spline(time[coarse], joints, min(5, len(coarse) - 1))
        q, rate_of_q, more = (np.asarray(angles(time, order)) for order in range(3))
        return cls(robot, time, pose, Motion(q, rate_of_q, more, omega, alpha, force, turn[:, 2]), carries)

    @cached_property
    def _body(self) -> Body:
        return Body.of(self.robot, others=False)

    @cached_property
    def _state(self) -> State:
        return self._body.at(self.motion)

    @cached_property
    def contacts(self) -> Array:
        """Points of contact, (N, L, 3) [m], trunk axes."""
        return np.asarray(self._state.feet - self._body.radii[:, None] * self.motion.normal[:, None])

    def torques(self, trunk: InertialParameters) -> tuple[Array, Array]:
        """Joint torques (N, n) [N·m] and contact forces (N, L, 3) [N], trunk axes, with a trunk that may carry a load.

        Friction and rotors are those of the robot's model.
        """
        body, state, motion = self._body, self._state, self.motion
        signals = trunk_signals(motion.specific_force.T, motion.angular_velocity.T, motion.angular_acceleration.T)
        own = np.einsum("ckn,k->nc", (TRUNK_MAP @ signals).reshape(6, 10, -1), trunk.vector)
        wrench = own + state.inertial.sum(axis=1)
        # of each contact, force above moment about the trunk's origin: [1 0 ; [p]x 1]
        whole = np.tile(np.eye(6), (*self.contacts.shape[:2], 1, 1))
        whole[:, :, 3:, :3] = skews(self.contacts)
        G = np.concatenate([whole[:, leg, :, :size] for leg, size in enumerate(body.sizes)], axis=2)
        share = np.repeat(self.carries, body.sizes, axis=1)
        own = np.linalg.solve(np.einsum("nck,nk,ndk->ncd", G, share, G), wrench[..., None])[..., 0]
        found = share * np.einsum("nck,nc->nk", G, own)
        torque = state.torque + body.friction(motion.velocity, motion.velocity)
        force, at = np.empty((len(wrench), len(body.legs), 3)), 0
        for k, (leg, size) in enumerate(zip(body.legs, body.sizes, strict=True)):
            own_force, at = found[:, at : at + size], at + size
            axis, arm = state.axis[:, leg], self.contacts[:, k, None] - state.origin[:, leg]
            rows = np.concatenate([np.cross(axis, arm), axis], axis=2)[:, :, :size]
            torque[:, leg] -= np.einsum("njc,nc->nj", rows, own_force)
            force[:, k] = own_force[:, :3]
        return torque, force


def planted_joints(robot: Robot, turn: Array, shift: Array, moved: Array, solved: float = 1e-7) -> Array:
    """Joint angles (N, n) that keep the feet where they are in the stance, or apart from it by (N, L, 3) [m], for
    poses (N, 3, 3) and (N, 3) [m]; `solved` is the largest error of a foot that is where it should [m, 1].
    IdentificationError: a foot cannot be there.
    """
    out, settings = np.tile(standing_configuration(robot), (len(turn), 1)), StanceSettings()
    for k, leg in enumerate(robot.legs):
        tree, own = robot.leg_tree(leg.name), [robot.tree.joints.index(joint) for joint in leg.joints]
        sole, foot, _ = leg_kinematics(tree, leg, out[:1, own])
        foot = np.einsum("nji,nj->ni", turn, foot - shift + moved[:, k])
        out[:, own], left = reached(tree, leg, out[:, own], foot, turn.transpose(0, 2, 1) @ sole, settings)
        if left > solved:
            raise IdentificationError(f"{leg.name} of {robot.name} cannot keep its foot in place: {left:.2g} m away")
    return out


@dataclass(frozen=True)
class PayloadBars:
    """Standard deviations of a payload."""

    mass: float  # without the torques' common scale [kg]
    scale: float  # of that scale, share of the mass [1]
    com: tuple[float, float, float]  # (3,) of its centre in trunk axes [m], NaN where it is not observed

    def score(self, unobserved: float) -> float:
        """Sum of the logarithms of the four, with `unobserved` [m] for a component that is not: less is better."""
        return float(np.log([self.mass, *np.nan_to_num(self.com, nan=unobserved)]).sum())

    @classmethod
    def median(cls, bars: Sequence[PayloadBars]) -> PayloadBars:
        """The median of each."""
        mass, scale, *com = np.median([[b.mass, b.scale, *b.com] for b in bars], axis=0).tolist()
        return cls(mass, scale, (com[0], com[1], com[2]))


_NOISE = {"position": 2e-4, "velocity": 0.02, "effort": 0.0033, "gyro": 0.003, "accelerometer": 0.05}
"""White noise of a sample, one standard deviation [rad, rad/s, share of the joint's limit, rad/s, m/s²], as on the
paper's test-bed.
"""


_OF_JOINTS = ("rotor", "viscous", "coulomb", "offset", "load_friction", "gain", "encoder")


class Drawn:
    """A robot as it may be, with errors drawn from the estimator's prior.

    Args:
        robot: the model that the estimator has.
        rng: of the draw.

    Attributes:
        true: the robot itself.
    """

    def __init__(self, robot: Robot, rng: np.random.Generator) -> None:
        model = ErrorModel(robot, ModelErrors())
        drawn = rng.multivariate_normal(np.zeros(model.layout.count), model.covariance, method="eigh")
        self._p = {name: drawn[place] for name, place in model.layout.places.items()}
        # from the legs' order of joints to the tree's
        order = np.argsort([robot.tree.joints.index(joint) for leg in robot.legs for joint in leg.joints])
        self._p |= {name: self._p[name][order] for name in _OF_JOINTS}
        self._model, self._limit = robot, model.limit[order]
        self._seed = int(rng.integers(2**32))
        self.true = self._robot()

    def _robot(self) -> Robot:
        robot, p = self._model, self._p
        dynamics, bodies, legs = {}, {}, []
        for k, joint in enumerate(robot.tree.joints):
            more = [abs(p["rotor"][k]), abs(p["viscous"][k]), abs(p["coulomb"][k]), p["offset"][k]]
            known = [getattr(robot.dynamics[joint], term) for term in FRICTION_TERMS]
            dynamics[joint] = JointDynamics(*map(add, known, more))
        links = robot.tree.links[1:]
        moved = p["link_com"].reshape(3, len(links))
        for k, link in enumerate(links):
            body = robot.inertias[link]
            mass = body.mass * (1.0 + max(float(p["link_mass"][k]), -0.5))
            if mass > 0.0:
                bodies[link] = InertialParameters.from_com(mass, body.com + moved[:, k], body.inertia_com)
        for leg, apart in zip(robot.legs, p["contact"].reshape(-1, 3), strict=True):
            x, y, z = (np.array(leg.foot_position) + apart).tolist()
            legs.append(replace(leg, foot_position=(x, y, z)))
        return replace(robot.with_dynamics(dynamics).with_inertias(bodies), legs=tuple(legs))

    def measured(self, planted: Planted, payload: InertialParameters | None = None) -> Samples:
        """What the sensors say while `true` moves, with or without a payload on its trunk."""
        p, motion, rng = self._p, planted.motion, np.random.default_rng(self._seed)
        trunk = self.true.inertias[self.true.trunk]
        effort, _ = planted.torques(trunk if payload is None else trunk + payload)
        effort += np.abs(p["load_friction"]) * np.abs(effort) * direction(motion.velocity)
        before = planted.time - abs(float(p["torque_lag"][0]))
        late = np.column_stack([np.interp(before, planted.time, torque) for torque in effort.T])
        w, turned = motion.angular_velocity, Rotation.from_rotvec(p["imu_rotation"]).as_matrix().T
        lever = np.broadcast_to(p["imu_lever"], w.shape)
        force = motion.specific_force + np.cross(motion.angular_acceleration, lever) + np.cross(w, np.cross(w, lever))

        def noisy(values: Array, size: float | Array) -> Array:
            return np.asarray(values + size * rng.standard_normal(values.shape))

        return Samples(
            planted.time,
            noisy(motion.position + p["encoder"], _NOISE["position"]),
            noisy(motion.velocity, _NOISE["velocity"]),
            noisy(late * (1.0 + p["gain"] + p["common_gain"]), _NOISE["effort"] * self._limit),
            noisy(w @ turned, _NOISE["gyro"]),
            noisy(force @ turned + p["accelerometer"], _NOISE["accelerometer"]),
        )


def expected_bars(robot: Robot, planted: Planted, payload: InertialParameters, drawn: Drawn) -> PayloadBars | None:
    """The payload's error bars from a motion of `drawn.true` without and with it; None if the estimator has none."""
    bare, loaded = drawn.measured(planted), drawn.measured(planted, payload)
    again = replace(loaded, time=loaded.time + bare.time[-1] + 0.5)  # s between the two motions
    estimator = TrunkEstimator(robot)
    estimator.add(bare)
    estimator.tare()
    estimator.add(again)
    found = estimator.payload
    if found is None or found.mass_std_without_scale is None:
        return None
    x, y, z = found.com_std.tolist()
    return PayloadBars(found.mass_std_without_scale, found.scale or 0.0, (x, y, z))
