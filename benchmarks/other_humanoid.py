"""Humanoids that sway on a plant that shares no code with the laboratory's, weighed.

`python benchmarks/other_humanoid.py [--robots g1,talos] [--seeds N] [--json F]`

Plant: MuJoCo alone, the robot's URDF on two soles of four balls each, all joints held on targets by stiff PD control;
the pelvis moves and turns over feet that stay, waist and arms swing. Robots and sensors differ from the model as in
`other_plant.py`. After four seconds a load of 3 to 9 % of the robot's mass is on its chest or in one hand.

Printed are what `other_plant.py` prints of a payload, and how often the load was taken to be where it is. With a stiff
body and no feedback of balance some robots fall; these do not count.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import mujoco as mj
import numpy as np
from other_plant import (
    GRAVITY,
    LOADED,
    RATES,
    SETTLE,
    STEP,
    DrawnRobot,
    Run,
    Weighed,
    add_imu,
    add_load,
    judged,
    set_up,
    summary,
)
from scipy.spatial.transform import Rotation

import stadera
from stadera.robot.imu import ImuMount
from stadera.types import Array

LENGTH = 10.0  # s
CORNERS = ((-0.07, -0.025), (-0.07, 0.025), (0.07, -0.025), (0.07, 0.025))  # m, of a sole
BENT = {"hip_pitch": -0.35, "knee": 0.7, "ankle_pitch": -0.35, "elbow": 0.6}  # rad, by part of a joint's name
BENT |= {f"leg_{side}_{k}_": q for side in ("left", "right") for k, q in ((3, -0.35), (4, 0.7), (5, -0.35))}
BENT |= {"arm_left_4_": -1.2, "arm_right_4_": -1.2}
SPARE = 20.0  # N·m, of a joint whose file states no limit


@dataclass(frozen=True)
class Humanoid:
    """Where loads may be: by link of the plant, the place that is right to name."""

    chest: str
    hands: dict[str, str]


HUMANOIDS = {
    "g1": Humanoid("torso_link", {f"{s}_wrist_yaw_link": f"{s}_wrist_yaw_link" for s in ("left", "right")}),
    "talos": Humanoid("torso_2_link", {f"gripper_{s}_base_link": f"arm_{s}_7_link" for s in ("left", "right")}),
}


@dataclass(frozen=True)
class Placed(Weighed):
    """Where a load is, where it is said to be, and the probability of the right place."""

    at: str = ""
    found_at: str = ""
    odds: float | None = None


class Plant(DrawnRobot):
    """A robot with drawn errors, and a body without mass where the load will be.

    Args:
        name: of `HUMANOIDS`. rng: all draws.
    """

    def __init__(self, name: str, rng: np.random.Generator) -> None:
        self.robot = robot = stadera.load_robot(name)
        where = HUMANOIDS[name]
        self.at, self.named = [(where.chest, where.chest), *where.hands.items()][rng.integers(3)]
        place = (0.05, 0.0, 0.15) if self.at == where.chest else (0.1, 0.0, 0.0)
        super().__init__(self._compiled(rng, place))
        self.legs = [[self.joints.index(joint) for joint in leg.joints] for leg in robot.legs]
        self.in_legs = np.isin(np.arange(len(self.joints)), np.concatenate(self.legs))
        stated = {joint: limit.effort for joint, limit in robot.limits.items()}
        effort = [stated.get(joint.name, self.model.jnt_actfrcrange[joint.id][1]) for joint in self.moved]
        self.limit: Array = np.array([x if 0.0 < x < 1e3 else SPARE for x in effort])
        self.differ(self.limit, 0.03 * np.clip(self.limit / 100.0, 0.3, 1.0), (0.005, 0.02), 2.0, rng)
        self._stand()

    def _compiled(self, rng: np.random.Generator, place: Sequence[float]) -> mj.MjModel:
        assert self.robot.source is not None
        root = ET.parse(self.robot.source).getroot()
        for link in root.findall("link"):
            for shape in (*link.findall("visual"), *link.findall("collision")):
                link.remove(shape)
        how = {"fusestatic": "false", "discardvisual": "true", "balanceinertia": "true"}
        ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", how)
        spec = mj.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
        if not any(joint.type == mj.mjtJoint.mjJNT_FREE for joint in spec.joints):
            spec.worldbody.first_body().add_freejoint()
        set_up(spec)
        for leg in self.robot.legs:
            for x, y in CORNERS:
                corner = (np.array(leg.foot_position) + np.array([x, y, 0.005])).tolist()
                spec.body(leg.links[-1]).add_geom(
                    type=mj.mjtGeom.mjGEOM_SPHERE, size=[0.005, 0, 0], pos=corner, mass=0.0
                )
        mount = ImuMount.of(self.robot)
        add_imu(spec, spec.body(self.robot.trunk), mount.translation, mount.rotation, rng)
        add_load(spec.body(self.at), place)
        return spec.compile()

    def _stand(self) -> None:
        """Knees bent, the centre of mass over the middle of the feet."""
        q = np.array([sum(bend for part, bend in BENT.items() if part in joint) for joint in self.joints])
        self.pose(q)
        feet = [self._sole(self.posture, k)[0] for k in range(2)]
        shift = self.posture.subtree_com[1] - np.mean(feet, axis=0)
        self.nominal = np.array(feet) + np.array([shift[0], shift[1], 0.0])
        self.standing = self.reached(self.nominal, np.eye(3), q, 80)

    def _sole(self, data: mj.MjData, leg: int) -> tuple[Array, Array]:
        """Place and orientation of a foot."""
        body = self.model.body(self.robot.legs[leg].links[-1]).id
        turn = data.xmat[body].reshape(3, 3).copy()
        return data.xpos[body] + turn @ np.array(self.robot.legs[leg].foot_position), turn

    def slope(self, data: mj.MjData, leg: int) -> Array:
        """Jacobian (6, k) of a foot, its translation first, by its leg's joints."""
        J, body = np.zeros((2, 3, self.model.nv)), self.model.body(self.robot.legs[leg].links[-1]).id
        mj.mj_jac(self.model, data, J[0], J[1], self._sole(data, leg)[0], body)
        return J.reshape(6, -1)[:, self.v[self.legs[leg]]]

    def reached(self, feet: Array, turn: Array, start: Array, steps: int) -> Array:
        """Joint positions that put the feet (2, 3) at places in the trunk's frame, all turned alike."""
        q = start.copy()
        for _ in range(steps):
            self.pose(q)
            for k, leg in enumerate(self.legs):
                place, own = self._sole(self.posture, k)
                E, J = turn @ own.T, self.slope(self.posture, k)
                away = 0.5 * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
                q[leg] += J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), np.r_[feet[k] - place, away])
        return q

    def run(self, load: float, rate: int, rng: np.random.Generator) -> Run:
        """Simulates; `load` [kg] is there from `LOADED` on."""
        data, n, inside = self.data, len(self.joints), self.in_legs
        height = -float(self.nominal[0, 2])
        data.qpos[:3], data.qpos[3:7], data.qpos[self.q] = (0.0, 0.0, height + 0.001), (1, 0, 0, 0), self.standing
        mj.mj_forward(self.model, data)
        sway, phase = rng.uniform(0.15, 0.4, 6), 2.0 * np.pi * rng.random(6)
        swing, late = rng.uniform(0.2, 0.6, n), 2.0 * np.pi * rng.random(n)
        stiff = np.minimum(np.where(inside, np.maximum(12.0 * self.limit, 12.0 * self.mass), 40.0), 40.0 * self.limit)
        damped = np.where(inside, 0.025, 0.02) * stiff
        q, forward, rows = self.standing.copy(), np.zeros(n), []
        for i in range(-round(SETTLE / STEP), round(LENGTH / STEP)):
            t = i * STEP
            if i == round(LOADED / STEP):
                self.put_on(load)
            if i % 4 == 0:
                start, last = 0.7 * min(max(t + 0.5, 0.0), 1.0), q
                s = start * np.sin(2.0 * np.pi * sway * t + phase)
                turn = Rotation.from_rotvec(np.array([0.04, 0.025, 0.08]) * s[3:]).as_matrix()
                q = self.reached((self.nominal - np.array([0.008, 0.02, 0.04]) * s[:3]) @ turn, turn.T, q, 2)
                q[~inside] = (self.standing + 0.15 * start * np.sin(2.0 * np.pi * swing * t + late))[~inside]
                forward = self._held_up(data)
            asked = last + (i % 4 + 1) / 4 * (q - last)
            self.drive(stiff * (asked - data.qpos[self.q]) - damped * data.qvel[self.v] + forward)
            if i >= 0 and i % round(1.0 / (rate * STEP)) == 0:
                rows.append(self.row(t))
        return self.recorded(rows, load, 0.7 * height)

    def _held_up(self, data: mj.MjData) -> Array:
        """Torques (joints,) [N·m] that carry the robot, each foot as much as is over it, and the limbs themselves."""
        out = np.where(self.in_legs, 0.0, data.qfrc_bias[self.v])
        aside = [self._sole(data, k)[0][1] for k in range(2)]
        share = np.clip((data.subtree_com[1][1] - aside[1]) / (aside[0] - aside[1]), 0.1, 0.9)
        for k, carried in enumerate((share, 1.0 - share)):
            out[self.legs[k]] = -self.slope(data, k)[2] * self.mass * GRAVITY * carried
        return out


