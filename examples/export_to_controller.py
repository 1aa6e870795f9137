"""Write identified legs for a controller: as a model file, and as plain numbers in a JSON of your own layout.

stadera identify swing.csv --robot hyq --json legs.json
python examples/export_to_controller.py hyq legs.json
"""

import json
import sys
from pathlib import Path

import stadera
from stadera.identify.schema import with_identified_legs
from stadera.robot.export import export_model


def main(name: str = "go2", legs: str | None = None) -> None:
    if legs is None:  # without arguments a real log that comes with stadera
        legs = "legs.json"
        stadera.identify(name, "go2_legs_in_air").save_json(legs)
    robot = with_identified_legs(stadera.load_robot(name), legs)

    # 1. a copy of the model file with the identified values, for whatever reads URDF or MJCF
    export_model(robot, f"identified{robot.source.suffix}")

    # 2. what a whole-body controller reads; inertias are about the link frame's origin, in its axes
    config = {
        "links": {
            link: {"mass": body.mass, "com": body.com.tolist(), "inertia": body.inertia.tolist()}
            for link, body in robot.inertias.items()
        },
        "joints": {
            joint: {"rotor_inertia": d.armature, "viscous": d.viscous, "coulomb": d.coulomb}
            for joint, d in robot.dynamics.items()
        },
    }
    Path("controller.json").write_text(json.dumps(config, indent=2))
    print(f"identified{robot.source.suffix} and controller.json written, {robot.mass:.2f} kg")


if __name__ == "__main__":
    main(*sys.argv[1:])
