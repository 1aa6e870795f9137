"""Draws one robot with `real` errors, its true bodies, joints, sensors and ground, from the sizes of these errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np

from stadera.inertia import InertialParameters
from stadera.lab.plant.model import DryFriction, build_model, mass_matrix
from stadera.lab.plant.sensors import STANDARD
from stadera.lab.plant.terrain import Stones, Terrain
from stadera.robot.model import JointDynamics, Leg, Robot
from stadera.robot.shapes import FLAT
from stadera.robot.sole import LEAST_RADIUS, foot_radius
from stadera.robot.stance import standing_configuration
from stadera.types import Array

Range = tuple[float, float]


def kinds_of(robot: Robot) -> list[int]:
    """The kind of each joint: its place in its leg, then, of joints outside the legs, how far they are from the trunk;
    left and right are alike.
    """
    places = {joint: k for leg in robot.legs for k, joint in enumerate(leg.joints)}
    first = 1 + max(places.values())
    depth = {joint: first - 1 + len(robot.tree.ancestors(i)) for i, joint in enumerate(robot.tree.joints)}
    return [places.get(joint, depth[joint]) for joint in robot.tree.joints]


@dataclass(frozen=True)
class VaryingSizes:
    """Sizes of what varies over a log: friction with the joints' position and load, torque offsets, the IMU's response,
    and times. Found on real robots; the laws are others than those of the estimators.
    """

    by_position: float = 0.3  # largest relative variation of Coulomb friction over a joint's range
    knots: int = 7  # in that range, between which friction is linear in the position
    by_load: Range = (0.0, 0.1)  # friction as a share of the torque carried, by kind of joint, uniform
    drift: float = 0.003  # largest drift of a torque offset over a log, as a share of the effort limit
    warming: float = 3.0  # time constants of the drift in a log
    lowpass: Range = (80.0, 260.0)  # corner of the accelerometer's low-pass [Hz], uniform
    held: float = 0.2  # share of runs in which joints or IMU are held between updates of their own rate
    updates: tuple[int, ...] = (2, 3, 4, 5)  # samples of the log for which they are
    jitter: float = 0.002  # largest delay of a stamp [s]


@dataclass(frozen=True)
class RealSizes:
    """Sizes of the `real` errors. A pair is a range to draw from; a single number is a standard deviation.

    Three rules scale with the robot and are assumptions:

    - Rotor inertia seen at the joint is proportional to the joint's effort limit, 3e-4 kg·m² per N·m: 0.010 for A1
      (33.5 N·m), 0.007 to 0.014 for Go2, whose real calf was identified at the order of 0.01, and 0.045 for HyQ.
    - Viscous friction is 0.1 to 1 % of the effort limit at 1 rad/s.
    - A joint's encoder has 13 to 16 bits per turn, and its drive differences positions over 5 ms.
    """

    noise: Range = (0.5, 3.0)  # factor on the noise of `standard`, uniform
    joint_gain: float = 0.03  # of each joint's measured torques, relative
    common_gain: float = 0.03  # of all together
    coulomb: Range = (0.003, 0.03)  # of each kind of joint, as a share of its effort limit, log-uniform
    viscous: Range = (0.001, 0.01)  # likewise, at 1 rad/s
    rotor: Range = (0.3, 1.5)  # of each kind of joint, relative to its class of robots, uniform
    rotor_per_limit: float = 3e-4  # rotor inertia of the class [kg·m² per N·m of the effort limit]
    alike: float = 0.2  # relative difference in friction between joints of a kind; rotors are alike
    encoder_zero: float = float(np.deg2rad(0.4))  # [rad]
    imu_rotation: float = float(np.deg2rad(1.0))  # [rad], of the whole rotation vector
    imu_place: float = 0.015  # [m], of the whole displacement
    foot: float = 0.005  # [m], of the radius and of each component of the contact point
    link_mass: float = 0.05  # relative
    link_com: float = 0.005  # [m], of each component. Of all links, the trunk's too.
    delay: Range = (0.0, 0.010)  # of the measured torques [s], uniform
    quantised: float = 1.0 / 3.0  # share of runs with quantised encoders and differenced velocities
    bits: tuple[int, ...] = (13, 14, 15, 16)  # of the encoder, over a turn of the joint
    differenced: float = 0.005  # [s], time over which positions are differenced
    rates: tuple[float, ...] = (200.0, 500.0, 1000.0)  # of the log [Hz]
    soft: float = 1.0 / 3.0  # share of runs on soft ground; the others are on hard, even ground
    rough: float = 1.0 / 3.0  # share of runs on rough ground
    # time constant of soft ground [s], uniform. At 0.03 s feet sink by 1 mm standing, 2.5 mm trotting; from 0.04 s on
    # some robots fall in a trot.
    softness: Range = (0.005, 0.03)
    roughness: Range = (0.0, 0.01)  # ± heights of rough ground [m], uniform
    slope: float = float(np.deg2rad(5.0))  # [rad], the largest; its heading is random
    # coefficient of the ground, uniform; the controllers assume 0.6, so feet sometimes slip
    friction: Range = (0.45, 0.9)
    lost: Range = (0.0, 0.005)  # share of samples lost, uniform
    spikes: Range = (0.0, 0.5)  # outliers per second, uniform
    varying: VaryingSizes | None = field(default_factory=VaryingSizes)  # what varies over a log; None for nothing
    # frequency [Hz] with which a joint's gear lets swing what is beyond it (the whole robot on the joint of a leg),
    # uniform; encoders are on the motors' side. None for stiff joints.
    elastic: Range | None = None
    gives_way: float = 0.01  # most that an elastic gear gives way at the joint's effort limit [rad]

    def of_drives(self, robot: Robot) -> RealSizes:
        """The sizes for a robot's kind of drives: on flat feet, harmonic gears, as Talos and iCub have."""
        harmonic = any(leg.contact == FLAT for leg in robot.legs)
        return replace(self, coulomb=(0.03, 0.08), elastic=(10.0, 20.0)) if harmonic else self


