"""The weighed trunk against its model: differences that torques with an error explain at least as well as a load.

While the feet stay where they are, a torque of one leg that is scaled, offset, clipped or dead changes that leg's
vertical force by some f and no other residual: near-vertical forces through the foot at p balance as

    Δm g = f,      Δh = Δm p      (horizontal components)

so mass m and first moment h of the trunk change as by a load right above that foot, or as by taking one away. A load of
its own is rarely there, and never negative. A common factor of all torques is a load, too; then only its size tells.
A size within the bars tells nothing, nor does a place above one of two feet, where friction puts it that holds a robot
in one leg; that of four legs holds alike. Steps break this: the foot's place and load vary, and a wrong torque leaves a
residual.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from stadera.errors import require_positive
from stadera.inertia import InertialParameters
from stadera.robot.kinematics import foot_positions
from stadera.robot.model import Robot
from stadera.robot.stance import lying
from stadera.trunk.load import SIGNIFICANT, Payload
from stadera.trust import Verdict
from stadera.types import Array


@dataclass(frozen=True)
class AgreementLimits:
    """When a difference from the model makes a weighing doubtful."""

    # than the model, share of the robot's mass; models and gains of all torques err by half as much
    lighter: float = 0.12
    # than the model, share of it: quadrupeds are built for loads of a third to a half of their mass
    heavier: float = 0.7
    least: float = 0.08  # force of one leg that may be wrong, share of the weight
    # what a load right above a foot may leave of the difference in mass and first moment, relative; one half way from
    # the middle to the foot leaves 0.32
    above: float = 0.28
    plain: float = 0.15  # force from which that holds, share of the weight; a smaller one has to fit as much better
    missing: float = 0.35  # the same where something would have been taken away
    stepped: float = 0.015  # standard deviation of a distance between feet that have stepped [m]
    rate: float = 20.0  # at which feet are looked at [Hz]
    stands: float = 0.05  # height of a foot above the lowest up to which it is on the ground, share of the legs' length
    lies: float = 0.5  # time for which the trunk is as low as the feet, after which it may lie on the ground [s]

    def __post_init__(self) -> None:
        require_positive("limit of differences from the model", self, [field.name for field in fields(self)])


class Footprint:
    """Where the feet of a robot are in the trunk, and the vertical, on average over a log while it does not lie on its
    trunk.
    """

    def __init__(self, robot: Robot, limits: AgreementLimits) -> None:
        self._robot, self._limits = robot, limits
        self._pairs = np.triu_indices(len(robot.legs), 1)
        self._count, self._feet, self._up = 0, np.zeros((len(robot.legs), 3)), np.zeros(3)
        self._moments = np.zeros((2, len(self._pairs[0])))  # of the distances between feet
        self._low = 0  # postures with the trunk on the ground
        # of each leg, times on the ground and sum of all joints' positions then
        self._on, self._sums = np.zeros(len(robot.legs)), np.zeros((len(robot.legs), len(robot.tree.joints)))

    def add(self, time: Array, position: Array, specific_force: Array) -> None:
        """Takes in samples (n,) [s], of the robot's joints (n, joints) [rad] and IMU (n, 3) [m/s²], trunk axes."""
        period = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
        kept = slice(None, None, max(1, round(1.0 / (self._limits.rate * period))))
        position, force = position[kept], specific_force[kept]
        feet = foot_positions(self._robot, position)
        up = specific_force.mean(axis=0)
        up /= max(float(np.linalg.norm(up)), 1e-9)
        low = lying(self._robot, feet, np.tile(up, (len(feet), 1)))
        self._low += int(low.sum())
        position, feet = position[~low], feet[~low]
        apart = np.linalg.norm(feet[:, self._pairs[0]] - feet[:, self._pairs[1]], axis=-1)
        self._count += len(feet)
        self._feet += feet.sum(axis=0)
        self._up += force[~low].sum(axis=0)
        self._moments += np.array([apart.sum(axis=0), (apart**2).sum(axis=0)])
        heights = np.nan_to_num(feet @ up, nan=np.inf)
        on = heights < heights.min(axis=1, keepdims=True) + self._limits.stands * self._robot.leg_length
        self._on += on.sum(axis=0)
        self._sums += on.T.astype(float) @ np.nan_to_num(position)

    def lay(self, left_out: float) -> bool:
        """Whether the trunk may have lain on the ground for longer than the time that was left out for it [s]."""
        return self._low > (self._limits.lies + 1.2 * left_out) * self._limits.rate  # both are counted roughly

    @property
    def stance(self) -> tuple[Array, Array] | None:
        """Vertical (3,), a unit vector in trunk axes, and joint positions (joints,) [rad] of the mean pose, each leg as
        while its foot is among the lowest; None if one never was.
        """
        if not self._on.all():
            return None
        position, joints = np.zeros(self._sums.shape[1]), self._robot.tree.joints
        for leg, total, count in zip(self._robot.legs, self._sums, self._on, strict=True):
            own = [joints.index(joint) for joint in leg.joints]
            position[own] = total[own] / count
        return self._up / max(float(np.linalg.norm(self._up)), 1e-9), position

    @property
    def stood(self) -> bool:
        """Whether no foot has stepped."""
        if not self._count:
            return False
        mean, square = self._moments / self._count
        return bool(np.sqrt(np.maximum(square - mean**2, 0.0)).max() < self._limits.stepped)

    def above(self, mass: float, moment: Array) -> tuple[int, float, float]:
        """The leg whose force explains a difference of mass [kg] and first moment (3,) [kg·m], trunk frame, best; its
        force [kg]; and what is left of the difference, relative.
        """
        up = self._up / max(float(np.linalg.norm(self._up)), 1e-9)
        feet = self._feet / self._count
        centre = feet.mean(axis=0)
        level = np.eye(3) - np.outer(up, up)
        places = (feet - centre) @ level
        length = float(np.linalg.norm(places, axis=1).mean())
        places = np.column_stack([np.ones(len(places)), places / length])
        difference = np.concatenate([[mass], level @ (moment - mass * centre) / length])
        force = places @ difference / (places**2).sum(axis=1)
        left = np.linalg.norm(difference - force[:, None] * places, axis=1)
        best = int(np.argmin(left))
        return best, float(force[best]), float(left[best] / max(np.linalg.norm(difference), 1e-12))


