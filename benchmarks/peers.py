"""stadera and what else one would use, in one run: legs, then trunks. `python benchmarks/peers.py [--json F]`.

**Legs.** One leg identified from the first half of a log, evaluated on the second: HyQ's right hind leg in the
test-bed, whose links, friction and rotor inertia differ from the model's, and a real Go2's right front leg
(`go2_legs_in_air`). Each contender runs in a process of its own: processor time from the recorded log to the
parameters, peak memory above that of libraries and log, root mean square of the torque error on the held-out half, and
with a known truth that of the torques predicted in a much faster motion. `pip install idyntree figaroh
'mujoco[sysid]'` brings the peers; one that is not installed is skipped by name.

The row "the true parameters" says what the held-out error is worth: the low-pass that all signals need smears the
steps of Coulomb friction, and whoever fits parameters to smeared steps lies below the truth there, and off in other
motions.

**Trunks.** Robots that trot or stand, with `standard` and `real` errors, take up a load in the middle: error of its
mass and place at the end, when its mass came within 20 % of the truth for good, and how many errors lie within two
standard deviations. Every method gets the same samples, and is told when the load came.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is loaded: one core is what is measured

import numpy as np
from peer_legs import CONTENDERS, LIBRARIES, Fitted, Problem, Signals, truth_predictor
from peer_tables import LEG_FIGURES, TRUNK_FIGURES, TRUTH, Row, explained, markdown
from peer_trunks import CASES, SETTINGS, TRUNK_METHODS, Walks, trunk_rows

from stadera.excite.sinusoids import Sinusoids
from stadera.files import write_text, written_together
from stadera.lab.plant.leg import perturbed_physical, simulate_leg
from stadera.logs import Preprocessing, Recording, preprocess, read, suggest_cutoff, take, write_table
from stadera.robot import JointDynamics, Robot, load_robot

DRIVE = JointDynamics(armature=0.03, viscous=0.6, coulomb=1.2, offset=-0.5)
NOISE = {"position": 2e-4, "effort": 0.5}  # rad, N·m: `standard`
PROBLEMS = {"hyq": ("hyq", "RH"), "go2_legs_in_air": ("go2", "RF")}


def true_hyq() -> Robot:
    """Whose leg is not the model's."""
    model = load_robot("hyq")
    leg = perturbed_physical(model, "RH", np.random.default_rng(3), com_std=0.01, stretch_std=0.1)
    return leg.with_dynamics(dict.fromkeys(model.tree.joints, DRIVE))


def with_truth(leg: str) -> Fitted:
    """The leg as it is."""
    return Fitted(truth_predictor(true_hyq(), leg), 0.0, True, False, "the plant's own values")


def hyq_log() -> Recording:
    """40 s at 250 Hz, two sinusoids a joint, noise on positions and torques."""
    rng, n = np.random.default_rng(0), 3
    motion = Sinusoids(
        joints=load_robot("hyq").leg("RH").joints,
        rest=np.array([0.0, -0.6, 1.2]),
        origins=np.array([[0.05, -0.5, 1.1]]),
        amplitudes=np.array([0.25, 0.35, 0.45])[:, None] * np.array([1.0, 0.5]) * np.ones((1, n, 2)),
        frequencies=rng.uniform(0.4, 1.6, (1, n, 2)),
        phases=rng.uniform(0.0, np.pi, (1, n, 2)),
        starts=np.array([0.0, 39.0]),
        fade=1.0,
    )
    exact = simulate_leg(true_hyq(), "RH", motion.sample(250.0))
    assert exact.effort is not None
    noisy = {name: getattr(exact, name) + rng.normal(0.0, size, exact.position.shape) for name, size in NOISE.items()}
    return Recording(exact.time, exact.joints, noisy["position"], effort=noisy["effort"])


def signals(log: Recording, joints: tuple[str, ...]) -> Signals:
    """Filtered without a shift in time at the cut-off that the log suggests, differentiated."""
    chosen = Preprocessing(cutoff_hz=suggest_cutoff(log))
    done = preprocess(log, chosen, joints)
    assert done.effort is not None
    return Signals(done.time, done.position, done.velocity, done.acceleration, done.effort)


