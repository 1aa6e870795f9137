"""Excitation of a leg on a held trunk: the paper's random draw, and what any motion is worth.

Section IV of the paper, as read here. Each joint follows one sinusoid at a time; its frequency, amplitude and phase are
drawn anew, uniformly, for every position of the origin: 0.3 to 0.9 Hz, zero to (0.25, 0.20, 0.40) rad for HAA, HFE,
KFE, 0 to π. The origins are poses chosen for the largest shift of the gravity torque: over a grid of the poses that
leave room for the full amplitude, each next one is that whose gravity torque, by the CAD model and each joint's in
units of its spread, lies farthest from all those taken before, the rest pose first (farthest-point sampling). How many
origins, and how long between, the paper does not say: six here, equally long, two seconds of fade from one to the next.
On other robots amplitudes keep the share that the paper's have of HyQ's joint ranges (95°, 120°, 120°).
"""

from __future__ import annotations

import numpy as np

from stadera.errors import IdentificationError
from stadera.excite.bounds import LegBounds
from stadera.excite.sinusoids import Sinusoids
from stadera.robot.model import Robot
from stadera.types import Array, Bools

FREQUENCIES = (0.3, 0.9)
"""The paper's band [Hz]."""

_AMPLITUDE_SHARES = np.array([0.25, 0.20, 0.40]) / np.deg2rad([95.0, 120.0, 120.0])
_LARGEST_SHARE = 0.25  # of the reach, so that there is room to shift origins
_ORIGINS = 6
_SHORTEST_SEGMENT = 10.0  # s, so that one origin sees a few periods of the slowest sinusoid
_FADE = 2.0  # s
_CANDIDATES = 9  # origins tried along each joint
_CHOICE = 8  # candidates for every origin wanted, at least, where few are clear
_CHECK_RATE = 100.0  # Hz
_DRAW_IN = 0.99
_SHORTEST = 2.0  # s
_ROUNDING = 1e-9


def paper_draw(
    robot: Robot,
    leg: str,
    rng: np.random.Generator,
    duration: float = 180.0,
    bounds: LegBounds | None = None,
) -> Sinusoids:
    """The paper's random sinusoids (see the module), within bounds.

    Args:
        robot: with its limits and prior (CAD) model.
        leg: LF, RF, LH or RH.
        rng: source of the draw; the same state gives the same motion.
        duration: from rest to rest [s].
        bounds: None for `LegBounds.of(robot, leg)`. A draw that breaks them is drawn in towards the rest pose until it
            fits.

    Raises:
        UnknownNameError: no such leg.
        IdentificationError: a duration under two seconds.
    """
    bounds = bounds or LegBounds.of(robot, leg)
    check_duration(duration)
    count = int(np.clip(duration // _SHORTEST_SEGMENT, 1, _ORIGINS))
    fade = min(_FADE, duration / (2 * count + 1))
    shape = (count, 3, 1)
    largest = np.minimum(_AMPLITUDE_SHARES * bounds.ranges, _LARGEST_SHARE * (bounds.upper - bounds.lower))
    frequencies = rng.uniform(*FREQUENCIES, shape)
    phases = rng.uniform(0.0, np.pi, shape)
    amplitudes = rng.uniform(0.0, 1.0, shape) * largest[:, None]
    origins = gravity_shifting_poses(bounds, largest, count)
    starts = np.linspace(0.0, duration - fade, count + 1)
    draw = Sinusoids(bounds.joints, bounds.rest, origins, amplitudes, frequencies, phases, starts, fade)
    return draw.drawn_in(fitting_factor(draw, bounds))


def gravity_shifting_poses(bounds: LegBounds, room: Array, count: int) -> Array:
    """Poses with the most different gravity torques, (count, 3) [rad], `room` (3,) inside the position bounds."""
    axes = [
        np.linspace(low, high, _CANDIDATES) for low, high in zip(bounds.lower + room, bounds.upper - room, strict=True)
    ]
    poses = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    torque = bounds.gravity_torque(poses)
    held = (np.abs(torque) <= bounds.effort).all(axis=1)
    if not held.any():
        raise IdentificationError(f"leg {bounds.leg}: no pose in reach can be held within the torque bounds")
    poses, torque = poses[held], torque[held]
    clear = _most_clear(poses, room, bounds, _CHOICE * count)
    poses, torque = poses[clear], torque[clear]
    spread = np.where(np.ptp(torque, axis=0) > 0, torque.std(axis=0), 1.0)
    torque = torque / spread
    nearest = np.linalg.norm(torque - bounds.gravity_torque(bounds.rest[None]) / spread, axis=1)
    chosen = []
    for _ in range(count):
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(torque - torque[chosen[-1]], axis=1))
    return np.asarray(poses[chosen])


def _most_clear(poses: Array, room: Array, bounds: LegBounds, least: int) -> Bools:
    """Which poses are clear with `room` about them; if those are fewer than `least`, the nearest to it."""
    about = np.stack(np.meshgrid(*([(-1.0, 0.0, 1.0)] * 3), indexing="ij"), axis=-1).reshape(-1, 3) * room
    slack = bounds.clearance_map.slack((poses[:, None] + about).reshape(-1, 3)).reshape(len(poses), -1).min(axis=1)
    return np.asarray(slack >= min(0.0, np.sort(slack)[-min(least, len(slack))]))


def fitting_factor(motion: Sinusoids, bounds: LegBounds) -> float:
    """How far the motion must be drawn in towards the rest pose to be within the bounds; 1 if it is.

    Raises:
        IdentificationError: not even the rest pose is within the bounds.
    """
    factor = 1.0
    while not _fits(motion.drawn_in(factor), bounds):
        factor *= _DRAW_IN
        if factor < 0.01:
            raise IdentificationError(f"leg {bounds.leg}: the rest pose itself is out of bounds")
    return factor


def _fits(motion: Sinusoids, bounds: LegBounds) -> bool:
    """Cheapest tests first."""
    samples = motion.sample(_CHECK_RATE).motion
    if bounds.excess(samples) > _ROUNDING:
        return False
    return all(bounds.clearance.slack(samples.position[::every]).min() >= -_ROUNDING for every in (20, 2))


def check_duration(duration: float) -> None:
    """Raises IdentificationError for a duration no motion fits into."""
    if not (np.isfinite(duration) and duration >= _SHORTEST):
        raise IdentificationError(f"an excitation lasts at least {_SHORTEST:g} s, got {duration} s")
