"""Weigh a robot from a log: the trunk, the payload on it, and when the load changed.

python examples/weigh_log.py walk.csv hyq 0 2          # without its payload from 0 to 2 s
"""

import sys

import stadera


def main(log: str | None = None, robot: str = "hyq", begin: str = "0", end: str = "2.5") -> None:
    if log is None:  # without arguments a simulated walk, on which 8 kg land after 3 s (extra `lab`)
        from stadera.lab.scenarios.catalog import Load, SimulateSettings
        from stadera.lab.scenarios.run import simulate

        settings = SimulateSettings(load=Load(8.0), load_time=3.0, rate=500.0)
        log = simulate(stadera.load_robot(robot), "crawl-load", settings).recording

    # columns of the log are found by name; a Recording made of arrays or a data frame does as well
    result = stadera.weigh(robot, log, tare=(float(begin), float(end)))
    print(result)

    # figures hold, or are doubtful and their bars widened, or the log does not fit the model
    print("trust:", result.trust.verdict, *result.trust.reasons)

    # standard deviations belong to every figure; NaN where the motion did not show it
    payload = result.payload
    print(f"payload {payload.mass:.3f} ± {payload.mass_std:.3f} kg at {payload.com} m in the trunk's frame")
    for change in result.changes:
        print(f"load changed at {change.time:.2f} s")

    result.save_json("weighed.json")
    result.save_html("weighed.html")
    result.save_urdf("weighed.urdf")  # the payload as a link of its own


if __name__ == "__main__":
    main(*sys.argv[1:])
