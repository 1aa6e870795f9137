"""The paper's random excitation of a leg on a held trunk.

Our reading of section IV of the paper. Each joint follows one sinusoid at a time; its frequency, amplitude and phase
are drawn uniformly for every position of the origin: 0.3 to 0.9 Hz, zero to (0.25, 0.20, 0.40) rad for HAA, HFE, KFE, 0
to π. The origins are poses with the largest changes of the gravity torque: on a grid of poses that leave room for the
full amplitude, each next one is the pose whose gravity torque in the CAD model, each joint's in units of its spread, is
farthest from those already chosen, starting with the rest pose (farthest-point sampling). The paper does not state the
number and duration of the origins; here six of equal duration are used, with fades of two seconds. On other robots
amplitudes are the same share of the joint ranges as the paper's of HyQ's (95°, 120°, 120°), of joints beyond the third
as the third's.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from stadera.errors import IdentificationError
from stadera.excite.bounds import LegBounds, fitting_factor, poses_between
from stadera.excite.sinusoids import FREQUENCIES, Sinusoids, check_duration
from stadera.robot.model import Robot
from stadera.types import Array, Bools

_AMPLITUDE_SHARES = np.array([0.25, 0.20, 0.40]) / np.deg2rad([95.0, 120.0, 120.0])


@dataclass(frozen=True)
class DrawSettings:
    """Settings of the random draw that the paper does not state."""

    origins: int = 6  # largest number of positions of the origin
    segment: float = 10.0  # least time at one origin [s], a few periods of the slowest sinusoid
    fade: float = 2.0  # longest time from one origin to the next [s]
    amplitude: float = 0.25  # largest amplitude, as a share of the reach [1], which leaves room to shift origins
    candidates: int = 729  # largest number of origins tried
    choice: int = 8  # least number of candidates for each origin, if few are clear


_SETTINGS = DrawSettings()


def paper_draw(
    robot: Robot, leg: str, rng: np.random.Generator, duration: float = 180.0, bounds: LegBounds | None = None
) -> Sinusoids:
    """The paper's random sinusoids (see the module), within bounds, over a duration [s]; None for `LegBounds.of(robot,
    leg)`. A draw that violates them is scaled towards the rest pose until it fits. Raises UnknownNameError: no such
    leg. IdentificationError: a duration under two seconds.
    """
    bounds = bounds or LegBounds.of(robot, leg)
    check_duration(duration)
    count = int(np.clip(duration // _SETTINGS.segment, 1, _SETTINGS.origins))
    fade = min(_SETTINGS.fade, duration / (2 * count + 1))
    joints = len(bounds.joints)
    shape, shares = (count, joints, 1), _AMPLITUDE_SHARES[np.minimum(np.arange(joints), 2)]
    limits = [bounds.robot.limits[joint] for joint in bounds.joints]
    ranges = np.array([min(limit.upper - limit.lower, 2.0 * np.pi) for limit in limits])
    largest = np.minimum(shares * ranges, _SETTINGS.amplitude * (bounds.upper - bounds.lower))
    frequencies = rng.uniform(*FREQUENCIES, shape)
    phases = rng.uniform(0.0, np.pi, shape)
    amplitudes = rng.uniform(0.0, 1.0, shape) * largest[:, None]
    origins = gravity_shifting_poses(bounds, largest, count)
    starts = np.linspace(0.0, duration - fade, count + 1)
    draw = Sinusoids(bounds.joints, bounds.rest, origins, amplitudes, frequencies, phases, starts, fade)
    return draw.drawn_in(fitting_factor(draw, bounds))


def gravity_shifting_poses(bounds: LegBounds, room: Array, count: int) -> Array:
    """Poses with the most different gravity torques, (count, n) [rad], `room` (n,) inside the position bounds."""
    poses, _ = poses_between(bounds.lower + room, bounds.upper - room, _SETTINGS.candidates)
    torque = bounds.gravity_torque(poses)
    held = (np.abs(torque) <= bounds.effort).all(axis=1)
    if not held.any():
        raise IdentificationError(f"leg {bounds.leg}: no pose in reach can be held within the torque bounds")
    poses, torque = poses[held], torque[held]
    clear = _most_clear(poses, room, bounds, _SETTINGS.choice * count)
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
    """Selects poses that are clear within `room` around them; if fewer than `least`, the nearest to it."""
    slack = np.full(len(poses), np.inf)
    for about in product((-1.0, 0.0, 1.0), repeat=len(room)):
        slack = np.minimum(slack, bounds.clearance_map.slack(poses + np.array(about) * room))
    return np.asarray(slack >= min(0.0, np.sort(slack)[-min(least, len(slack))]))
