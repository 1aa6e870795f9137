"""How many seconds the test-bed simulates in a second of one core.

Plant, sensors and controller at 1 kHz, `standard` sensor errors. Standing has the estimator by contact forces beside
it, fed every 10 ms. The plant alone, its joints held by springs, is what the rest is measured against: MuJoCo is the
part that is not ours.

Time is processor time. Of several chunks the median is what a machine in use gives, the best what an idle one would.
Run `python benchmarks/test_bed.py [--robots hyq,go2,anymal_c,b1]`; `--json F` writes the ratios.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is loaded: one core is what is measured

import numpy as np

from stadera.files import written_together
from stadera.lab.control.reference import Shake
from stadera.lab.control.stand import Controller, TestBed
from stadera.lab.control.trot import Trot
from stadera.lab.control.trunk import TrunkController
from stadera.lab.laws.recursive import ContactCom
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import STANDARD, Sensors
from stadera.robot import Robot, load_robot
from stadera.robot.stance import standing_configuration

ROBOTS = "hyq,go2,anymal_c,b1"
_STIFFNESS, _DAMPING = 5.0, 0.03  # 1/rad of a joint's effort limit; s
_SETTLE = 0.5  # s, simulated before anything is timed


def made(robot: Robot, controller: Controller, estimator: ContactCom | None = None, hold: int = 1) -> TestBed:
    """The robot at the beginning of a run."""
    plant = Plant(robot)
    plant.reset(standing_configuration(robot))
    bed = TestBed(plant, Sensors(STANDARD, 0, robot), controller, estimator, every=10, hold=hold)
    bed.run(_SETTLE)
    return bed


def plant_alone(robot: Robot) -> Callable[[float], None]:
    """Steps with springs in the joints."""
    plant = made(robot, TrunkController(robot)).plant
    held, torque = plant.joint_position, plant.effort
    stiffness = _STIFFNESS * np.array([robot.limits[joint].effort for joint in robot.tree.joints])

    def run(seconds: float) -> None:
        for _ in range(round(seconds / plant.timestep)):
            pull = held - plant.joint_position - _DAMPING * plant.joint_velocity
            plant.step(torque + stiffness * pull)

    return run


def standing(robot: Robot) -> Callable[[float], None]:
    """With an estimator."""
    controller = TrunkController(robot)
    return made(robot, controller, ContactCom(robot)).run


def shaking(robot: Robot) -> Callable[[float], None]:
    """With a small motion of the body."""
    controller = TrunkController(robot)
    bed = made(robot, controller)
    controller.follow(Shake.of(robot, controller.reference, controller.time))
    return bed.run


def trotting(robot: Robot, hold: int = 1) -> Callable[[float], None]:
    """At 0.3 m/s; with `hold`, the controller is asked every so many periods."""
    trot = Trot.of(robot)
    bed = made(robot, trot, hold=hold)
    trot.walk((0.3, 0.0))
    bed.run(_SETTLE)
    return bed.run


RUNS = {
    "plant_alone": plant_alone,
    "stand": standing,
    "shake": shaking,
    "trot": trotting,
    "trot_hold_2": partial(trotting, hold=2),
}


def ratios(run: Callable[[float], None], chunk: float, chunks: int) -> dict[str, float]:
    """Simulated seconds a second of processor time."""
    spent = []
    for _ in range(chunks):
        start = time.process_time()
        run(chunk)
        spent.append(time.process_time() - start)
    return {"median": chunk / median(spent), "best": chunk / min(spent)}


def main() -> None:
    """Runs everything and prints ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", default=ROBOTS)
    parser.add_argument("--chunk", type=float, default=0.4, help="simulated at a time [s]")
    parser.add_argument("--chunks", type=int, default=8)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    found: dict[str, dict[str, dict[str, float]]] = {}
    print(f"simulated seconds a second of one core, median (best) of {args.chunks} chunks of {args.chunk} s")
    print(f"{'':10s}" + "".join(f"{name:>18s}" for name in RUNS))
    for name in args.robots.split(","):
        robot = load_robot(name)
        found[name] = {kind: ratios(make(robot), args.chunk, args.chunks) for kind, make in RUNS.items()}
        cells = (f"{value['median']:.2f} ({value['best']:.2f})" for value in found[name].values())
        print(f"{name:10s}" + "".join(f"{cell:>18s}" for cell in cells))
    if args.json:
        with written_together([args.json]) as (draft,):
            draft.write_text(json.dumps({"simulated_seconds_per_second": found}, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
