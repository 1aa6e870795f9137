"""True state of the plant at one instant, hidden from estimators, and contacts with the ground, read from MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from stadera.constants import ROUNDING
from stadera.lab.plant.world import FRAME, GROUND, TRAY, box_body, foot_geom
from stadera.robot.model import Robot
from stadera.types import Array, Bools


@dataclass(frozen=True, eq=False)
class TrueState:
    """The plant's state with the torque applied up to this instant; all values are simultaneous."""

    time: float  # [s]
    position: Array  # (3,) [m], the trunk frame's origin in the world
    orientation: Array  # (4,) quaternion xyzw of the trunk in the world
    linear_velocity: Array  # (3,) [m/s], of the trunk frame's origin, world axes
    angular_velocity: Array  # (3,) [rad/s], trunk axes
    linear_acceleration: Array  # (3,) [m/s²], second derivative of `position`, world axes
    angular_acceleration: Array  # (3,) [rad/s²], trunk axes
    joint_position: Array  # (n,) [rad], in the tree's order
    joint_velocity: Array  # (n,) [rad/s]
    joint_acceleration: Array  # (n,) [rad/s²]
    effort: Array  # (n,) [N·m], torques of the actuators on the joints
    foot_position: Array  # (L, 3) [m], centres of the feet in the world, legs in the robot's order
    contact_point: Array  # (L, 3) [m], contact points, world; NaN for feet in the air
    foot_force: Array  # (L, 3) [N], forces of the ground on the feet, world axes
    foot_contact: Bools  # (L,) bool, whether the foot touches the ground

    @property
    def rotation(self) -> Array:
        """Rotation of the trunk in the world, r_world = R r_trunk, (3, 3)."""
        return np.asarray(Rotation.from_quat(self.orientation).as_matrix())


class Contacts:
    """Contacts between bodies in a world compiled by `build_world`."""

    def __init__(self, model: mujoco.MjModel, robot: Robot) -> None:
        self._model = model
        names: dict[int, str] = {g: model.geom(g).name for g in range(model.ngeom)}
        self._ground = frozenset(g for g, name in names.items() if name.startswith(GROUND))
        self._tray = model.geom(TRAY).id
        self._frame = {self._tray: "trunk"} | {
            g: name.removeprefix(f"{FRAME} ").rstrip(" 0123456789")
            for g, name in names.items()
            if name.startswith(FRAME)
        }
        self.feet = np.array([model.site(foot_geom(leg)).id for leg in robot.legs])
        """Sites of the feet's centres, legs in the robot's order."""
        starts = [f"{foot_geom(leg)} " for leg in robot.legs]
        self._leg_of_geom = {g: k for g, name in names.items() for k, s in enumerate(starts) if name.startswith(s)}
        self.soles = np.array(list(self._leg_of_geom))
        """Geoms of the feet."""

    def on_ground(self, data: mujoco.MjData) -> str:
        """The part that touches the ground but should not: "trunk", "LF knee", "RH hip", ...; empty for none."""
        for pair in data.contact.geom.tolist():
            touching = [self._frame[geom] for geom in pair if geom in self._frame]
            if touching and not self._ground.isdisjoint(pair):
                return touching[0]
        return ""

    def box_on_tray(self, data: mujoco.MjData, index: int) -> bool:
        """True if the box of that number touches the tray."""
        pair = {self._tray, self._model.geom(box_body(index)).id}
        return any({int(a), int(b)} == pair for a, b in data.contact.geom)

    def of_feet(self, data: mujoco.MjData) -> tuple[Array, Array, Bools]:
        """Contact points of the feet (L, 3) [m], forces on them (L, 3) [N], both in the world, and contact states (L,).
        A foot on several points or stones gets the sum of their forces, at the mean of their points weighted by normal
        force; the point of a foot in the air is NaN.
        """
        count = len(self.feet)
        points, forces, weights = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count)
        touching = np.zeros(count, dtype=bool)
        contact, efc_force = data.contact, data.efc_force
        geoms, frames, positions = contact.geom, contact.frame.reshape(-1, 3, 3), contact.pos
        for k, address in enumerate(contact.efc_address):
            first, second = geoms[k].tolist()
            # MuJoCo sorts the pair by the kind of geom: a plane comes before a sphere, a box after it
            sign, foot = (1.0, second) if first in self._ground else (-1.0, first)
            leg = self._leg_of_geom.get(foot)
            if leg is None or address < 0 or not (first in self._ground or second in self._ground):
                continue
            # The frame's rows are its axes in the world, the first from the first geom to the second. With elliptic
            # cones the constraint forces are the contact force on the second in this frame.
            force = efc_force[address : address + 3]
            weight = max(float(force[0]), ROUNDING)
            forces[leg] += sign * (force @ frames[k])
            points[leg] += weight * positions[k]
            weights[leg] += weight
            touching[leg] = True
        points[touching] /= weights[touching, None]
        points[~touching] = np.nan
        return points, forces, touching
