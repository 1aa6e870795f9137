"""The motion of a standing robot's trunk that tells most of a payload, within what the robot can do.

    minimise    Σ ln σ(payload's mass, centre x, y, z)             as `expected_bars` predicts them
    subject to  joints' positions, velocities and torques within their limits,
                every foot pressed to the ground and within its friction cone,

for the bare robot and for the heaviest load anywhere above its back. The path is a sum of two sinusoids for each
coordinate that moves, faded in and out. It is searched for by draws and then by steps from the best of them;
each is made as large as the bounds allow. All are compared under the same drawn errors, and the bars that are shown
come from other draws.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from itertools import product
from os import PathLike

import numpy as np

from stadera.errors import IdentificationError, require_positive
from stadera.excite.bounds import Margins
from stadera.excite.sinusoids import Sinusoids
from stadera.excite.trunk.planted import AXES, Drawn, PayloadBars, Planted, expected_bars
from stadera.excite.trunk.result import Routine
from stadera.inertia import InertialParameters
from stadera.robot.load import load_robot
from stadera.robot.model import Robot
from stadera.trunk.result import ObservedLimits
from stadera.types import Array, Progress


@dataclass(frozen=True)
class RoutineSettings:
    """Settings of a weighing routine."""

    seconds: float = 5.0  # from rest to rest [s]. It is done twice: without and with the load.
    rate: float = 100.0  # of the table, and of the log to be recorded [Hz]
    seed: int = 0  # of all draws
    # coordinates that move, of `AXES`; a robot's own body control may not have all. Over feet that stay, gravity tips a
    # trunk that is displaced, so on joints held by stiffness and damping x, y and yaw swing: at 0.8 Hz four simulated
    # robots move 1.1 to 3.1 times as far as asked, and slip; in roll, pitch and z 1.0 to 1.1 times.
    axes: tuple[str, ...] = ("roll", "pitch", "z")
    load: float = 0.1  # payload for which bars are predicted, share of the robot's mass [1]
    heaviest: float = 0.2  # payload with which the motion stays within the bounds, likewise
    angle: float = float(np.deg2rad(12.0))  # largest roll, pitch and yaw [rad]; at 15° two of eight loaded HyQs fell
    shift: float = 0.2  # largest x, y and z, share of the leg's length [1]
    # lowest and highest [Hz]. Faster ones are filtered by a robot's own body control, and joints held by stiffness
    # and damping exceed them: pitch by up to 9 % at 0.8 Hz, 25 % at 1.6, 52 % at 2.4 (four simulated robots).
    frequencies: tuple[float, float] = (0.3, 0.8)
    fade: float = 0.5  # at each end [s]
    margins: Margins = field(default_factory=Margins)  # from the joints' limits
    pressed: float = 0.3  # least normal force of a foot, share of the mean one [1]
    # largest tangential over normal force of a foot [1]: half of what rubber has on a dry floor, 0.6 and more, for
    # dust, a slope, and feet that push against each other
    cone: float = 0.3
    others: float = 0.3  # share of drawn motions in which a coordinate besides roll and pitch moves [1]
    # draws, steps: number of motions drawn, and of steps from the best
    draws: int = 12
    steps: int = 12
    drawn: int = 3  # number of robots drawn for the bars that are shown
    look_rate: float = 200.0  # sampling rate at which motions are compared [Hz]

    def __post_init__(self) -> None:
        names = ("seconds", "rate", "load", "heaviest", "angle", "shift", "fade", "pressed", "cone", "look_rate")
        require_positive("setting of a routine", self, (*names, "draws", "drawn"))
        if self.seconds < 4.0 * self.fade:
            raise IdentificationError(f"a routine lasts {4.0 * self.fade:g} s at least, got {self.seconds:g} s")
        if unknown := [axis for axis in self.axes if axis not in AXES]:
            raise IdentificationError(f"a routine's axes are of {', '.join(AXES)}, got {', '.join(unknown)}")


def weighing_routine(
    robot: Robot | str | PathLike[str], settings: RoutineSettings | None = None, progress: Progress | None = None
) -> Routine:
    """Designs the motion by which a standing robot weighs its payload best.

    Args:
        robot: a robot with a prior (CAD) model, its name, or a path to a URDF or MJCF.
        progress: called with the step's name, items done and total.

    Raises:
        ModelError: the model file cannot be read, or the robot has no nominal stance.
        IdentificationError: no motion is within the bounds.
    """
    robot, settings = load_robot(robot), settings or RoutineSettings()
    report = progress or (lambda what, done, total: None)
    rng = np.random.default_rng(settings.seed)
    search = _Search(robot, settings)
    drawn = Drawn(robot, np.random.default_rng((settings.seed, 0)))
    unobserved = ObservedLimits().com * robot.leg_length
    total = settings.draws + settings.steps + settings.drawn
    best: tuple[float, Array] | None = None
    for k in range(settings.draws + settings.steps):
        report("search", k, total)
        if k < settings.draws or best is None:
            x = search.drawn(rng)
        else:
            x = best[1] + 0.3 * rng.normal(size=best[1].shape) * np.abs(best[1])
        path = search.fitted(x)
        bars = None if path is None else search.bars(path, drawn)
        if bars is not None and (best is None or bars.score(unobserved) < best[0]):
            best = bars.score(unobserved), x
    if best is None:
        raise IdentificationError(f"no motion of {robot.name}'s trunk is within its bounds; allow less load or fade")
    chosen = search.fitted(best[1])
    assert chosen is not None
    found = []
    for k in range(settings.drawn):
        report("search", settings.draws + settings.steps + k, total)
        found.append(search.bars(chosen, Drawn(robot, np.random.default_rng((settings.seed, 1 + k)))))
    report("search", total, total)
    known = [bars for bars in found if bars is not None]
    if not known:
        raise IdentificationError(f"no motion of {robot.name}'s trunk determines a payload of {settings.load:.0%}")
    planted = Planted.of(robot, chosen, settings.rate)
    torque = np.max([np.abs(planted.torques(t)[0]).max(axis=0) for t in search.trunks], axis=0)
    return Routine(robot, settings, chosen, planted, torque, PayloadBars.median(known), settings.load * robot.mass)


@lru_cache(maxsize=64)
def undesigned_bars(robot: Robot, load: float) -> PayloadBars | None:
    """Error bars of a payload, `load` as a share of the robot's mass, to expect from five seconds of any sway within
    its bounds; a designed one is better. None if no sway of a few that were drawn determines it. Raises ModelError: the
    robot has no nominal stance.
    """
    search, rng = _Search(robot, RoutineSettings(load=load)), np.random.default_rng(0)
    for _ in range(3):
        path = search.fitted(search.drawn(rng))
        if path is not None and (bars := search.bars(path, Drawn(robot, rng))) is not None:
            return bars
    return None


@lru_cache(maxsize=64)
def bars_of_steps(robot: Robot, load: float, steps: int = 10) -> PayloadBars | None:
    """The same of slow steps, without and with the load; None if they do not determine it. Between draws of a Go2, a
    HyQ and a Solo 12 bars scatter by 10 to 20 %. Raises ModelError: the robot has no nominal stance.
    """
    drawn = Drawn(robot, np.random.default_rng(0))
    payload = _cube(load * robot.mass, (0.0, 0.0, 0.3 * robot.leg_length), robot.leg_length)
    try:
        return expected_bars(robot, Planted.stepping(drawn.true, steps, RoutineSettings().look_rate), payload, drawn)
    except IdentificationError:
        return None


class _Search:
    """Paths by their unknowns x (2, 6, 3): sine and cosine coefficients, and the places of their frequencies."""

    def __init__(self, robot: Robot, settings: RoutineSettings) -> None:
        self.robot, self.settings = robot, settings
        shift = settings.shift * robot.leg_length
        size = np.array([settings.angle] * 3 + [shift] * 3)
        self._size = size * [axis in settings.axes for axis in AXES]
        self._payload = _cube(settings.load * robot.mass, (0.0, 0.0, 0.3 * robot.leg_length), robot.leg_length)
        bare, hips = robot.inertias[robot.trunk], robot.hips
        corners = product(*(np.array([0.25, -0.25]) * np.ptp(hips[:, k]) + np.median(hips[:, k]) for k in (0, 1)))
        heaviest = settings.heaviest * robot.mass
        loads = (_cube(heaviest, (x, y, 0.3 * robot.leg_length), robot.leg_length) for x, y in corners)
        self.trunks = [bare, *(bare + load for load in loads)]

    def drawn(self, rng: np.random.Generator) -> Array:
        """Random unknowns: roll and pitch, which tell most, and some of the others."""
        size = rng.uniform(0.0, 1.0, 6) * (rng.uniform(size=6) < self.settings.others)
        size[:2] = 1.0
        swings = size[:, None] * rng.normal(size=(2, 6, 2))
        return np.concatenate([swings, rng.uniform(-1.0, 1.0, (2, 6, 1))], axis=2)

    def path(self, x: Array) -> Sinusoids:
        """The path of unknowns x; no coordinate exceeds its largest value."""
        settings = self.settings
        low, high = settings.frequencies
        amplitude = np.hypot(x[..., 0], x[..., 1]).T
        amplitude = self._size[:, None] * amplitude / np.maximum(amplitude.sum(axis=1), 1.0)[:, None]
        frequency = low + (high - low) * 0.5 * (1.0 + np.sin(0.5 * np.pi * x[..., 2]).T)
        return Sinusoids(
            joints=AXES,
            rest=np.zeros(6),
            origins=np.zeros((1, 6)),
            amplitudes=amplitude[None],
            frequencies=frequency[None],
            phases=np.arctan2(x[..., 1], x[..., 0]).T[None],
            starts=np.array([0.0, settings.seconds - settings.fade]),
            fade=settings.fade,
        )

    def fitted(self, x: Array) -> Sinusoids | None:
        """The path of unknowns x, as large as the bounds allow; None if even a small one is outside."""
        whole, least, most = self.path(x), 0.0, 1.0
        if self.within(whole):
            return whole
        for _ in range(5):
            middle = 0.5 * (least + most)
            least, most = (middle, most) if self.within(whole.drawn_in(middle)) else (least, middle)
        return whole.drawn_in(least) if least > 0.0 else None

    def within(self, path: Sinusoids) -> bool:
        """True if the robot can do it, bare and with the heaviest load."""
        robot, settings = self.robot, self.settings
        margins = settings.margins
        try:
            planted = Planted.of(robot, path, 0.5 * settings.look_rate)
        except IdentificationError:
            return False
        limits = [robot.limits[joint] for joint in robot.tree.joints]
        lower, upper, velocity, effort = np.array([[x.lower, x.upper, x.velocity, x.effort] for x in limits]).T
        q, speed = planted.motion.position, np.abs(planted.motion.velocity)
        room = np.minimum(margins.position, np.maximum(np.minimum(q[0] - lower, upper - q[0]), 0.0))
        if ((q < lower + room) | (q > upper - room)).any() or (speed > margins.velocity * velocity).any():
            return False
        up = planted.motion.normal[:, None]
        for trunk in self.trunks:
            torque, force = planted.torques(trunk)
            normal = (force * up).sum(axis=2)
            sliding = np.linalg.norm(force - normal[..., None] * up, axis=2)
            pressed = settings.pressed * normal.sum(axis=1, keepdims=True) / len(robot.legs)
            if (normal < pressed).any() or (sliding > settings.cone * normal).any():
                return False
            if (np.abs(torque) > margins.effort * effort).any():
                return False
        return True

    def bars(self, path: Sinusoids, drawn: Drawn) -> PayloadBars | None:
        """The payload's expected error bars, None if it is not determined."""
        try:
            planted = Planted.of(drawn.true, path, self.settings.look_rate)
            return expected_bars(self.robot, planted, self._payload, drawn)
        except IdentificationError:
            return None


def _cube(mass: float, place: tuple[float, float, float], length: float) -> InertialParameters:
    """A payload of half the leg's length, in trunk axes."""
    return InertialParameters.from_com(mass, place, mass * (0.5 * length) ** 2 / 6.0 * np.eye(3))
