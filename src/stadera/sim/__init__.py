"""The test-bed: a MuJoCo plant made from a `Robot`, independent of the models that estimators use."""

from stadera.sim.leg import Gains, simulate_leg
from stadera.sim.perturb import Perturbed, perturbed, perturbed_physical

__all__ = ["Gains", "Perturbed", "perturbed", "perturbed_physical", "simulate_leg"]
