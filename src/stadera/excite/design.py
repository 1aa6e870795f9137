"""Designs an excitation and compares it with the paper's random draws: the computation behind `stadera excite`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from stadera.body import FrictionModel, JointMotion
from stadera.errors import IdentificationError, positive, require_positive
from stadera.excite.bounds import LegBounds, Margins
from stadera.excite.optimise import FourierSearch, optimal_excitation
from stadera.excite.result import Appraisal, Excitation, Peaks
from stadera.excite.sinusoids import Reference, Sinusoids, check_duration
from stadera.excite.worth import LegExperiment
from stadera.identify.observability import gradients_of
from stadera.logs import Recording
from stadera.robot.load import load_robot
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration

if TYPE_CHECKING:
    from stadera.lab.laws.paper_draw import DrawSettings


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
        draw: settings of the paper's draws that the paper does not state; None for the defaults.
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
    draw: DrawSettings | None = None
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
        draws.append(paper_draw(robot, leg, rng, settings.duration, bounds, settings.draw))
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
    """Converts a motion to a table for a controller: position, velocity and acceleration of each joint over time; if
    `whole`, with the robot's other joints at rest in the nominal stance.
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
        _peaks(chosen, experiment.bounds, settings.look_rate),
    )


def _peaks(chosen: Sinusoids, bounds: LegBounds, rate: float) -> Peaks:
    motion = chosen.sample(rate).motion
    return Peaks(
        motion.position.min(axis=0),
        motion.position.max(axis=0),
        np.abs(motion.velocity).max(axis=0),
        np.abs(motion.acceleration).max(axis=0),
        np.abs(bounds.torque(motion)).max(axis=0),
        float(bounds.clearance.distance(motion.position[::2]).min()),
    )
