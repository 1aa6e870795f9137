"""The test-bed: a MuJoCo plant made from a `Robot`, independent of the models that estimators use."""

from stadera.lab.plant.leg import Gains, perturbed, perturbed_physical, simulate_leg
from stadera.lab.plant.payload import DroppedBox, OutsideForce, Payload, RigidMass, Tray, VirtualForce
from stadera.lab.plant.plant import Plant, SimulationError
from stadera.lab.plant.sensors import (
    HARSH,
    IDEAL,
    STANDARD,
    Gaussian,
    SensorErrors,
    SensorReading,
    Sensors,
    estimator_model,
    measured,
    plant_model,
    recording_of,
    sensor_errors,
    truth_of,
)
from stadera.lab.plant.terrain import Stones, Terrain
from stadera.lab.plant.world import TrueState

__all__ = [
    "HARSH",
    "IDEAL",
    "STANDARD",
    "DroppedBox",
    "Gains",
    "Gaussian",
    "OutsideForce",
    "Payload",
    "Plant",
    "RigidMass",
    "SensorErrors",
    "SensorReading",
    "Sensors",
    "SimulationError",
    "Stones",
    "Terrain",
    "Tray",
    "TrueState",
    "VirtualForce",
    "estimator_model",
    "measured",
    "perturbed",
    "perturbed_physical",
    "plant_model",
    "recording_of",
    "sensor_errors",
    "simulate_leg",
    "truth_of",
]
