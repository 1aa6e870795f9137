"""The plant of the test-bed: a legged robot on the ground in MuJoCo, with loads on its links.

A step applies a torque to the joints, held over the step, and integrates (semi-implicit Euler). Then the accelerations
and contact forces are computed again at the new instant with that torque still acting, so that all values read between
two steps are simultaneous and satisfy

    M(q) v̇ + h(q, v) + joint dynamics = Sᵀ effort + Σ Jᵀ f + payload and outside forces

to the accuracy of the contact solver. Positions and velocities are not recomputed in the next step.

The joints' viscous damping is integrated implicitly, after the contacts are solved: if it approaches joint inertia over
timestep, standing feet chatter. The damping of real robots is a hundred times smaller.
"""

from math import isfinite
from typing import TypeVar

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from stadera.errors import StaderaError
from stadera.inertia import InertialParameters
from stadera.lab.plant.model import DryFriction, joint_offsets, quaternion_wxyz, set_body_inertia
from stadera.lab.plant.payload import DroppedBox, OutsideForce, Payload, RigidMass, Tray, VirtualForce
from stadera.lab.plant.terrain import Terrain
from stadera.lab.plant.world import BOX, IMU, TIMESTEP, Contacts, TrueState, build_world
from stadera.robot.model import Robot
from stadera.types import Array

_XYZW = np.array([1, 2, 3, 0])
Kind = TypeVar("Kind")


class SimulationError(StaderaError):
    """The plant got an input that it cannot simulate, or its motion diverged."""


