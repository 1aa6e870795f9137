"""Reproductions of the paper's tables and figures: listed in the registry."""

from stadera.lab.experiments.registry import ALL, EXPERIMENTS, experiments_named, run_experiments
from stadera.lab.experiments.result import ExperimentResult, Record, Skipped
from stadera.lab.experiments.runner import Experiment, ReproduceSettings

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
