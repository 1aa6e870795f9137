"""What a motion of the trunk is expected to tell of a payload: the error bars of `TrunkEstimator` on a made log.

The log is that of the robot as it may be: its errors are drawn from the estimator's own prior (`ModelErrors`), its
sensors have the noise of `SensorNoise`. The robot does the motion without a load, is tared, and does it again with one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.errors import require_positive
from stadera.excite.sinusoids import Sinusoids
from stadera.excite.trunk.planted import Planted
from stadera.inertia import InertialParameters
from stadera.robot.model import JointDynamics, Robot
from stadera.trunk import Samples, TrunkEstimator
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.settings import ModelErrors
from stadera.types import Array

_REST = 0.5  # s between the two motions


@dataclass(frozen=True)
class SensorNoise:
    """White noise of a sample, standard deviations: those of the paper's test-bed.

    Attributes:
        position, velocity: [rad, rad/s]. effort: share of the joint's limit [1].
        gyro, accelerometer: [rad/s, m/s²].
    """

    position: float = 2e-4
    velocity: float = 0.02
    effort: float = 0.0033
    gyro: float = 0.003
    accelerometer: float = 0.05

    def __post_init__(self) -> None:
        require_positive("noise", self, tuple(vars(self)))


@dataclass(frozen=True)
class Bars:
    """Standard deviations of a payload.

    Attributes:
        mass: without the torques' common scale [kg]. scale: of that scale, share of the mass [1].
        com: (3,) of its centre in trunk axes [m], NaN where it is not observed.
    """

    mass: float
    scale: float
    com: tuple[float, float, float]

    def score(self, unobserved: float) -> float:
        """Sum of the logarithms of the four, with `unobserved` [m] for a component that is not: less is better."""
        return float(np.log([self.mass, *np.nan_to_num(self.com, nan=unobserved)]).sum())

    @classmethod
    def median(cls, bars: Sequence[Bars]) -> Bars:
        """The median of each."""
        mass, scale, *com = np.median([[b.mass, b.scale, *b.com] for b in bars], axis=0).tolist()
        return cls(mass, scale, (com[0], com[1], com[2]))


class Drawn:
    """A robot as it may be, with errors drawn from the estimator's prior.

    Args:
        robot: the model that the estimator has.
        rng: of the draw.
        noise: of the sensors.

    Attributes:
        true: the robot itself.
    """

    def __init__(self, robot: Robot, rng: np.random.Generator, noise: SensorNoise | None = None) -> None:
        model = ErrorModel(robot, ModelErrors(), robot.leg_length)
        drawn = rng.multivariate_normal(np.zeros(model.layout.count), model.covariance, method="eigh")
        self._p = {name: drawn[place] for name, place in model.layout.places.items()}
        self._model, self._noise, self._limit = robot, noise or SensorNoise(), model.limit
        self._seed = int(rng.integers(2**32))
        self._order = [robot.tree.joints.index(joint) for leg in robot.legs for joint in leg.joints]
        self.true = self._robot()

    def _robot(self) -> Robot:
        robot, p = self._model, self._p
        own = np.abs([p[name] for name in ("rotor", "viscous", "coulomb")])
        dynamics, bodies, legs = {}, {}, []
        for k, at in enumerate(self._order):
            joint = robot.tree.joints[at]
            rotor, viscous, coulomb, offset = (getattr(robot.dynamics[joint], n) for n in _TERMS)
            dynamics[joint] = JointDynamics(
                rotor + own[0, k], viscous + own[1, k], coulomb + own[2, k], offset + p["offset"][k]
            )
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
        p, noise, motion = self._p, self._noise, planted.motion
        rng, order = np.random.default_rng(self._seed), self._order
        trunk = self.true.inertias[self.true.trunk]
        effort, _ = planted.torques(trunk if payload is None else trunk + payload)
        late, scale, zero = np.empty_like(effort), np.empty(len(order)), np.empty(len(order))
        scale[order] = 1.0 + p["gain"] + p["common_gain"]
        zero[order] = p["encoder"]
        for j in range(len(order)):
            late[:, j] = np.interp(planted.time - abs(float(p["torque_lag"][0])), planted.time, effort[:, j])
        limit = np.empty(len(order))
        limit[order] = self._limit
        w, turned = motion.angular_velocity, Rotation.from_rotvec(p["imu_rotation"]).as_matrix().T
        lever = np.broadcast_to(p["imu_lever"], w.shape)
        force = motion.specific_force + np.cross(motion.angular_acceleration, lever) + np.cross(w, np.cross(w, lever))

        def noisy(values: Array, size: float | Array) -> Array:
            return np.asarray(values + size * rng.standard_normal(values.shape))

        return Samples(
            planted.time,
            noisy(motion.position + zero, noise.position),
            noisy(motion.velocity, noise.velocity),
            noisy(late * scale, noise.effort * limit),
            noisy(w @ turned, noise.gyro),
            noisy(force @ turned + p["accelerometer"], noise.accelerometer),
        )


_TERMS = ("armature", "viscous", "coulomb", "offset")


def expected_bars(robot: Robot, path: Sinusoids, payload: InertialParameters, drawn: Drawn, rate: float) -> Bars | None:
    """The payload's error bars from a motion without and a motion with it; None if the estimator has none.

    Raises:
        IdentificationError: a foot cannot stay where it is.
    """
    planted = Planted.of(drawn.true, path, rate)
    bare, loaded = drawn.measured(planted), drawn.measured(planted, payload)
    again = replace(loaded, time=loaded.time + bare.time[-1] + _REST)
    estimator = TrunkEstimator(robot)
    estimator.add(bare)
    estimator.tare()
    estimator.add(again)
    found = estimator.payload
    if found is None or found.mass_std_without_scale is None:
        return None
    x, y, z = found.com_std.tolist()
    return Bars(found.mass_std_without_scale, found.scale or 0.0, (x, y, z))
