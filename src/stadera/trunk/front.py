"""From samples as they come to blocks of rows: order of the joints, gaps, spikes, the ground's normal, and refusals."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stadera.body import Motion
from stadera.errors import RecordingError
from stadera.inertia import skews
from stadera.robot.imu import ImuMount
from stadera.robot.limbs import Place
from stadera.robot.model import Robot
from stadera.robot.stance import lying
from stadera.trunk.block_rows import BlockRows
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.ground import GroundNormal, turned
from stadera.trunk.measurement import Measurement
from stadera.trunk.noise import AtRest
from stadera.trunk.rows import RowMaker
from stadera.trunk.samples import SampleBuffer, Samples, Stretch
from stadera.trunk.settings import TrunkSettings
from stadera.trunk.spikes import SpikeFilter
from stadera.trunk.window import Window, window_of
from stadera.types import Array, Bools

LIES = "the robot lies on its trunk, which carries what no leg feels"
"""Why blocks are left out that are no sign of a fault."""


class Made(NamedTuple):
    """Result of one block.

    Attributes:
        rows: of the window that it completes; None for the first block of a stretch, and for one that was refused.
        refusal: why it, or samples before it, were refused, one sentence; else empty.
        due: time of the sample that completed it [s].
        struck: True if its rows are left out because of an impact; legs in the air count nonetheless.
    """

    rows: BlockRows | None = None
    refusal: str = ""
    struck: bool = False
    due: float = -inf


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
        seen, impacts: time of the rows that were used, and of those left out for impacts [s].
        shape: parameters of the trunk at which errors of the IMU are linearised.
        ahead: most blocks that may be computed before these parameters and `know_joints` change.

    Raises:
        RecordingError: a joint is given twice, or one of the robot's legs is not.
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
        extra = robot.extra.joints if robot.extra is not None else ()
        if twice := [joint for joint, count in Counter(self._names).items() if count > 1]:
            raise RecordingError(f"the arrays given to update have joint {twice[0]!r} twice")
        if lacking := [joint for joint in robot.tree.joints if joint not in self._names]:
            others = ", ".join(name for name in self._names if name not in (*robot.tree.joints, *extra))
            unknown = f"; joints that {robot.name} has not are {others}" if others else ""
            raise RecordingError(f"the arrays given to update lack joint {lacking[0]!r}{unknown}")
        self._order = np.array([self._names.index(joint) for joint in robot.tree.joints])
        self._extra_order = {at: self._names.index(joint) for at, joint in enumerate(extra) if joint in self._names}
        self._stops = robot.stops
        self.shape = robot.inertias[robot.trunk]
        self._maker = RowMaker(robot, mount, settings.swing, places)
        self._sampling = ErrorLayout.of(robot).places["sampling"]
        self._buffer, self._waiting = SampleBuffer(robot.tree.joints, settings), deque[Stretch]()
        self._ground, self._spikes = GroundNormal(self._maker.weight), SpikeFilter()
        self.seen = self.impacts = 0.0
        self.ahead = 1

    @property
    def spikes(self) -> int:
        """Number of samples of which single wild values were replaced."""
        return self._spikes.replaced

    @property
    def at_rest(self) -> AtRest:
        """Specific force while the robot rests."""
        return self._maker.at_rest

    def know_joints(self, mean: Array, std: Array) -> None:
        """Takes rotor inertia, viscous and Coulomb friction of the legs' joints (3, joints), and their standard
        deviations, for what a swinging leg seems to carry.
        """
        self._maker.lifted.known, self._maker.lifted.known_std = mean, std

    def restart(self) -> None:
        """Announces that the next samples do not continue the previous ones; their rate may differ."""
        self._buffer = SampleBuffer(self._robot.tree.joints, self._settings)
        self._waiting.clear()
        self._forget()

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
        if (time := _numbers("t", t)).shape:
            raise RecordingError(f"update needs t as one number [s], got an array of shape {time.shape}")
        joints, values = len(self._names), {}
        channels = {"q": (q, joints), "dq": (dq, joints), "tau": (tau, joints), "gyro": (gyro, 3), "accel": (accel, 3)}
        for name, (value, size) in channels.items():
            array = _numbers(name, value) if value is not None else np.empty(0)
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
        imu, lever = (turn(values["gyro"]), turn(values["accel"])), self.mount.translation
        return Measurement(float(time), position, velocity, effort, *imu, lever=lever, extra=extra)

    def gather(self, measurement: Measurement) -> Array | None:
        """Stores a measurement; the table of all stored ones, for `take`, once a block is full."""
        return self._buffer.gather(measurement)

    def take(self, table: Array) -> None:
        """Takes in samples, see `Samples.table`; the blocks that they complete are then `made`."""
        self._waiting.extend(self._buffer.take(table))

    def made(self) -> Iterator[Made]:
        """The blocks that samples have completed, one by one; `ahead` at a time are computed."""
        while self._waiting:
            stretch = self._waiting.popleft()
            if stretch.reason:
                yield Made(refusal=stretch.reason, due=stretch.begin)
            if stretch.gap:
                self._maker.restart()
                if stretch.gap > self._settings.lost_ground:
                    self._forget()
            edges, begin = stretch.edges, 0
            while begin < len(edges) - 1:
                some = edges[begin : begin + self.ahead + 1]
                made = self.blocks(stretch.table[some[0] : some[-1] + 2], tuple(b - a for a, b in pairwise(some)))
                for each, end in zip(made, edges[begin + 1 :], strict=False):
                    yield self._counted(each)._replace(due=float(stretch.table[end + 1, 0]))
                begin += len(made)

    def blocks(self, table: Array, sizes: tuple[int, ...]) -> list[Made]:
        """Processes successive blocks, at least one, of so many samples, with one sample more before and after them."""
        joints, legs = len(self._stops), self._robot.legs
        clean, sizes, squares = self._spikes.clean(table, sizes, joints)
        window, samples, imu = window_of(sizes), Samples.of_table(clean, joints), clean[1:-1, 1 + 3 * joints :]
        first, last = window.edges[:-1], window.edges[1:] - 1
        used = np.logical_and.reduceat(imu[:, 3:6].any(axis=1), first)
        duration = samples.time[last + 2] - samples.time[first + 1]
        mean = window.sums(window.mean, imu[:, :6])[:, 0]
        omega, force = mean[:, :3], mean[:, 3:]
        along = force / np.maximum(np.sqrt((force * force).sum(axis=1, keepdims=True)), 1e-300)
        turn, motion = turned(omega, duration), self._maker.motion(samples)
        up = self._ground.follow(along, turn, duration, used)
        at_end = Motion._make((*(values[last] for values in motion[:6]), up))
        feet = self._maker.feet(at_end, samples.effort[last + 1])
        normal = self._ground.normals(up, turn, duration, used, *feet)
        back = skews(0.5 * duration[:, None] * omega)  # from the block's end to its middle
        normal += (back @ normal[:, :, None])[:, :, 0]
        motion = motion._replace(normal=normal[window.block])
        stops = self._stopped(table[: window.edges[-1] + 2, 1 : 1 + joints], window)
        on_trunk = self._on_trunk(up, *feet)
        rows, singular = self._maker.blocks(samples, sizes, motion, self.shape, squares, used)
        made = []
        for own, leg, there, stop, lies in zip(rows, singular, used, stops, on_trunk, strict=True):
            if not there:
                made.append(Made(refusal="the accelerometer reads zero"))
            elif lies:
                made.append(Made(refusal=LIES))
            elif leg is not None:
                made.append(Made(refusal=f"leg {legs[leg].name} is so stretched that its foot's force is not felt"))
            else:
                made.append(Made() if own is None else Made(refusal=stop) if stop else Made(own, "", self._struck(own)))
        return made

    def _on_trunk(self, up: Array, feet: Array, force: Array) -> Bools:
        """Blocks (B,) in which the trunk is as low as the feet (B, legs, 3), and these carry too little of it [N]."""
        carried = np.einsum("bli,bi->b", force, up)
        return np.asarray(lying(self._robot, feet, up) & (carried < self._settings.lies * self._maker.weight))

    def _struck(self, rows: BlockRows) -> bool:
        """Whether a block is left out for its impacts."""
        unresolved = np.abs(rows.columns[:3, 11 + self._sampling.start]).max()
        return bool(unresolved > self._settings.impact * self._maker.weight)

    def _forget(self) -> None:
        """Discards the ground's normal and the history of the motion."""
        self._maker.forget()
        self._ground = GroundNormal(self._maker.weight)

    def _stopped(self, position: Array, window: Window) -> list[str]:
        """For each block, the refusal of one in which a joint is at its mechanical stop, whose torque no sensor shows;
        else empty.
        """
        stop = self._settings.stop
        lower, upper = position.min(axis=0) - self._stops[:, 0], self._stops[:, 1] - position.max(axis=0)
        if min(lower.min(), upper.min()) >= stop:
            return [""] * (len(window.edges) - 1)
        near = np.abs(position[:, :, None] - self._stops).min(axis=2)
        inside = np.minimum.reduceat(near[1:-1], window.edges[:-1], axis=0)
        away = np.minimum(inside, np.minimum(near[window.edges[:-1]], near[window.edges[1:] + 1]))
        names = [self._robot.tree.joints[at] for at in away.argmin(axis=1)]
        return [
            f"joint {name!r} is at its mechanical stop, which carries a torque unseen" if least else ""
            for name, least in zip(names, away.min(axis=1) < stop, strict=True)
        ]

    def _counted(self, made: Made) -> Made:
        """Counts a block's time; if most of it is left out for impacts, that is a reason to refuse."""
        if made.rows is not None and made.struck:
            self.impacts += made.rows.elapsed
            if self.impacts > self.seen:
                unresolved = "the log's rate does not resolve the impacts that its accelerometer shows"
                return made._replace(refusal=unresolved)
        elif made.rows is not None:
            self.seen += made.rows.elapsed
        return made


def _numbers(name: str, value: ArrayLike) -> Array:
    """A value given to `update` as an array. RecordingError: it is no number, or its parts differ in length."""
    try:
        array = np.asarray(value)
        if array.dtype.kind in "fiubO":
            return array.astype(float, copy=False)
    except (TypeError, ValueError):
        pass
    raise RecordingError(f"update needs {name} in numbers{' [s]' * (name == 't')}, got {value!r:.60}")
