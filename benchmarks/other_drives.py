"""Drives identified from walks on a plant that shares no code with the laboratory's.

`python benchmarks/other_drives.py [--robots aliengo,go1,...] [--seeds N] [--json F]`

Robots of `other_plant.py`, errors included, trot for twenty seconds without a load. Printed is by how much rotor
inertia, viscous and Coulomb friction of `stadera.identify` are off the plant's, as a share of these and in standard
deviations, by term and joint; and the torques' lag.
"""

from __future__ import annotations

import json
from argparse import ArgumentParser
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import other_plant as plants

import stadera
from stadera.errors import StaderaError

ROBOTS, LENGTH = ("aliengo", "go1", "mini_cheetah", "hyqreal2", "b2"), 20.0  # s
JOINTS, TERMS = ("hips", "thighs", "calves"), ("armature", "viscous", "coulomb")


@dataclass(frozen=True)
class Found:
    """One term of one joint; `std` None where the log does not tell it."""

    robot: str
    seed: int
    joint: str
    term: str
    true: float
    value: float
    std: float | None


def identified(robot: str, seed: int) -> Iterator[Found]:
    """One run; nothing if the robot fell or was refused."""
    rng = np.random.default_rng([seed, ROBOTS.index(robot), 8])
    plant = plants.Plant(robot, rng)
    run = plant.run("trot", 0.0, int(rng.choice(plants.RATES)), rng)
    if run.fell:
        print(f"  {robot}, seed {seed}: fell")
        return
    log, _ = plants.sensed(run, plant.limit, rng)
    try:
        found = stadera.identify(robot, log)
    except StaderaError as refusal:
        print(f"  {robot}, seed {seed}: {refusal}")
        return
    said = "good" if found.trust.verdict == "good" else "; ".join(found.trust.reasons)
    print(f"  {robot}, seed {seed}: torques late by {-1e3 * found.torque_lag:.1f} ms, {said}", flush=True)
    model = plant.model
    truth = zip(TERMS, (model.dof_armature, model.dof_damping, model.dof_frictionloss), strict=True)
    places = [*zip(plant.joints, plant.v, strict=True)]
    true = {(joint, term): float(values[at]) for term, values in truth for joint, at in places}
    for leg in found.legs:
        for kind, joint in zip(JOINTS, leg.leg.joints, strict=True):
            for term in TERMS:
                q = leg.parameters[f"{joint}.{term}"]
                yield Found(robot, seed, kind, term, true[joint, term], q.value, q.std)


def main() -> None:
    parser = ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", default=",".join(ROBOTS))
    parser.add_argument("--seeds", type=int, default=3, help="runs of each robot")
    parser.add_argument("--json", type=Path, help="write all terms")
    asked = parser.parse_args()
    plants.LOADED, plants.LENGTH = 2.0 * LENGTH, LENGTH
    runs = [(robot, seed) for robot in asked.robots.split(",") for seed in range(asked.seeds)]
    found = [one for run in runs for one in identified(*run)]
    for term in TERMS:
        for joint in JOINTS:
            own = [one for one in found if (one.term, one.joint) == (term, joint) and one.std]
            if not own:
                print(f"{term} of {joint}: none known")
                continue
            share = np.array([one.value / one.true - 1.0 for one in own])
            apart = np.array([(one.value - one.true) / one.std for one in own])
            off = (
                f"off by {100 * np.median(np.abs(share)):.0f} % (median), {100 * np.median(share):+.0f} % in the middle"
            )
            print(f"{term} of {joint}: {len(own)} known; {off}; {np.sqrt(np.mean(apart**2)):.2f} σ (rms), ", end="")
            print(f"{np.abs(apart).max():.1f} σ at most")
    if asked.json is not None:
        asked.json.write_text(json.dumps([asdict(one) for one in found], indent=1))


if __name__ == "__main__":
    main()
