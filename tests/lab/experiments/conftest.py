"""One quick set of runs that the tests of experiments share."""

from __future__ import annotations

import pytest

from stadera.lab.experiments.legs import LegCase
from stadera.lab.experiments.table1 import Recovery


@pytest.fixture(scope="session")
def runs() -> LegCase:
    return LegCase("exact", 0, quick=True)


@pytest.fixture(scope="session")
def exact(runs: LegCase) -> Recovery:
    """The paper's perturbation, no noise, eq. 5."""
    log = runs.recorded(runs.paper_truth, runs.motion)
    return Recovery.of(runs.identified_exact(log, "null-space"), runs.paper_truth)


@pytest.fixture(scope="session")
def possible(runs: LegCase) -> Recovery:
    """A physical perturbation, no noise, physically consistent."""
    log = runs.recorded(runs.physical_truth, runs.motion)
    return Recovery.of(runs.identified_exact(log, "consistent"), runs.physical_truth)
