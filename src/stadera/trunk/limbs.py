"""Rows of the limbs besides the legs: what their joints carry, and what a load on any link does to all rows.

With X_k the inertial wrench of link k as columns of its ten parameters (`stadera.body.kernel`), a body of parameters φ
that is added to it changes

    the trunk's rows:     A θ - (∂b/∂φ_k) φ + C p = b
    a limb's joint j:     r_jᵀ X_k φ + I_r q̈ + b q̇ + c s + o + (g + g_0) τ + p_s + Σ_i r_jᵀ X_i δφ_i = τ - h

for all joints j between it and the trunk, with p_s only while the joint rests, and I_r, b and c only while it does not:
as it turns back its friction changes sign with it, which is noise; g_0 is the scale of all joints' torques; δφ_i of
masses and centres of the limb's own links. ∂b/∂φ_k are `State.columns`, which are -X_k for a link outside the legs, and
r_j takes a wrench to the torque that joint j needs. So a hand that holds still tells by its arm's torques what it
holds, and one that moves by the trunk's rows too.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from stadera.body import Body, Motion, State
from stadera.body.friction import direction
from stadera.inertia import parameter_map
from stadera.robot.limbs import Limbs, Place
from stadera.robot.model import Robot
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.window import Window
from stadera.types import Array, Bools

TERMS = ("limb_rotor", "limb_viscous", "limb_coulomb", "limb_offset", "limb_gain")
"""Errors of a limb's joints, in the order of the sums."""

LIMB_SUMS = ("limb_terms", "limb_left", "limb_columns", "limb_motion")


