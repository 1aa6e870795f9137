"""The paper's offline experiment (section IV.A): the runs of Table I and Fig. 4, real legs of Fig. 5, and both figures.

In simulation HyQ's right hind leg swings on a held trunk. The paper's real logs of HyQ are not public; those of Fig. 5
are a Unitree Go2 and an Aliengo on a stand, with legs in the air.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from stadera.body import FrictionModel
from stadera.errors import StaderaError
from stadera.excite.sinusoids import Sinusoids
from stadera.identify.legs import identify
from stadera.identify.prior import PriorWidth, positive_definite
from stadera.identify.result import MODELS, Identification, LegIdentification
from stadera.identify.settings import IdentifySettings
from stadera.lab.experiments.runner import CaseValues, ExperimentResult, Paper, Record, ReproduceSettings
from stadera.lab.laws.paper_draw import paper_draw
from stadera.lab.plant.leg import Gains, perturbed, perturbed_physical, simulate_leg
from stadera.lab.plant.sensors import STANDARD, measured
from stadera.logs import Recording
from stadera.logs.recording import concatenate
from stadera.logs.topics import example
from stadera.report.figures import Axis, Figure, Panel, line, stacked
from stadera.report.identify.tables import rmse_table
from stadera.report.look import ROLES
from stadera.robot import load_robot
from stadera.robot.model import Robot

ROBOT, LEG = "hyq", "RH"
COM_STD, INERTIA_STD = 0.02, 0.02
"""The paper's perturbation of CAD: [m] and [kg·m²]."""


# -- simulated runs ---------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class LegCase:
    """One identification in simulation, `part` of its experiment, and what is drawn for its seed: two motions and two
    truths. Estimators only get the recordings and `cad`.
    """

    part: str
    seed: int
    quick: bool

    @property
    def size(self) -> tuple[float, float]:
        """Duration of every log [s], and its sampling rate [Hz]."""
        return (20.0, 250.0) if self.quick else (180.0, 1000.0)

    def __str__(self) -> str:
        duration, rate = self.size
        return f"{duration:g} s at {rate:g} Hz"

    def _generator(self, draw: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(self.seed).spawn(draw + 1)[draw])

    @cached_property
    def cad(self) -> Robot:
        """The unperturbed robot: the prior."""
        return load_robot(ROBOT)

    @cached_property
    def paper_truth(self) -> Robot:
        """Centres of mass and tensors perturbed as in the paper; the links may be physically impossible."""
        return perturbed(self.cad, LEG, self._generator(0), com_std=COM_STD, inertia_std=INERTIA_STD)

    @cached_property
    def physical_truth(self) -> Robot:
        """A perturbation of the same size for which every link is physically possible."""
        return perturbed_physical(self.cad, LEG, self._generator(1), com_std=COM_STD)

    @cached_property
    def motion(self) -> Sinusoids:
        """The paper's random draw, for identification."""
        return paper_draw(self.cad, LEG, self._generator(2), self.size[0])

    @cached_property
    def second_motion(self) -> Sinusoids:
        """Another draw, for validation."""
        return paper_draw(self.cad, LEG, self._generator(3), self.size[0])

    def recorded(self, truth: Robot, motion: Sinusoids) -> Recording:
        """Exact position, velocity, acceleration and torque of a motion. Gains are computed from CAD."""
        return simulate_leg(truth, LEG, motion.sample(self.size[1]), gains=Gains.scaled(self.cad, LEG))

    def sensed(self, recording: Recording) -> Recording:
        """The recording with standard sensor errors, without acceleration."""
        return measured(recording, self.cad, STANDARD, self.seed)

    def identified_exact(self, log: Recording, method: str, validation: Recording | None = None) -> Identification:
        """Identifies from an exact log: no filter, no lag, links only (viscous friction as in the URDF)."""
        settings = IdentifySettings(
            legs=(LEG,),
            method=method,
            friction=FrictionModel(),
            cutoff_hz=None,
            torque_lag=0.0,
            split=1.0,
            width=self.width,
        )
        return identify(self.cad, [log], settings, None if validation is None else [validation])

    def identified_sensed(self, log: Recording, split: float = 1.0) -> Identification:
        """Identifies from a log with sensor errors: filtered, physically consistent, with unknown torque offsets."""
        settings = IdentifySettings(
            legs=(LEG,), friction=FrictionModel(("offset",)), torque_lag=0.0, split=split, width=self.width
        )
        return identify(self.cad, [log], settings)

    @cached_property
    def width(self) -> PriorWidth:
        """Prior width equal to the perturbation's size, which is known, although its draw is not.

        A displacement s of a link whose thinnest radius of gyration is r changes its pseudo-inertia by s/r in the
        prior's coordinates; the largest s/r of the leg's links is used, and at least the default width.
        """
        usual, squares = PriorWidth(), []
        for body in (positive_definite(self.cad.inertias[link]) for link in self.cad.leg(LEG).links):
            second = body.shifted(-body.com).pseudo_inertia[:3, :3]
            squares.append(np.linalg.eigvalsh(second).min() / body.mass)
        return replace(usual, shape=max(usual.shape, COM_STD / float(np.sqrt(min(squares)))))


