"""Legs that swing in the air with the trunk held level: a log for identifying the legs of a run's robot.

Each leg follows one of the paper's random draws, two and a half times as fast, so that rotor inertia is observable. The
legs move simultaneously: on a held trunk they do not affect each other, and nothing collides in this plant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stadera.errors import IdentificationError
from stadera.excite.bounds import LegBounds, fitting_factor
from stadera.excite.sinusoids import Sinusoids
from stadera.lab.laws.paper_draw import paper_draw
from stadera.lab.plant import Gains, measured, plant_model, simulate_leg
from stadera.lab.plant.friction import VaryingFriction
from stadera.lab.reality import TrueMotion, drawn, measured_log
from stadera.lab.scenarios.catalog import DEFAULTS, SWING
from stadera.lab.scenarios.run import PERIOD, Run
from stadera.lab.scenarios.settings import SimulateSettings
from stadera.lab.truth import Truth, TruthAt
from stadera.logs import Recording
from stadera.robot.model import Robot
from stadera.types import Progress

ALL = "all"


def swing(
    robot: Robot, leg: str = ALL, settings: SimulateSettings | None = None, progress: Progress | None = None
) -> Run:
    """Swings one leg of the model file's robot, or all at once, with the settings' errors, duration, rate and seed. The
    same seed draws the same robot as for a run on the ground.
    """
    settings = settings or SimulateSettings()
    draw = drawn(robot, settings.real_sizes, settings.seed) if settings.real_sizes else None
    real = draw.robot if draw else plant_model(robot, settings.sensor_errors)
    friction = draw.varying.friction if draw and draw.varying else None
    swings = _swings(robot, real, leg, settings, progress or (lambda *_: None), friction)
    every = round(1.0 / (settings.rate or draw.rate) / PERIOD) if draw else settings.every
    exact, trunk = _merged(swings, every), real.inertias[real.trunk]
    truth = Truth(
        robot=robot.name,
        scenario=SWING,
        errors=settings.errors,
        seed=settings.seed,
        slope=0.0,
        stiffness=(),
        moments=(TruthAt.of(0.0, trunk, trunk),),
        drawn=draw.to_dict() if draw else None,
    )
    if draw is None:
        return Run(measured(exact, robot, settings.sensor_errors, settings.seed), truth, exact, robot)
    motion, source = TrueMotion.held(_merged(swings)), f"simulated {robot.name}, {SWING}"
    return Run(measured_log(motion, robot, draw, settings.seed, settings.rate, source), truth, exact, robot)


def _swings(
    robot: Robot,
    real: Robot,
    leg: str,
    settings: SimulateSettings,
    progress: Progress,
    friction: VaryingFriction | None,
) -> list[Recording]:
    """Exact recordings of the legs, one sample per millisecond."""
    every = [one.name for one in robot.legs]
    names = every if leg.lower() == ALL else [robot.leg(leg).name]
    swings = []
    for k, name in enumerate(names):
        progress("swinging", k, len(names))
        rng = np.random.default_rng((settings.seed, every.index(name)))
        motion = _brisk(robot, name, rng, settings.duration or DEFAULTS.swing).sample(1.0 / PERIOD)
        own = [robot.tree.joints.index(joint) for joint in robot.leg(name).joints]
        held = friction.of(own) if friction else None
        swings.append(simulate_leg(real, name, motion, gains=Gains.scaled(robot, name), friction=held))
    return swings


def _brisk(robot: Robot, leg: str, rng: np.random.Generator, duration: float) -> Sinusoids:
    """The paper's draw, faster, and scaled towards the rest pose if speeds or torques would be too large.

    If the path to the rest pose is not clear (a draw on the far side of the trunk), another one is drawn.
    """
    for left in reversed(range(DEFAULTS.draws)):
        try:
            draw = paper_draw(robot, leg, rng, duration)
            faster = replace(draw, frequencies=DEFAULTS.faster * draw.frequencies)
            return faster.drawn_in(fitting_factor(faster, LegBounds.of(robot, leg)))
        except IdentificationError:
            if not left:
                raise
    raise AssertionError("unreachable: the last draw returns or raises")


def _merged(swings: Sequence[Recording], every: int = 1) -> Recording:
    """Merges simultaneous recordings of different joints into one, keeping every n-th sample."""
    first = swings[0]
    joints = tuple(joint for swing in swings for joint in swing.joints)

    def joined(name: str) -> np.ndarray:
        return np.hstack([swing.channel(name, swing.joints) for swing in swings])[::every]

    return Recording(
        time=first.time[::every],
        joints=joints,
        position=joined("position"),
        velocity=joined("velocity"),
        acceleration=joined("acceleration"),
        effort=joined("effort"),
        source=first.source,
    )
