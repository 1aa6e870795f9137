"""Information expected from a motion before it is performed, predicted by the prior model.

With Gaussian noise of known size and the prior θ = θ_CAD + S x, x ~ N(0, 1), a log whose rows compress to R θ = z
lowers the entropy of the prior, for any torques, by::

    gain = ½ log det(1 + Sᵀ Rᵀ R S) = Σ_k ½ log(1 + s_k²)        [nat], s_k the singular values of R S

This is the mutual information of log and parameters, and the criterion of D-optimality with a prior. It does not depend
on units or frames; directions that no motion can excite add nothing instead of minus infinity; and a direction counts
by the factor by which its standard deviation shrinks, not by its initial size as in sums of variances.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from stadera.body import FrictionModel, JointMotion, JointTorqueRegressor
from stadera.errors import IdentificationError, positive
from stadera.excite.bounds import LegBounds
from stadera.excite.sinusoids import Reference
from stadera.identify.observability import Observability, observability
from stadera.identify.prior import Prior, robot_prior
from stadera.information import Information
from stadera.types import Array

_POSES = 500


@dataclass(frozen=True, eq=False)
class LegExperiment:
    """A leg on a held trunk and its sensors."""

    bounds: LegBounds  # of the leg
    noise: Array  # (n,) [N·m], standard deviation of one torque sample, independent from sample to sample
    rate: float = 1000.0  # sampling rate of the log [Hz]
    # joint-side terms identified together with the rigid bodies
    friction: FrictionModel = field(default_factory=FrictionModel.full)

    def __post_init__(self) -> None:
        noise = np.asarray(self.noise, dtype=float)
        count = len(self.bounds.joints)
        if noise.shape != (count,) or not (np.isfinite(noise).all() and (noise > 0).all()):
            raise IdentificationError(f"torque noise needs {count} positive numbers [N·m], got {noise.tolist()}")
        positive("a sampling rate", self.rate, "Hz", IdentificationError)
        object.__setattr__(self, "noise", noise)

    @classmethod
    def usual(
        cls, bounds: LegBounds, rate: float = 1000.0, noise: float = 0.0033, noise_of_gravity: float = 0.02
    ) -> LegExperiment:
        """Torque noise as shares of each joint's effort limit, or of its largest gravity torque if it has none."""
        limits = np.array([bounds.robot.limits[joint].effort for joint in bounds.joints])
        poses = np.random.default_rng(0).uniform(bounds.lower, bounds.upper, (_POSES, len(bounds.joints)))
        gravity = np.abs(bounds.gravity_torque(poses)).max(axis=0)
        return cls(bounds, np.where(np.isfinite(limits), noise * limits, noise_of_gravity * gravity), rate)

    @cached_property
    def regressor(self) -> JointTorqueRegressor:
        """Regressor of the leg."""
        return JointTorqueRegressor(self.bounds.robot.leg_tree(self.bounds.leg), self.friction)

    @cached_property
    def prior(self) -> Prior:
        """Prior of the leg's parameters."""
        return robot_prior(self.bounds.robot, self.regressor.columns)

    def information(self, reference: Reference) -> Information:
        """Information in a log of the motion, sampled at the experiment's rate."""
        interval = float(np.mean(np.diff(reference.time)))
        data = self._information(reference.motion, self.noise)
        return data.scaled_noise(float(np.sqrt(1.0 / (interval * self.rate))))

    def gain(self, reference: Reference) -> float:
        """The motion's information gain [nat]."""
        singular = np.linalg.svd(self.information(reference).R @ self.prior.root, compute_uv=False)
        return float(0.5 * np.sum(np.log1p(singular**2)))

    def observability(self, reference: Reference) -> Observability:
        """Observability of the parameters in a log of the motion, compared with the prior."""
        return observability(self.information(reference), self.prior)

    @cached_property
    def structure(self) -> Observability:
        """Observability under the richest motion without noise, whose combinations are identifiable at best."""
        rng = np.random.default_rng(0)
        shape = _POSES, len(self.bounds.joints)
        position = rng.uniform(self.bounds.lower, self.bounds.upper, shape)
        motion = JointMotion(position, *rng.normal(0.0, (2.0, 10.0), (*shape, 2)).transpose(2, 0, 1))
        return observability(self._information(motion, 1e-6 * self.noise), self.prior)

    def _information(self, motion: JointMotion, noise: Array) -> Information:
        torque = np.zeros_like(motion.position)
        return Information.of(self.regressor.rows(motion, torque, std=noise), self.regressor.columns)
