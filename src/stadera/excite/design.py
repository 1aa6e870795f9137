"""Designs an excitation and compares it with the paper's random draws: the computation behind `stadera excite`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from os import PathLike
from typing import Any

import numpy as np

from stadera.body import FrictionModel
from stadera.errors import IdentificationError, positive, require_positive
from stadera.excite.bounds import LegBounds, Margins
from stadera.excite.optimise import FourierSearch, LegExperiment, optimal_excitation
from stadera.excite.sinusoids import Reference, Sinusoids, check_duration
from stadera.identify.observability import Combination, gradients_of
from stadera.logs import Recording
from stadera.results import Result, data_frame, finite_or_none
from stadera.robot.load import load_robot
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration
from stadera.types import Array


@dataclass(frozen=True)
class ExciteSettings:
    """Settings of an excitation.

    Attributes:
        duration: from rest to rest [s].
        rate: of the table to be played, and of the log to be recorded [Hz].
        seed: of all random draws.
        random: use one of the paper's random draws instead of the optimum.
        draws: number of random draws to compare with.
        margins: distances from the leg's limits.
        stand_height: height of the trunk's origin above level ground [m], None for no ground.
        search: settings of the optimisation.
        noise: standard deviation of a torque sample, as a share of the joint's effort limit [1]: that of the paper's
            test-bed.
        noise_of_gravity: the same as a share of the largest gravity torque, if the model states no limit [1]. Assumed.
        look_rate: sampling rate for comparing motions and their peaks [Hz]; sufficient for motions of a few hertz.

    Raises:
        IdentificationError: an invalid value.
    """

    duration: float = 180.0
    rate: float = 500.0
    seed: int = 0
    random: bool = False
    draws: int = 5
    margins: Margins = field(default_factory=Margins)
    stand_height: float | None = None
    search: FourierSearch = field(default_factory=FourierSearch)
    noise: float = 0.0033
    noise_of_gravity: float = 0.02
    look_rate: float = 100.0

    def __post_init__(self) -> None:
        check_duration(self.duration)
        if not (np.isfinite(self.rate) and self.rate >= 10.0):
            raise IdentificationError(f"an excitation is played at 10 Hz at least, got {self.rate} Hz")
        if self.draws < 1 or self.seed < 0:
            raise IdentificationError(f"need a seed of at least 0 and at least one draw, got {self.seed}, {self.draws}")
        if self.stand_height is not None:
            positive("the trunk's height over the ground", self.stand_height, "m", IdentificationError)
        require_positive("setting of an excitation", self, ("noise", "noise_of_gravity", "look_rate"))


def excite(
    robot: Robot | str | PathLike[str],
    leg: str,
    settings: ExciteSettings | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Excitation:
    """Designs the excitation of one leg on a held trunk.

    Args:
        robot: a robot with limits and a prior (CAD) model, its name, or a path to a URDF or MJCF.
        leg: its name.
        progress: called with the step's name, items done and total.

    Raises:
        UnknownNameError: no such robot or leg.
        ModelError: the model file cannot be read, or the robot has no nominal stance.
        IdentificationError: the leg has no room to move, or is too close to the ground.
    """
    from stadera.lab.laws.paper_draw import paper_draw

    robot, settings = load_robot(robot), settings or ExciteSettings()
    report = progress or (lambda what, done, total: None)
    ground = None if settings.stand_height is None else -settings.stand_height
    bounds = LegBounds.of(robot, leg, margins=settings.margins, ground=ground)
    experiment = LegExperiment.usual(bounds, settings.rate, settings.noise, settings.noise_of_gravity)
    count = 1 if settings.random else settings.draws
    draws = []
    for k in range(count):
        report("random draws", k, count)
        rng = np.random.default_rng((settings.seed, k))
        draws.append(paper_draw(robot, leg, rng, settings.duration, bounds))
    report("random draws", count, count)
    if settings.random:
        return _appraised(experiment, settings, draws[0], [])
    best = optimal_excitation(
        experiment,
        np.random.default_rng(settings.seed),
        settings.duration,
        settings.search,
        lambda share: report("search", round(100 * share), 100),
    )
    return _appraised(experiment, settings, best, draws)


def motion_table(robot: Robot, reference: Reference, whole: bool = True) -> Recording:
    """Converts a motion to a table for a controller: position, velocity and acceleration of each joint over time, to
    nine decimals; if `whole`, with the robot's other joints at rest in the nominal stance.
    """
    joints, rest = (robot.tree.joints, standing_configuration(robot)) if whole else (reference.joints, 0.0)
    columns, shape = [joints.index(joint) for joint in reference.joints], (len(reference), len(joints))

    def played(still: Array | float, moving: Array) -> Array:
        values = np.full(shape, still)
        values[:, columns] = moving
        return np.round(values, 9) + 0.0

    position = played(rest, reference.position)
    velocity, acceleration = played(0.0, reference.velocity), played(0.0, reference.acceleration)
    return Recording(reference.time, joints, position, velocity, acceleration, source=f"excitation of {robot.name}")


def _appraised(
    experiment: LegExperiment, settings: ExciteSettings, chosen: Sinusoids, draws: Sequence[Sinusoids]
) -> Excitation:
    rigid = replace(experiment, friction=FrictionModel())
    combinations = experiment.structure.combinations()
    gradients = gradients_of(combinations, experiment.structure.columns)
    prior_std = np.linalg.norm(gradients * experiment.prior.scales, axis=1)

    def appraise(motion: Sinusoids) -> Appraisal:
        reference = motion.sample(settings.look_rate)
        seen = experiment.observability(reference)
        std = seen.std(gradients) / prior_std
        return Appraisal(motion, experiment.gain(reference), seen.rank, rigid.observability(reference).rank, std)

    return Excitation(
        experiment,
        settings,
        appraise(chosen),
        tuple(appraise(draw) for draw in draws),
        combinations,
        rigid.structure.rank,
    )


@dataclass(frozen=True, eq=False)
class Appraisal:
    """Expected information from one motion."""

    motion: Sinusoids
    gain: float  # information gain [nat]
    rank: int  # number of directions that would be known better than from the prior, joint terms included
    rigid_rank: int  # the same for the links' parameters alone, with the joint terms known
    std: Array  # (combinations,), standard deviation of each identifiable combination as a share of its prior one


@dataclass(frozen=True, eq=False, repr=False)
class Excitation(Result):
    """A designed excitation.

    Attributes:
        experiment: the leg, its bounds and the noise.
        settings: as requested.
        chosen: the motion to play.
        draws: the paper's random draws for comparison; empty if the motion is itself one.
        combinations: that motion can identify at best.
        rigid_rank: number of combinations of the links' parameters alone.
    """

    experiment: LegExperiment
    settings: ExciteSettings
    chosen: Appraisal
    draws: tuple[Appraisal, ...]
    combinations: tuple[Combination, ...]
    rigid_rank: int

    report = "stadera.report.excite.leg"

    @property
    def gained(self) -> float | None:
        """Information in excess of the median random draw's [nat]; None without draws."""
        return self.chosen.gain - float(np.median([d.gain for d in self.draws])) if self.draws else None

    @cached_property
    def ratios(self) -> Array | None:
        """By combination, the random draws' median standard deviation divided by the chosen motion's."""
        return np.median([d.std for d in self.draws], axis=0) / self.chosen.std if self.draws else None

    @property
    def median_ratio(self) -> float | None:
        """The median of `ratios`; None without draws."""
        return None if self.ratios is None else float(np.median(self.ratios))

    @cached_property
    def extremes(self) -> dict[str, Array]:
        """Extremes of the chosen motion by joint, (n,) each: "lower" and "upper" position [rad], and magnitudes of
        "velocity" [rad/s], "acceleration" [rad/s²] and "torque" as the prior model predicts it [N·m].
        """
        motion = self.chosen.motion.sample(self.settings.look_rate)
        torque = self.experiment.bounds.torque(motion)
        sizes = {"velocity": motion.velocity, "acceleration": motion.acceleration, "torque": torque}
        position = {"lower": motion.position.min(axis=0), "upper": motion.position.max(axis=0)}
        return position | {name: np.abs(values).max(axis=0) for name, values in sizes.items()}

    @cached_property
    def least_distance(self) -> float:
        """Least distance to trunk, other legs, itself and the ground [m]; above 0.1 m a lower bound of it."""
        path = self.chosen.motion.sample(self.settings.look_rate).position[::2]
        return float(self.experiment.bounds.clearance.distance(path).min())

    @property
    def motions(self) -> dict[str, Appraisal]:
        """The motion and those it is compared with, by name."""
        if not self.draws:
            return {"random draw": self.chosen}
        return {"optimised": self.chosen, **{f"draw {k + 1}": draw for k, draw in enumerate(self.draws)}}

    def to_dataframe(self) -> Any:
        """A pandas DataFrame, one row for each identifiable combination: combination, std (share of the prior's),
        random_std (median of the random draws, NaN without them).

        Raises:
            MissingExtraError: pandas is not installed.
        """
        random = self.chosen.std * (np.nan if self.ratios is None else self.ratios)
        names = [str(combination) for combination in self.combinations]
        return data_frame({"combination": names, "std": self.chosen.std, "random_std": random})

    def __repr__(self) -> str:
        bounds, settings = self.experiment.bounds, self.settings
        gained = "" if self.gained is None else f", {self.gained:.3g} nat more than the median random draw"
        return (
            f"Excitation of {bounds.robot.name} {bounds.leg}, {settings.duration:g} s at {settings.rate:g} Hz: "
            f"{self.chosen.gain:.4g} nat, {self.chosen.rigid_rank} of {self.rigid_rank} combinations{gained}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON: settings, extremes, information of each motion, and the sinusoids themselves.

        Standard deviations are shares of the prior's. Limits that the model does not state are null.
        """
        bounds, settings, motion = self.experiment.bounds, self.settings, self.chosen.motion
        low, high, velocity, acceleration, torque = (values.tolist() for values in self.extremes.values())
        joints = {
            joint: {
                "position": [low[k], high[k]],
                "position_bounds": [float(bounds.lower[k]), float(bounds.upper[k])],
                "velocity": velocity[k],
                "velocity_bound": finite_or_none(bounds.velocity[k]),
                "acceleration": acceleration[k],
                "torque": torque[k],
                "torque_bound": finite_or_none(bounds.effort[k]),
            }
            for k, joint in enumerate(bounds.joints)
        }
        arrays = ("rest", "origins", "amplitudes", "frequencies", "phases", "starts")
        return {
            "robot": bounds.robot.name,
            "leg": bounds.leg,
            "kind": "random" if settings.random else "optimised",
            "duration": settings.duration,
            "rate": settings.rate,
            "seed": settings.seed,
            "stand_height": settings.stand_height,
            "torque_noise": dict(zip(bounds.joints, self.experiment.noise.tolist(), strict=True)),
            "joints": joints,
            "least_distance": finite_or_none(self.least_distance),
            "motions": [
                {"name": name, "gain": a.gain, "rank": a.rank, "rigid_rank": a.rigid_rank}
                for name, a in self.motions.items()
            ],
            "combinations": [
                {
                    "text": str(combination),
                    "std": float(self.chosen.std[k]),
                    "random_std": None if self.ratios is None else float(self.ratios[k] * self.chosen.std[k]),
                    "ratio": None if self.ratios is None else float(self.ratios[k]),
                }
                for k, combination in enumerate(self.combinations)
            ],
            "gained": self.gained,
            "median_ratio": self.median_ratio,
            "rigid_rank": self.rigid_rank,
            "sinusoids": {name: getattr(motion, name).tolist() for name in arrays} | {"fade": motion.fade},
            "notes": list(bounds.clearance.notes),
            "units": dict(_UNITS),
        }


_UNITS = {
    "duration": "s",
    "rate": "Hz",
    "stand_height": "m",
    "torque_noise": "N·m",
    "position": "rad",
    "velocity": "rad/s",
    "acceleration": "rad/s²",
    "torque": "N·m",
    "least_distance": "m",
    "gain": "nat",
    "gained": "nat",
    "std": "of the prior's",
    "sinusoids": "rad, Hz, s",
}