REAL_SETS: Mapping[str, RealSizes] = MappingProxyType(
    {"real": RealSizes(), "real-unit-gain": replace(RealSizes(), common_gain=0.0)}
)
"""By name: realistic errors, and the same with a mean gain of all torques of one, which weight cannot show. Gains of
`real` are not normalised: their mean is the common gain times the mean of the joints' own.
"""


@dataclass(frozen=True, eq=False)
class DrawnVarying:
    """True values of what varies over a run, see `VaryingSizes`."""

    friction: DryFriction
    drift: Array  # (n,) [N·m], of the torque offsets from the beginning of the log to its end
    warming: float  # time constants of the drift in the log
    lowpass: float  # [Hz]
    held: dict[str, int]  # samples of the log for which "joints" and "imu" are held
    jitter: float  # [s]

    @classmethod
    def of(cls, robot: Robot, true: Robot, sizes: VaryingSizes, seed: int) -> DrawnVarying:
        """DrawnRobot by a generator of its own; `true` has the drawn Coulomb friction."""
        rng, joints = np.random.default_rng(np.random.SeedSequence(seed).spawn(5)[4]), robot.tree.joints
        ranges = [(max(robot.limits[j].lower, -np.pi), min(robot.limits[j].upper, np.pi)) for j in joints]
        variation = rng.uniform(-1.0, 1.0, (len(joints), sizes.knots))
        kind = kinds_of(robot)
        load = rng.uniform(*sizes.by_load, max(kind) + 1)
        friction = DryFriction(
            coulomb=np.array([true.dynamics[joint].coulomb for joint in joints]),
            low=np.array([low for low, _ in ranges]),
            high=np.array([high for _, high in ranges]),
            variation=sizes.by_position * variation / np.abs(variation).max(axis=1, keepdims=True),
            load=load[kind],
        )
        drift = sizes.drift * robot.effort_limits * rng.uniform(-1.0, 1.0, len(joints))
        lowpass, jitter = float(rng.uniform(*sizes.lowpass)), float(rng.uniform(0.0, sizes.jitter))
        held, which = rng.uniform() < sizes.held, str(rng.choice(["joints", "imu"]))
        samples = int(rng.choice(sizes.updates))
        return cls(friction, drift, sizes.warming, lowpass, {which: samples} if held else {}, jitter)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, joints in the tree's order."""
        return {
            "friction": {name: value.tolist() for name, value in vars(self.friction).items()},
            "drift": self.drift.tolist(),
            **{name: getattr(self, name) for name in ("lowpass", "held", "jitter")},
        }


