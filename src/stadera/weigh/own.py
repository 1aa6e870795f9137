"""A user's own estimator in the pipeline for motion: `--method FILE.py:Name`.

The class is made with the robot and takes one measurement at a time, as `stadera.trunk.protocol.Estimator` says. The
payload is the difference of its estimates now and at the tare; their errors count as independent.
"""

from __future__ import annotations

import numpy as np

from stadera.inertia import InertialParameters
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trunk.load import LoadChange, Payload, centre_slope
from stadera.trunk.measurement import Measurement
from stadera.trunk.protocol import Estimator, Status, TrunkEstimate
from stadera.trunk.result import ObservedLimits, TrunkParameters
from stadera.trunk.samples import Samples
from stadera.trust import Trust
from stadera.types import Array


class OwnEstimator:
    """Feeds samples to an estimator of one measurement at a time, and answers as `TrunkEstimator` does.

    Args:
        estimator: the user's.
        mount: of the IMU, for its lever.

    Attributes:
        changes, evidence, torque_lag, drives, spikes, impacts: what such an estimator does not tell: none.
    """

    changes: tuple[LoadChange, ...] = ()
    evidence = torque_lag = drives = None
    spikes, impacts = 0, 0.0

    def __init__(self, estimator: Estimator, robot: Robot, mount: ImuMount) -> None:
        self._estimator, self._robot, self._mount = estimator, robot, mount
        self._tare: TrunkEstimate | None = None

    def add_table(self, table: Array) -> None:
        """Processes samples given by their `Samples.table`."""
        samples = Samples.of_table(table, len(self._robot.tree.joints))
        for k, time in enumerate(samples.time):
            self._estimator.update(
                Measurement(
                    float(time),
                    samples.position[k],
                    samples.velocity[k],
                    samples.effort[k],
                    samples.angular_velocity[k],
                    samples.specific_force[k],
                    lever=self._mount.translation,
                    extra=samples.extra[k],
                )
            )

    def tare(self) -> None:
        """Makes the present estimate the reference for `payload`."""
        self._tare = self.estimate()

    def estimate(self) -> TrunkEstimate:
        """The estimator's own answer."""
        return self._estimator.estimate()

    @property
    def learnt(self) -> float:
        """Time of the last measurement used [s]; NaN before any."""
        return self.estimate().time

    @property
    def refusal(self) -> str:
        """Why the latest measurement was refused; empty if it was not."""
        return self.estimate().reason

    def parameters(self) -> TrunkParameters:
        """The estimate, with the model's inertia."""
        found, inertia = self.estimate(), self._robot.inertias[self._robot.trunk].inertia_com
        body = InertialParameters.from_com(found.trunk.mass, found.trunk.com_trunk, inertia)
        observed = np.concatenate([found.observed, np.zeros(6, dtype=bool)])
        return TrunkParameters(body, found.covariance, np.full(6, np.nan), observed)

    @property
    def payload(self) -> Payload | None:
        """Difference from the tare; None without one."""
        if self._tare is None:
            return None
        total, moments = np.zeros((4, 4)), np.zeros(4)
        for found, sign in ((self.estimate(), 1.0), (self._tare, -1.0)):
            mass, centre = found.value[0], found.value[1:]
            moments += sign * np.array([mass, *(mass * centre)])
            slope = np.linalg.inv(centre_slope(np.array([mass, *(mass * centre)])))
            seen = found.observed
            unknown = np.full(4, (10.0 * self._robot.leg_length) ** 2)  # a centre that was not observed, nor is now
            covariance = np.where(np.outer(seen, seen), np.nan_to_num(found.covariance), np.diag(~seen * unknown))
            total += slope @ covariance @ slope.T
        return Payload.of_moments(moments, total, np.full(3, ObservedLimits().com * self._robot.leg_length))

    @property
    def trust(self) -> Trust:
        """Doubtful: nobody has checked this estimator's fit."""
        if self.estimate().status is Status.WAITING:
            return Trust("doubtful", np.nan, {}, ("too few samples yet for an estimate",))
        return Trust("doubtful", np.nan, {}, ("weighed by an own estimator, whose fit is not evaluated",))
