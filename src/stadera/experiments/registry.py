"""The experiments by name, in the paper's order. A new one is one file and one line here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

from stadera.errors import MissingExtraError, StaderaError, UnknownNameError
from stadera.experiments import (
    alarms,
    fig4,
    fig5,
    fig6,
    inertial_share,
    survival,
    table1,
    table2,
    table3,
    table4,
    table5,
    walking,
)
from stadera.experiments.real_logs import MissingDataError
from stadera.experiments.result import Experiment, ExperimentResult, Progress, ReproduceSettings, Skipped

ALL = "all"

_EXPERIMENTS = (
    table1.EXPERIMENT,
    fig4.EXPERIMENT,
    fig5.EXPERIMENT,
    table2.EXPERIMENT,
    fig6.EXPERIMENT,
    table3.EXPERIMENT,
    table4.EXPERIMENT,
    inertial_share.EXPERIMENT,
    table5.EXPERIMENT,
    survival.EXPERIMENT,
    walking.EXPERIMENT,
    alarms.EXPERIMENT,
)

EXPERIMENTS: Mapping[str, Experiment] = MappingProxyType({e.name: e for e in _EXPERIMENTS})


def experiments_named(name: str) -> tuple[Experiment, ...]:
    """The experiment of that name, or all that are no studies of hundreds of runs.

    Raises:
        UnknownNameError: no such experiment.
    """
    if name.lower() == ALL:
        return tuple(experiment for experiment in _EXPERIMENTS if not experiment.study)
    if name.lower() not in EXPERIMENTS:
        raise UnknownNameError("experiment", name, (*EXPERIMENTS, ALL))
    return (EXPERIMENTS[name.lower()],)


def run_experiments(
    experiments: Sequence[Experiment], settings: ReproduceSettings, progress: Progress
) -> Iterator[ExperimentResult | Skipped]:
    """Runs them in turn. Of several, one whose logs or robot models are not on this machine is skipped.

    Raises:
        StaderaError: an experiment could not be run, or takes no number of seeds.
    """
    if settings.seeds is not None and not all(experiment.seeded for experiment in experiments):
        seeded = ", ".join(name for name, experiment in EXPERIMENTS.items() if experiment.seeded)
        raise StaderaError(f"a number of seeds can be told to these experiments only: {seeded}")
    for experiment in experiments:
        try:
            yield experiment.run(settings, progress)
        except (MissingDataError, MissingExtraError) as error:
            if len(experiments) == 1:
                raise
            yield Skipped(experiment.name, str(error))
