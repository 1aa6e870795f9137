"""How fast a leg is identified, beside what is commonly used, in one run on one machine.

From arrays (180,000 samples of HyQ's right hind leg, three joints) to the thirty inertial parameters:

* stadera: rows on whole arrays, square-root information, null-space solution (eq. 5);
* Pinocchio's `computeJointTorqueRegressor` in a Python loop, normal equations, least squares;
* iDynTree's `inverseDynamicsInertialParametersRegressor` in a Python loop, normal equations, least squares.

The runs alternate and medians are compared; on a machine that does other things too, the median over pairs of
successive runs says more. Then an hour at 1 kHz (3.6 million samples) is streamed from a Parquet file to the same
solution in a process of its own, whose peak memory is reported.
Run `python benchmarks/offline_leg.py`; `--json F` writes the figures.
"""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stadera.body import JointMotion, JointTorqueRegressor
from stadera.files import written_together
from stadera.identify.prior import robot_prior
from stadera.identify.solutions import null_space_solution
from stadera.information import Information
from stadera.lab.pinocchio import pinocchio_model
from stadera.logs import Preprocessing, Recording, preprocess_stream, stream, write_table
from stadera.robot import Robot, load_robot

Array = NDArray[np.float64]

LEG = "RH"
CHUNK = 16384
_REST = 0.2  # s; BLAS's threads wait for more work by spinning
NOISE = 1e-3  # N·m, only scales the stadera solution's confidence


def motion(samples: int, seed: int = 0) -> JointMotion:
    """Three sinusoids of about 0.6 Hz a joint."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples)[:, None] / 1000.0
    w = 2 * np.pi * rng.uniform(0.3, 0.9, (3, 3))
    phase, size = rng.uniform(0, np.pi, (3, 3)), rng.uniform(0.1, 0.4, (3, 3))
    angle = t[:, :, None] * w + phase
    centre = np.array([-0.2, 0.3, -1.2])
    return JointMotion(
        centre + (size * np.sin(angle)).sum(2), (size * w * np.cos(angle)).sum(2), -(size * w**2 * np.sin(angle)).sum(2)
    )


def with_stadera(robot: Robot, joints: JointMotion, torque: Array) -> Array:
    """Arrays to solution, chunk by chunk."""
    regressor = JointTorqueRegressor(robot.leg_tree(LEG))
    rows = (
        row
        for start in range(0, len(joints), CHUNK)
        for row in regressor.rows(joints.slice(slice(start, start + CHUNK)), torque[start : start + CHUNK], std=NOISE)
    )
    information = Information.of(rows, regressor.columns)
    return null_space_solution(information, robot_prior(robot, regressor.columns)).values


def with_pinocchio(robot: Robot, joints: JointMotion, torque: Array) -> Array:
    """The leg alone as a fixed-base model, one sample at a time; one product for the normal equations."""
    import pinocchio as pin

    full = pinocchio_model(robot)
    leg = robot.leg(LEG).joints
    others = [full.getJointId(name) for name in robot.tree.joints if name not in leg]
    locked = pin.buildReducedModel(full, [1, *others], pin.neutral(full))
    data = locked.createData()
    Y = np.empty((len(joints), 3, 30))
    q, v, a = joints.position, joints.velocity, joints.acceleration
    for k in range(len(q)):
        Y[k] = pin.computeJointTorqueRegressor(locked, data, q[k], v[k], a[k])
    flat = Y.reshape(-1, 30)
    return np.linalg.lstsq(flat.T @ flat, flat.T @ torque.ravel(), rcond=None)[0]


def with_idyntree(robot: Robot, joints: JointMotion, torque: Array) -> Array:
    """iDynTree's regressor of the leg, one sample at a time, normal equations."""
    import idyntree.bindings as idt

    assert robot.source is not None
    leg = robot.leg(LEG).joints
    loader = idt.ModelLoader()
    loader.loadReducedModelFromFile(str(robot.source), idt.StringVector(list(leg)))
    computations = idt.KinDynComputations()
    computations.loadRobotModel(loader.model())
    links = computations.getNrOfLinks()
    regressor = idt.MatrixDynSize(6 + 3, 10 * links)
    base, twist, gravity = np.eye(4), np.zeros(6), np.array([0.0, 0.0, -9.81])
    gram, right = np.zeros((10 * links, 10 * links)), np.zeros(10 * links)
    q, v, a = joints.position, joints.velocity, joints.acceleration
    for k in range(len(q)):
        computations.setRobotState(base, q[k], twist, v[k], gravity)
        computations.inverseDynamicsInertialParametersRegressor(twist, a[k], regressor)
        Y = regressor.toNumPy()[6:]
        gram += Y.T @ Y
        right += Y.T @ torque[k]
    return np.linalg.lstsq(gram, right, rcond=None)[0]


