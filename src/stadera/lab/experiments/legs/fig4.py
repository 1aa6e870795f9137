"""Fig. 4: torques of a second motion in simulation, predicted by the identified leg and by CAD."""

from __future__ import annotations

from stadera.lab.experiments.legs.runs import LEG, LegRuns, one_after_another
from stadera.lab.experiments.legs.torques import rmse_records, rmse_table, torque_figure
from stadera.lab.experiments.paper import Paper, ReproduceSettings, Steps
from stadera.lab.experiments.result import ExperimentResult
from stadera.types import Progress

PAPER = Paper.of("fig4")

_MODELS = ("prior", "identified")


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """Identifies on one motion and predicts another."""
    runs, step = LegRuns.of(settings), Steps(PAPER.name, progress)
    step("simulating the leg on two motions")
    first, second = (runs.recorded(runs.paper_truth, m) for m in (runs.motion, runs.second_motion))
    step("identifying without noise")
    exact = runs.identified_exact(first, "null-space", second)
    step("simulating a physically possible leg")
    first, second = (runs.recorded(runs.physical_truth, m) for m in (runs.motion, runs.second_motion))
    step("identifying with sensor errors")
    noisy = runs.identified_sensed(runs.sensed(one_after_another(first, second)), split=0.5)
    step.finished()
    note = "On the second motion, which was not used to identify."
    friction = ("prior", "prior_friction", "identified")
    return PAPER.result(
        records=(
            *rmse_records(PAPER, {"sensor errors": "none"}, exact.legs[0], "prior", _MODELS),
            *rmse_records(PAPER, {"sensor errors": "standard"}, noisy.legs[0], "prior_friction"),
        ),
        tables=(
            rmse_table(exact, "Torque RMSE, no noise", note, _MODELS),
            rmse_table(
                noisy, "Torque RMSE, sensor errors", f"{note} Friction: the sensors' constant offsets.", friction
            ),
        ),
        figures=(
            torque_figure(exact.legs[0], "Without noise, as in the paper", note, _MODELS),
            torque_figure(noisy.legs[0], "With sensor errors", note, _MODELS),
        ),
        facts={
            "Robot": f"{runs.cad.name}, leg {LEG}, trunk held",
            "Motions": f"two random draws, {runs.size} each",
            "Seed": str(settings.seed),
        },
    )
