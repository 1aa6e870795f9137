"""A walk as pictures: the true motion, and the trunk as estimated and as the controller has it, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from stadera.lab.experiments.moving.loaded_walk import LoadedWalk
from stadera.lab.plant import DroppedBox
from stadera.lab.plant.payload import Tray
from stadera.robot.kinematics import forward_kinematics
from stadera.robot.model import Robot
from stadera.supervise import NonstopSupervisor, Supervisor
from stadera.types import Array, Bools

_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
_TRUNK_DEPTH = 0.14  # m, drawn, below the back


@dataclass(frozen=True, eq=False)
class Film:
    """k frames; world axes and metres, unless it says otherwise.

    Attributes:
        time: (k,) [s].
        legs: (k, 4, 4, 3), by leg, from the hip to the foot's centre.
        trunk, box: (k, 8, 3), corners; NaN for a box that is not there yet.
        com, model: (k, 3), the whole robot's centre of mass with its load: true, and as controller and planner have
            it.
        force: (k, 4) [N], vertical, on the feet.
        down: (k, 4) bool, feet of the support polygon.
        margin: (k,), of the true centre of mass inside it; NaN on fewer than three feet.
        mass: (k, 3) [kg], of the trunk with its load: true, as controller and planner have it, as it is weighed.
        trunk_com: (k, 3, 2), the same of its centre of mass in x and y, trunk frame.
        std: (k, 3), of what is weighed, mass [kg], x and y. NaN for all that is not weighed at the time.
        state: (k,) what the supervisor is doing; the crawl's phase without one.
    """

    time: Array
    legs: Array
    trunk: Array
    box: Array
    com: Array
    model: Array
    force: Array
    down: Bools
    margin: Array
    mass: Array
    trunk_com: Array
    std: Array
    state: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time)


class Camera:
    """Takes a frame of a walk every so many periods.

    Args:
        robot: what walks.
        every: periods from one frame to the next.
    """

    def __init__(self, robot: Robot, every: int = 40) -> None:
        self._robot, self._every, self._periods = robot, every, -1
        tray = Tray.of(robot)
        half = np.array([*tray.half_size[:2], 0.5 * _TRUNK_DEPTH])
        middle = np.array([*tray.centre[:2], tray.top - 0.5 * _TRUNK_DEPTH])
        self._trunk = middle + half * _CORNERS
        self._frames: dict[str, list[Array]] = {field.name: [] for field in fields(Film)}
        self._states: list[str] = []
        columns = [[robot.tree.joints.index(joint) + 1 for joint in leg.joints] for leg in robot.legs]
        self._links = np.array(columns)

    def look(self, walk: LoadedWalk) -> None:
        """A frame, if it is time for one."""
        self._periods += 1
        if self._periods % self._every == 0:
            self._take(walk)

    def film(self) -> Film:
        """All frames so far."""
        arrays = {name: np.array(frames) for name, frames in self._frames.items() if name != "state"}
        arrays["down"] = arrays["down"].astype(bool)
        return Film(**arrays, state=tuple(self._states))  # type: ignore[arg-type]

    def _take(self, walk: LoadedWalk) -> None:
        plant, controller, supervisor = walk.bed.plant, walk.crawl.controller, walk.supervisor
        state, truth, trunk = plant.state, plant.truth(), controller.trunk.model
        R, p = state.rotation, state.position
        legs = self._leg_points(state.joint_position) @ R.T + p
        com = walk.monitor.com()
        robot_mass = truth.mass + controller.legs.mass
        # the legs' share is the same in both, so the two differ by the trunk's
        moment = robot_mass * (R.T @ (com - p)) - truth.first_moment + trunk.mass * trunk.com_trunk
        modelled = p + R @ (moment / (trunk.mass + controller.legs.mass))
        weighed, std = _weighed(supervisor)
        values = {
            "time": state.time,
            "legs": legs,
            "trunk": self._trunk @ R.T + p,
            "box": self._box(walk) @ R.T + p,
            "com": com,
            "model": modelled,
            "force": state.foot_force[:, 2],
            "down": walk.monitor.carrying(),
            "margin": walk.monitor.margin(),
            "mass": [truth.mass, trunk.mass, weighed[0]],
            "trunk_com": [truth.com[:2], trunk.com_trunk[:2], weighed[1:]],
            "std": std,
        }
        for name, value in values.items():
            self._frames[name].append(np.array(value, dtype=float))
        self._states.append(str(walk.crawl.phase if supervisor is None else supervisor.state))

    def _leg_points(self, joint_position: Array) -> Array:
        """Hips, the next two joints and the feet, trunk frame (4, 4, 3)."""
        rotations, translations = forward_kinematics(self._robot.tree, joint_position[None])
        joints = translations[0][self._links]
        last, foot = self._links[:, 2], np.array([leg.foot_position for leg in self._robot.legs])
        feet = joints[:, 2] + np.einsum("lij,lj->li", rotations[0][last], foot)
        return np.concatenate([joints, feet[:, None]], axis=1)

    def _box(self, walk: LoadedWalk) -> Array:
        boxes = [payload for payload in walk.bed.plant.payloads if isinstance(payload, DroppedBox)]
        if not boxes:
            return np.full((8, 3), np.nan)
        rotation, translation = walk.bed.plant.boxes[0]
        return np.asarray(0.5 * np.asarray(boxes[0].size) * _CORNERS @ rotation.T + translation)


def _weighed(supervisor: Supervisor | NonstopSupervisor | None) -> tuple[Array, Array]:
    """Mass, x and y of the trunk as weighed at the time, and their standard deviations; NaN where they are not.

    A supervisor that stops tests the mass all the way, and weighs the centre of mass at rest.
    """
    value, std = np.full(3, np.nan), np.full(3, np.nan)
    if isinstance(supervisor, NonstopSupervisor):
        return supervisor.estimate.value[:3], supervisor.estimate.std[:3]
    if supervisor is not None:
        value[0] = supervisor.load_test.mass
        if supervisor.weighing and supervisor.estimate is not None:
            value[1:], std[1:] = supervisor.estimate.value[1:3], supervisor.estimate.std[1:3]
    return value, std
