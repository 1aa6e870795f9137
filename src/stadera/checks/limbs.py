"""Hypotheses of limbs besides the legs: arms whose values are exchanged or in degrees, and joints of the other sign.

What an arm holds is named by its torques, so those of the other arm name the wrong hand, with any certainty. Each
joint's torque obeys a row of its own, whatever the feet do (`stadera.trunk.limbs`),

    Σ_k r_jᵀ X_k φ_k + C p = τ_j - h_j + noise

with φ_k a load at the end of each limb, up to the robot's own mass, which is another one in every second, as is the
friction that holds a joint at rest; p are errors of the drives, of their usual sizes. Their likelihood
(`stadera.checks.likelihood`) compares the log as recorded with hypotheses: one that explains the torques better than by
chance, also without the second that it gains most in, and better than any other is true. Arms that hang still side by
side show none, nor does a joint that carries hardly more than its friction. Where none is true and much of the torques
remains, something else is wrong with them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stadera.body import Body, Motion
from stadera.checks.hypotheses import Hypothesis, limb_faults
from stadera.checks.instants import Instants
from stadera.checks.likelihood import Products, explained, less
from stadera.checks.limits import CheckLimits
from stadera.checks.residual import unit
from stadera.logs.mend import AS_RECORDED, Mend
from stadera.logs.recording import Recording
from stadera.robot.imu import ImuMount, force_at_origin
from stadera.robot.limbs import Limbs, place_of
from stadera.robot.model import Robot
from stadera.trunk.error_model import ErrorModel, limb_limits
from stadera.trunk.history import wide_prior
from stadera.trunk.limbs import TERMS, LimbRows, by_mass_and_centre
from stadera.trunk.settings import ModelErrors
from stadera.types import Array, Bools

_ERRORS = tuple(f"limb_{name}" for name in ("rotor", "viscous", "coulomb", "offset", "gain"))
"""Errors of `stadera.trunk.error_model`. Those of the links' masses and centres move no gain by more than 4 %."""


