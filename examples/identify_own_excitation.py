"""Design a motion that excites one leg, play it, and identify the leg from the log.

A simulated leg plays the motion here (extra `lab`). On a robot whose trunk is held, play `motion.csv` and log joint
positions and torques instead.

    python examples/identify_own_excitation.py hyq RH
"""

import sys

import stadera
from stadera.excite.design import motion_table
from stadera.lab.plant.leg import simulate_leg
from stadera.logs import write_table
from stadera.report.numbers import number, with_std


def main(name: str = "hyq", leg: str = "RH", seconds: str = "30") -> None:
    robot = stadera.load_robot(name)

    # 1. the motion; `random=True` is quick, the default searches for the most informative motion for some minutes
    settings = stadera.ExciteSettings(duration=float(seconds), rate=250.0, random=True)
    excitation = stadera.excite(robot, leg, settings)
    reference = excitation.chosen.motion.sample(settings.rate)
    write_table(motion_table(robot, reference), "motion.csv")

    # 2. the log: columns <joint>.position and <joint>.effort are enough
    log = simulate_leg(robot, leg, reference)

    # 3. links, rotors and friction of the leg, each with its standard deviation
    result = stadera.identify(robot, [log], stadera.IdentifySettings(legs=(leg,)))
    for parameter, found in result.legs[0].parameters.items():
        value = number(found.value, 3) if found.std is None else with_std(found.value, found.std)
        print(f"{parameter:22} {value:22} {found.unit:10} {found.verdict}")


if __name__ == "__main__":
    main(*sys.argv[1:])
