"""The test-bed: a quadruped standing or walking on the ground in MuJoCo, and the loads on its back.

One step applies a torque to the joints, held over the step, and integrates (semi-implicit Euler). Afterwards the
accelerations and contact forces are worked out once more at the new instant with that torque still acting, so that
whatever is read between two steps belongs to one instant and obeys

    M(q) v̇ + h(q, v) + joint dynamics = Sᵀ effort + Σ Jᵀ f + payload and outside forces

to the accuracy of the contact solver. Positions and velocities are not worked out again in the next step.

The joints' viscous damping is integrated implicitly, after the contacts are solved: where it nears joint inertia over
timestep, standing feet chatter. Robots' own damping is a hundred times less.
"""

from __future__ import annotations

from math import isfinite

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from stadera.errors import StaderaError
from stadera.inertia import InertialParameters
from stadera.lab.plant.contacts import Contacts
from stadera.lab.plant.model import joint_offsets, set_body_inertia
from stadera.lab.plant.outside import OutsideForce
from stadera.lab.plant.payload import DroppedBox, Payload, RigidMass, Tray, VirtualForce
from stadera.lab.plant.state import TrueState
from stadera.lab.plant.terrain import Terrain
from stadera.lab.plant.world import box_body, build_world, foot_radius
from stadera.robot.model import Robot
from stadera.types import Array

_FREE_POSITIONS, _FREE_VELOCITIES = 7, 6
_XYZW = np.array([1, 2, 3, 0])
_WXYZ = np.array([3, 0, 1, 2])


class SimulationError(StaderaError):
    """The plant was handed something it cannot simulate, or its motion ran away."""