class LimbRows:
    """Rows of a robot's limbs.

    Args:
        robot: the model. body: its tree, with the joints outside the legs only if the log has them.
        places: links on which a load may be, besides the trunk; what is not in the body is not seen.
        layout: places of the errors.

    Attributes:
        joints: (l,), places of the limbs' joints in the body.
    """

    def __init__(self, robot: Robot, body: Body, places: tuple[Place, ...], layout: ErrorLayout) -> None:
        n, known = len(robot.tree.joints), len(body.joints)
        limbs = [n + k for k in Limbs.of(robot).joints if n + k < known]
        self.joints: NDArray[np.int64] = np.array(limbs, dtype=np.int64)
        loaded = np.array([place.body if place.body < known else 0 for place in places], dtype=np.int64)
        self._there = np.repeat([float(place.body < known) for place in places], 10)
        self._links = np.concatenate([self.joints, loaded])
        self._body, self._layout, self._places, self._loaded = body, layout, places, loaded
        self._sliding = body.slides[self.joints][:, None]
        self._carries = np.array([[_carried(body, k, j) for k in self._links] for j in self.joints], dtype=float)
        self._carries = self._carries.reshape(len(self.joints), len(self._links))
        poses = robot.extra.poses(robot.extra.reference) if robot.extra is not None else []
        self._at_reference = np.array([parameter_map(*poses[k - n]) for k in self.joints])

    def sums(self, window: Window, motion: Motion, state: State, effort: Array) -> dict[str, Array]:
        """Weighted sums over B blocks, in both halves of a window, by name:

        limb_terms: (B, 2, l, 5), of q̈, q̇, s, 1 and τ. limb_left: (B, 2, l), of τ - h.
        limb_columns: (B, 2, l, links, 10), of r_jᵀ X_k; zero unless joint j carries link k.
        limb_motion: (B, 2, l, 2), of q̇ and q̈.

        Args:
            effort: (n, l), of the limbs' joints; zero throughout a block where it is not known.
        """
        known = np.logical_or.reduceat(effort != 0.0, window.edges[:-1], axis=0)[:, None].astype(float)
        each = self.at(motion, window.line(motion.velocity[:, self.joints]), state, effort)
        sums = {name: window.sums(window.halves, values) for name, values in each.items()}
        for name in LIMB_SUMS[:3]:
            sums[name] *= known.reshape(*known.shape, *[1] * (sums[name].ndim - 3))
        return sums

    def at(self, motion: Motion, sliding: Array, state: State, effort: Array) -> dict[str, Array]:
        """What `sums` are of, at n samples; the velocities `sliding` (n, l) determine the direction of friction."""
        J, s = self.joints, direction(sliding)
        q, v = motion.acceleration[:, J], motion.velocity[:, J]
        return {
            "limb_terms": np.stack([q, v, s, np.ones_like(s), effort], axis=-1),
            "limb_left": effort - state.torque[:, J],
            "limb_columns": self._columns(state),
            "limb_motion": np.stack([v, q], axis=-1),
        }

    def _columns(self, state: State) -> Array:
        """r_jᵀ X_k, (n, l, links, 10); zero unless joint j carries link k."""
        J, n = self.joints, len(state.torque)
        origin, axis = state.origin[:, J], state.axis[:, J]
        turning = np.concatenate([np.cross(origin, axis), axis], axis=2)
        sliding = np.concatenate([axis, np.zeros_like(axis)], axis=2)
        r, X = np.where(self._sliding, sliding, turning), -state.columns[:, self._links]  # X: (n, links, 6, 10)
        columns = np.matmul(r, X.transpose(0, 2, 1, 3).reshape(n, 6, -1)).reshape(n, len(J), len(self._links), 10)
        return np.asarray(columns * self._carries[:, :, None])

    def quieten(self, sums: Mapping[str, Array], rests: Bools, state: State | None, still: Bools) -> None:
        """Puts what acts on the links of a robot that stands in place of noise, in windows' sums.

        Columns of accelerations that are noise would be correlated with the target's, and a load or an error of a link
        that is minus the link itself would explain both. By signs of velocities that are noise joints that rest would
        seem to have no friction.

        Args:
            sums: of B windows, also "by_links". rests: (B,), in which the trunk rests. state: of those, None of none.
            still: (B, l), joints that rest.
        """
        sums["limb_terms"][..., :3] *= ~still[..., None]
        if state is not None:
            known = (sums["limb_terms"][rests, :, 3] > 0.0).astype(float)
            sums["by_links"][rests] = state.columns
            sums["limb_columns"][rests] = self._columns(state) * known[..., None, None]

    def rows(self, sums: Mapping[str, Array], by_mass_and_centre: Array, still: Bools) -> Array:
        """Columns (B, l, 10 + 1 + errors + loads) of A, b, C and of what a load does, of B windows' sums.

        Args:
            by_mass_and_centre: (links of the body, 10, 4), derivatives of each link's parameters.
            still: as of `quieten`.
        """
        layout, count, columns = self._layout, len(self.joints), sums["limb_columns"]
        out = np.zeros((len(columns), count, 11 + layout.count + 10 * len(self._places)))
        out[:, :, 10], C, each = sums["limb_left"], out[:, :, 11 : 11 + layout.count], np.arange(count)
        terms = sums["limb_terms"]
        for k, name in enumerate(TERMS):
            C[:, each, layout.places[name].start + each] = terms[..., k]
        C[:, :, layout.places["common_gain"].start] = terms[..., TERMS.index("limb_gain")]
        C[:, each, layout.places["limb_stiction"].start + each] = still * terms[..., 3]
        own = by_mass_and_centre[self.joints]
        self._own(C, (columns[:, :, :count, None] @ own)[..., 0, :])
        out[:, :, 11 + layout.count :] = columns[:, :, count:].reshape(len(columns), count, -1)
        return out

    def add(self, columns: Array, A: Array, by_links: Array, by_mass_and_centre: Array) -> None:
        """Writes what errors of the limbs' links and a load do to the trunk's rows.

        The trunk contains the limbs' links at their reference, also what is wrong with them there. So only what these
        errors do elsewhere is an error of the rows.

        Args:
            columns: (B, 6, 10 + 1 + errors + loads), of the trunk's rows. A: (B, 6, 10), of the signals as they are.
            by_links: (B, links, 6, 10), sums of `State.columns`. by_mass_and_centre: as of `rows`.
        """
        end = 11 + self._layout.count
        if len(self.joints):
            effect = -(by_links[:, self.joints] + A[:, None] @ self._at_reference) @ by_mass_and_centre[self.joints]
            self._own(columns[:, :, 11:end], effect.transpose(0, 2, 1, 3))
        columns[:, :, end:] = -by_links[:, self._loaded].transpose(0, 2, 1, 3).reshape(len(A), 6, -1) * self._there

    def _own(self, C: Array, effect: Array) -> None:
        """Writes the effect (B, rows, l, 4) of masses and centres of the limbs' links."""
        C[:, :, self._layout.places["limb_mass"]] = effect[..., 0]
        C[:, :, self._layout.places["limb_com"]] = effect[..., 1:].swapaxes(2, 3).reshape(*C.shape[:2], -1)


def by_mass_and_centre(body: Body) -> Array:
    """Derivatives (links, 10, 4) of each link's parameters φ by a share of all of them, and by a displacement of its
    mass c without rotation: of m c by m, of I by m (2 c_i 1 - e_i cᵀ - c e_iᵀ).
    """
    out, unit = np.zeros((len(body.joints), 10, 1 + 3)), np.eye(3)
    for k, phi in enumerate(body.parameters):
        out[k, :, 0], c = phi, phi[1:4]
        for i, axis in enumerate(unit):
            tensor = 2.0 * c[i] * unit - np.outer(axis, c) - np.outer(c, axis)
            out[k, 1 + i, 1 + i] = phi[0]
            out[k, 4:, 1 + i] = tensor[np.triu_indices(3)]
    return out


def _carried(body: Body, link: int, joint: int) -> bool:
    """True if a joint is between a link and the trunk."""
    while link != joint and link < len(body.parents):
        link = int(body.parents[link])
    return link == joint
