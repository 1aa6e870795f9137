"""How a crawl is walked: what is commanded, and sizes and times scaled from the robot itself."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import StaderaError, UnknownNameError
from stadera.legs.model import foot_positions
from stadera.robot.model import LEG_NAMES, Robot
from stadera.robot.stance import standing_configuration

LATERAL_SEQUENCE = ("LH", "LF", "RH", "RF")
"""Hind foot, then the front foot of the same side: the order that needs least sway."""


class CrawlError(StaderaError):
    """A crawl was asked for that cannot be walked."""


@dataclass(frozen=True)
class CrawlCommand:
    """Where to walk.

    Attributes:
        speed: [m/s], ahead, negative for backwards; along the ground's horizontal projection.
        turn: [rad/s], to the left.
    """

    speed: float = 0.1
    turn: float = 0.0

    def __post_init__(self) -> None:
        if not np.isfinite([self.speed, self.turn]).all():
            raise CrawlError(f"a crawl's speed and turn must be finite, got {self.speed} m/s and {self.turn} rad/s")


@dataclass(frozen=True)
class CrawlTuning:
    """Shares and counts of a crawl, the same for all robots; chosen on the four robots of the tests.

    Attributes:
        swing_share: of a step, at most, that the leg swings.
        transfer_share: of the rest, at most, that taking the load off takes.
        restless: power of the time for body motion, by which rest counts less where that is short.
        shortest: share of a swing's time to which it may be shortened.
        planned: steps that are planned ahead.
        least_body: share of a body motion's time that it has after a late landing.
        earliest: share of a swing after which a touch counts.
        longest_airborne: that a plan holds the body over three feet, for a leg that may be long in the air [s].
        moved: of the margin, by which the modelled centre of mass may have moved since the plan.
        delays: of the lead, that a step may be delayed for a new model; the least that is enough is taken.
        sitting: height of a sitting trunk, as a share of the standing one.
        sit_time: of the lead, that sitting down takes.
        follows: share of the way to the ground's inclination that one step takes.
        looks: at a plan, over the time that a leg is off the ground.
        stretched: share of |det J| in the nominal stance, below which a leg is stretched out.
    """

    swing_share: float = 0.6
    transfer_share: float = 0.35
    restless: int = 4
    shortest: float = 0.5
    planned: int = 4
    least_body: float = 0.7
    earliest: float = 0.5
    longest_airborne: float = 5.0
    moved: float = 0.2
    delays: tuple[float, ...] = (0.0, 0.25, 0.5, 1.0)
    sitting: float = 0.45
    sit_time: float = 3.0
    follows: float = 0.5
    looks: int = 8
    stretched: float = 0.35


@dataclass(frozen=True)
class CrawlSettings:
    """Sizes and times of a crawl.

    Attributes:
        sequence: the four legs in the order in which they swing.
        cycle: [s], of four steps, at low speed; the stride is what the speed makes of it,
        longest_stride: [m], up to so much: faster walks have shorter cycles.
        swing: [s], of a leg's swing; shorter in cycles that are shorter than it takes.
        transfer: [s], for taking the load off a foot, and as much for putting it on.
        clearance: [m], of a swinging foot over the higher of its two footholds.
        press: [m], below the expected ground at which a swing ends, so that the foot meets the ground moving.
        search: [m], how far below the expected height a foot feels for the ground, at
        search_speed: [m/s].
        margin: [m], that centre of mass and zero-moment point are to keep to the support polygon's edges.
        least_margin: [m], of the modelled centre of mass to the coming triangle's edges, below which no foot is lifted.
        unhurried: [s], of body motion before a step, from which on the body rests while a leg swings; with less time it
            rests less and less, for the sake of smaller accelerations.
        patience: [s], for which a step waits for that, before the crawl stops.
        lead: [s], that the body has before the first step from a stand.
        tuning: see `CrawlTuning`.

    Raises:
        CrawlError: a sequence that is not each leg once, a size or time that is not positive.
    """

    cycle: float
    longest_stride: float
    swing: float
    transfer: float
    clearance: float
    press: float
    search: float
    search_speed: float
    margin: float
    least_margin: float
    lead: float
    unhurried: float
    patience: float = 3.0
    sequence: tuple[str, ...] = LATERAL_SEQUENCE
    tuning: CrawlTuning = field(default_factory=CrawlTuning)

    def __post_init__(self) -> None:
        for name in (size.name for size in fields(self) if size.name not in ("sequence", "tuning")):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise CrawlError(f"a crawl's {name} must be positive, got {value}")
        for name in self.sequence:
            if name not in LEG_NAMES:
                raise UnknownNameError("leg", name, LEG_NAMES)
        if sorted(self.sequence) != sorted(LEG_NAMES):
            raise CrawlError(f"a crawl's sequence has each leg once, got {', '.join(self.sequence)}")

    @classmethod
    def of(cls, robot: Robot) -> CrawlSettings:
        """Scaled from the height h of the hips over the feet and the time √(h / g) in which a body of that height falls
        over.
        """
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
        """Of a command.

        Raises:
            CrawlError: a speed for which there is no time to move the body.
        """
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
    """Times of a step, on the average of a cycle.

    Attributes:
        step: [s], all of it. swing: [s], of the leg. transfer: [s], of its load, before the swing and after it.
        rest: how much it counts that the body rests in swings, up to 1.
    """

    step: float
    swing: float
    transfer: float
    rest: float = 1.0

    @property
    def body(self) -> float:
        """[s], in which four feet are on the ground."""
        return self.step - self.swing


def standing_height(robot: Robot) -> float:
    """Height of the hips over the feet's centres in the nominal stance [m]."""
    feet = foot_positions(robot, standing_configuration(robot)[None])[0]
    hips = [robot.tree.translations[robot.tree.joints.index(leg.joints[0])][2] for leg in robot.legs]
    return float(np.mean(hips) - feet[:, 2].mean())
