"""Registry of experiments, in the paper's order. A new one is a file, an entry of experiments.toml and a line here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

from stadera.errors import MissingExtraError, StaderaError, UnknownNameError
from stadera.lab.experiments.faults import study as faults
from stadera.lab.experiments.legs import fig4, fig5, table1
from stadera.lab.experiments.legs.real_logs import MissingDataError
from stadera.lab.experiments.moving import alarms, inertial_share, survival, table5, walking
from stadera.lab.experiments.paper import Experiment, ReproduceSettings
from stadera.lab.experiments.reality import mini_cheetah
from stadera.lab.experiments.reality import study as reality
from stadera.lab.experiments.result import ExperimentResult, Skipped
from stadera.lab.experiments.standing import fig6, table2, table3, table4
from stadera.types import Progress

ALL = "all"

_MODULES = (table1, fig4, fig5, table2, fig6, table3, table4, inertial_share, table5)
_STUDIES = (survival, walking, alarms, reality, faults, mini_cheetah)
_EXPERIMENTS = tuple(module.PAPER.experiment(module.run) for module in (*_MODULES, *_STUDIES))

EXPERIMENTS: Mapping[str, Experiment] = MappingProxyType({e.name: e for e in _EXPERIMENTS})


def experiments_named(name: str) -> tuple[Experiment, ...]:
    """The experiment with that name; for `all`, every one except the studies of hundreds of runs."""
    if name.lower() == ALL:
        return tuple(experiment for experiment in _EXPERIMENTS if not experiment.study)
    if name.lower() not in EXPERIMENTS:
        raise UnknownNameError("experiment", name, (*EXPERIMENTS, ALL))
    return (EXPERIMENTS[name.lower()],)


def run_experiments(
    experiments: Sequence[Experiment], settings: ReproduceSettings, progress: Progress
) -> Iterator[ExperimentResult | Skipped]:
    """Runs experiments in turn. If there are several, one whose logs or robot models are not available is skipped."""
    if settings.seeds is not None and not all(experiment.seeded for experiment in experiments):
        seeded = ", ".join(name for name, experiment in EXPERIMENTS.items() if experiment.seeded)
        raise StaderaError(f"a number of seeds can be set for these experiments only: {seeded}")
    for experiment in experiments:
        try:
            yield experiment.run(settings, progress)
        except (MissingDataError, MissingExtraError) as error:
            if len(experiments) == 1:
                raise
            yield Skipped(experiment.name, str(error))
