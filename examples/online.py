"""Weigh a robot online, in the loop that reads its sensors. A log stands for the robot here.

python examples/online.py walk.csv hyq 2          # without its payload until 2 s
"""

import sys

import stadera
from stadera.logs import read


def main(log: str | None = None, robot: str = "hyq", tare: str = "2.5") -> None:
    if log is None:  # without arguments a simulated walk, on which 8 kg land after 3 s (extra `lab`)
        from stadera.lab.scenarios.catalog import Load, SimulateSettings
        from stadera.lab.scenarios.run import simulate

        settings = SimulateSettings(load=Load(8.0), load_time=3.0, rate=500.0)
        log = simulate(stadera.load_robot(robot), "crawl-load", settings).recording
    sensors = read(log)  # on your robot: its joint states and its IMU
    estimator = stadera.TrunkEstimator(robot, joints=sensors.joints, imu_frame=sensors.imu.frame)
    tared, changes = False, 0
    for k, t in enumerate(sensors.time):
        q, dq, tau = sensors.position[k], sensors.velocity[k], sensors.effort[k]
        estimator.update(t, q, dq, tau, sensors.imu.angular_velocity[k], sensors.imu.linear_acceleration[k])
        if not tared and t >= float(tare):
            estimator.tare()  # from here on `payload` is the difference to now
            tared = True
        if len(estimator.changes) > changes:
            changes += 1
            print(f"{t:.2f} s: the load changed")
    payload = estimator.payload
    print(f"payload {payload.mass:.2f} ± {payload.mass_std:.2f} kg, trust: {estimator.trust.verdict}")


if __name__ == "__main__":
    main(*sys.argv[1:])
