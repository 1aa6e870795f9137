"""What a robot's motion showed about its drives: rotor inertia, friction and torque offset of the legs' joints.

These are model errors that weighing estimates together with the trunk (`stadera.trunk.joint_errors`); with the model's
values they are the drives'. The next log may start from them: `--legs` takes the JSON of a weighing.

A leg in the air shows the inertia about each joint as a whole. What its links have more than the model is taken for
rotor inertia, so that a rotor is known no better than Σ (s_l I_l)², with I_l the inertia of each link beyond the joint
about its axis, and s_l the relative error of the link's mass. Likewise the weight that the links have more than the
model, or elsewhere by r_l, is taken for a torque offset: Σ (s_l τ_l)² + (r_l m_l g)², with τ_l the torque of the link's
weight.

A friction law errs alike in each stride, in the air as under load. With each swing counted anew, Coulomb friction of
thighs and knees from fifteen trots of 20 s on a second plant is 2.7 and 2.9 standard deviations off (rms), else 1.0;
with half of `SwingDetection.strides` 0.7 and 0.8, with three times of it 1.8 and 1.7.
The trunk's estimate has them anew: with strides alike a real Go2's walk has half a kilogram less, other walks the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stadera.constants import GRAVITY
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
        errors: of which they are.
    """

    joints: tuple[str, ...]
    model: Array
    value: Array
    std: Array
    prior_std: Array
    errors: Errors

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
        by_share, by_place = _carried(robot)
        share, place = (np.sqrt(model.variance[model.layout.places[name]]) for name in ("link_mass", "link_com"))
        hidden = (by_share * share) ** 2
        hidden[1] += (by_place * place[: len(share)]) ** 2
        for k, of_links in zip((0, 3), np.sqrt(hidden.sum(axis=2)), strict=True):
            std[:, k] = np.hypot(std[:, k], of_links)
        return cls(joints, given, given + mean, std, prior, errors)

    @property
    def observed(self) -> Bools:
        """(joints, 4), which terms the log showed."""
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


def _carried(robot: Robot) -> tuple[Array, Array]:
    """Inertia about a joint's axis [kg·m²] and torque of the weight [N·m], (2, joints, links), of each link beyond it,
    and that torque's change by a displacement of the link [N], (joints, links); in the nominal stance, or with all
    joints at zero if there is none.
    """
    tree, q = robot.tree, usual_configuration(robot)
    rotations, translations = (values[0] for values in forward_kinematics(tree, q[None]))
    out, moved = np.zeros((2, len(tree.joints), len(tree.joints))), np.zeros((len(tree.joints), len(tree.joints)))
    for k, link in enumerate(tree.links[1:]):
        body, R = robot.inertias[link], rotations[k + 1]
        centre = translations[k + 1] + R @ body.com
        for j in tree.ancestors(k):
            axis, lever = rotations[j + 1] @ tree.axes[j], centre - translations[j + 1]
            about = R @ body.inertia_com @ R.T
            across = np.cross(axis, lever)
            out[0, j, k] = axis @ about @ axis + body.mass * float(across @ across)
            out[1, j, k] = body.mass * GRAVITY * across[2]
            moved[j, k] = body.mass * GRAVITY * float(np.hypot(axis[0], axis[1]))
    return out, moved
