"""Estimator of the trunk for a robot that stands still: rows as in motion, of samples at rest alone.

It is for logs that tell nothing in motion: slower than that, or without an IMU. What counts as rest see
`stadera.trunk.standing.detection`; all else, changes of the load and the tare included, is `TrunkEstimator`'s.

Without an IMU the vertical is the direction of the feet's forces (`stadera.trunk.standing.forces`), so that each block
has its own tilt, whose two columns are those of a turned IMU. Rows in their unit are projected onto the complement of
these columns, which leaves four of six, in which torque offsets include their effect on the vertical.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from stadera.constants import GRAVITY
from stadera.inertia import skew
from stadera.robot.imu import ImuMount
from stadera.robot.load import load_robot
from stadera.robot.model import Robot
from stadera.trunk.block_rows import BlockRows, unit_of_rows
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.front import Made
from stadera.trunk.load import plain
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.trunk.samples import Samples
from stadera.trunk.settings import TrunkSettings
from stadera.trunk.standing.detection import StaticDetector
from stadera.trunk.standing.forces import ContactForceEstimator
from stadera.types import Array, Bools


def level_axes(up: Array) -> Array:
    """Rotation (3, 3) from trunk axes to level ones, x where the trunk's points; `up` (3,) is the vertical, a unit
    vector in trunk axes.
    """
    ahead = np.array([1.0, 0.0, 0.0]) - up[0] * up
    ahead /= max(float(np.linalg.norm(ahead)), 1e-9)
    return np.array([ahead, np.cross(up, ahead), up])


@dataclass(frozen=True, eq=False)
class Stance:
    """Pose of the robot on its feet; each leg as it is on average while its foot is on the ground.

    Attributes:
        to_level: (3, 3), from trunk axes to level ones.
        position: (joints,) [rad], in the order of the robot's tree.
    """

    to_level: Array
    position: Array


@dataclass(frozen=True, eq=False)
class Balance(Stance):
    """Balance of a robot at rest.

    Attributes:
        feet: (legs, 3) [m], contacts, trunk frame. stance: (legs,) bool. force: (legs,) [N], vertical.
        pressure: (2,) [m], centre of pressure, in the level plane through the trunk's origin, x where the trunk's x
            points. robot_com: (2,) [m], estimated centre of mass of the whole robot there; NaN where not observed.
    """

    feet: Array
    stance: Bools
    force: Array
    pressure: Array
    robot_com: Array


@dataclass(frozen=True, eq=False)
class Vertical:
    """Unit vector upwards (3,) in trunk axes at the end of the log, and the standard deviations of its components,
    constant errors included; from the "imu", or the "forces" of the feet without one.
    """

    source: Literal["imu", "forces"]
    up: Array
    std: Array

    @property
    def tilt_std(self) -> float:
        """Standard deviation of the tilt, the root mean square of both directions [rad]."""
        return float(np.linalg.norm(self.std) / np.sqrt(2.0))

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        up = {"value": plain(self.up), "std": plain(self.std)}
        return {"source": self.source, "up": up, "tilt_std": self.tilt_std}


class StandingEstimator(TrunkEstimator):
    """`TrunkEstimator` of the samples at rest; the others are refused with a reason.

    Args:
        robot, start, settings, mount: as of `TrunkEstimator`. Measurements without an IMU say so
            (`Measurement.vertical_by_forces`). Loads are taken to be on the trunk.
    """

    def __init__(
        self,
        robot: Robot | str,
        start: TrunkModel | None = None,
        settings: TrunkSettings | None = None,
        mount: ImuMount | None = None,
    ) -> None:
        model = robot if isinstance(robot, Robot) else load_robot(robot)
        super().__init__(model, start=start, settings=settings, mount=mount, at=model.trunk)
        self._gate, self._forces = StaticDetector(self.robot), ContactForceEstimator(self.robot)
        self._unit = unit_of_rows(self.robot)[:, None]
        self._at_rest: Measurement | None = None
        self._block: BlockRows | None = None

    def _take(self, measurement: Measurement) -> None:
        gate = self._gate
        if reason := gate.unusable(measurement) or gate.complaint(measurement, self._forces.at(measurement)):
            self._refuse(reason)
            return
        self._at_rest = measurement
        super()._take(measurement)

    def add(self, samples: Samples | Sequence[Measurement]) -> None:
        """Processes any number of samples, equivalent to as many calls of `update`."""
        for measurement in samples:
            self._take(measurement)

    def learning(self, table: Array) -> Iterator[float]:
        """As of `TrunkEstimator`, of samples with an IMU; each is a step."""
        for measurement in Samples.of_table(table, len(self.robot.tree.joints)):
            yield measurement.time
            self._take(measurement)

    def _learn(self, made: Made) -> None:
        if made.rows is not None:
            self._block = made.rows
            if self._at_rest is not None and self._at_rest.vertical_by_forces:
                made = made._replace(rows=self._untilted(made.rows))
        super()._learn(made)

    def _untilted(self, rows: BlockRows) -> BlockRows:
        """The rows that the vertical's tilt leaves."""
        places, columns = self.errors.layout.places, rows.columns / self._unit
        turn = places["imu_rotation"]
        tilt = np.linalg.svd(columns[:, 11 + turn.start : 11 + turn.stop])[0][:, :2]
        columns -= tilt @ (tilt.T @ columns)
        none = places["accelerometer"]
        columns[:, 11 + none.start : 11 + none.stop] = 0.0
        return replace(rows, columns=columns * self._unit)

    @property
    def vertical(self) -> Vertical | None:
        """In the last sample at rest; None before any block."""
        m, rows = self._at_rest, self._block
        if m is None or rows is None:
            return None
        places, covariance = self.errors.layout.places, self.errors.covariance.copy()
        turn, bias = places["imu_rotation"], places["accelerometer"]
        if not m.vertical_by_forces:
            tilt = covariance[turn, turn] + covariance[bias, bias] / GRAVITY**2
            return Vertical("imu", m.up, np.sqrt(np.diag(skew(m.up) @ tilt @ skew(m.up).T)))
        # by the sum of the forces: three equations for the mass and the two directions of the tilt
        across = np.linalg.svd(m.up[None])[2][1:].T
        C = rows.errors[:3, : len(covariance)]
        felt = np.linalg.solve(np.column_stack([rows.matrix[:3, 0], C[:, turn] @ across]), C)[1:]
        for place in (turn, bias):
            felt[:, place] = 0.0
        root = skew(m.up) @ across @ felt
        return Vertical("forces", m.up, np.sqrt(np.diag(root @ covariance @ root.T)))

    @property
    def balance(self) -> Balance | None:
        """In the last sample at rest; None before any."""
        if (m := self._at_rest) is None:
            return None
        forces, up, trunk = self._forces.at(m), m.up, self.trunk
        to_level, mass, legs = level_axes(up), trunk.inertial.mass, self._forces.leg_mass
        com = (mass * trunk.inertial.com + forces.weights.moment) / (mass + legs)
        return Balance(
            to_level=to_level,
            position=m.joint_position,
            feet=forces.contact,
            stance=forces.stance,
            force=forces.vertical(up),
            pressure=(to_level @ forces.pressure(up))[:2],
            robot_com=(to_level @ com)[:2] if trunk.observed[1:3].all() else np.full(2, np.nan),
        )
