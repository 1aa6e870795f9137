"""Reproductions of the paper's tables and figures, and studies: each a file, its text in the TOML, a line here."""

from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from types import MappingProxyType

from stadera.errors import MissingExtraError, StaderaError, UnknownNameError
from stadera.lab.experiments.legs import MissingDataError
from stadera.lab.experiments.runner import Experiment, ExperimentResult, Record, ReproduceSettings, Skipped
from stadera.types import Progress

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

ALL = "all"

_FILES = (  # in the order of the list
    "table1 legs tables_2_3 fig6 table4 inertial_share table5 alarms reality faults humanoids identified mini_cheetah"
)
_EXPERIMENTS = tuple(
    found
    for name in _FILES.split()
    for found in vars(import_module(f"{__name__}.{name}")).values()
    if isinstance(found, Experiment)
)
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