def weighed(robot: str, seed: int) -> Placed | None:
    """One run; None if the robot fell."""
    rng = np.random.default_rng([seed, list(HUMANOIDS).index(robot), 6])
    plant = Plant(robot, rng)
    run = plant.run(plant.mass * rng.uniform(0.03, 0.09), int(rng.choice(RATES)), rng)
    if run.fell:
        return None
    found, payload = judged(robot, "sway", seed, run, plant.limit, rng)
    places = {} if payload is None else payload.places
    likeliest = max(places, key=lambda place: places[place], default="")
    return Placed(**asdict(found), at=plant.named, found_at=likeliest, odds=places.get(plant.named))


def main() -> None:
    parser = ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", default=",".join(HUMANOIDS))
    parser.add_argument("--seeds", type=int, default=5, help="runs of each robot")
    parser.add_argument("--json", type=Path, help="write the runs")
    asked, runs = parser.parse_args(), []
    for robot in asked.robots.split(","):
        found = [one for seed in range(asked.seeds) if (one := weighed(robot, seed))]
        runs += found
        print(
            f"{robot}: {summary(found, asked.seeds)}, {sum(one.at == one.found_at for one in found)} at the right place"
        )
        for one in found:
            if one.verdict != "good" or one.at != one.found_at:
                print(f"  seed {one.seed}, {one.at}: {one.verdict}, {one.refused or one.found_at}")
    if asked.json is not None:
        asked.json.write_text(json.dumps([asdict(one) for one in runs], indent=1))


if __name__ == "__main__":
    main()
