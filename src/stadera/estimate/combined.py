"""Everything that statics tell, in one problem: poses, forces, the vertical, and the constant errors as unknowns.

Torque offsets, errors of the feet's positions and of the vertical do not change over a run, while the poses do. The six
equations of every pose (and three more for each leg held in the air) therefore tell them apart from the centre of mass,
once there are poses enough: two unknown torques cannot look like a shifted load at every tilt, height and place of the
trunk. They are sought together with the trunk,

    min over θ, n of  Σ_poses ‖whitened equations(θ, n)‖² + nᵀ C⁻¹ n + the weak prior of approach (a),

by Gauss-Newton: the equations are linear in all but the feet, and nearly so in these. See `stadera.estimate.poses`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stadera.estimate.equilibrium import ConstantErrors
from stadera.estimate.noise import ForceNoise
from stadera.estimate.poses import PosesCom, TrunkSolution, sought

Array = NDArray[np.float64]

_ITERATIONS = 6
_SETTLED = 1e-6  # m, by which the centre of mass still changes
WIDE_TORQUE, WIDE_FOOT = 0.15, 0.03
"""What `CombinedCom` takes offsets to be at most unless told: share of the effort limits, and [m]; 1 σ."""


class CombinedCom(PosesCom):
    """Trunk and constant errors together, over the poses that the robot has held.

    Arguments and errors as for `PosesCom`; `errors` None for torque offsets of 15 % of the effort limits, feet off by
    3 cm, 0.2° of the vertical (1 σ each).

    Attributes:
        sources: (39,), the constant errors as last estimated, in the order of `error_names`.
    """

    _KEPT = 64

    def _usual_errors(self) -> ConstantErrors:
        return ConstantErrors.of(ForceNoise.of(self.robot, constant=WIDE_TORQUE, foot_position=WIDE_FOOT))

    @property
    def sources(self) -> Array:
        """(39,), the constant errors as last estimated."""
        return self._linear_at.copy()

    def _solution(self) -> TrunkSolution:
        before, self._linear_at = np.full(3, np.inf), self._anchor
        for _ in range(_ITERATIONS):
            solution = sought(self._gathered().merge(self._prior), self.errors)
            self._linear_at = solution.errors
            if float(np.abs(solution.com - before).max()) < _SETTLED:
                break
            before = solution.com
        return solution

    def _close(self) -> None:
        if len(self._closed) >= self._KEPT:  # the oldest pose is about to be made linear for good
            self._solve()
            self._anchor = self._linear_at
        super()._close()
