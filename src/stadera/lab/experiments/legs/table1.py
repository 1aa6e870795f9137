"""Table I: the right hind leg identified in simulation, compared with the simulated values.

Four cases: the paper's own (CAD perturbed, no noise, eq. 5); the same with a physically possible perturbation, solved
physically consistently; that with sensor errors; and the information of the motion: the ranks reached by the paper's
random draw and by the optimised excitation.
"""

from __future__ import annotations

from stadera.lab.experiments.legs.recovery import Recovery
from stadera.lab.experiments.legs.runs import LEG, LegRuns
from stadera.lab.experiments.legs.tables import (
    combination_table,
    deviation_figure,
    first_moment_table,
    inertia_table,
    paper_table,
)
from stadera.lab.experiments.legs.torques import torque_figure
from stadera.lab.experiments.legs.worth import motion_worth, worth_records, worth_table
from stadera.lab.experiments.paper import Paper, ReproduceSettings, Steps
from stadera.lab.experiments.result import ExperimentResult, Record
from stadera.types import Progress

PAPER = Paper.of("table1")


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """Simulates, identifies and compares."""
    runs = LegRuns.of(settings)
    step = Steps(PAPER.name, progress)
    step("simulating the leg on two motions")
    log = runs.recorded(runs.paper_truth, runs.motion)
    second = runs.recorded(runs.paper_truth, runs.second_motion)
    step("identifying, CAD in the null space")
    exact = Recovery.of(runs.identified_exact(log, "null-space", second), runs.paper_truth)
    step("simulating a physically possible leg")
    log = runs.recorded(runs.physical_truth, runs.motion)
    step("identifying, physically consistent")
    possible = Recovery.of(runs.identified_exact(log, "consistent"), runs.physical_truth)
    step("identifying with sensor errors")
    noisy = Recovery.of(runs.identified_sensed(runs.sensed(log)), runs.physical_truth)
    step("optimising the motion")
    worth = motion_worth(runs, settings.quick)
    step.finished()
    return PAPER.result(
        (*_exact_records(exact), *_possible_records(possible), *_noisy_records(noisy), *worth_records(PAPER, worth)),
        (
            first_moment_table(exact),
            inertia_table(exact),
            paper_table(PAPER.values["links"]),
            combination_table(noisy, "With sensor errors: what the leg's torques depend on"),
            worth_table(worth),
        ),
        (
            torque_figure(
                exact.leg,
                "Torques on a second motion",
                "Not used to identify. The identified model's curves lie on the measured ones; CAD's do not.",
                ("prior", "identified"),
            ),
            deviation_figure(noisy),
        ),
        {
            "Robot": f"{runs.cad.name}, leg {LEG}, trunk held",
            "Motion": f"the paper's random sinusoids, {runs.size}",
            "Plant": "MuJoCo, PD-tracked",
            "Identified": f"{len(exact.leg.estimate.columns)} parameters, rank {exact.leg.estimate.observability.rank}",
            "Seed": str(settings.seed),
        },
    )


def _relative_records(case: dict[str, str | float], found: Recovery) -> tuple[Record, ...]:
    bound = PAPER.bounds["relative"]
    parameters, combinations = found.worst(found.parameters), found.worst(found.combinations)
    return (
        PAPER.record(case, "worst relative error, observable parameters", "1", parameters, bound=bound),
        PAPER.record(case, "worst relative error, identifiable combinations", "1", combinations, bound=bound),
    )


def _exact_records(found: Recovery) -> tuple[Record, ...]:
    """Records of the paper's case. It states 1 mm for observable components, CAD for the others, and rank 12."""
    case, paper, bounds = _case("the paper's", "none", found), PAPER.values, PAPER.bounds
    com, rank = found.largest_error(found.coms), found.leg.estimate.observability.rank
    return (
        *_relative_records(case, found),
        PAPER.record(case, "worst error, observable CoM", "m", com, paper["com"], bounds["com"]),
        PAPER.record(case, "unobservable parameters, largest change from CAD", "SI", found.drift, 0.0, 0.0),
        Record(PAPER.name, case, "rank, of 30", "1", rank, paper["rank"], bounds["rank"], "at least"),
    )


def _possible_records(found: Recovery) -> tuple[Record, ...]:
    case, com = _case("physical", "none", found), found.largest_error(found.coms)
    return (
        *_relative_records(case, found),
        PAPER.record(case, "worst error, observable CoM", "m", com, bound=PAPER.bounds["com"]),
        PAPER.record(case, "links that no real body could be", "1", found.impossible_links, bound=0.0),
    )


def _noisy_records(found: Recovery) -> tuple[Record, ...]:
    case = _case("physical", "standard", found)
    deviations = max(abs(c.deviations) for c in found.combinations)
    rank = found.leg.estimate.observability.rank
    return (
        PAPER.record(case, "error of combinations, NEES / n", "1", found.nees, bound=found.nees_limit()),
        PAPER.record(case, "worst error of a combination", "σ", deviations),
        PAPER.record(case, "rank, of 33 with torque offsets", "1", rank),
    )


def _case(perturbation: str, errors: str, found: Recovery) -> dict[str, str | float]:
    return {"perturbation": perturbation, "sensor errors": errors, "method": found.leg.estimate.method}
