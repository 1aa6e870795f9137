"""Table I: the right hind leg identified in simulation, identified against simulated values.

Four cases. The paper's own: CAD perturbed, no noise, eq. 5. The same with a perturbation that leaves every link
possible, solved physically consistent. That one with sensor errors. And what the motion is worth: the rank that the
paper's random draw reaches, and that of the optimised excitation.
"""

from __future__ import annotations

from stadera.experiments.leg_runs import COM_STD, INERTIA_STD, LEG, LegRuns
from stadera.experiments.motion_worth import motion_worth, worth_records, worth_table
from stadera.experiments.recovery import Recovery
from stadera.experiments.result import Experiment, ExperimentResult, Progress, Record, ReproduceSettings, Steps
from stadera.experiments.table1_tables import combination_table, deviation_figure, first_moment_table, inertia_table
from stadera.experiments.torques import torque_figure

NAME = "table1"

_BOUND = 1e-6
_COM_BOUND = 1e-3  # m
_PAPER_RANK, _RANK = 12, 17
_LEAD = (
    "HyQ's right hind leg swings on a held trunk, tracked in a MuJoCo simulation whose links are not what CAD says: "
    f"centres of mass are off by {COM_STD:g} m and inertias by {INERTIA_STD:g} kg·m² (one standard deviation of each "
    "component, the paper's). From joint motion and torques alone the leg is identified, with CAD as what was believed "
    "before. What such a motion cannot show stays at CAD, and is marked."
)
_NOTES = (
    "Masses are held at CAD, where the simulation has them too: no motion on a held trunk tells them apart from the "
    "rest. A centre of mass counts as observable where the data fix the first moment once the masses are given.",
    "Identified and simulated differ where a value is not observable by itself; the combinations of them, on which "
    "torques depend, are found. A perturbation like the paper's makes links that no real leg could have (moments of "
    "inertia below zero), so eq. 5 is used there, and the physically consistent solution on a possible one.",
    "Relative errors are |identified − simulated| / |simulated|, the worst of all observable parameters or "
    "identifiable combinations. The estimators are given the recording and CAD; simulated values only judge.",
    "With sensor errors positions, velocities and torques are noisy, each torque sensor is off by a constant that is "
    "identified besides, and accelerations come from filtered positions.",
)


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """Simulates, identifies and compares."""
    runs = LegRuns.of(settings)
    step = Steps(NAME, progress)
    step("simulating the leg on two motions")
    log = runs.recorded(runs.paper_truth, runs.motion)
    second = runs.recorded(runs.paper_truth, runs.second_motion)
    step("identifying, eq. 5")
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
    return ExperimentResult(
        name=NAME,
        title="Table I: HyQ's right hind leg, identified in simulation",
        lead=_LEAD,
        records=(
            *_exact_records(exact),
            *_possible_records(possible),
            *_noisy_records(noisy),
            *worth_records(NAME, worth),
        ),
        tables=(
            first_moment_table(exact),
            inertia_table(exact),
            combination_table(noisy, "With sensor errors: what the leg's torques depend on"),
            worth_table(worth),
        ),
        figures=(
            torque_figure(
                exact.leg,
                "Torques on a second motion",
                "Not used to identify. The identified model's curves lie on the measured ones; CAD's do not.",
                ("prior", "identified"),
            ),
            deviation_figure(noisy),
        ),
        notes=_NOTES,
        facts={
            "Robot": f"{runs.cad.name}, leg {LEG}, trunk held",
            "Motion": f"the paper's random sinusoids, {runs.size}",
            "Plant": "MuJoCo, PD-tracked",
            "Identified": f"{len(exact.leg.estimate.columns)} parameters, rank {exact.leg.estimate.observability.rank}",
            "Seed": str(settings.seed),
        },
    )


def _exact_records(found: Recovery) -> tuple[Record, ...]:
    """The paper's case. It states 1 mm for what is observable, CAD for what is not, and rank 12."""
    case, observability = _case("the paper's", "none", found), found.leg.estimate.observability
    return (
        _record(case, "worst relative error, observable parameters", "1", found.worst(found.parameters), _BOUND),
        _record(case, "worst relative error, identifiable combinations", "1", found.worst(found.combinations), _BOUND),
        Record(NAME, case, "worst error, observable CoM", "m", found.largest_error(found.coms), 1e-3, _COM_BOUND),
        Record(NAME, case, "unobservable parameters, largest change from CAD", "SI", found.drift, 0.0, 0.0),
        Record(NAME, case, "rank, of 30", "1", observability.rank, _PAPER_RANK, _RANK, "at least"),
    )


def _possible_records(found: Recovery) -> tuple[Record, ...]:
    case = _case("physical", "none", found)
    impossible = sum(not found.leg.estimate.inertia(link).is_physical() for link in found.leg.leg.links)
    return (
        _record(case, "worst relative error, observable parameters", "1", found.worst(found.parameters), _BOUND),
        _record(case, "worst relative error, identifiable combinations", "1", found.worst(found.combinations), _BOUND),
        _record(case, "worst error, observable CoM", "m", found.largest_error(found.coms), _COM_BOUND),
        _record(case, "links that no real body could be", "1", impossible, 0.0),
    )


def _noisy_records(found: Recovery) -> tuple[Record, ...]:
    case = _case("physical", "standard", found)
    deviations = max(abs(c.deviations) for c in found.combinations)
    return (
        _record(case, "error of combinations, NEES / n", "1", found.nees, found.nees_limit()),
        _record(case, "worst error of a combination", "σ", deviations),
        _record(case, "rank, of 33 with torque offsets", "1", found.leg.estimate.observability.rank),
    )


def _case(perturbation: str, errors: str, found: Recovery) -> dict[str, str | float]:
    return {"perturbation": perturbation, "sensor errors": errors, "method": found.leg.estimate.method}


def _record(case: dict[str, str | float], metric: str, unit: str, value: float, bound: float | None = None) -> Record:
    return Record(NAME, case, metric, unit, value, bound=bound)


EXPERIMENT = Experiment(NAME, "Table I, HyQ's right hind leg identified in simulation", run)