@dataclass(frozen=True, eq=False)
class DrawnRobot:
    """True values of one run. Joint values are in the tree's order, (n,)."""

    robot: Robot  # the plant, with true links, feet, friction and rotors
    noise: float  # factor on the noise of `STANDARD`
    torque_gain: Array  # measured torque over the true one
    torque_offset: Array  # [N·m], added to it
    common_gain: float  # the mean of `torque_gain` over the joints
    encoder_zero: Array  # [rad], measured position minus the true one
    imu_rotation: Array  # (3,) rotation vector [rad]
    imu_place: Array  # (3,) [m], of the IMU relative to its nominal pose, both in the nominal IMU frame
    gyro_offset: Array  # (3,) constant error [rad/s]
    accelerometer_offset: Array  # (3,) [m/s²]
    orientation_offset: Array  # (3,) rotation vector [rad]
    delay: float  # [s], of the measured torques
    quantum: float | None  # [rad], of the encoders; None if positions are not quantised and velocities are measured
    differenced: float  # [s], interval for differencing quantised positions
    rate: float  # of the log [Hz]
    terrain: Terrain  # the ground
    lost: float  # share of samples
    spikes: float  # per second
    compliance: Array  # of the gears [rad/(N·m)]
    varying: DrawnVarying | None  # what varies over the run

    @property
    def friction(self) -> DryFriction | None:
        """Dry friction that varies; None if it does not."""
        return None if self.varying is None else self.varying.friction

    def to_dict(self) -> dict[str, Any]:
        """Plain values, SI units; joints by name, links with their true ten parameters."""
        joints, t = self.robot.tree.joints, self.terrain
        by_joint = ("torque_gain", "torque_offset", "encoder_zero", "compliance")
        rest = {
            name: value for name, value in vars(self).items() if name not in ("robot", "terrain", "varying", *by_joint)
        }
        return {
            **{name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in rest.items()},
            **{name: dict(zip(joints, vars(self)[name].tolist(), strict=True)) for name in by_joint},
            "joints": {joint: vars(self.robot.dynamics[joint]) for joint in joints},
            "links": {link: self.robot.inertias[link].vector.tolist() for link in self.robot.tree.links},
            "feet": {
                leg.name: {"position": list(leg.foot_position), "radius": leg.foot_radius} for leg in self.robot.legs
            },
            "ground": {name: getattr(t, name) for name in ("slope", "heading", "friction", "softness")}
            | {"roughness": t.stones.height if t.stones else 0.0},
            **({"varying": self.varying.to_dict()} if self.varying else {}),
        }


def drawn(robot: Robot, sizes: RealSizes, seed: int) -> DrawnRobot:
    """Draws the true robot, sensors and ground of a seed from the model file's robot; the same in every scenario."""
    body, sensors, ground = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3))
    n, limit = len(robot.tree.joints), robot.effort_limits
    noise = float(sensors.uniform(*sizes.noise))
    common = 1.0 + sizes.common_gain * float(sensors.standard_normal())
    gain = 1.0 + sizes.joint_gain * _heavy(sensors, n)
    gain *= common if sizes.common_gain else 1.0 / gain.mean()
    quantised = bool(sensors.uniform() < sizes.quantised)
    quantum = 2.0 * np.pi / 2.0 ** int(sensors.choice(sizes.bits))
    scaled, true = STANDARD.times(noise), _true_robot(robot, sizes, limit, body)
    return DrawnRobot(
        robot=true,
        noise=noise,
        torque_gain=gain,
        torque_offset=scaled.torque_constant * limit * sensors.standard_normal(n),
        common_gain=float(gain.mean()),
        encoder_zero=sizes.encoder_zero * _heavy(sensors, n),
        imu_rotation=sizes.imu_rotation / np.sqrt(3.0) * sensors.standard_normal(3),
        imu_place=sizes.imu_place / np.sqrt(3.0) * sensors.standard_normal(3),
        gyro_offset=scaled.gyro_constant * sensors.standard_normal(3),
        accelerometer_offset=scaled.accelerometer_constant * sensors.standard_normal(3),
        orientation_offset=scaled.orientation_constant * sensors.standard_normal(3),
        delay=float(sensors.uniform(*sizes.delay)),
        quantum=quantum if quantised else None,
        differenced=sizes.differenced,
        rate=float(sensors.choice(sizes.rates)),
        terrain=_ground(sizes, ground),
        lost=float(sensors.uniform(*sizes.lost)),
        spikes=float(sensors.uniform(*sizes.spikes)),
        varying=DrawnVarying.of(robot, true, sizes.varying, seed) if sizes.varying else None,
        compliance=_compliance(robot, sizes, seed),
    )


def _compliance(robot: Robot, sizes: RealSizes, seed: int) -> Array:
    """Compliance (n,) [rad/(N·m)], by a generator of its own: 1 / (I (2π f)²), or what `gives_way` allows."""
    n = len(robot.tree.joints)
    if sizes.elastic is None:
        return np.zeros(n)
    model = build_model(robot)
    data = mujoco.MjData(model)
    data.qpos[:] = standing_configuration(robot)
    inertia = np.diag(mass_matrix(model, data)).copy()
    inertia[[robot.tree.joints.index(j) for leg in robot.legs for j in leg.joints]] = robot.mass * robot.leg_length**2
    swinging = 2.0 * np.pi * np.random.default_rng(np.random.SeedSequence(seed).spawn(7)[6]).uniform(*sizes.elastic, n)
    return np.minimum(1.0 / (inertia * swinging**2), sizes.gives_way / robot.effort_limits)


