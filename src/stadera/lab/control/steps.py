"""Steps of a crawl: their sizes and times, footholds along the path, and the supports through which the body moves.

The body's path is an arc: with speed v and turn rate r its pose (x, y, ψ) obeys ẋ = v cos ψ, ẏ = v sin ψ, ψ̇ = r. Each
foot has a nominal position relative to the path's pose. A foot stays in place for the next three steps after landing,
so it is placed at its nominal position in the middle of that time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import StaderaError
from stadera.lab.control.com_plan import SupportPhase, SupportPolygon, plan_com
from stadera.robot.model import LEG_NAMES, Robot
from stadera.robot.stance import nominal_feet
from stadera.types import Array


@dataclass(frozen=True)
class CrawlCommand:
    """Desired motion."""

    speed: float = 0.1  # [m/s], ahead, negative for backwards; along the ground's horizontal projection
    turn: float = 0.0  # [rad/s], to the left


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


@dataclass(frozen=True)
class CrawlSettings:
    """Sizes and times of a crawl, scaled from the robot, and dimensionless settings, the same for all robots, chosen on
    the four robots of the tests.
    """

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
    # the legs in the order in which they swing: hind, then front of the same side, which needs least sway
    sequence: tuple[str, ...] = ("LH", "LF", "RH", "RF")
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
    follows: float = 0.5  # share of a change of the ground's inclination followed in one step
    looks: int = 8  # number of evaluations of a plan while a leg is off the ground
    stretched: float = 0.35  # share of |det J| in the nominal stance below which a leg counts as extended
    overload: float = 0.5  # time at its torque limit after which a joint is overloaded [s]

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
        speed = abs(command.speed)
        cycle = min(self.cycle, self.longest_stride / speed) if speed > 0 else self.cycle
        step = 0.25 * cycle
        swing = min(self.swing, self.swing_share * step)
        transfer, rest = min(self.transfer, self.transfer_share * (step - swing)), (step - swing) / self.unhurried
        if swing < self.shortest * self.swing:
            fastest = self.swing_share * self.longest_stride / (4.0 * self.shortest * self.swing)
            raise StaderaError(
                f"a crawl of {speed:.3g} m/s is too fast for this robot, the fastest is {fastest:.3g} m/s"
            )
        return StepTiming(step, swing, transfer, min(rest, 1.0) ** self.restless)


def standing_height(robot: Robot) -> float:
    """Height of the hips above the feet's centres in the nominal stance [m]."""
    return float(robot.hips[:, 2].mean() - nominal_feet(robot)[:, 2].mean())


@dataclass(frozen=True, eq=False)
class PathPose:
    """A pose of the path, seen from above, in the odometry frame: (2,) [m], and the heading [rad]."""

    position: Array
    heading: float

    def ahead(self, speed: float, turn: float, time: float) -> PathPose:
        """The pose on the path after a time [s], along the chord of the arc."""
        angle = turn * time
        chord = speed * time * float(np.sinc(0.5 * angle / np.pi))
        direction = self.heading + 0.5 * angle
        step = chord * np.array([np.cos(direction), np.sin(direction)])
        return PathPose(self.position + step, self.heading + angle)

    def place(self, offset: Array) -> Array:
        """Transforms a point (2,) [m] relative to the pose to the odometry frame."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        return np.asarray(self.position + np.array([[c, -s], [s, c]]) @ offset)


def footholds(feet: Array, heading: float) -> tuple[Array, PathPose]:
    """Nominal positions (4, 2) [m] ahead and to the left of a path's pose that starts in the middle of the feet."""
    middle = feet[:, :2].mean(axis=0)
    c, s = np.cos(heading), np.sin(heading)
    return (feet[:, :2] - middle) @ np.array([[c, -s], [s, c]]), PathPose(middle, heading)


@dataclass(frozen=True, eq=False)
class Step:
    """A coming step, or a leg in the air or just landed: index of the leg, its foothold (2,) [m], and the time before
    it lifts, or its remaining time [s].
    """

    leg: int
    target: Array
    time: float


