"""Approach (b): the centre of mass from the trunk's orientation error (the paper's section III.B, eq. 12-15).

The trunk controller demands contact forces whose moment about the ESTIMATED centre of mass ĉ is that of its virtual
springs, K e with e = log(Rᵀ R_d) (trunk axes; R the trunk's rotation, R_d its reference), and compensates gravity by m
g u through ĉ (u: the vertical). At rest the forces carry the true weight and their moment about the TRUE centre of mass
c vanishes; about ĉ it is then (c - ĉ) x m g u, so for δ = c - ĉ of the whole robot

    K e = δ x m g u        =>        E δ = u x (K e) / (m g),      E = 1 - u uᵀ

exactly, for any reference. Upright, roll φ and pitch θ small, e = (-φ, -θ, ·) and

    δ_x = +K_y θ / (m g),      δ_y = -K_x φ / (m g)

which is the paper's M = [[0, -1], [1, 0]] K / (m g) on e_o = (-φ, -θ) (eq. 12; its I K_p is K).
A centre of mass ahead of the estimate lowers the nose, θ > 0, so ĉ_x must grow with +θ: eq. 14's α is M β. As printed,
with α a positive scalar on (-φ, -θ), the update would diverge in x.

Phase one steps ĉ by β S E δ (S: see `RecursiveCom`). At its end e = 0: the true centre of mass is above or below
ĉ along the vertical u₀, e_z of a trunk held upright. Phase two tilts the reference, and the remaining error is along u₀
alone, δ = s u₀:

    s = u₀ · (u x K e) / (m g (1 - (u · u₀)²))                                                            (eq. 15)

The loop of posture and estimate is stable: by Routh's criterion on the posture's ω² / (s² + 2 ζ ω s + ω²), the lag of
the estimate's use and the update, the paper's settling time leaves it a gain margin of 16 dB.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.constants import GRAVITY
from stadera.inertia import skew
from stadera.lab.laws.equilibrium import NoisyForces, constant_errors_of
from stadera.lab.laws.recursive import Instant, LawSettings, RecursiveCom, step_size
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.trunk.standing.forces import ContactForces
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class PostureLaw:
    """Parameters of the trunk controller that approach (b) needs."""

    stiffness: Array  # (3,) [N·m/rad], K about the trunk's axes
    reference: Array  # (3, 3), R_d, of the trunk in the world
    feeds_back: bool = True  # whether the controller uses this estimate; else it keeps the estimator's initial one


class OrientationCom(RecursiveCom):
    """Steps towards the centre of mass for which the trunk's orientation error vanishes.

    `posture` is the control law that holds the trunk; `start` is also the controller's initial estimate. Contact forces
    are used for mass and stance only.
    """

    def __init__(
        self,
        robot: Robot,
        posture: PostureLaw,
        start: TrunkModel | None = None,
        forces: NoisyForces | None = None,
        settings: LawSettings | None = None,
    ) -> None:
        super().__init__(robot, start, forces, settings)
        self.posture, self.reference = posture, posture.reference
        self._step, self._due = step_size(self.settings.settling, self.settings.period), np.nan
        self._clear()

    def look_for_height(self, reference: Array | None = None) -> None:
        super().look_for_height()
        if reference is not None:
            self.reference = reference
        self._clear()

    def _learn(self, measurement: Measurement, forces: ContactForces) -> None:
        if measurement.rotation is None:
            self._refuse("no orientation: this method weighs by the trunk's orientation error")
            return
        if np.isnan(self._due):
            self._due = measurement.time + self.settings.period
        self._turned += Rotation.from_matrix(measurement.rotation.T @ self.reference).as_rotvec()
        self._count += 1
        if measurement.time < self._due - 1e-9:
            return
        error, up = self._turned / self._count, measurement.up
        self._clear()
        self._due = measurement.time + self.settings.period
        self._correct(measurement, forces, error, up)

    def _correct(self, measurement: Measurement, forces: ContactForces, error: Array, up: Array) -> None:
        """Makes one step with the mean orientation error (3,) [rad] of a period."""
        leg_moment = forces.weights.moment
        com = self._robot_com(leg_moment)
        mass, weighed = self._weighed(forces, up, self._step)
        weight = GRAVITY * (mass + self.forces.leg_mass)
        felt = np.cross(up, self.posture.stiffness * error) / weight  # E δ of the controller's estimate
        if not self.posture.feeds_back:
            used = (self._start.mass * self._start.com_trunk + leg_moment) / (self._start.mass + self.forces.leg_mass)
            felt += (used - com) - up * float(up @ (used - com))
        innovation = self._selected(felt * (1.0 + self.forces.leg_mass / self._trunk.mass), up)
        if innovation is None:  # the posture is still moving to the tilt
            return
        self._settled.take(innovation, self._step)
        com_trunk = self._trunk.com_trunk + self._step * innovation
        if self._adopt(measurement.time, mass, com_trunk, weighed and self._settled.reached):
            self._looked_at(measurement, forces, com)

    def _interrupted(self) -> None:
        super()._interrupted()
        self._clear()

    def _clear(self) -> None:
        self._turned, self._count = np.zeros(3), 0
        self._due = np.nan

    def _felt(self, instant: Instant) -> Array:
        """Effect (4, k) of constant errors in this pose; an orientation error ε changes e by -ε."""
        felt = super()._felt(instant)
        felt[1:, constant_errors_of(self.robot)["vertical"]] = (
            -skew(instant.up) * self.posture.stiffness / (instant.trunk.mass * GRAVITY)
        )
        return felt
