"""Design of an excitation, and how much better it is than the paper's random draw: what `stadera excite` computes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stadera.errors import IdentificationError
from stadera.identify.bounds import LegBounds, Margins
from stadera.identify.excitation import check_duration, paper_draw
from stadera.identify.experiment import Experiment
from stadera.identify.observability import Combination, Observability
from stadera.identify.optimise import FourierSearch, optimal_excitation
from stadera.identify.sinusoids import Reference, Sinusoids
from stadera.recording import Recording
from stadera.regressors import FrictionModel, JointMotion
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration

Array = NDArray[np.float64]

_LOOK_RATE = 100.0  # Hz, enough for motions of a few hertz


@dataclass(frozen=True)
class ExciteSettings:
    """What excitation is wanted.

    Attributes:
        duration: from rest to rest [s].
        rate: of the table that is played, and of the log that is recorded [Hz].
        seed: of all that is drawn.
        random: the paper's random draw itself, instead of the optimum.
        draws: how many random draws the optimum is compared with.
        margins: kept from the leg's limits.
        stand_height: height of the trunk's origin over a level ground [m], None for a leg over a void.
        search: for the optimum.

    Raises:
        IdentificationError: a value that makes no sense.
    """

    duration: float = 180.0
    rate: float = 500.0
    seed: int = 0
    random: bool = False
    draws: int = 5
    margins: Margins = field(default_factory=Margins)
    stand_height: float | None = None
    search: FourierSearch = field(default_factory=FourierSearch)

    def __post_init__(self) -> None:
        check_duration(self.duration)
        if not (np.isfinite(self.rate) and self.rate >= 10.0):
            raise IdentificationError(f"an excitation is played at 10 Hz at least, got {self.rate} Hz")
        if self.draws < 1 or self.seed < 0:
            raise IdentificationError(f"need a seed of at least 0 and at least one draw, got {self.seed}, {self.draws}")
        if self.stand_height is not None and not (np.isfinite(self.stand_height) and self.stand_height > 0):
            raise IdentificationError(f"the trunk's height over the ground must be positive, got {self.stand_height} m")


@dataclass(frozen=True, eq=False)
class Appraisal:
    """What one motion would tell.

    Attributes:
        motion: the motion.
        gain: information gain [nat].
        rank: directions that would be known better than the prior knows them, joint terms included.
        rigid_rank: the same with the joints' own terms known, for the links' parameters alone.
        std: (combinations,), standard deviation of each identifiable combination in shares of its prior one.
    """

    motion: Sinusoids
    gain: float
    rank: int
    rigid_rank: int
    std: Array


@dataclass(frozen=True, eq=False)
class Excitation:
    """A designed excitation.

    Attributes:
        experiment: the leg, its bounds and the noise.
        settings: what was asked for.
        chosen: the motion to play.
        draws: the paper's random draws it is compared with; empty where the motion is itself one.
        combinations: what any motion can at best identify.
        rigid_rank: how many combinations that are of the links alone.
        peaks: what the chosen motion uses of the leg's bounds.
    """

    experiment: Experiment
    settings: ExciteSettings
    chosen: Appraisal
    draws: tuple[Appraisal, ...]
    combinations: tuple[Combination, ...]
    rigid_rank: int
    peaks: Peaks

    @property
    def gained(self) -> float | None:
        """Information more than the median random draw's [nat]; None without draws."""
        return self.chosen.gain - float(np.median([d.gain for d in self.draws])) if self.draws else None

    @cached_property
    def ratios(self) -> Array | None:
        """By combination, median standard deviation over the random draws in units of the chosen motion's."""
        return np.median([d.std for d in self.draws], axis=0) / self.chosen.std if self.draws else None

    @property
    def median_ratio(self) -> float | None:
        """The median of `ratios`; None without draws."""
        return None if self.ratios is None else float(np.median(self.ratios))


