"""Runs of the test-bed by name, as logs that the rest of the package reads."""

from stadera.simulate.run import Run, simulate
from stadera.simulate.scenarios import SCENARIOS, Event, Scenario, scenario_named
from stadera.simulate.settings import Load, SimulateSettings
from stadera.simulate.truth import Truth, TruthAt, read_truth, truth_json, truth_paths

__all__ = [
    "SCENARIOS",
    "Event",
    "Load",
    "Run",
    "Scenario",
    "SimulateSettings",
    "Truth",
    "TruthAt",
    "read_truth",
    "scenario_named",
    "simulate",
    "truth_json",
    "truth_paths",
]