# -- real logs --------------------------------------------------------------------------------------------------------
VARIABLE = "STADERA_DATA"
_BESIDE = Path("..") / "shared" / "data"


class MissingDataError(StaderaError):
    """Real logs needed by an experiment are not available."""


def data_folder(given: Path | None = None) -> Path | None:
    """The folder of real logs: the given one, else STADERA_DATA, else ../shared/data; None if there is none."""
    named = os.environ.get(VARIABLE)
    folder = given or (Path(named) if named else None)
    if folder is None:
        return _BESIDE if _BESIDE.is_dir() else None
    if not folder.is_dir():
        raise MissingDataError(f"no real logs: {folder} does not exist (set {VARIABLE} to their folder)")
    return folder


def real_log(name: str, given: Path | None = None) -> Path:
    """Path of a log, `real/<name>.csv` in the folder of real logs, or the package's own if there is no folder."""
    folder = data_folder(given)
    path = example(name) if folder is None else folder / "real" / f"{name}.csv"
    if not path.is_file():
        raise MissingDataError(f"{path}: no such log (set {VARIABLE} to the folder that holds real/{name}.csv)")
    return path


# -- torques and their errors, as in both figures ---------------------------------------------------------------------
NAMES = {"identified": "identified", "prior_friction": "CAD with friction", "prior": "CAD"}
PART = "validation"


def torque_figure(leg: LegIdentification, title: str, note: str, models: tuple[str, ...]) -> Figure:
    """Three panels of torques, then the errors of the first joint; later models are on top."""
    trace, time = next(trace for trace in leg.traces if trace.part == PART), Axis("time [s]")
    panels = []
    for k, joint in enumerate(leg.leg.joints):
        lines = [line(trace.time, trace.measured[:, k], "measured", "ink", width=2.4)]
        lines += [line(trace.time, trace.predicted[m][:, k], NAMES[m], ROLES[m], width=1.3) for m in models]
        panels.append(Panel(time, Axis("torque [N·m]"), tuple(lines), title=joint))
    errors = tuple(
        line(trace.time, (trace.measured - trace.predicted[m])[:, 0], NAMES[m], ROLES[m], width=1.3) for m in models
    )
    panels.append(Panel(time, Axis("error [N·m]"), errors, title=f"{leg.leg.joints[0]}: errors"))
    return stacked(title, panels, note)


def _rmse_records(
    paper: Paper, case: CaseValues, leg: LegIdentification, against: str, models: tuple[str, ...] = MODELS
) -> Iterator[Record]:
    """RMSE of each joint and model; the identified one is bounded by that of the model `against`."""
    for joint in leg.leg.joints:
        errors = {m: leg.rmse[PART][m][joint] for m in models}
        where = {**case, "leg": leg.leg.name, "joint": joint}
        for model, error in errors.items():
            bound = errors[against] if model == "identified" else None
            yield paper.record(where, f"torque RMSE, {NAMES[model]}", "N·m", error, bound=bound)


# -- Fig. 4: torques of a second motion in simulation, predicted by the identified leg and by CAD ---------------------
_FIG4, _PLAIN = Paper.of("fig4"), ("prior", "identified")


