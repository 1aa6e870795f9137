"""The paper's tables and figures, done again: one file each, named in the registry."""

from stadera.experiments.registry import ALL, EXPERIMENTS, experiments_named, run_experiments
from stadera.experiments.result import Experiment, ExperimentResult, Record, ReproduceSettings, Skipped

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
