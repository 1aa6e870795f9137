"""Nominal stance: feet under the hips, legs slightly bent; legs of other than three joints as at zero, feet raised."""

from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stadera.constants import NOTHING
from stadera.errors import ModelError, require_positive
from stadera.robot.kinematics import foot_positions, forward_kinematics, leg_kinematics
from stadera.robot.model import Leg, Robot, Tree
from stadera.types import Array, Bools


@dataclass(frozen=True)
class StanceSettings:
    """Settings for finding the nominal stance."""

    # height of the HFE joint above the foot, as a share of the stretched leg [1]; tried in turn, for limits may forbid
    # some
    extensions: tuple[float, ...] = (0.8, 0.75, 0.85, 0.7, 0.9, 0.65, 0.95, 0.6)
    grid: tuple[int, int, int] = (3, 4, 5)  # number of starts of Newton's method for HAA, HFE, KFE
    steps: int = 30  # number of its steps at most
    largest_step: float = 0.3  # of a joint in one step [rad]
    # step of a joint after which a start is done [rad], it leaves an error of its square; `reached` ends at a foot's
    # error below it [m, 1]
    last_step: float = 1e-9
    solved: float = 1e-8  # residual below which a solution is accepted [m and sine of an angle]
    raised: tuple[float, ...] = (0.06, 0.09, 0.04, 0.12)  # share of the leg, for legs of other than three joints
    bent: float = 0.5  # of their joints, at a start of Newton's method [rad]

    def __post_init__(self) -> None:
        require_positive("stance setting", self, ("steps", "largest_step", "last_step", "solved", "bent"))
        if not (all(0.0 < share < 1.0 for share in self.extensions) and min(self.grid) >= 1):
            raise ModelError(f"a stance needs extensions between 0 and 1 and at least one start a joint, got {self}")


def standing_configuration(robot: Robot, settings: StanceSettings | None = None) -> Array:
    """Joint angles of a plausible stance, in the tree's order [rad], (n,); ModelError if there is none within the
    limits.

    In each leg the foot is below the HFE joint in x, the leg's plane is vertical (HFE axis horizontal) and the feet are
    at one height, 80 % of the extended leg below the hips (or as close to it as the limits allow). Of the solutions
    within the limits, the one with HAA closest to the middle of its range is chosen, and among those the one with the
    knee towards the robot's middle. If a leg has more or fewer joints, all feet are where they are with all joints at
    zero, with the soles as there, but higher by a share of the legs' length.
    """
    return _standing(robot, settings or StanceSettings()).copy()


def usual_configuration(robot: Robot) -> Array:
    """The same, or all joints at zero if there is no such stance."""
    with suppress(ModelError):
        return standing_configuration(robot)
    return np.zeros(len(robot.tree.joints))


def nominal_feet(robot: Robot) -> Array:
    """Centres of the feet in the nominal stance, trunk frame [m], (legs, 3), legs in the robot's order."""
    return np.asarray(foot_positions(robot, standing_configuration(robot)[None])[0])


@lru_cache(maxsize=16)
def _standing(robot: Robot, settings: StanceSettings) -> Array:
    if all(len(leg.joints) == 3 for leg in robot.legs):
        heights, stretched = _hips(robot)[:, 2], np.array([_stretched(robot, leg) for leg in robot.legs])
        lacking = "the feet below the hips within the joints' limits"
        grounds = (float(np.mean(heights - extension * stretched)) for extension in settings.extensions)
        tried = ([_solve_leg(robot, leg, ground, settings) for leg in robot.legs] for ground in grounds)
    else:
        lacking = "the feet raised from where they are with all joints at zero"
        raised = (share * robot.leg_length for share in settings.raised)
        tried = ([_raised_leg(robot, leg, height, settings) for leg in robot.legs] for height in raised)
    for found in tried:
        if all(angles is not None for angles in found):
            q = np.zeros(len(robot.tree.joints))
            for leg, angles in zip(robot.legs, found, strict=True):
                q[[robot.tree.joints.index(name) for name in leg.joints]] = angles
            return q
    raise ModelError(f"robot {robot.name}: no stance with {lacking}")


def _raised_leg(robot: Robot, leg: Leg, height: float, settings: StanceSettings) -> Array | None:
    """Angles (n,) of a leg whose foot is higher by `height` than at zero, a flat one with its sole as there; None if
    there are none within the limits. From a bent leg, each joint towards the middle of its range, else to either
    side in turn.
    """
    tree, (low, high) = robot.leg_tree(leg.name), np.array([_range(robot, joint) for joint in leg.joints]).T
    sole, foot, _ = leg_kinematics(tree, leg, np.zeros((1, len(leg.joints))))
    aside = settings.bent * np.cos(np.pi * np.arange(len(low)))  # for limits that are as far to either side
    for start in (0.2 * (low + high), aside):
        (q,), left = reached(tree, leg, np.clip(start, low, high)[None], foot + height * np.eye(3)[2], sole, settings)
        if ((q >= low) & (q <= high)).all() and left < settings.solved:
            return np.asarray(q)
    return None


def reached(
    tree: Tree, leg: Leg, start: Array, foot: Array, sole: Array, settings: StanceSettings
) -> tuple[Array, float]:
    """Angles (N, n) of a leg, by Newton's method from a start, that bring its foot to places (N, 3) [m], trunk axes, a
    flat one with its link at rotations (N, 3, 3); and the largest error that is left [m, 1].
    """
    q, left = start, np.inf
    for _ in range(settings.steps):
        turned, at, slope = leg_kinematics(tree, leg, q)
        apart = turned @ sole.transpose(0, 2, 1)
        tilt = 0.5 * np.stack([apart[:, k - 1, k - 2] - apart[:, k - 2, k - 1] for k in range(3)], axis=1)
        error = np.concatenate([at - foot, tilt], axis=1)[:, : leg.contact]
        left = float(np.abs(error).max())
        if left < settings.last_step:
            break
        step = np.einsum("njc,nc->nj", np.linalg.pinv(slope[..., : leg.contact].swapaxes(1, 2), rcond=1e-3), error)
        largest = np.maximum(np.abs(step).max(axis=1, keepdims=True), NOTHING)
        q = q - step * np.minimum(1.0, settings.largest_step / largest)
    return q, left


