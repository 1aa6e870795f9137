"""What a running robot costs: a Go2's trot at 500 Hz with a load, over Zenoh on loopback in real time.

Three processes: one publishes JointState and Imu by the clock, `stadera live` weighs, and this one listens as a
controller would.
Compared with the same log fed at once: the trunk in standard deviations. Measured: by how much the load was noticed
after the stamp at which it came, lost messages, processor time of `stadera live` as a share of one core, and the age
of the figures. `TrunkEstimator.update` is timed apart, sample by sample.

python benchmarks/live.py [--seconds 60] [--json F]; `--soak HOURS` instead feeds that much of the stream as fast as
it goes and reports memory and drift. Linux only.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import resource
import signal
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from live_client import Stadera, imu, joint_state

from stadera.files import written_together
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.live import LiveSession
from stadera.live.topics import Arrival
from stadera.logs import Recording, read, write_table
from stadera.logs.bags.decode import IMU, JOINT_STATE
from stadera.robot import Robot, load_robot
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.measurement import measurements_of
from stadera.trunk.samples import Samples

ROBOT, RATE, LOAD = "go2", 500.0, 3.0  # Hz, kg
BOUNDS = {"sigmas": 0.1, "noticed_s": 0.3, "lost": 0, "cpu_share": 0.5, "update_99_ms": 2.0, "update_worst_ms": 10.0}


def trot(robot: Robot, seconds: float) -> tuple[Recording, float]:
    """A log, and when its load comes [s]."""
    at = min(0.5 * seconds, 10.0)
    settings = SimulateSettings("standard", Load(LOAD), duration=seconds, rate=RATE, load_time=at)
    return simulate(robot, "trot-load", settings).recording, at


def publish(log: Recording, endpoint: str) -> None:
    """Sends a log by the clock; its stamps are the times of sending. Prints when its first sample was due."""
    robot, unit = Stadera(endpoint), log.imu
    assert unit is not None
    while not robot.state:
        time.sleep(0.05)
    begun = time.time() + 0.5
    print(begun, flush=True)
    for k, t in enumerate(log.time - log.time[0]):
        stamp = begun + float(t)
        if (ahead := stamp - time.time()) > 0:
            time.sleep(ahead)
        values = (channel[k].tolist() for channel in (log.position, log.velocity, log.effort))
        imu_values = unit.angular_velocity[k].tolist(), unit.linear_acceleration[k].tolist()
        robot.send(stamp, log.joints, *values, *imu_values, unit.frame or "")
    time.sleep(1.0)
    robot.session.close()


def processor_time(pid: int) -> float:
    """[s], of a process so far."""
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def over_zenoh(robot: Robot, log: Recording, loaded_at: float, folder: Path) -> dict[str, float]:
    """The stream's figures."""
    endpoint, path = "tcp/127.0.0.1:17447", write_table(log, folder / "trot.parquet")
    weigh = [sys.executable, "-m", "stadera", "live", "--robot", ROBOT, "--listen", endpoint]
    live = subprocess.Popen(weigh, stdout=subprocess.DEVNULL)
    robot_process = subprocess.Popen(
        [sys.executable, __file__, "--publish", str(path), endpoint], stdout=subprocess.PIPE, text=True
    )
    listener, ages, noticed = Stadera(endpoint), [], float("nan")
    assert robot_process.stdout is not None
    begun = float(robot_process.stdout.readline())
    time.sleep(max(begun - time.time(), 0.0))
    spent, last = processor_time(live.pid), {}
    while robot_process.poll() is None:
        time.sleep(0.002)
        if (state := listener.state) is last or not state:
            continue
        last, now = state, time.time()
        if state["lag"]["processing"] is not None and not state["waiting_for"]:
            ages.append(state["lag"]["processing"])
        if np.isnan(noticed) and any(c["time"] > begun + loaded_at - 1.0 for c in state["changes"]):
            noticed = now - (begun + loaded_at)
    spent = processor_time(live.pid) - spent
    live.send_signal(signal.SIGTERM)
    live.wait()
    listener.session.close()
    expected = TrunkEstimator(robot)
    expected.add(Samples.of_recording(log, robot))
    found, std = _flat(last), np.sqrt(np.diag(expected.trunk.covariance))
    value = np.array([expected.trunk.inertial.mass, *expected.trunk.com])
    return {
        "samples": len(log),
        "sigmas": float(np.nanmax(np.abs(found - value) / std)),
        "noticed_s": noticed,
        "lost": sum(last["lost"].values()),
        "cpu_share": spent / float(log.time[-1] - log.time[0]),
        "age_median_ms": 1e3 * float(np.median(ages)),
        "age_worst_ms": 1e3 * float(np.max(ages)),
    }


