"""Settings of a crawl: the command, and sizes and times scaled from the robot; its phases and events."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import StrEnum

import numpy as np

from stadera.body.statics import nominal_feet
from stadera.constants import GRAVITY
from stadera.errors import StaderaError, UnknownNameError, positive
from stadera.robot.model import LEG_NAMES, Robot

LATERAL_SEQUENCE = ("LH", "LF", "RH", "RF")
"""Hind foot, then the front foot of the same side: the sequence that needs least sway."""


class CrawlError(StaderaError):
    """The requested crawl is impossible."""


@dataclass(frozen=True)
class CrawlCommand:
    """Desired motion."""

    speed: float = 0.1  # [m/s], ahead, negative for backwards; along the ground's horizontal projection
    turn: float = 0.0  # [rad/s], to the left

    def __post_init__(self) -> None:
        if not np.isfinite([self.speed, self.turn]).all():
            raise CrawlError(f"a crawl's speed and turn must be finite, got {self.speed} m/s and {self.turn} rad/s")


@dataclass(frozen=True)
class CrawlTuning:
    """Dimensionless settings of a crawl, the same for all robots; chosen on the four robots of the tests."""

    swing_share: float = 0.6  # largest share of a step for the leg's swing
    transfer_share: float = 0.35  # largest share of the rest for unloading the foot
    restless: int = 4  # exponent with which rest of the body is weighted less if there is little time
    shortest: float = 0.5  # share of its time to which a swing may be shortened
    planned: int = 4  # number of steps planned ahead
    least_body: float = 0.7  # share of its time that a body motion keeps after a late landing
    earliest: float = 0.5  # share of a swing after which a touch is accepted
    # time for which a plan keeps the body over three feet [s], for a leg that may stay in the air
    longest_airborne: float = 5.0
    # change of the modelled centre of mass since the plan, as a share of the margin, that causes a new plan
    moved: float = 0.2
    # delays of a step for a new model, as shares of the lead, in increasing order
    delays: tuple[float, ...] = (0.0, 0.25, 0.5, 1.0)
    sitting: float = 0.45  # height of a sitting trunk, as a share of the standing one
    sit_time: float = 3.0  # time for sitting down, as a share of the lead
    follows: float = 0.5  # share of a change of the ground's inclination followed in one step
    looks: int = 8  # number of evaluations of a plan while a leg is off the ground
    stretched: float = 0.35  # share of |det J| in the nominal stance below which a leg counts as extended


@dataclass(frozen=True)
class CrawlSettings:
    """Sizes and times of a crawl."""

    cycle: float  # [s], of four steps, at low speed; the stride follows from the speed,
    longest_stride: float  # [m], up to this length: faster walks have shorter cycles
    swing: float  # [s], of a leg's swing; less in short cycles
    transfer: float  # [s], for unloading a foot, and for loading it
    clearance: float  # [m], of a swinging foot above the higher of its two footholds
    press: float  # [m], below the expected ground at which a swing ends, so that the foot is moving at touch-down
    search: float  # [m], distance below the expected height over which a foot searches for the ground, at
    search_speed: float  # [m/s]
    margin: float  # [m], of centre of mass and zero-moment point to the support polygon's edges
    least_margin: float  # [m], of the modelled centre of mass in the coming triangle, below which no foot is lifted
    lead: float  # [s], for the body before the first step from a stand
    # [s], of body motion before a step above which the body rests while a leg swings; with less time it rests less,
    # which reduces accelerations
    unhurried: float
    patience: float = 3.0  # [s], time limit for that before the crawl stops
    sequence: tuple[str, ...] = LATERAL_SEQUENCE  # the four legs in the order in which they swing
    tuning: CrawlTuning = field(default_factory=CrawlTuning)

    def __post_init__(self) -> None:
        for name in (size.name for size in fields(self) if size.name not in ("sequence", "tuning")):
            value = getattr(self, name)
            positive(f"a crawl's {name}", value, error=CrawlError)
        for name in self.sequence:
            if name not in LEG_NAMES:
                raise UnknownNameError("leg", name, LEG_NAMES)
        if sorted(self.sequence) != sorted(LEG_NAMES):
            raise CrawlError(f"a crawl's sequence has each leg once, got {', '.join(self.sequence)}")

    @classmethod
    def of(cls, robot: Robot) -> CrawlSettings:
        """Settings scaled from the hips' height h above the feet and √(h / g), in which such a body topples."""
        height = standing_height(robot)
        time = float(np.sqrt(height / GRAVITY))
        return cls(
            cycle=13.0 * time,
            longest_stride=0.6 * height,
            swing=1.4 * time,
            transfer=0.25 * time,
            clearance=0.12 * height,
            press=0.01 * height,
            search=0.25 * height,
            search_speed=0.08 * height / time,
            margin=0.04 * height,
            least_margin=0.01 * height,
            lead=3.0 * time,
            unhurried=1.7 * time,
        )

    def timing(self, command: CrawlCommand) -> StepTiming:
        """Times of the steps for a command."""
        speed, how = abs(command.speed), self.tuning
        cycle = min(self.cycle, self.longest_stride / speed) if speed > 0 else self.cycle
        step = 0.25 * cycle
        swing = min(self.swing, how.swing_share * step)
        transfer, rest = min(self.transfer, how.transfer_share * (step - swing)), (step - swing) / self.unhurried
        timing = StepTiming(step, swing, transfer, min(rest, 1.0) ** how.restless)
        if swing < how.shortest * self.swing:
            fastest = how.swing_share * self.longest_stride / (4.0 * how.shortest * self.swing)
            raise CrawlError(f"a crawl of {speed:.3g} m/s is too fast for this robot, the fastest is {fastest:.3g} m/s")
        return timing


@dataclass(frozen=True)
class StepTiming:
    """Times of a step, averaged over a cycle."""

    step: float  # [s], total
    swing: float  # [s], of the leg
    transfer: float  # [s], for unloading before the swing, and for loading after it
    rest: float = 1.0  # weight of the body's rest during swings, up to 1
    least: float = 0.02  # [s], of a phase of the plan

    @property
    def body(self) -> float:
        """Time with four feet on the ground [s]."""
        return self.step - self.swing


def standing_height(robot: Robot) -> float:
    """Height of the hips above the feet's centres in the nominal stance [m]."""
    return float(robot.hips[:, 2].mean() - nominal_feet(robot)[:, 2].mean())


class CrawlPhase(StrEnum):
    """Phase of a crawl."""

    STAND = "stand"
    BODY = "body motion"
    SWING = "swing"
    RETREAT = "retreat"
    SIT = "sit"


@dataclass(frozen=True)
class CrawlEvent:
    """A transition: time [s], the phase that begins, the leg concerned (or None), and the reason."""

    time: float
    phase: CrawlPhase
    leg: str | None
    reason: str