class StepSequence:
    """The steps of a crawl along its path; `timing` is that of the command."""

    def __init__(self, robot: Robot, settings: CrawlSettings, command: CrawlCommand) -> None:
        self._settings, self._height = settings, standing_height(robot)
        self._order = tuple(LEG_NAMES.index(name) for name in settings.sequence)
        self._turn = 0
        self._offsets, self._path = footholds(nominal_feet(robot), 0.0)
        self.timing: StepTiming
        self.command = command

    @property
    def command(self) -> CrawlCommand:
        """Desired motion."""
        return self._command

    @command.setter
    def command(self, command: CrawlCommand) -> None:
        settings = self._settings
        self.timing, self._command = settings.timing(command), command
        stride = abs(command.speed) * 4.0 * self.timing.step
        self._body_times = body_times(self._offsets, self._order, stride, self.timing, self._height, settings.margin)

    def start(self, feet: Array, heading: float) -> None:
        """Starts the path in the middle of the feet (4, 3) [m], with a heading [rad]."""
        self._offsets, self._path = footholds(feet, heading)

    @property
    def leg(self) -> int:
        return self._order[self._turn % 4]

    @property
    def target(self) -> Array:
        """Foothold of the next leg, (2,) [m]."""
        return self._target(self._turn, self._next(self._path))

    @property
    def heading(self) -> float:
        """Heading of the path at its landing [rad]."""
        return self._next(self._path).heading

    def done(self) -> None:
        """Advances to the next leg after a landing."""
        self._path, self._turn = self._next(self._path), self._turn + 1

    def body_time(self, late: float) -> float:
        """Time for the body's motion before the next swing [s], shorter after a late landing."""
        body = float(self._body_times[self._turn % 4])
        return max(body - late, self._settings.least_body * body, 2.0 * self.timing.transfer)

    def ahead(self, body: float) -> list[Step]:
        """The next steps, the first after a body motion of `body` [s]."""
        steps, path = [], self._path
        for turn in range(self._turn, self._turn + self._settings.planned):
            path = self._next(path)
            before = body if turn == self._turn else float(self._body_times[turn % 4])
            steps.append(Step(self._order[turn % 4], self._target(turn, path), before))
        return steps

    def _next(self, path: PathPose) -> PathPose:
        return path.ahead(self._command.speed, self._command.turn, self.timing.step)

    def _target(self, turn: int, path: PathPose) -> Array:
        """Foothold for the path's pose at landing; one and a half steps later its stance is half over."""
        middle = path.ahead(self._command.speed, self._command.turn, 1.5 * self.timing.step)
        return middle.place(self._offsets[self._order[turn % 4]])


def support_phases(
    feet: Array, steps: Sequence[Step], timing: StepTiming, margin: float, stand: float, airborne: Step | None = None
) -> list[SupportPhase]:
    """The phases from now on, ending with a stand of `stand` [s] on four feet.

    While a foot is being unloaded or loaded, only the other three count as support. `feet`: (4, 2) [m]; that of an
    airborne one is ignored. `margin` [m]: of the goals within the triangles.
    """
    feet, phases = np.array(feet[:, :2]), []
    landed = 0.0
    if airborne is not None:
        phases.append(_on_three(feet, airborne.leg, airborne.target, max(airborne.time, timing.least), margin))
        feet[airborne.leg] = airborne.target
        landed = timing.transfer
    for step in steps:
        duration = max(2.0 * timing.transfer + timing.swing, timing.least)
        swing = _on_three(feet, step.leg, step.target, duration, margin)
        before = max(step.time - timing.transfer - landed, timing.least)
        phases += [SupportPhase(before, SupportPolygon.of(feet), swing.goal, rests=False), swing]
        feet[step.leg] = step.target
        landed = timing.transfer
    phases.append(SupportPhase(stand, SupportPolygon.of(feet), feet.mean(axis=0), rests=False))
    return phases


def body_times(
    offsets: Array, sequence: Sequence[int], stride: float, timing: StepTiming, height: float, margin: float
) -> Array:
    """Time for the body before each step of the sequence, (4,) [s]: more if it has farther to go.

    Two cycles straight ahead are planned with equal times, and the distances between swings are evaluated: distances d
    in times T with equal peak accelerations have T ∝ √d. The mean of the times is the timing's; none is shorter than
    the transfers of load. Nominal positions of the feet (4, 2), stride of a cycle, height of the centre of mass over
    the feet and margin in [m].
    """
    least = min(2.0 * timing.transfer + timing.least, timing.body)
    feet, steps = np.array(offsets), []
    for k, leg in enumerate(sequence):  # as if the robot had been walking: the last to land is the farthest ahead
        feet[leg, 0] += (k - 1.5) * 0.25 * stride
    for k, leg in enumerate(2 * tuple(sequence)):
        steps.append(Step(leg, feet[leg] + np.array([(k // 4 + 1) * stride, 0.0]), timing.body))
    start = np.zeros((3, 2))
    start[0] = feet.mean(axis=0)
    phases = support_phases(feet, steps, timing, margin, timing.step)
    plan = plan_com(0.0, start, phases, height, margin, timing.rest)
    swings = timing.body + 0.5 * timing.swing + timing.step * np.arange(3, 8)
    ways = np.diff([plan.at(time)[0] for time in swings], axis=0)  # to the swings 4, 5, 6, 7: a whole cycle
    weights = np.sqrt(np.linalg.norm(ways, axis=1))
    return np.asarray(least + 4.0 * (timing.body - least) * weights / weights.sum())


def _on_three(feet: Array, leg: int, target: Array, duration: float, margin: float) -> SupportPhase:
    """The phase on the other three feet; the goal is the point in their triangle nearest to the middle of all four."""
    triangle = SupportPolygon.of(np.delete(feet, leg, axis=0))
    middle = feet.mean(axis=0) + 0.125 * (target - feet[leg])  # half-way through the swing
    return SupportPhase(duration, triangle, triangle.goal(middle, margin), rests=True)
