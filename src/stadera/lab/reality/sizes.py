"""Sizes of the `real` errors: the distributions from which a run draws its robot, sensors and ground."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

Range = tuple[float, float]


@dataclass(frozen=True)
class RealSizes:
    """Sizes of the `real` errors. A pair is a range to draw from; a single number is a standard deviation.

    Three rules scale with the robot and are assumptions:

    - Rotor inertia seen at the joint is proportional to the joint's effort limit, 3e-4 kg·m² per N·m: 0.010 for A1
      (33.5 N·m), 0.007 to 0.014 for Go2, whose real calf was identified at the order of 0.01, and 0.045 for HyQ.
    - Viscous friction is 0.1 to 1 % of the effort limit at 1 rad/s.
    - A joint's encoder has 13 to 16 bits per turn, and its drive differences positions over 5 ms.

    Attributes:
        noise: factor on the noise of `standard`, uniform.
        joint_gain, common_gain: of the measured torques, relative; of each joint, and of all together.
        coulomb: of each kind of joint, as a share of its effort limit, log-uniform.
        viscous: likewise, at 1 rad/s.
        rotor: of each kind of joint, relative to its class of robots, uniform.
        rotor_per_limit: rotor inertia of the class [kg·m² per N·m of the effort limit].
        alike: relative difference in friction between joints of a kind; rotors are alike.
        encoder_zero: [rad].
        imu_rotation: [rad], of the whole rotation vector; imu_place: [m], of the whole displacement.
        foot: [m], of the radius and of each component of the contact point.
        link_mass: relative; link_com: [m], of each component. Of all links, the trunk's too.
        delay: of the measured torques [s], uniform.
        quantised: share of runs with quantised encoders and differenced velocities.
        bits: of the encoder, over a turn of the joint.
        differenced: [s], time over which positions are differenced.
        rates: of the log [Hz].
        soft, rough: shares of runs on soft and on rough ground; the others are on hard, even ground.
        softness: time constant of soft ground [s], uniform. At 0.03 s feet sink by 1 mm standing, 2.5 mm trotting;
            from 0.04 s on some robots fall in a trot.
        roughness: ± heights of rough ground [m], uniform.
        slope: [rad], the largest; its heading is random.
        friction: coefficient of the ground, uniform; the controllers assume 0.6, so feet sometimes slip.
        lost: share of samples lost, uniform.
        spikes: outliers per second, uniform.
    """

    noise: Range = (0.5, 3.0)
    joint_gain: float = 0.03
    common_gain: float = 0.03
    coulomb: Range = (0.003, 0.03)
    viscous: Range = (0.001, 0.01)
    rotor: Range = (0.3, 1.5)
    rotor_per_limit: float = 3e-4
    alike: float = 0.2
    encoder_zero: float = float(np.deg2rad(0.4))
    imu_rotation: float = float(np.deg2rad(1.0))
    imu_place: float = 0.015
    foot: float = 0.005
    link_mass: float = 0.05
    link_com: float = 0.005
    delay: Range = (0.0, 0.010)
    quantised: float = 1.0 / 3.0
    bits: tuple[int, ...] = (13, 14, 15, 16)
    differenced: float = 0.005
    rates: tuple[float, ...] = (200.0, 500.0, 1000.0)
    soft: float = 1.0 / 3.0
    rough: float = 1.0 / 3.0
    softness: Range = (0.005, 0.03)
    roughness: Range = (0.0, 0.01)
    slope: float = float(np.deg2rad(5.0))
    friction: Range = (0.45, 0.9)
    lost: Range = (0.0, 0.005)
    spikes: Range = (0.0, 0.5)


REAL_SETS: Mapping[str, RealSizes] = MappingProxyType(
    {"real": RealSizes(), "real-unit-gain": replace(RealSizes(), common_gain=0.0)}
)
"""By name: realistic errors, and the same with a mean gain of all torques of one, which weight cannot show."""