def _flat(state: dict) -> np.ndarray:
    """Mass and centre of mass, (4,), NaN where not observed."""
    trunk = state["trunk"]
    return np.array([trunk["mass"]["value"], *trunk["com"]["value"]], dtype=float)


def update_times(robot: Robot, log: Recording) -> dict[str, float]:
    """Single calls of `TrunkEstimator.update`: by the clock, and in processor time, which others disturb less. What is
    loaded is kept from the collector of cyclic garbage, as `stadera live` does: it would look through all of it once a
    minute, for 60 ms.
    """
    estimator, spent = TrunkEstimator(robot), []
    gc.collect()
    gc.freeze()
    for measurement in measurements_of(log, robot):
        begun = time.perf_counter(), time.thread_time()
        estimator.update(measurement)
        spent.append((time.perf_counter() - begun[0], time.thread_time() - begun[1]))
    gc.unfreeze()
    found = {}
    # without the first second, in which kernels are compiled and loaded
    for name, times in zip(("update", "update_cpu"), np.array(spent[500:]).T, strict=True):
        found[f"{name}_mean_us"] = 1e6 * float(times.mean())
        found[f"{name}_99_ms"] = 1e3 * float(np.percentile(times, 99))
        found[f"{name}_worst_ms"] = 1e3 * float(times.max())
    return found


def soak(robot: Robot, log: Recording, hours: float) -> dict[str, float]:
    """So many hours of a stream, the log again and again with later stamps: memory and the trunk's mass over time."""
    unit, session, masses, memory = log.imu, LiveSession(robot), [], []
    assert unit is not None
    rows = range(len(log))
    joints = [bytearray(joint_state(0.0, log.joints, log.position[k], log.velocity[k], log.effort[k])) for k in rows]
    inertial = [bytearray(imu(0.0, unit.angular_velocity[k], unit.linear_acceleration[k], "")) for k in rows]
    period, begun = 1.0 / RATE, time.monotonic()
    passes = max(2, round(3600.0 * hours / (len(log) * period)))
    for k in range(passes):
        for start in range(0, len(log), 5):
            session.feed(_stamped(joints, inertial, range(start, min(start + 5, len(log))), k * len(log), period))
        masses.append(session.state(session.intake.seen["/imu"].last).trunk.inertial.mass)
        memory.append(resident_mb())
    late = len(memory) // 4
    return {
        "hours": passes * len(log) * period / 3600.0,
        "times_real_time": passes * len(log) * period / (time.monotonic() - begun),
        "memory_mb": memory[late],
        "memory_end_mb": memory[-1],
        "mass_spread_kg": float(np.ptp(masses[late:])),
        "mass_std_kg": session.state(0.0).trunk.mass_std,
    }


def _stamped(joints: list, inertial: list, rows: range, before: int, period: float) -> list[Arrival]:
    found = []
    for k in rows:
        stamp = round(1e9 * (before + k) * period)
        for topic, kind, messages in (("/imu", IMU, inertial), ("/joint_states", JOINT_STATE, joints)):
            struct.pack_into("<iI", messages[k], 4, *divmod(stamp, 1_000_000_000))
            found.append(Arrival(topic, kind, stamp, bytes(messages[k]), 1e-9 * stamp))
    return found


def resident_mb() -> float:
    """Memory of this process now [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6


def main() -> None:
    """Runs what is asked for, and prints JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0, help="of the trot")
    parser.add_argument("--soak", type=float, metavar="HOURS")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--publish", nargs=2, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.publish:
        publish(read(args.publish[0]), args.publish[1])
        return
    robot = load_robot(ROBOT)
    log, loaded_at = trot(robot, args.seconds)
    if args.soak:
        unloaded = log.mapped(lambda _, values: values[log.time < loaded_at - 0.1])
        found = soak(robot, unloaded, args.soak)
    else:
        with tempfile.TemporaryDirectory() as folder:
            found = over_zenoh(robot, log, loaded_at, Path(folder)) | update_times(robot, log)
        found |= {"bounds": BOUNDS, "load_average": os.getloadavg()[0]}
    text = json.dumps(found, indent=2)
    print(text)
    if args.json:
        with written_together([args.json]) as (draft,):
            draft.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
