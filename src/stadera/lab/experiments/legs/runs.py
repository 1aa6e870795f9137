"""The paper's offline experiment in simulation (section IV.A): HyQ's right hind leg, swinging on a held trunk."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stadera.body import FrictionModel
from stadera.excite.paper_draw import paper_draw
from stadera.excite.sinusoids import Sinusoids
from stadera.identify.legs import identify
from stadera.identify.prior import PriorWidth, positive_definite
from stadera.identify.result import Identification
from stadera.identify.settings import IdentifySettings
from stadera.lab.experiments.paper import ReproduceSettings
from stadera.lab.plant import STANDARD, Gains, measured, perturbed, perturbed_physical, simulate_leg
from stadera.logs import Recording
from stadera.logs.join import concatenate
from stadera.robot import load_robot
from stadera.robot.model import Robot

ROBOT, LEG = "hyq", "RH"
COM_STD, INERTIA_STD = 0.02, 0.02
"""The paper's perturbation of CAD: [m] and [kg·m²]."""


@dataclass(frozen=True)
class Size:
    """Duration of a log [s], and its sampling rate [Hz]."""

    duration: float
    rate: float

    def __str__(self) -> str:
        return f"{self.duration:g} s at {self.rate:g} Hz"


PAPER, QUICK = Size(180.0, 1000.0), Size(20.0, 250.0)


@dataclass(frozen=True, eq=False)
class LegRuns:
    """Random draws for one seed: two motions and two truths. Estimators only get the recordings and `cad`."""

    seed: int  # of the draws
    size: Size  # of every log

    @classmethod
    def of(cls, settings: ReproduceSettings) -> LegRuns:
        """The paper's size, or the quick one."""
        return cls(settings.seed, QUICK if settings.quick else PAPER)

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
        return paper_draw(self.cad, LEG, self._generator(2), self.size.duration)

    @cached_property
    def second_motion(self) -> Sinusoids:
        """Another draw, for validation."""
        return paper_draw(self.cad, LEG, self._generator(3), self.size.duration)

    def recorded(self, truth: Robot, motion: Sinusoids) -> Recording:
        """Exact position, velocity, acceleration and torque of a motion. Gains are computed from CAD."""
        return simulate_leg(truth, LEG, motion.sample(self.size.rate), gains=Gains.scaled(self.cad, LEG))

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
        usual = PriorWidth()
        thinnest = min(_thinnest(self.cad, link) for link in self.cad.leg(LEG).links)
        return replace(usual, shape=max(usual.shape, COM_STD / thinnest))


def one_after_another(first: Recording, second: Recording) -> Recording:
    """Joins two recordings; the second begins one sample after the end of the first."""
    later = first.time[-1] + (first.time[1] - first.time[0]) - second.time[0]
    return concatenate([first, replace(second, time=second.time + later)])


def _thinnest(robot: Robot, link: str) -> float:
    """A link's smallest radius of gyration [m]."""
    body = positive_definite(robot.inertias[link])
    second = body.shifted(-body.com).pseudo_inertia[:3, :3]
    return float(np.sqrt(np.linalg.eigvalsh(second).min() / body.mass))