class Plant:
    """A simulated quadruped whose parameters are the truth of an experiment. Deterministic.

    Args:
        robot: the truth: inertias, joint dynamics and limits are this robot's.
        terrain: what it stands on.
        timestep: [s], of simulation and control.

    Raises:
        ModelError: the robot cannot be simulated (see `stadera.lab.plant.model`).
    """

    def __init__(self, robot: Robot, terrain: Terrain | None = None, timestep: float = 1e-3) -> None:
        self.robot = robot
        self.terrain = terrain or Terrain()
        self.timestep = timestep
        self._payloads: tuple[Payload, ...] = ()
        self._outside: OutsideForce | None = None
        self._outside_start: Array | None = None
        self._tray = Tray.of(robot)
        self._steps = 0
        self._joint_count = len(robot.tree.joints)
        self._build()

    # -- running ----------------------------------------------------------------------------------------------
    def reset(self, joint_position: ArrayLike, orientation: ArrayLike | None = None) -> None:
        """Stands the robot on the ground at rest at time zero, above the world's origin, without payload.

        Args:
            joint_position: (n,) [rad], in the tree's order.
            orientation: (4,) quaternion xyzw of the trunk; None for parallel to the plane. The lowest foot touches it.

        Raises:
            SimulationError: a wrong shape or a value that is not finite; no ground around the origin.
        """
        q = self._checked(joint_position, "joint positions")
        self._payloads, self._outside, self._steps = (), None, 0
        self._build()
        quat = np.zeros(4)
        if orientation is None:
            mujoco.mju_mat2Quat(quat, np.ascontiguousarray(self.terrain.rotation).ravel())
        else:
            quat[:] = np.asarray(orientation, dtype=float)[_WXYZ]
            mujoco.mju_normalize4(quat)
        self._data.qpos[3:7], self._data.qpos[self._q] = quat, q
        mujoco.mj_kinematics(self._model, self._data)
        gaps = self.terrain.clearance(self._data.geom_xpos[self._contacts.feet]) - self._radii
        if not isfinite(gaps.min()):
            raise SimulationError("there is no ground under the robot to be reset on")
        self._data.qpos[2] -= gaps.min() / self.terrain.normal[2]
        self._evaluate()

    def step(self, torque: ArrayLike) -> None:
        """Applies joint torques (n,) [N·m], saturated at the effort limits, for one timestep.

        Raises:
            SimulationError: a wrong shape, a value that is not finite, or a motion that ran away.
        """
        model, data = self._model, self._data
        self._control[:] = self._checked(torque, "joint torques")
        mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_VEL, True)
        mujoco.mj_Euler(model, data)
        self._steps += 1
        self._evaluate()

    # -- payload ----------------------------------------------------------------------------------------------
    @property
    def payloads(self) -> tuple[Payload, ...]:
        """What is on the robot now."""
        return self._payloads

    def apply_payload(self, payload: Payload) -> None:
        """Puts one more payload on, while running; a dropped box starts above the tray, moving with the trunk."""
        self._payloads = (*self._payloads, payload)
        if isinstance(payload, DroppedBox):
            self._rebuild()
            self._place_box(sum(isinstance(p, DroppedBox) for p in self._payloads) - 1, payload)
        else:
            self._load_trunk()
        self._evaluate()

    def remove_payload(self) -> None:
        """Takes everything off, while running."""
        had_box = any(isinstance(payload, DroppedBox) for payload in self._payloads)
        self._payloads = ()
        if had_box:
            self._rebuild()
        else:
            self._load_trunk()
        self._evaluate()

    def pull(self, force: OutsideForce) -> None:
        """From now on this force acts from outside, in the place of any other; where it acts is where it began."""
        self._outside, self._outside_start = force, None
        self._evaluate()

    def truth(self) -> InertialParameters:
        """Trunk and payload, in the trunk frame: what weighing has to find.

        A virtual force counts as the point mass that it equals at rest, without inertia; a dropped box
        counts where it lies now, as long as it touches the tray.
        """
        total = self.robot.inertias[self.robot.trunk]
        boxes = 0
        for payload in self._payloads:
            if isinstance(payload, DroppedBox):
                if self._contacts.box_on_tray(self._data, boxes):
                    total = total + payload.parameters.transformed(*self._box_pose(boxes))
                boxes += 1
            else:
                total = total + payload.parameters
        return total

    # -- truth of this instant --------------------------------------------------------------------------------
    @property
    def time(self) -> float:
        """[s] since the reset."""
        return self._steps * self.timestep

    @property
    def joint_position(self) -> Array:
        """(n,) [rad], a copy."""
        return np.array(self._joint_position)

    @property
    def joint_velocity(self) -> Array:
        """(n,) [rad/s], a copy."""
        return np.array(self._joint_velocity)

    @property
    def effort(self) -> Array:
        """(n,) [N·m], what the actuators do to the joints, a copy."""
        return np.array(self._effort)

    @property
    def imu_motion(self) -> Array:
        """(6,) angular velocity [rad/s] and specific force [m/s²] at and in the IMU frame, a copy."""
        return np.array(self._imu_motion)

    @property
    def imu_quaternion_wxyz(self) -> Array:
        """(4,) MuJoCo's quaternion, scalar first, of the IMU frame in the world."""
        quat = np.empty(4)
        mujoco.mju_mulQuat(quat, self._orientation, self._imu_quaternion)
        return quat

    @property
    def on_ground(self) -> str:
        """What touches the ground though it should not, such as "trunk" or "LF knee"; empty for nothing."""
        return self._contacts.on_ground(self._data)

    @property
    def box_poses(self) -> tuple[Array, ...]:
        """Where every dropped box is now: (7,) position of its centre [m] and quaternion xyzw, in the world."""
        data, count = self._data, sum(isinstance(payload, DroppedBox) for payload in self._payloads)
        bodies = [self._model.body(box_body(index)).id for index in range(count)]
        return tuple(np.concatenate([data.xpos[body], data.xquat[body][_XYZW]]) for body in bodies)

    @property
    def state(self) -> TrueState:
        """Everything that is true now."""
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
            foot_position=np.array(data.geom_xpos[self._contacts.feet]),
            contact_point=points,
            foot_force=forces,
            foot_contact=touching,
        )

    # -- inside -----------------------------------------------------------------------------------------------
    def _build(self) -> None:
        boxes = [payload for payload in self._payloads if isinstance(payload, DroppedBox)]
        self._model = build_world(self.robot, self.terrain, self.timestep, boxes)
        self._data = mujoco.MjData(self._model)
        n = self._joint_count
        self._q = slice(_FREE_POSITIONS, _FREE_POSITIONS + n)
        self._v = slice(_FREE_VELOCITIES, _FREE_VELOCITIES + n)
        # views into MuJoCo's memory
        self._joint_position, self._joint_velocity = self._data.qpos[self._q], self._data.qvel[self._v]
        self._control, self._effort = self._data.ctrl, self._data.actuator_force
        self._acceleration, self._imu_motion = self._data.qacc, self._data.sensordata
        self._orientation, self._imu_quaternion = self._data.qpos[3:7], np.array(self._model.site_quat[0])
        self._trunk = self._model.body(self.robot.trunk).id
        self._contacts = Contacts(self._model, self.robot)
        self._radii = np.array([foot_radius(leg) for leg in self.robot.legs])
        self._load_trunk()
        self._data.qfrc_applied[self._v] = -joint_offsets(self.robot, self.robot.tree)

    def _rebuild(self) -> None:
        """A new world with the boxes of now, the robot going on where it was."""
        before = self._data
        self._build()
        after, q, v = self._data, self._q.stop, self._v.stop
        after.ctrl[:] = before.ctrl
        after.qpos[:q], after.qvel[:v] = before.qpos[:q], before.qvel[:v]
        after.qacc_warmstart[:v] = before.qacc_warmstart[:v]

    def _load_trunk(self) -> None:
        rigid = [payload.parameters for payload in self._payloads if isinstance(payload, RigidMass)]
        virtual = [payload for payload in self._payloads if isinstance(payload, VirtualForce)]
        set_body_inertia(self._model, self._trunk, sum(rigid, start=self.robot.inertias[self.robot.trunk]))
        mujoco.mj_setConst(self._model, mujoco.MjData(self._model))
        # the virtual forces as one, at MuJoCo's point of application, the body's centre of mass
        com = self._model.body_ipos[self._trunk]
        self._virtual_force = float(sum(payload.force for payload in virtual))
        self._trunk_com = np.array(com)
        self._data.xfrc_applied[self._trunk] = 0.0
        self._virtual_moment = np.zeros(3)  # Σ force (point - com), trunk axes [N·m]
        for payload in virtual:
            self._virtual_moment += payload.force * (np.asarray(payload.position) - com)

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
        """Its force and moment about the trunk's centre of mass, world axes, on top of the virtual forces."""
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

    def _place_box(self, index: int, box: DroppedBox) -> None:
        data = self._data
        quat = data.qpos[3:7]
        centre = np.array([*box.position, self._tray.top + box.height + 0.5 * box.size[2]])
        q, v = self._q.stop + _FREE_POSITIONS * index, self._v.stop + _FREE_VELOCITIES * index
        data.qpos[q : q + 3] = data.qpos[:3] + _rotated(centre, quat)
        data.qpos[q + 3 : q + 7] = quat
        data.qvel[v : v + 3] = data.qvel[:3] + _rotated(np.cross(data.qvel[3:6], centre), quat)
        data.qvel[v + 3 : v + 6] = data.qvel[3:6]

    def _box_pose(self, index: int) -> tuple[Array, Array]:
        """Rotation and translation of a box's frame in the trunk frame."""
        body = self._model.body(box_body(index)).id
        trunk = np.array(self._data.xmat[self._trunk]).reshape(3, 3)
        rotation = trunk.T @ np.array(self._data.xmat[body]).reshape(3, 3)
        return rotation, trunk.T @ (self._data.xpos[body] - self._data.xpos[self._trunk])

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
