"""From samples as they come to blocks of rows: order of the joints, gaps, spikes, the ground's normal, and refusals."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stadera.errors import RecordingError, UnknownNameError
from stadera.robot.imu import ImuMount
from stadera.robot.limbs import Place
from stadera.robot.model import Robot
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.ground import GroundNormal
from stadera.trunk.measurement import Measurement
from stadera.trunk.rows import BlockRows, RowMaker
from stadera.trunk.samples import SampleBuffer, Samples
from stadera.trunk.settings import TrunkSettings
from stadera.trunk.spikes import SpikeFilter
from stadera.types import Array


class Made(NamedTuple):
    """Result of one block.

    Attributes:
        rows: of the window that it completes; None for the first block of a stretch, and for one that was refused.
        refusal: why it, or samples before it, were refused, one sentence; else empty.
        struck: True if its rows are left out because of an impact; legs in the air count nonetheless.
    """

    rows: BlockRows | None = None
    refusal: str = ""
    struck: bool = False


class Front:
    """Converts samples into rows, block by block.

    Args:
        robot: the model.
        mount: of the IMU; samples are in trunk axes, those of `measured` in the IMU's.
        settings: of blocks, gaps, swinging legs, impacts and stops.
        joints: names in the order of the arrays of `measured`; None for the robot's own.
        places: where a load may be, besides the trunk.

    Attributes:
        mount: of the IMU.
        gaps: the last hundred gaps between samples: end time and duration of each [s].
        seen, impacts: time of the rows that were used, and of those left out for impacts [s].
        shape: parameters of the trunk at which errors of the IMU are linearised.

    Raises:
        UnknownNameError: a joint of the robot is not among the given ones.
    """

    def __init__(
        self,
        robot: Robot,
        mount: ImuMount,
        settings: TrunkSettings,
        joints: Sequence[str] | None = None,
        places: tuple[Place, ...] = (),
    ) -> None:
        self._robot, self.mount, self._settings = robot, mount, settings
        self._names = tuple(joints) if joints is not None else robot.tree.joints
        for joint in robot.tree.joints:
            if joint not in self._names:
                raise UnknownNameError("joint", joint, list(self._names), "the arrays given to update")
        self._order = np.array([self._names.index(joint) for joint in robot.tree.joints])
        extra = robot.extra.joints if robot.extra is not None else ()
        self._extra_order = {at: self._names.index(joint) for at, joint in enumerate(extra) if joint in self._names}
        limits = [robot.limits[joint] for joint in robot.tree.joints]
        self._stops = np.array([[limit.lower, limit.upper] for limit in limits])
        self.shape = robot.inertias[robot.trunk]
        self._maker, self._sampling = (
            RowMaker(robot, mount, settings.swing, places),
            ErrorLayout.of(robot).places["sampling"],
        )
        self._buffer = SampleBuffer(robot.tree.joints, settings)
        self._ground, self._spikes = GroundNormal(self._maker.weight), SpikeFilter()
        self.gaps: deque[tuple[float, float]] = deque(maxlen=100)
        self.seen = self.impacts = 0.0

    @property
    def torque_noise(self) -> Array:
        """Standard deviation of the torques' white noise, (joints,) [N·m]."""
        return self._maker.noise.torque

    @property
    def spikes(self) -> int:
        """Number of samples of which single wild values were replaced."""
        return self._spikes.replaced

    def know_joints(self, mean: Array, std: Array) -> None:
        """Takes rotor inertia, viscous and Coulomb friction of the legs' joints (3, joints), and their standard
        deviations, for what a swinging leg seems to carry.
        """
        self._maker.lifted.known, self._maker.lifted.known_std = mean, std

    def restart(self) -> None:
        """Announces that the next samples do not continue the previous ones; their rate may differ."""
        self._buffer = SampleBuffer(self._robot.tree.joints, self._settings)
        self._forget()

    def interrupt(self) -> None:
        """Announces that the next samples do not follow the previous ones."""
        self._maker.restart()

    def measured(
        self,
        t: float,
        q: ArrayLike | None,
        dq: ArrayLike | None,
        tau: ArrayLike | None,
        gyro: ArrayLike | None,
        accel: ArrayLike | None,
    ) -> Measurement:
        """A measurement from arrays in the given joints' order and the IMU's axes; raises RecordingError."""
        joints, values = len(self._names), {}
        channels = {"q": (q, joints), "dq": (dq, joints), "tau": (tau, joints), "gyro": (gyro, 3), "accel": (accel, 3)}
        for name, (value, size) in channels.items():
            array = np.asarray(value, dtype=float) if value is not None else np.empty(0)
            if array.shape != (size,):
                raise RecordingError(f"update needs {name} of shape ({size},), got {array.shape}")
            values[name] = array
        turn, extra = self.mount.in_trunk_axes, np.empty(0)
        if self._robot.extra is not None and self._extra_order:
            count = len(self._robot.extra.joints)
            extra = np.append(self._robot.extra.reference, np.zeros(2 * count))
            for at, k in self._extra_order.items():
                extra[[at, count + at, 2 * count + at]] = values["q"][k], values["dq"][k], values["tau"][k]
        position, velocity, effort = (values[name][self._order] for name in ("q", "dq", "tau"))
        omega, force = turn(values["gyro"]), turn(values["accel"])
        return Measurement(t, position, velocity, effort, omega, force, lever=self.mount.translation, extra=extra)

    def gather(self, measurement: Measurement) -> Array | None:
        """Stores a measurement; the table of all stored ones, for `take`, once a block is full."""
        return self._buffer.gather(measurement)

    def take(self, table: Array) -> Iterator[Made]:
        """The blocks that these samples complete, see `Samples.table`, one by one."""
        for stretch in self._buffer.take(table):
            if stretch.reason:
                yield Made(refusal=stretch.reason)
            if stretch.gap:
                self.interrupt()
                self.gaps.append((stretch.begin, stretch.gap))
                if stretch.gap > self._settings.lost_ground:
                    self._forget()
            for block in stretch.blocks:
                yield self.block(block)

    def block(self, table: Array) -> Made:
        """Processes one block, (n + 2, ...), with one sample more before and after it."""
        samples = self._spikes.clean(Samples.of_table(table, len(self._robot.tree.joints)))
        inside = slice(1, -1)
        duration = float(samples.time[-1] - samples.time[1])
        force, omega = samples.specific_force[inside], samples.angular_velocity[inside]
        if not force.any(axis=1).all():
            self._maker.restart()
            return Made(refusal="the accelerometer reads zero")
        normal = self._ground.ahead(force.mean(axis=0), omega.mean(axis=0), duration)
        made = self._maker.block(samples, normal, self.shape, self._spikes.squares)
        if made.singular is not None:
            leg = self._robot.legs[made.singular].name
            return Made(refusal=f"leg {leg} is so stretched that its foot's force is not felt")
        self._ground.learn(made.feet, made.force, duration)
        if made.rows is None:
            return Made()
        if stop := self._at_a_stop(table):
            return Made(refusal=stop)
        return self._counted(made.rows)

    def _forget(self) -> None:
        """Discards the ground's normal and the history of the motion."""
        self._maker.forget()
        self._ground = GroundNormal(self._maker.weight)

    def _at_a_stop(self, table: Array) -> str:
        """Refuses a block in which a joint is at its mechanical stop, whose torque no sensor shows."""
        away = np.abs(table[:, 1 : 1 + len(self._stops), None] - self._stops).min(axis=(0, 2))
        at = int(np.argmin(away))
        if away[at] >= self._settings.stop:
            return ""
        return f"joint {self._robot.tree.joints[at]!r} is at its mechanical stop, which carries a torque unseen"

    def _counted(self, rows: BlockRows) -> Made:
        """Leaves out a block for its impacts; if most of the time is, that is a reason to refuse."""
        if np.abs(rows.columns[:3, 11 + self._sampling.start]).max() <= self._settings.impact * self._maker.weight:
            self.seen += rows.elapsed
            return Made(rows)
        self.impacts += rows.elapsed
        unresolved = "the log's rate does not resolve the impacts that its accelerometer shows"
        return Made(rows, unresolved if self.impacts > self.seen else "", struck=True)
