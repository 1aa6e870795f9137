"""From blocks of samples to rows: spikes, the ground's normal, and `RowMaker`."""

from __future__ import annotations

from typing import NamedTuple

from stadera.inertia import InertialParameters
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trunk.ground import GroundNormal
from stadera.trunk.rows import BlockRows, RowMaker
from stadera.trunk.samples import Samples
from stadera.trunk.settings import SwingDetection
from stadera.trunk.spikes import SpikeFilter
from stadera.types import Array

BLIND = -1
"""Refusal of a block in which the accelerometer reads zero; other numbers are near-singular legs."""


class Made(NamedTuple):
    """Result of one block.

    Attributes:
        rows: of the window that it completes; None for the first block of a stretch, and for one that was refused.
        refused: index of a leg so near-singular that its foot's force is not determined, or `BLIND`; None for neither.
    """

    rows: BlockRows | None
    refused: int | None = None


class Front:
    """Converts blocks of samples into rows.

    Args:
        robot: the model.
        mount: of the IMU; the samples are in trunk axes.
        swing: criteria for a swinging leg.
    """

    def __init__(self, robot: Robot, mount: ImuMount, swing: SwingDetection) -> None:
        self._maker, self._joints = RowMaker(robot, mount, swing), len(robot.tree.joints)
        self._ground, self._spikes = GroundNormal(self._maker.weight), SpikeFilter()

    @property
    def torque_noise(self) -> Array:
        """Standard deviation of the torques' white noise, (joints,) [N·m]."""
        return self._maker.noise.torque

    @property
    def spikes(self) -> int:
        """Number of samples of which single wild values were replaced."""
        return self._spikes.replaced

    def interrupt(self) -> None:
        """Announces that the next samples do not continue the previous ones."""
        self._maker.restart()

    def forget(self) -> None:
        """Also discards the ground's normal and the history of the motion."""
        self._maker.forget()
        self._ground = GroundNormal(self._maker.weight)

    def know_joints(self, mean: Array, std: Array) -> None:
        """Takes rotor inertia, viscous and Coulomb friction of the legs' joints (3, joints), and their standard
        deviations, for what a swinging leg seems to carry.
        """
        self._maker.lifted.known, self._maker.lifted.known_std = mean, std

    def block(self, table: Array, trunk: InertialParameters) -> Made:
        """Processes one block.

        Args:
            table: (n + 2, ...), `Samples.table` of the block, with one sample more before and after it.
            trunk: parameters at which errors of the IMU are linearised.
        """
        samples = self._spikes.clean(Samples.of_table(table, self._joints))
        inside = slice(1, -1)
        duration = float(samples.time[-1] - samples.time[1])
        force, omega = samples.specific_force[inside], samples.angular_velocity[inside]
        if not force.any(axis=1).all():
            self._maker.restart()
            return Made(None, BLIND)
        normal = self._ground.ahead(force.mean(axis=0), omega.mean(axis=0), duration)
        made = self._maker.block(samples, normal, trunk, self._spikes.squares)
        if made.singular is None:
            self._ground.learn(made.feet, made.force, duration)
        return Made(made.rows, made.singular)