class Plant:
    """A simulated robot with true parameters. Deterministic; `friction` is in place of the robot's Coulomb friction.
    `payloads` are the present loads on the robot, at most one of them a dropped box.
    """

    timestep = TIMESTEP

    def __init__(self, robot: Robot, terrain: Terrain | None = None, friction: DryFriction | None = None) -> None:
        self.robot, self.terrain, self._friction = robot, terrain or Terrain(), friction
        self.payloads: tuple[Payload, ...] = ()
        self._outside: OutsideForce | None = None
        self._outside_start: Array | None = None
        self._tray = Tray.of(robot)
        self._steps = 0
        self._joint_count = len(robot.tree.joints)
        self._build()

    # -- running ----------------------------------------------------------------------------------------------
    def reset(self, joint_position: ArrayLike) -> None:
        """Places the robot on the ground at rest at time zero, parallel to the plane and without payload: joint
        positions (n,) [rad] in the tree's order. The lowest foot touches the ground.
        """
        q = self._checked(joint_position, "joint positions")
        self.payloads, self._outside, self._steps = (), None, 0
        self._build()
        self._data.qpos[3:7], self._data.qpos[self._q] = quaternion_wxyz(self.terrain.rotation), q
        mujoco.mj_kinematics(self._model, self._data)
        gaps = self.terrain.clearance(self._data.geom_xpos[self._contacts.soles]) - self._radii
        if not isfinite(gaps.min()):
            raise SimulationError("there is no ground under the robot to be reset on")
        self._data.qpos[2] -= gaps.min() / self.terrain.normal[2]
        self._evaluate()

    def step(self, torque: ArrayLike) -> None:
        """Applies joint torques (n,) [N·m], saturated at the effort limits, for one timestep."""
        model, data = self._model, self._data
        self._control[:] = self._checked(torque, "joint torques")
        if self._friction is not None:
            model.dof_frictionloss[self._v] = self._friction.at(self._joint_position, self._effort)
        mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_VEL, True)
        mujoco.mj_Euler(model, data)
        self._steps += 1
        self._evaluate()

    # -- payload ----------------------------------------------------------------------------------------------
    def apply_payload(self, payload: Payload) -> None:
        """Adds a load during the simulation; a dropped box starts above the tray, moving with the trunk."""
        self.payloads = (*self.payloads, payload)
        if isinstance(payload, DroppedBox):
            self._rebuild()
            self._place_box(payload)
        else:
            self._load_trunk()
        self._evaluate()

    def pull(self, force: OutsideForce) -> None:
        """Applies an external force from now on, replacing any other; its reference point is the present position."""
        self._outside, self._outside_start = force, None
        self._evaluate()

    def truth(self) -> InertialParameters:
        """Trunk and payload, in the trunk frame: the ground truth of weighing. A virtual force counts as the equivalent
        point mass at rest, a dropped box at its present position while it touches the tray; what is on another link
        does not count.
        """
        total = self._loaded_links()[self.robot.trunk]
        for force in self._of(VirtualForce):
            total = total + force.parameters
        for box in self._of(DroppedBox):
            if self._contacts.box_on_tray(self._data):
                total = total + box.parameters.transformed(*self._box_in_trunk())
        return total

    # -- truth of this instant --------------------------------------------------------------------------------
    @property
    def time(self) -> float:
        """Time since the reset [s]."""
        return self._steps * self.timestep

    @property
    def joint_position(self) -> Array:
        """Joint positions (n,) [rad], a copy."""
        return np.array(self._joint_position)

    @property
    def joint_velocity(self) -> Array:
        """Joint velocities (n,) [rad/s], a copy."""
        return np.array(self._joint_velocity)

    @property
    def effort(self) -> Array:
        """Torques of the actuators on the joints, (n,) [N·m], a copy."""
        return np.array(self._effort)

    @property
    def imu_motion(self) -> Array:
        """Angular velocity [rad/s] and specific force [m/s²] at the IMU, in its frame, (6,), a copy."""
        return np.array(self._imu_motion)

    @property
    def imu_quaternion_wxyz(self) -> Array:
        """(4,) MuJoCo's quaternion, scalar first, of the IMU frame in the world."""
        quat = np.empty(4)
        mujoco.mju_mulQuat(quat, self._orientation, self._imu_quaternion)
        return quat

    @property
    def on_ground(self) -> str:
        """The part that touches the ground but should not, such as "trunk" or "LF knee"; empty for none."""
        return self._contacts.on_ground(self._data)

    @property
    def box_pose(self) -> Array:
        """(7,) position of the dropped box's centre [m] and quaternion xyzw, in the world; NaN without one."""
        if not self._of(DroppedBox):
            return np.full(7, np.nan)
        body = self._data.body(BOX)
        return np.concatenate([body.xpos, body.xquat[_XYZW]])

    @property
    def state(self) -> TrueState:
        """All true values at the present instant."""
        data = self._data
        points, forces, touching = self._contacts.of_feet(data)
        return TrueState(
            time=self.time,
            position=np.array(data.qpos[:3]),
            orientation=np.array(data.qpos[3:7])[_XYZW],
            linear_velocity=np.array(data.qvel[:3]),
            angular_velocity=np.array(data.qvel[3:6]),
            linear_acceleration=np.array(data.qacc[:3]),
            angular_acceleration=np.array(data.qacc[3:6]),
            joint_position=self.joint_position,
            joint_velocity=self.joint_velocity,
            joint_acceleration=np.array(data.qacc[self._v]),
            effort=self.effort,
            carried=self._carried(),
            foot_position=np.array(data.site_xpos[self._contacts.feet]),
            contact_point=points,
            foot_force=forces,
            foot_contact=touching,
        )

    def _carried(self) -> Array:
        """Torque (n,) [N·m] that each joint passes on to its link, with the sticking or sliding friction as solved."""
        data, v = self._data, self._v
        friction, rows = np.zeros(self._model.nv), slice(data.ne, data.ne + data.nf)
        friction[data.efc_id[rows]] = data.efc_force[rows]
        passed = data.qfrc_actuator + data.qfrc_applied + data.qfrc_passive + friction
        return np.asarray((passed - self._model.dof_armature * data.qacc)[v])

    # -- inside -----------------------------------------------------------------------------------------------
    def _build(self) -> None:
        self._model = build_world(self.robot, self.terrain, self._of(DroppedBox))
        self._data = mujoco.MjData(self._model)
        n = self._joint_count
        self._q, self._v = slice(7, 7 + n), slice(6, 6 + n)  # after the trunk's free joint
        # views into MuJoCo's memory
        self._joint_position, self._joint_velocity = self._data.qpos[self._q], self._data.qvel[self._v]
        self._control, self._effort = self._data.ctrl, self._data.actuator_force
        self._acceleration, self._imu_motion = self._data.qacc, self._data.sensordata
        self._orientation, self._imu_quaternion = self._data.qpos[3:7], np.array(self._model.site(IMU).quat)
        self._trunk = self._model.body(self.robot.trunk).id
        self._contacts = Contacts(self._model, self.robot)
        self._radii = np.array(self._model.geom_size[self._contacts.soles, 0])
        self._load_trunk()
        self._data.qfrc_applied[self._v] = -joint_offsets(self.robot, self.robot.tree)

    def _rebuild(self) -> None:
        """Compiles a new world with the box, and continues from the robot's state."""
        before = self._data
        self._build()
        after, q, v = self._data, self._q.stop, self._v.stop
        after.ctrl[:] = before.ctrl
        after.qpos[:q], after.qvel[:v] = before.qpos[:q], before.qvel[:v]
        after.qacc_warmstart[:v] = before.qacc_warmstart[:v]

    def _load_trunk(self) -> None:
        virtual = self._of(VirtualForce)
        for link, inertia in self._loaded_links().items():
            set_body_inertia(self._model, self._model.body(link).id, inertia)
        mujoco.mj_setConst(self._model, mujoco.MjData(self._model))
        # all virtual forces as one, at MuJoCo's point of application, the body's centre of mass
        com = self._model.body_ipos[self._trunk]
        self._virtual_force = float(sum(payload.force for payload in virtual))
        self._trunk_com = np.array(com)
        self._data.xfrc_applied[self._trunk] = 0.0
        self._virtual_moment = np.zeros(3)  # Σ force (point - com), trunk axes [N·m]
        for payload in virtual:
            self._virtual_moment += payload.force * (np.asarray(payload.position) - com)

    def _loaded_links(self) -> dict[str, InertialParameters]:
        links = dict(self.robot.inertias)
        for payload in self._of(RigidMass):
            link = payload.link or self.robot.trunk
            links[link] = links[link] + payload.parameters
        return links

    def _of(self, kind: type[Kind]) -> list[Kind]:
        """The loads of one kind, in the order in which they were added."""
        return [payload for payload in self.payloads if isinstance(payload, kind)]

    def _evaluate(self) -> None:
        data = self._data
        if self._virtual_force:
            # arm x (0, 0, -force), summed
            x, y, _ = _rotated(self._virtual_moment, data.qpos[3:7])
            data.xfrc_applied[self._trunk] = (0.0, 0.0, -self._virtual_force, -y, x, 0.0)
        if self._outside is not None:
            self._add_outside(self._outside)
        mujoco.mj_forward(self._model, data)
        if not isfinite(self._acceleration.dot(self._acceleration)):
            raise SimulationError(f"robot {self.robot.name}: the simulated motion ran away at {self.time:.3f} s")

    def _add_outside(self, outside: OutsideForce) -> None:
        """Adds its force and moment about the trunk's centre of mass, world axes, to the virtual forces."""
        data, at = self._data, np.asarray(outside.at)
        if not self._virtual_force:
            data.xfrc_applied[self._trunk] = 0.0
        if self.time < outside.begin:
            return
        point = data.qpos[:3] + _rotated(at, data.qpos[3:7])
        if self._outside_start is None:
            self._outside_start = point
        force = outside.force(self.time, point - self._outside_start)
        arm = _rotated(at - self._trunk_com, data.qpos[3:7])
        data.xfrc_applied[self._trunk] += np.concatenate([force, np.cross(arm, force)])

    def _place_box(self, box: DroppedBox) -> None:
        data, q, v = self._data, self._q.stop, self._v.stop
        quat = data.qpos[3:7]
        centre = np.array([*box.position, self._tray.top + box.height + 0.5 * box.size[2]])
        data.qpos[q : q + 3] = data.qpos[:3] + _rotated(centre, quat)
        data.qpos[q + 3 : q + 7] = quat
        data.qvel[v : v + 3] = data.qvel[:3] + _rotated(np.cross(data.qvel[3:6], centre), quat)
        data.qvel[v + 3 : v + 6] = data.qvel[3:6]

    def _box_in_trunk(self) -> tuple[Array, Array]:
        body, trunk = self._data.body(BOX), self._data.body(self._trunk)
        rotation = np.array(trunk.xmat).reshape(3, 3).T
        return rotation @ np.array(body.xmat).reshape(3, 3), rotation @ (body.xpos - trunk.xpos)

    def _checked(self, values: ArrayLike, what: str) -> Array:
        array = np.asarray(values, dtype=float)
        if array.shape != (self._joint_count,):
            raise SimulationError(f"{what} need shape ({self._joint_count},), got {array.shape}")
        if not isfinite(array.dot(array)):
            bad = self.robot.tree.joints[int(np.argmin(np.isfinite(array)))]
            raise SimulationError(f"{what} are not finite at joint {bad!r}")
        return array


def _rotated(vector: Array, quat_wxyz: Array) -> Array:
    result = np.empty(3)
    mujoco.mju_rotVecQuat(result, vector, quat_wxyz)
    return result
