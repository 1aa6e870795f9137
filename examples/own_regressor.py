"""Add your own term to the joint-torque model: a torsion spring at the knee.

Whatever is linear in its parameters becomes `Rows`: names, matrix, target, noise. An `Information` adds rows up and
solves them; it does not know where they come from.

    python examples/own_regressor.py
"""

import numpy as np

import stadera
from stadera.body import FrictionModel, JointMotion, JointTorqueRegressor, Rows, TrunkMotion
from stadera.information import Information

NOISE = 0.05  # N·m, standard deviation of the measured torque


def main(samples: int = 2000, stiffness: float = 12.0) -> None:
    robot = stadera.load_robot("hyq")
    tree = robot.leg_tree("RH")
    knee = tree.joints[2]

    # a motion, and the torques that a leg with a spring would measure
    rng = np.random.default_rng(0)
    q, dq, ddq = (scale * rng.uniform(-1, 1, (samples, 3)) for scale in (1.0, 5.0, 30.0))
    motion, trunk = JointMotion(q, dq, ddq), TrunkMotion.held(np.array([0.0, 0.0, 1.0]))
    rigid = JointTorqueRegressor(tree, FrictionModel(("viscous",)))
    truth = {
        f"{link}.{name}": value for link in tree.links[1:] for name, value in robot.inertias[link].to_dict().items()
    }
    truth |= {f"{joint}.viscous": 0.1 for joint in tree.joints}
    torque = np.column_stack([r.predict(np.array([truth[c] for c in r.columns]))
                              for r in rigid.rows(motion, np.zeros((samples, 3)), trunk)])  # fmt: skip
    torque[:, 2] += stiffness * q[:, 2]
    torque += NOISE * rng.standard_normal(torque.shape)

    # your regressor: the library's rows, and for the knee one column more
    rows = []
    for joint, row in zip(tree.joints, rigid.rows(motion, torque, trunk, std=NOISE), strict=True):
        if joint == knee:
            matrix = np.column_stack([row.matrix, q[:, 2]])
            row = Rows((*row.columns, f"{knee}.spring"), matrix, row.target, row.std)
        rows.append(row)
    columns = (*rigid.columns, f"{knee}.spring")

    # solve: the rigid bodies known from CAD, friction and spring free
    known = {name: value for name, value in truth.items() if not name.endswith("viscous")}
    information = Information.of(rows, columns).fix(known)
    for name in information.names:
        value, std = information.mean[information[name]], np.sqrt(information.covariance(name))
        print(f"{name:22} {value.item():8.4f} ± {std.item():.4f}")


if __name__ == "__main__":
    main()