@dataclass(frozen=True, eq=False)
class LimbFooting:
    """Rows of the limbs' joints at the instants of a log with an IMU, in units of 1 % of each joint's limit.

    Attributes:
        blocks: of all joints of the robot's `stadera.body.Body`.
    """

    robot: Robot
    blocks: Instants
    limits: CheckLimits

    @classmethod
    def of(cls, recording: Recording, robot: Robot, mount: ImuMount | None, limits: CheckLimits) -> LimbFooting | None:
        """Of a log with an IMU and torques of all joints of limbs; None of others."""
        extra, others = robot.extra, recording.others
        if extra is None or others is None or others.effort is None or mount is None or recording.effort is None:
            return None
        joints = [extra.joints[k] for k in Limbs.of(robot).joints]
        if not joints or not set(joints) <= set(others.names):
            return None  # what moves unseen turns what it carries
        k, more = len(extra.joints), extra.states(others, len(recording))
        legs = robot.tree.joints
        whole = replace(
            recording,
            joints=(*legs, *extra.joints),
            position=np.hstack([recording.channel("position", legs), more[:, :k]]),
            effort=np.hstack([recording.channel("effort", legs), more[:, 2 * k :]]),
            velocity=None,
            acceleration=None,
            others=None,
        )
        blocks = Instants.of(whole, whole.joints, mount, limits).thinned(limits.motion_instants, limits)
        return cls(robot, blocks, limits) if len(blocks) >= limits.order_fewest and blocks.complete else None

    @cached_property
    def _body(self) -> Body:
        return Body.of(self.robot)

    @cached_property
    def _model(self) -> ErrorModel:
        return ErrorModel(self.robot, ModelErrors())

    @cached_property
    def _by_mass(self) -> Array:
        return by_mass_and_centre(self._body)

    @cached_property
    def _rows(self) -> LimbRows:
        extra = self.robot.extra
        ends = () if extra is None else (place_of(self.robot, extra.links[k]) for k in Limbs.of(self.robot).ends)
        return LimbRows(self.robot, self._body, tuple(ends), self._model.layout)

    def _moving(self, blocks: Instants) -> tuple[dict[str, Array], Bools]:
        """What the rows are of without torques, see `LimbRows.at`, and the joints at rest (n, l)."""
        omega, a = blocks.angular_velocity, blocks.specific_force
        assert omega is not None
        assert a is not None
        alpha = blocks.slopes(omega)
        at_origin = force_at_origin(a, omega, blocks.lever, alpha)
        motion = Motion(blocks.position, blocks.rate, blocks.slopes(blocks.rate), omega, alpha, at_origin, unit(a))
        state, velocity = self._body.at(motion, columns=True), motion.velocity[:, self._rows.joints]
        still = np.abs(velocity) < self.limits.step_slides
        samples = self._rows.at(motion, velocity, state, np.zeros_like(velocity))
        samples["limb_terms"][..., :3] *= ~still[..., None]  # velocities at rest are noise, and so are friction's signs
        return samples, still

    @cached_property
    def _as_recorded(self) -> tuple[dict[str, Array], Bools]:
        return self._moving(self.blocks)

    def by_second(self, undo: Mend = AS_RECORDED) -> Products:
        """Of the log after a correction, without what is another one in every second."""
        blocks, J, layout = self.blocks.after(undo), self._rows.joints, self._model.layout
        moving, still = self._as_recorded if blocks.position is self.blocks.position else self._moving(blocks)
        effort, terms = blocks.effort[:, J], moving["limb_terms"].copy()
        terms[..., TERMS.index("limb_gain")] = effort
        samples = {**moving, "limb_terms": terms, "limb_left": moving["limb_left"] + effort}
        rows = self._rows.rows(samples, self._by_mass, still)
        known = effort != 0.0
        scale = known[..., None] / (0.01 * limb_limits(self.robot)[:, None])
        std, n = np.sqrt(self._model.variance), len(blocks)
        errors, holding = (rows[:, :, 11 + at] * std[at] for at in (layout.at(*_ERRORS), layout.at("limb_stiction")))
        loads = rows[:, :, 11 + layout.count :].reshape(n, len(J), -1, 10)[..., :4] * wide_prior(self.robot)[:4]
        hidden = scale * np.concatenate([holding, loads.reshape(n, len(J), -1)], axis=2)
        columns = scale * np.concatenate([rows[:, :, 10:11], errors], axis=2)
        found, counts, spreads = [], [], []
        for at in (blocks.group == one for one in np.unique(blocks.group)):
            H = hidden[at].reshape(-1, hidden.shape[2])
            found.append(less(columns[at].reshape(-1, columns.shape[2]), explained(H, 1.0)))
            counts.append(np.count_nonzero(known[at]))
            spreads.append(np.linalg.slogdet(np.eye(H.shape[1]) + H.T @ H)[1])
        return Products(np.array(found), np.array(counts, dtype=float), np.array(spreads))

    @cached_property
    def recorded(self) -> Products:
        """Of the log as recorded."""
        return self.by_second()

    @property
    def left(self) -> float:
        """What remains of the torques, share of their limits."""
        repeated = self.limits.order_repeated
        return 0.01 * float(np.sqrt(self.recorded.likelihood(repeated).variance / repeated))

    @property
    def turned(self) -> bool:
        """True if a joint turns further than any can."""
        turning = self._rows.joints[~self._body.slides[self._rows.joints]]
        return bool(np.abs(self.blocks.position[:, turning]).max(initial=0.0) > self.limits.unlimited)


def misread_limbs(footing: LimbFooting) -> tuple[list[Hypothesis], float] | None:
    """The hypothesis that explains the limbs' torques better than the log as recorded, or two that do so alike, and
    twice the gain in log likelihood; None if none does.
    """
    limits, recorded = footing.limits, footing.recorded
    tried = {one: footing.by_second(one.undo) for one in limb_faults(footing.robot, degrees=footing.turned)}
    costs = {one: each.likelihood(limits.order_repeated).cost for one, each in tried.items()}
    ranked = sorted(costs, key=costs.__getitem__)
    gain = recorded.likelihood(limits.order_repeated).cost - costs[ranked[0]]
    near = max(limits.order_gain, (1.0 - limits.alike) * gain)  # friction counts in both
    alike = [one for one in ranked if costs[one] - costs[ranked[0]] <= near]
    least = limits.order_gain if ranked[0].undo.swapped else limits.limb_gain
    if gain <= least or len(alike) > 2:
        return None
    always = recorded.gains_always(tried[ranked[0]], 0.5 * least, limits.order_repeated)
    return (alike, gain) if always else None
