"""Reproductions of the paper's tables and figures: one file each, listed in the registry."""

from stadera.lab.experiments.paper import Experiment, ReproduceSettings
from stadera.lab.experiments.registry import ALL, EXPERIMENTS, experiments_named, run_experiments
from stadera.lab.experiments.result import ExperimentResult, Record, Skipped

__all__ = [
    "ALL",
    "EXPERIMENTS",
    "Experiment",
    "ExperimentResult",
    "Record",
    "ReproduceSettings",
    "Skipped",
    "experiments_named",
    "run_experiments",
]
