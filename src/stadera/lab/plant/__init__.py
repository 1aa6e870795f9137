"""The test-bed: a MuJoCo plant made from a `Robot`, independent of the models that estimators use."""

from stadera.lab.plant.leg import Gains, simulate_leg
from stadera.lab.plant.payload import DroppedBox, OutsideForce, Payload, RigidMass, Tray, VirtualForce
from stadera.lab.plant.perturb import perturbed, perturbed_physical
from stadera.lab.plant.plant import Plant, SimulationError
from stadera.lab.plant.state import TrueState
from stadera.lab.plant.terrain import Stones, Terrain
from stadera.lab.sensor_errors import HARSH, IDEAL, STANDARD, Gaussian, SensorErrors, sensor_errors
from stadera.lab.sensors import SensorReading, Sensors, estimator_model, measured, plant_model, recording_of, truth_of

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