def fitted(contender: str, case: str, path: Path) -> dict[str, Any]:
    """One contender's figures on one log. Its libraries are loaded before time and memory are taken.

    Raises:
        ImportError: a library of the contender's is not installed.
    """
    for library in LIBRARIES.get(contender, ()):
        importlib.import_module(library)
    kind, leg = PROBLEMS[case]
    robot, log = load_robot(kind), read(path)
    joints = robot.leg(leg).joints
    half = len(log) // 2
    first, second = take(log, slice(0, half)), take(log, slice(half, None))
    test = signals(second, joints)
    before, begun = peak_mb(reset=True), time.process_time()
    if contender == TRUTH:
        found = with_truth(leg)
    else:
        found = CONTENDERS[contender](Problem(robot, leg, first, lambda: signals(first, joints)))
    seconds, peak = time.process_time() - begun, peak_mb()
    predicted = found.predict(test.q, test.v, test.a)
    if found.lag:
        later = test.time + found.lag
        predicted = np.column_stack([np.interp(later, test.time, column) for column in predicted.T])
    inside = slice(50, -50)  # the filter's ends
    return {
        "seconds": seconds,
        "mb": peak - before,
        "rmse": float(np.sqrt(np.mean((predicted - test.tau)[inside] ** 2))),
        "error": error_to_truth(found, leg) if case == "hyq" else None,
        "physical": found.physical,
        "bars": found.bars,
        "settings": found.settings,
    }


def error_to_truth(found: Fitted, leg: str) -> float:
    """Root mean square of the torque's error [N·m] in random motions at up to 4 rad/s and 20 rad/s²."""
    rng = np.random.default_rng(9)
    fast = [size * rng.uniform(-1.0, 1.0, (400, 3)) for size in (1.2, 4.0, 20.0)]
    return float(np.sqrt(np.mean((found.predict(*fast) - truth_predictor(true_hyq(), leg)(*fast)) ** 2)))


def legs(contenders: Sequence[str], cases: Sequence[str]) -> Iterator[Row]:
    """Every contender on every log, each in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        for case in cases:
            path = Path(folder) / f"{case}.parquet"
            write_table(hyq_log() if case == "hyq" else read(case), path)
            for contender in (*contenders, *([TRUTH] if case == "hyq" else [])):
                command = [sys.executable, __file__, "--one", contender, case, str(path)]
                done = subprocess.run(command, capture_output=True, text=True, check=False)
                row = {"case": case, "contender": contender}
                if done.returncode:
                    yield row | {"skipped": (done.stderr.strip().splitlines() or ["failed"])[-1]}
                else:
                    yield row | json.loads(done.stdout.splitlines()[-1])


def peak_mb(reset: bool = False) -> float:
    """The process's peak resident memory [MB], from now on if it is reset (Linux)."""
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    status = Path("/proc/self/status").read_text()
    return float(status.split("VmHWM:")[1].split()[0]) / 1024.0


def main() -> None:
    """Runs everything and prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=Walks.seeds, help="walks for each robot and set of errors")
    parser.add_argument("--quick", action="store_true", help="a minute: one log, one short walk, no mujoco.sysid")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--one", nargs=3, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.one:
        print(json.dumps(fitted(args.one[0], args.one[1], Path(args.one[2]))))
        return
    if args.quick:
        record = compared(QUICK, [name for name in CONTENDERS if name != "mujoco.sysid"], ["hyq"], ["trot, standard"])
    else:
        record = compared(Walks(seeds=args.seeds), list(CONTENDERS), list(PROBLEMS), list(CASES))
    print(markdown(record))
    if args.json:
        with written_together([args.json]) as (draft,):
            write_text(draft, json.dumps(record, indent=1, ensure_ascii=False))


QUICK = Walks(robots=("go2",), seeds=1, loaded_at=3.0, duration=6.0)


def compared(walks: Walks, contenders: list[str], problems: list[str], cases: list[str]) -> dict[str, Any]:
    """All rows, why a peer is ahead, and what each was run with."""
    leg_rows = explained(list(legs(contenders, problems)), LEG_FIGURES)
    return {
        "cases": {name: f"{name}, {PROBLEMS[name][1]}" for name in problems},
        "settings": {
            **{f"{row['contender']}, legs": row["settings"] for row in leg_rows if "settings" in row},
            **{f"{TRUNK_METHODS[name]}, trunks": said for name, said in SETTINGS.items()},
        },
        "legs": [{key: value for key, value in row.items() if key != "settings"} for row in leg_rows],
        "trunks": explained(list(trunk_rows(walks, cases)), TRUNK_FIGURES),
        "walks": asdict(walks),
    }


if __name__ == "__main__":
    main()