def doubts(
    robot: Robot,
    trunk: InertialParameters,
    std: float,
    payload: Payload | None,
    footprint: Footprint,
    limits: AgreementLimits,
    left_out: float = 0.0,
) -> Iterator[tuple[Verdict, str]]:
    """Verdict and reason of what torques with an error would explain: of the trunk as weighed, with all that is on it,
    its mass known to `std` [kg], and of the payload since the tare, None without one. `left_out`: time for
    which it lay on its trunk, and was not weighed [s].
    """
    difference = trunk - robot.inertias[robot.trunk]
    found: list[tuple[Verdict, str]] = []
    if footprint.stood:
        added = None if payload is None or payload.at else payload.parameters
        loads = [(difference, std)]
        if added is not None and payload is not None:
            loads = [(difference - added, std), (added, payload.mass_std)]
        found = [doubt for load in loads for doubt in _of_one_leg(robot, *load, footprint, limits)]
    if footprint.lay(left_out):
        text = "the trunk is as low as the feet: it may lie on the ground"
        yield "doubtful", f"{text}, which then carries a part that no leg feels"
    more = difference.mass
    if payload is not None and payload.at and payload.mass < 0.0:  # no part of the trunk's values
        more, std = more + payload.mass, float(np.hypot(std, payload.mass_std))
    yield from found[:1] or _of_all(more / robot.mass, SIGNIFICANT * std / robot.mass, limits)


def _of_one_leg(
    robot: Robot, load: InertialParameters, std: float, footprint: Footprint, limits: AgreementLimits
) -> Iterator[tuple[Verdict, str]]:
    leg, force, left = footprint.above(load.mass, load.vector[1:4])
    least = max(limits.least * robot.mass, SIGNIFICANT * std if len(robot.legs) == 2 else 0.0)
    name, felt = robot.legs[leg].name, abs(force) > least
    if felt and force < 0.0 and left < limits.missing:
        text = f"the robot would weigh {-force:.3g} kg less than expected, all of it above foot {name}"
        yield "bad", f"{text}: the torques of {name} read too little"
    elif felt and force > 0.0 and left < limits.above * min(1.0, force / robot.mass / limits.plain):
        text = f"all that the robot weighs more than expected, {force:.3g} kg, would be right above foot {name}"
        yield "doubtful", f"{text}: while it stands, torques of {name} that read too much look the same"


def _of_all(share: float, unsure: float, limits: AgreementLimits) -> Iterator[tuple[Verdict, str]]:
    """By the difference in mass, and how much of it the bars allow for, as shares of the robot's."""
    if share < -max(limits.lighter, unsure):
        yield "doubtful", f"the robot would weigh {-100 * share:.0f} % less than its model: torques read too little"
    elif share > max(limits.heavier, unsure):
        text = f"the robot would weigh {1 + share:.2g} times what its model does"
        yield "doubtful", f"{text}: torques in another unit or with another gear ratio look the same"
