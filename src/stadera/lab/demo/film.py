"""Records a walk frame by frame: the true motion, and the trunk as estimated and as used by the controller."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from stadera.lab.experiments.loaded_walk import LoadedWalk
from stadera.lab.supervise import Supervisor
from stadera.types import Array, Bools

PERIODS = 40
"""Periods of 1 ms between two frames: 25 frames a second."""


@dataclass(frozen=True, eq=False)
class Film:
    """k frames; world axes and metres, unless stated otherwise."""

    time: Array  # (k,) [s]
    trunk: Array  # (k, 7), position of the trunk's origin, and its orientation as a quaternion xyzw
    joints: Array  # (k, n) [rad], in the tree's order
    box: Array  # (k, 7), the same for the box; NaN while there is none
    feet: Array  # (k, 4, 3), centres of the feet
    force: Array  # (k, 4, 3) [N], of the ground on them
    down: Bools  # (k, 4) bool, feet of the support polygon
    limited: Bools  # (k, n) bool, joints whose torque is at its limit
    com: Array  # (k, 3), true centre of mass of the whole robot with its load
    model: Array  # (k, 3), that used by controller and planner
    margin: Array  # (k,), of the true centre of mass inside the support polygon; NaN on fewer than three feet
    mass: Array  # (k, 3) [kg], of the trunk with its load: true, used by controller and planner, and estimated
    trunk_com: Array  # (k, 3, 2), the same of its centre of mass in x and y, trunk frame
    std: Array  # (k, 3), of the estimates of mass [kg], x and y. NaN for quantities without a present estimate.
    state: tuple[str, ...]  # (k,) state of the supervisor; without one, the crawl's phase

    def __len__(self) -> int:
        return len(self.time)


class Camera:
    """Records a frame of a walk every `PERIODS`."""

    def __init__(self) -> None:
        self._periods = -1
        self._frames: dict[str, list[Array]] = {field.name: [] for field in fields(Film)}
        self._states: list[str] = []

    def look(self, walk: LoadedWalk) -> None:
        """Records a frame, if it is due."""
        self._periods += 1
        if self._periods % PERIODS == 0:
            self._take(walk)

    def film(self) -> Film:
        arrays = {name: np.array(frames) for name, frames in self._frames.items() if name != "state"}
        arrays |= {name: arrays[name].astype(bool) for name in ("down", "limited")}
        return Film(**arrays, state=tuple(self._states))  # type: ignore[arg-type]

    def _take(self, walk: LoadedWalk) -> None:
        plant, controller, supervisor = walk.bed.plant, walk.crawl.controller, walk.supervisor
        state, truth, trunk = plant.state, plant.truth(), controller.trunk.model
        com, R, p = walk.monitor.com(), state.rotation, state.position
        # the legs' contribution is the same in both, so the two differ by the trunk's
        moment = (truth.mass + controller.legs.leg_mass) * (R.T @ (com - p)) - truth.first_moment
        modelled = p + R @ ((moment + trunk.mass * trunk.com_trunk) / (trunk.mass + controller.legs.leg_mass))
        weighed, std = _weighed(supervisor)
        values = {
            "time": state.time,
            "trunk": [*p, *state.orientation],
            "joints": state.joint_position,
            "box": plant.box_poses[0] if plant.box_poses else np.full(7, np.nan),
            "feet": state.foot_position,
            "force": state.foot_force,
            "down": walk.monitor.carrying(),
            "limited": walk.monitor.at_limit(),
            "com": com,
            "model": modelled,
            "margin": walk.monitor.margin(),
            "mass": [truth.mass, trunk.mass, weighed[0]],
            "trunk_com": [truth.com[:2], trunk.com_trunk[:2], weighed[1:]],
            "std": std,
        }
        for name, value in values.items():
            self._frames[name].append(np.array(value, dtype=float))
        self._states.append(str(walk.crawl.phase if supervisor is None else supervisor.state))


def _weighed(supervisor: Supervisor | None) -> tuple[Array, Array]:
    """Present estimate of the trunk's mass, x and y, and standard deviations; NaN where there is none."""
    if supervisor is None or supervisor.estimate is None:
        return np.full(3, np.nan), np.full(3, np.nan)
    return supervisor.estimate.value[:3], supervisor.estimate.std[:3]