def _predicted(case: LegCase) -> Identification:
    truth = case.paper_truth if case.part == "none" else case.physical_truth
    first, second = (case.recorded(truth, motion) for motion in (case.motion, case.second_motion))
    if case.part == "none":
        return case.identified_exact(first, "null-space", second)
    later = first.time[-1] + (first.time[1] - first.time[0]) - second.time[0]
    both = concatenate([first, replace(second, time=second.time + later)])
    return case.identified_sensed(case.sensed(both), split=0.5)


def _fig4(cases: Sequence[LegCase], found: Sequence[Identification]) -> ExperimentResult:
    exact, noisy = found
    (exact_leg,), (noisy_leg,) = exact.legs, noisy.legs
    note = "On the second motion, which was not used to identify."
    offsets = f"{note} Friction: the sensors' constant offsets."
    return _FIG4.result(
        (
            *_rmse_records(_FIG4, {"sensor errors": "none"}, exact_leg, "prior", _PLAIN),
            *_rmse_records(_FIG4, {"sensor errors": "standard"}, noisy_leg, "prior_friction"),
        ),
        (
            replace(rmse_table(exact), title="Torque RMSE, no noise [N·m]", note=note),
            replace(rmse_table(noisy), title="Torque RMSE, sensor errors [N·m]", note=offsets),
        ),
        (
            torque_figure(exact_leg, "Without noise, as in the paper", note, _PLAIN),
            torque_figure(noisy_leg, "With sensor errors", note, _PLAIN),
        ),
        {
            "Robot": f"{ROBOT}, leg {LEG}, trunk held",
            "Motions": f"two random draws, {cases[0]} each",
            "Seed": str(cases[0].seed),
        },
    )


FIG4 = _FIG4.experiment(
    lambda settings: [LegCase(part, settings.seed, settings.quick) for part in ("none", "standard")],
    _predicted,
    _fig4,
    alone=True,
)


# -- Fig. 5: torques of real legs, identified on the first half of a log and evaluated on the second ------------------
_FIG5 = Paper.of("fig5")


@dataclass(frozen=True)
class RealLegs:
    """A robot and its log."""

    robot: str
    log: Path


def _real_cases(settings: ReproduceSettings) -> list[RealLegs]:
    cases = [RealLegs(robot, real_log(f"{robot}_legs_in_air", settings.data)) for robot in ("go2", "aliengo")]
    for case in cases:
        load_robot(case.robot)  # a missing model is named before the work
    return cases


def _fig5(cases: Sequence[RealLegs], found: Sequence[Identification]) -> ExperimentResult:
    pairs = [(case.robot, result) for case, result in zip(cases, found, strict=True)]
    legs = [(robot, leg) for robot, result in pairs for leg in result.legs]
    legs.sort(key=lambda pair: pair[1].leg.name != "RF")  # the paper's leg of each robot first
    return _FIG5.result(
        [record for robot, result in pairs for record in _real_records(robot, result)],
        [
            replace(
                rmse_table(result),
                title=f"{robot}: torque RMSE [N·m]",
                note=f"On {result.validated_on}, not used to identify.",
            )
            for robot, result in pairs
        ],
        [
            torque_figure(
                leg, f"{robot}, leg {leg.leg.name}", "The held-out half of the log, its first minute.", MODELS
            )
            for robot, leg in legs
        ],
        {"Logs": ", ".join(case.log.name for case in cases), "Identified on": "the first half of each"},
    )


def _real_records(robot: str, result: Identification) -> Iterator[Record]:
    for leg in result.legs:
        yield from _rmse_records(_FIG5, {"robot": robot}, leg, "prior_friction")
    for leg in result.legs:
        case = {"robot": robot, "leg": leg.leg.name}
        yield _FIG5.record(case, "links that no real body could be", "1", impossible_links(leg), bound=0.0)


def impossible_links(leg: LegIdentification) -> int:
    """Number of physically impossible links in an identified leg."""
    return sum(not leg.estimate.inertia(link).is_physical() for link in leg.leg.links)


FIG5 = _FIG5.experiment(_real_cases, lambda case: identify(case.robot, case.log), _fig5, alone=True)