def with_usual_drives(robot: Robot, sizes: RealSizes) -> Robot:
    """The robot that its controller knows: rotor inertia and friction as the middle of what is drawn.

    A manufacturer knows the motors. A controller without their inertia takes the torque that brakes a light leg for
    touch-down, and drives the foot into the ground with the stance's force: joints reach 25 rad/s, as no real robot's.
    """
    limit, middle = robot.effort_limits, {**robot.dynamics}
    for joint, most in zip(robot.tree.joints, limit.tolist(), strict=True):
        given = robot.dynamics[joint]
        middle[joint] = replace(
            given,
            armature=given.armature + 0.5 * sum(sizes.rotor) * sizes.rotor_per_limit * most,
            coulomb=given.coulomb + float(np.sqrt(sizes.coulomb[0] * sizes.coulomb[1])) * most,
            viscous=given.viscous + float(np.sqrt(sizes.viscous[0] * sizes.viscous[1])) * most,
        )
    return replace(robot, dynamics=middle)


def _true_robot(robot: Robot, sizes: RealSizes, limit: Array, rng: np.random.Generator) -> Robot:
    def moved(inertia: InertialParameters) -> InertialParameters:
        scale = 1.0 + sizes.link_mass * float(_heavy(rng, 1)[0])
        return InertialParameters(scale * inertia.vector).shifted(sizes.link_com * _heavy(rng, 3))

    def trodden(leg: Leg) -> Leg:
        radius = max(foot_radius(leg) + sizes.foot * float(rng.standard_normal()), LEAST_RADIUS)
        x, y, z = (np.asarray(leg.foot_position) + sizes.foot * rng.standard_normal(3)).tolist()
        return replace(leg, foot_position=(x, y, z), foot_radius=radius)

    inertias = {**robot.inertias, **{link: moved(robot.inertias[link]) for link in robot.tree.links}}
    legs = tuple(trodden(leg) for leg in robot.legs)
    return replace(robot, inertias=inertias, legs=legs, dynamics=_joints(robot, sizes, limit, rng))


def _joints(robot: Robot, sizes: RealSizes, limit: Array, rng: np.random.Generator) -> dict[str, JointDynamics]:
    """Friction and rotors added to the model file's; joints of a kind (HAA, HFE, KFE) are similar."""
    kinds = kinds_of(robot)
    coulomb, viscous = (_log_uniform(size, rng, max(kinds) + 1) for size in (sizes.coulomb, sizes.viscous))
    rotor = rng.uniform(*sizes.rotor, max(kinds) + 1)
    result = {}
    for joint, k, most in zip(robot.tree.joints, kinds, limit.tolist(), strict=True):
        given = robot.dynamics[joint]
        differ = 1.0 + sizes.alike * rng.uniform(-1.0, 1.0, 2)
        result[joint] = replace(
            given,
            armature=given.armature + float(rotor[k]) * sizes.rotor_per_limit * most,
            coulomb=given.coulomb + float(np.clip(coulomb[k] * differ[0], *sizes.coulomb)) * most,
            viscous=given.viscous + float(viscous[k] * differ[1]) * most,
        )
    return result


def _heavy(rng: np.random.Generator, n: int) -> Array:
    """Draws (n,) of unit variance with heavy tails: Student's t with four degrees of freedom, over √2, at most 5. Most
    joints of a robot are good and a few are not; estimators that assume Gaussian errors are not drawn from their own
    assumption.
    """
    return np.asarray(np.clip(rng.standard_t(4.0, n) / np.sqrt(2.0), -5.0, 5.0))


def _log_uniform(limits: Range, rng: np.random.Generator, count: int) -> Array:
    low, high = limits
    return low * (high / low) ** rng.uniform(size=count)


def _ground(sizes: RealSizes, rng: np.random.Generator) -> Terrain:
    kind = rng.uniform()
    softness, roughness = rng.uniform(*sizes.softness), rng.uniform(*sizes.roughness)
    slope, heading, friction = rng.uniform(0.0, sizes.slope), rng.uniform(-np.pi, np.pi), rng.uniform(*sizes.friction)
    stones_seed = int(rng.integers(2**31))
    soft, rough = kind < sizes.soft, sizes.soft <= kind < sizes.soft + sizes.rough
    return Terrain(
        slope=float(slope),
        heading=float(heading),
        friction=float(friction),
        stones=Stones(seed=stones_seed, height=float(roughness)) if rough else None,
        softness=float(softness) if soft else 0.0,
    )
