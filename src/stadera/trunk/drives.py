"""What a robot's motion told about its drives: rotor inertia, friction and torque offset of the legs' joints.

These are model errors that weighing estimates together with the trunk (`stadera.trunk.joint_errors`); with the model's
values they are the drives'. The next log may start from them: `--legs` takes the JSON of a weighing.

A leg in the air shows the inertia about each joint as a whole. What its links have more than the model is taken for
rotor inertia, so that a rotor is known no better than Σ (s_l I_l)², with I_l the inertia of each link beyond the joint
about its axis, and s_l the relative error of the link's mass.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stadera.robot.kinematics import forward_kinematics
from stadera.robot.model import Robot
from stadera.robot.stance import usual_configuration
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.joint_errors import Errors
from stadera.types import Array, Bools

TERMS = {"armature": "rotor", "viscous": "viscous", "coulomb": "coulomb", "offset": "offset"}
"""Names of the joints' terms, and of their errors in `ErrorLayout.places`."""
_LEARNT = 0.5  # of the prior's standard deviation, below which a term was observed
_KNOWN = 0.25  # the same, below which it was observed by itself rather than in part


@dataclass(frozen=True, eq=False)
class Drives:
    """Terms of the legs' joints, in the order of `TERMS`.

    Attributes:
        joints: names, by leg and outwards.
        model: (joints, 4), the model's values [kg·m², N·m·s/rad, N·m, N·m]; `value` with the errors estimated.
        std, prior_std: (joints, 4), standard deviations after and before the log.
    """

    joints: tuple[str, ...]
    model: Array
    value: Array
    std: Array
    prior_std: Array

    @classmethod
    def of(cls, robot: Robot, model: ErrorModel, errors: Errors) -> Drives:
        """Of a robot with these model errors."""
        joints = tuple(joint for leg in robot.legs for joint in leg.joints)
        places = [model.layout.places[name] for name in TERMS.values()]
        given = np.array([[getattr(robot.dynamics[joint], term) for term in TERMS] for joint in joints])
        mean, std, prior = (
            np.array([values[place] for place in places]).T
            for values in (errors.mean, errors.std, np.sqrt(model.variance))
        )
        share = np.sqrt(model.variance[model.layout.places["link_mass"]])
        std[:, 0] = np.hypot(std[:, 0], np.sqrt(((_carried(robot) * share) ** 2).sum(axis=1)))
        return cls(joints, given, given + mean, std, prior)

    @property
    def observed(self) -> Bools:
        """(joints, 4), which terms the log told."""
        return np.asarray(self.std < _LEARNT * self.prior_std)

    def to_dict(self) -> dict[str, Any]:
        """By joint and term, in the form of `identify --json`; what was not observed is the model's, without std."""
        out: dict[str, Any] = {}
        for j, joint in enumerate(self.joints):
            out[joint] = {}
            for k, term in enumerate(TERMS):
                seen, alone = self.observed[j, k], self.std[j, k] < _KNOWN * self.prior_std[j, k]
                out[joint][term] = {
                    "prior": float(self.model[j, k]),
                    "value": float(self.value[j, k] if seen else self.model[j, k]),
                    "std": float(self.std[j, k]) if seen else None,
                    "observability": "observable" if alone else "partial" if seen else "unobservable",
                }
        return out


def _carried(robot: Robot) -> Array:
    """Inertia (joints, links) [kg·m²] of each link beyond a joint about its axis, in the nominal stance, or with all
    joints at zero if there is none.
    """
    tree, q = robot.tree, usual_configuration(robot)
    rotations, translations = (values[0] for values in forward_kinematics(tree, q[None]))
    out = np.zeros((len(tree.joints), len(tree.joints)))
    for k, link in enumerate(tree.links[1:]):
        body, R = robot.inertias[link], rotations[k + 1]
        centre = translations[k + 1] + R @ body.com
        for j in tree.ancestors(k):
            axis, lever = rotations[j + 1] @ tree.axes[j], centre - translations[j + 1]
            about = R @ body.inertia_com @ R.T
            out[j, k] = axis @ about @ axis + body.mass * float(np.sum(np.cross(axis, lever) ** 2))
    return out
