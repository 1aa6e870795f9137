"""The MuJoCo world of a robot: floating trunk, feet of one sphere or several, ground, a tray for boxes, an IMU.

Its true state, hidden from estimators, is read from MuJoCo. Trunk, hips and knees can collide with the ground too,
so that a fallen robot lies on them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from stadera.constants import ROUNDING
from stadera.lab.plant.model import build_spec, compile_model, placeholder_inertia, quaternion_wxyz, set_body_inertia
from stadera.lab.plant.payload import DroppedBox, Tray
from stadera.lab.plant.terrain import Terrain
from stadera.robot.imu import ImuMount
from stadera.robot.model import Leg, Robot
from stadera.robot.shapes import FLAT
from stadera.robot.sole import foot_radius, sole
from stadera.types import Array, Bools

GROUND, TRAY, IMU, BOX, FRAME = "ground", "tray", "imu_site", "box", "frame"
"""Names in the compiled model; geoms of the ground begin with the first, those that should not touch it with the
last.
"""

TIMESTEP = 1e-3
"""Of simulation and control [s]."""

# Who touches whom: a pair collides where one's contype shares a bit with the other's conaffinity.
_FOOT_BIT, _BOX_BIT = 1, 2


@dataclass(frozen=True)
class ContactSettings:
    """Settings of contacts and of their solver."""

    # time constant of a hard contact, in timesteps: as stiff as is stable, so that feet penetrate by micrometres
    timesteps: float = 2.5
    impedance: tuple[float, ...] = (0.95, 0.99, 1e-4, 0.5, 2.0)  # MuJoCo's solimp
    # ratio of the stiffnesses of friction and normal force (impratio); keeps standing feet from creeping
    friction_to_normal: float = 100.0
    tolerance: float = 1e-12  # of MuJoCo's solver
    extent: float = 50.0  # drawn size of the ground [m]; the plane itself is infinite
    thickness: float = 0.2  # of stones [m]


CONTACT = ContactSettings()


def foot_geom(leg: Leg) -> str:
    """Name of a foot's centre in the compiled model, with which the names of its spheres begin."""
    return f"foot {leg.name}"


def build_world(robot: Robot, terrain: Terrain, boxes: Sequence[DroppedBox]) -> mujoco.MjModel:
    """Compiles the world, perhaps with a box, which follows the robot in the state."""
    spec = build_spec(robot, robot.tree, floating=True, timestep=TIMESTEP)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = CONTACT.friction_to_normal
    spec.option.tolerance = CONTACT.tolerance
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    _add_ground(spec, terrain)
    trunk = spec.body(robot.trunk)
    for leg in robot.legs:
        spec.body(leg.links[-1]).add_site(name=foot_geom(leg), pos=leg.foot_position)
        points, radius = sole(robot, leg)
        for k, point in enumerate(points.tolist()):
            _add_sphere(spec, leg.links[-1], f"{foot_geom(leg)} {k}", point, radius, terrain)
    _add_frame(spec, robot, terrain)
    tray = Tray.of(robot)
    trunk.add_geom(
        name=TRAY,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=tray.centre,
        size=tray.half_size,
        **_contact(0.8, bits=(_BOX_BIT, _FOOT_BIT)),
    )
    for box in boxes:
        _add_box(spec, box)
    mount = ImuMount.of(robot)
    trunk.add_site(name=IMU, pos=mount.translation, quat=quaternion_wxyz(mount.rotation))
    for kind in (mujoco.mjtSensor.mjSENS_GYRO, mujoco.mjtSensor.mjSENS_ACCELEROMETER):
        spec.add_sensor(type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=IMU, name=kind.name)
    model = compile_model(spec, robot, robot.tree)
    for box in boxes:
        set_body_inertia(model, model.body(BOX).id, box.parameters)
        mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _contact(friction: float, softness: float = 0.0, bits: tuple[int, int] = (0, _FOOT_BIT)) -> dict[str, object]:
    return {
        "contype": bits[0],
        "conaffinity": bits[1],
        "friction": (friction, 0.0, 0.0),
        "condim": 3,
        "solref": (max(softness, CONTACT.timesteps * TIMESTEP), 1.0),
        "solimp": CONTACT.impedance,
    }


def _add_ground(spec: mujoco.MjSpec, terrain: Terrain) -> None:
    common = _contact(terrain.friction, terrain.softness, bits=(_FOOT_BIT, 0))
    common["quat"] = quaternion_wxyz(terrain.rotation)
    if terrain.stones is None:
        kind, size = mujoco.mjtGeom.mjGEOM_PLANE, (CONTACT.extent, CONTACT.extent, 0.1)
        spec.worldbody.add_geom(name=GROUND, type=kind, size=size, **common)
        return
    stones, half = terrain.stones, 0.5 * terrain.stones.size
    behind, _, side = stones.counts
    for (i, j), height in np.ndenumerate(stones.heights()):
        centre = (stones.size * (i - behind), stones.size * (j - side), height - 0.5 * CONTACT.thickness)
        spec.worldbody.add_geom(
            name=f"{GROUND} {i} {j}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=terrain.rotation @ centre,
            size=(half, half, 0.5 * CONTACT.thickness),
            **common,
        )


def _add_frame(spec: mujoco.MjSpec, robot: Robot, terrain: Terrain) -> None:
    """Adds knees and hips as spheres of the feet's size, and the trunk's boxes, which only collide with the ground."""
    for leg in robot.legs:
        links = leg.links[1 : len(leg.links) - (leg.contact == FLAT) * 2]  # ankles are near the ground
        for k, link in enumerate(links):
            part = "hip" if k < len(links) - 1 else "knee"
            _add_sphere(spec, link, f"{FRAME} {leg.name} {part} {k}", (0.0, 0.0, 0.0), foot_radius(leg), terrain)
    boxes = [shape for shape in robot.shapes if shape.link == robot.trunk and shape.kind == "box"]
    for index, box in enumerate(boxes):
        spec.body(robot.trunk).add_geom(
            name=f"{FRAME} trunk {index}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=box.translation,
            quat=quaternion_wxyz(box.rotation),
            size=0.5 * np.asarray(box.size),
            **_contact(terrain.friction, terrain.softness),
        )


def _add_sphere(
    spec: mujoco.MjSpec, link: str, name: str, centre: Sequence[float], radius: float, terrain: Terrain
) -> None:
    spec.body(link).add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        pos=centre,
        size=(radius, 0.0, 0.0),
        **_contact(terrain.friction, terrain.softness),
    )


def _add_box(spec: mujoco.MjSpec, box: DroppedBox) -> None:
    body = spec.worldbody.add_body(name=BOX)
    placeholder_inertia(body)
    body.add_freejoint(name=BOX)
    body.add_geom(
        name=BOX,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=0.5 * np.asarray(box.size),
        priority=1,  # its friction is used for any contact
        **_contact(box.friction, bits=(0, _FOOT_BIT | _BOX_BIT)),
    )


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
    # (n,) [N·m], torques that the gears pass on: effort less joint friction and what accelerates the rotors
    carried: Array
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

    def box_on_tray(self, data: mujoco.MjData) -> bool:
        """True if the box touches the tray."""
        pair = {self._tray, self._model.geom(BOX).id}
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