def _hips(robot: Robot) -> Array:
    """Approximate origins of the HFE joints with vertical leg planes: at the middle of the HAA ranges; (4, 3)."""
    q = np.zeros((1, len(robot.tree.joints)))
    for leg in robot.legs:
        q[0, robot.tree.joints.index(leg.joints[0])] = 0.5 * sum(_range(robot, leg.joints[0]))
    _, translations = forward_kinematics(robot.tree, q)
    hips: Array = translations[0, [robot.tree.links.index(leg.links[1]) for leg in robot.legs]]
    return hips


def _stretched(robot: Robot, leg: Leg) -> float:
    """Thigh plus shank: the largest distance of the foot from the HFE joint in the plane normal to its axis [m]."""
    hfe, kfe = (robot.tree.joints.index(name) for name in leg.joints[1:])
    thigh, shank = robot.tree.translations[kfe], np.array(leg.foot_position)
    return sum(float(np.linalg.norm(np.cross(robot.tree.axes[j], v))) for j, v in ((hfe, thigh), (kfe, shank)))


def _range(robot: Robot, joint: str) -> tuple[float, float]:
    """The joint's range, or one turn around zero if it has none or a larger one."""
    limit = robot.limits[joint]
    if limit.upper - limit.lower > 2 * np.pi:
        return max(-np.pi, limit.lower), min(np.pi, limit.upper)
    return limit.lower, limit.upper


def _solve_leg(robot: Robot, leg: Leg, ground: float, settings: StanceSettings) -> Array | None:
    """Angles (3,) of a leg with its foot at height `ground` in the trunk frame; None if there are none."""
    low, high = np.array([_range(robot, joint) for joint in leg.joints]).T
    starts = [np.linspace(a, b, count + 2)[1:-1] for a, b, count in zip(low, high, settings.grid, strict=True)]
    q = np.stack(np.meshgrid(*starts, indexing="ij"), axis=-1).reshape(-1, 3)
    tree, left = robot.leg_tree(leg.name), np.arange(len(q))
    for _ in range(settings.steps):
        error, slope = _error(tree, leg, q[left], ground)
        step = (np.linalg.pinv(slope) @ error[:, :, None])[..., 0]
        largest = np.maximum(np.abs(step).max(axis=1), NOTHING)
        q[left] -= step * np.minimum(1.0, settings.largest_step / largest)[:, None]
        left = left[largest > settings.last_step]
        if not len(left):
            break
    q = np.where(q < low, q + 2 * np.pi, np.where(q > high, q - 2 * np.pi, q))
    error, _ = _error(tree, leg, q, ground)
    good = (np.abs(error).max(axis=1) < settings.solved) & ((q >= low) & (q <= high)).all(axis=1)
    return _preferred(tree, q[good], 0.5 * (low + high), settings.solved) if good.any() else None


def _error(tree: Tree, leg: Leg, q: Array, ground: float) -> tuple[Array, Array]:
    """Residual of a stance (N, 3), [foot x - HFE x, HFE axis z, foot z - ground], and its derivative (N, 3, 3)."""
    origins, (_, foot, motion) = forward_kinematics(tree, q)[1][:, 1:], leg_kinematics(tree, leg, q)
    axes = motion[..., 3:]
    error = np.column_stack([foot[:, 0] - origins[:, 1, 0], axes[:, 1, 2], foot[:, 2] - ground])
    slope = np.zeros((len(q), 3, 3))
    slope[:, 0], slope[:, 2] = motion[..., 0], motion[..., 2]
    slope[:, 0, 0] -= np.cross(axes[:, 0], origins[:, 1] - origins[:, 0])[:, 0]
    slope[:, 1, 0] = np.cross(axes[:, 0], axes[:, 1])[:, 2]
    return error, slope


def _preferred(tree: Tree, q: Array, middle: Array, solved: float) -> Array:
    """The solution (3,) with the least HAA, then with the knee towards the middle, then with the least rotation
    otherwise.
    """
    _, translations = forward_kinematics(tree, q)
    hip, knee = translations[:, 2, 0], translations[:, 3, 0]
    away = np.abs(q - middle)
    outwards = (knee - hip) * np.sign(hip) > 0
    best = q[np.lexsort((away[:, 1:].sum(axis=1), outwards, np.round(away[:, 0], 3)))[0]]
    return np.where(np.abs(best) < solved, 0.0, best)


def lying(robot: Robot, feet: Array, up: Array) -> Bools:
    """At which times, (n,), the trunk's lowest point is at the height of the feet's lowest, by their centres (n, legs,
    3) [m] and the vertical (n, 3), both in trunk axes.
    """
    # share of the leg's length; shapes of trunks are coarse, and robots crouch to half of their legs' length
    low = 0.1
    own = [shape for shape in robot.shapes if shape.link == robot.trunk]
    lowest = np.min([up @ shape.translation - shape.reach(up @ shape.rotation) for shape in own], axis=0)
    heights = np.einsum("nli,ni->nl", feet, up)
    ground = (heights - np.array([leg.foot_radius for leg in robot.legs])).min(axis=1)
    return np.asarray(lowest - ground < low * robot.leg_length)
