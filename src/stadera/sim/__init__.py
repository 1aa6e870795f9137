"""The test-bed: a MuJoCo plant made from a `Robot`, independent of the models that estimators use."""

from stadera.sim.errors import (
    HARSH,
    IDEAL,
    STANDARD,
    Gaussian,
    SensorErrors,
    sensor_errors,
    with_foot_position,
    with_torque_offset,
)
from stadera.sim.leg import Gains, simulate_leg
from stadera.sim.payload import DroppedBox, Payload, RigidMass, Tray, VirtualForce
from stadera.sim.perturb import Perturbed, perturbed, perturbed_physical
from stadera.sim.plant import Plant, SimulationError
from stadera.sim.record import recording_of, truth_of
from stadera.sim.sensors import Sample, Sensors, estimator_model, measured, plant_model
from stadera.sim.state import TrueState
from stadera.sim.terrain import Stones, Terrain
from stadera.sim.world import default_imu_frame, imu_pose

__all__ = [
    "HARSH",
    "IDEAL",
    "STANDARD",
    "DroppedBox",
    "Gains",
    "Gaussian",
    "Payload",
    "Perturbed",
    "Plant",
    "RigidMass",
    "Sample",
    "SensorErrors",
    "Sensors",
    "SimulationError",
    "Stones",
    "Terrain",
    "Tray",
    "TrueState",
    "VirtualForce",
    "default_imu_frame",
    "estimator_model",
    "imu_pose",
    "measured",
    "perturbed",
    "perturbed_physical",
    "plant_model",
    "recording_of",
    "sensor_errors",
    "simulate_leg",
    "truth_of",
    "with_foot_position",
    "with_torque_offset",
]