@dataclass(frozen=True, eq=False)
class Peaks:
    """Extremes of a motion, (3,) each.

    Attributes:
        lower, upper: position [rad].
        velocity: magnitude [rad/s].
        acceleration: magnitude [rad/s²].
        torque: magnitude, as the prior model predicts [N·m].
        distance: least distance to trunk, other legs, itself and the ground [m]; from 0.1 m on a lower bound of it.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    torque: Array
    distance: float


def excite(
    robot: Robot,
    leg: str,
    settings: ExciteSettings | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Excitation:
    """Designs the excitation of one leg on a held trunk.

    Args:
        robot: with its limits and prior (CAD) model.
        leg: LF, RF, LH or RH.
        settings: None for the defaults.
        progress: called with what is being done, how much of it is done, and of how much.

    Raises:
        UnknownNameError: no such leg.
        ModelError: a robot without a nominal stance.
        IdentificationError: a leg that has no room to move, or stands too near the ground.
    """
    settings = settings or ExciteSettings()
    tell = progress or (lambda what, done, total: None)
    ground = None if settings.stand_height is None else -settings.stand_height
    bounds = LegBounds.of(robot, leg, margins=settings.margins, ground=ground)
    experiment = Experiment.usual(bounds, settings.rate)
    count = 1 if settings.random else settings.draws
    draws = []
    for k in range(count):
        tell("random draws", k, count)
        rng = np.random.default_rng((settings.seed, k))
        draws.append(paper_draw(robot, leg, rng, settings.duration, bounds))
    tell("random draws", count, count)
    if settings.random:
        return _appraised(experiment, settings, draws[0], [])
    best = optimal_excitation(
        experiment,
        np.random.default_rng(settings.seed),
        settings.duration,
        settings.search,
        lambda share: tell("search", round(100 * share), 100),
    )
    return _appraised(experiment, settings, best, draws)


def motion_table(robot: Robot, reference: Reference, whole: bool = True) -> Recording:
    """A motion as a table that a controller can play: position, velocity and acceleration of each joint over time.

    Args:
        robot: whose joints they are.
        reference: of some of its joints.
        whole: with the robot's other joints too, still at their nominal stance; else the reference's joints alone.
    """
    if not whole:
        motion, joints = reference.motion, reference.joints
    else:
        joints = robot.tree.joints
        columns = [joints.index(joint) for joint in reference.joints]
        position = np.tile(standing_configuration(robot), (len(reference), 1))
        velocity, acceleration = np.zeros_like(position), np.zeros_like(position)
        position[:, columns] = reference.position
        velocity[:, columns], acceleration[:, columns] = reference.velocity, reference.acceleration
        motion = JointMotion(position, velocity, acceleration)
    return Recording(
        reference.time,
        joints,
        motion.position,
        motion.velocity,
        motion.acceleration,
        source=f"excitation of {robot.name}",
    )


def _appraised(
    experiment: Experiment, settings: ExciteSettings, chosen: Sinusoids, draws: Sequence[Sinusoids]
) -> Excitation:
    rigid = replace(experiment, friction=FrictionModel())
    combinations = experiment.structure.combinations()
    gradients = _gradients(experiment.structure, combinations)
    prior_std = np.linalg.norm(gradients * experiment.prior.scales, axis=1)

    def appraise(motion: Sinusoids) -> Appraisal:
        reference = motion.sample(_LOOK_RATE)
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
        _peaks(chosen, experiment.bounds),
    )


def _gradients(seen: Observability, combinations: Sequence[Combination]) -> Array:
    """(combinations, parameters)."""
    out = np.zeros((len(combinations), len(seen.columns)))
    for row, combination in zip(out, combinations, strict=True):
        for name, factor in combination.terms:
            row[seen.columns.index(name)] = factor
    return out


def _peaks(chosen: Sinusoids, bounds: LegBounds) -> Peaks:
    motion = chosen.sample(_LOOK_RATE).motion
    return Peaks(
        motion.position.min(axis=0),
        motion.position.max(axis=0),
        np.abs(motion.velocity).max(axis=0),
        np.abs(motion.acceleration).max(axis=0),
        np.abs(bounds.torque(motion)).max(axis=0),
        float(bounds.clearance.distance(motion.position[::2]).min()),
    )