def timed(function: Callable[[], Array]) -> float:
    """Seconds of one run, begun when the threads of the run before have gone to sleep."""
    time.sleep(_REST)
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def peak_mb() -> float:
    """The process's peak resident memory [MB]; on Linux not `ru_maxrss`, in which a child starts with its parent's."""
    status = Path("/proc/self/status")
    if status.exists():
        return float(status.read_text().partition("VmHWM:")[2].split()[0]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def hour(robot: Robot, path: Path) -> None:
    """Streams a log to a solution; prints seconds and the process's peak memory."""
    start = time.perf_counter()
    joints = robot.leg(LEG).joints
    regressor = JointTorqueRegressor(robot.leg_tree(LEG))
    settings = Preprocessing(cutoff_hz=10.0)

    def rows() -> object:
        for part in preprocess_stream(stream(path, joints=joints, require=("effort",)), settings, joints):
            if part.effort is not None and len(part):
                motion = JointMotion(part.position, part.velocity, part.acceleration)
                for start in range(0, len(part), CHUNK):
                    piece = slice(start, start + CHUNK)
                    yield from regressor.rows(motion.slice(piece), part.effort[piece], std=NOISE)

    information = Information.of(rows(), regressor.columns)  # type: ignore[arg-type]
    null_space_solution(information, robot_prior(robot, regressor.columns))
    print(json.dumps({"seconds": time.perf_counter() - start, "peak_mb": peak_mb()}))


def write_hour(robot: Robot, path: Path, seconds: int) -> None:
    """A log of so many minutes at 1 kHz, a minute at a time."""
    joints = robot.leg(LEG).joints
    minute = motion(60_000)
    regressor = JointTorqueRegressor(robot.leg_tree(LEG))
    torque = regressor.predict(minute, prior_values(robot))
    write_table(
        (
            Recording(
                time=np.arange(60_000) / 1000.0 + 60.0 * k, joints=joints, position=minute.position, effort=torque
            )
            for k in range(seconds // 60)
        ),
        path,
    )


def prior_values(robot: Robot) -> dict[str, float]:
    """The model's parameters of the leg, by name."""
    columns = JointTorqueRegressor(robot.leg_tree(LEG)).columns
    return dict(zip(columns, robot_prior(robot, columns).values.tolist(), strict=True))


def main() -> None:
    """Runs everything and prints ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=180_000)
    parser.add_argument("--hour-seconds", type=int, default=3600, help="length of the streamed log [s]")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--stream", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    robot = load_robot("hyq")
    if args.stream:
        hour(robot, args.stream)
        return

    joints = motion(args.samples)
    torque = JointTorqueRegressor(robot.leg_tree(LEG)).predict(joints, prior_values(robot))
    contenders = {
        "stadera": with_stadera,
        "pinocchio_loop": with_pinocchio,
    }
    seconds: dict[str, list[float]] = {name: [] for name in contenders}
    with_stadera(robot, joints.slice(slice(0, 1000)), torque[:1000])
    peak = peak_mb()
    for _ in range(args.rounds):
        for name, function in contenders.items():
            seconds[name].append(timed(lambda f=function: f(robot, joints, torque)))
            if name == "stadera" and len(seconds[name]) == 1:
                peak = peak_mb()
    try:
        seconds["idyntree_loop"] = [timed(lambda: with_idyntree(robot, joints, torque))]
    except ImportError:
        print("iDynTree is not installed (pip install 'stadera[bench]'): left out")
    median = {name: statistics.median(values) for name, values in seconds.items()}

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hour.parquet"
        write_hour(robot, path, args.hour_seconds)
        streamed = json.loads(
            subprocess.run(
                [sys.executable, __file__, "--stream", str(path)], check=True, capture_output=True, text=True
            ).stdout
        )

    print(f"{args.samples} samples of HyQ's {LEG} leg, arrays to solution, median of {args.rounds}:")
    for name, value in median.items():
        print(f"  {name:18s} {value:8.3f} s   {value / median['stadera']:7.1f} x stadera's")
    pairs = [other / own for own, other in zip(seconds["stadera"], seconds["pinocchio_loop"], strict=True)]
    print(f"  pairs of runs: {statistics.median(pairs):.1f} times as fast as Pinocchio's loop in the median")
    print(f"  peak memory with stadera {peak:.0f} MB, the arrays and libraries included")
    print(f"{args.hour_seconds} s at 1 kHz streamed from Parquet:")
    print(f"  {streamed['seconds']:.1f} s, peak memory {streamed['peak_mb']:.0f} MB")
    if args.json:
        figures = {
            "seconds": median,
            "pairs": statistics.median(pairs),
            "peak_mb": {"stadera": peak, "hour_streamed": streamed["peak_mb"]},
            "hour_seconds": streamed["seconds"],
        }
        with written_together([args.json]) as (draft,):
            draft.write_text(json.dumps(figures, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
