"""Write your own estimator of the trunk: the mass of a robot at rest, from the forces of its feet.

An estimator is any class that is made with a robot and has `update(measurement)` and `estimate()`.

    stadera simulate stand --robot hyq --out stand.csv
    stadera weigh stand.csv --robot hyq --method examples/own_estimator.py:MeanMass
    python examples/own_estimator.py stand.csv hyq
"""

import sys

import numpy as np

import stadera
from stadera.constants import GRAVITY
from stadera.logs import read
from stadera.trunk.measurement import measurements_of
from stadera.trunk.model import TrunkModel
from stadera.trunk.protocol import Estimator, Status, TrunkEstimate, unobserved
from stadera.trunk.standing.forces import ContactForceEstimator

TORQUE_SCALE = 0.03  # standard deviation of what all torques have in common, as torque sensors are specified


class MeanMass:
    """Mean of the vertical force of the feet, less the weight of the legs."""

    def __init__(self, robot: stadera.Robot) -> None:
        self.forces, self.prior = ContactForceEstimator(robot), TrunkModel.prior(robot)
        self.masses: list[float] = []
        self.time = np.nan

    def update(self, measurement: stadera.Measurement) -> None:
        carried = self.forces.at(measurement).wrench[:3] @ measurement.up / GRAVITY
        self.masses.append(carried - self.forces.leg_mass)
        self.time = measurement.time

    def estimate(self) -> TrunkEstimate:
        covariance = unobserved()  # NaN: not observed, as the centre of mass stays
        if not self.masses:
            return TrunkEstimate(self.time, self.prior, covariance, Status.WAITING)
        # the mean of many samples is known well, but not the scale of the torques, which no number of samples shows
        carried = np.mean(self.masses) + self.forces.leg_mass
        covariance[0, 0] = np.var(self.masses) / len(self.masses) + (TORQUE_SCALE * carried) ** 2
        trunk = TrunkModel(float(np.mean(self.masses)), self.prior.com_trunk)
        return TrunkEstimate(self.time, trunk, covariance, Status.MOVING)


def main(log: str | None = None, name: str = "hyq") -> None:
    robot = stadera.load_robot(name)
    if log is None:  # without arguments a simulated robot that stands (extra `lab`)
        from stadera.lab.scenarios.catalog import SimulateSettings
        from stadera.lab.scenarios.run import simulate

        log = simulate(robot, "stand", SimulateSettings(duration=5.0)).recording
    estimator: Estimator = MeanMass(robot)
    for measurement in measurements_of(read(log), robot):
        estimator.update(measurement)
    estimate = estimator.estimate()
    print(f"trunk {estimate.trunk.mass:.2f} ± {estimate.std[0]:.2f} kg")


if __name__ == "__main__":
    main(*sys.argv[1:])
