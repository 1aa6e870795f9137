"""What is known from outside the log: a scale that the robot stood on, a test weight on its back, earlier logs.

Each is a set of values y that are linear in model errors p and in trunks θ_k, of the loads under which they were known:

    y = A p + Σ_k N_k θ_k + ε,      cov ε = R

An estimate of θ_k has the error n_k - K_k δ, with n_k the noise of its rows (`Errors.of_rows`), and δ the error of
p̂, of covariance Σ. What is missing, y less its estimate, has the error

    ν = H δ + Σ_k N_k n_k + ε,      H = A - Σ_k N_k K_k,      S = cov ν

and corrects any other estimate, of error e, by its covariance C with ν:

    x ← x + C S⁻¹ (y - ŷ),      cov x ← cov x - C S⁻¹ Cᵀ

Errors that may change with the load, V of p̂'s covariance, are others at another time: two values share them only
through the trunks that both name. Several sets are one with a longer y.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve

from stadera.errors import IdentificationError
from stadera.inertia import InertialParameters
from stadera.robot.model import Robot
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.joint_errors import Errors
from stadera.trunk.load import without_scale
from stadera.trunk.model import ImplausibleError, TrunkBounds, TrunkModel
from stadera.trunk.result import TrunkParameters
from stadera.trunk.segment import Segment
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Values known from outside.

    Attributes:
        what: who says so, for sentences.
        value: y (m,). covariance: R (m, m).
        errors: A (m, errors).
        trunks: N (m, 10) of each trunk; None is that of the present load.
        of_logs: True if y are estimates of p from other logs. The torques' common scale, which they did not know, is in
            the error of these as it is in that of p̂: y = A (p - Φ g) + ε with Φ of p̂, so that y tells nothing of g.
    """

    what: str
    value: Array
    covariance: Array
    errors: Array
    trunks: tuple[tuple[Segment | None, Array], ...] = ()
    of_logs: bool = False

    def of_load(self, present: Segment | None, instead: Segment | None) -> Knowledge:
        """The same with `instead` in place of the load `present`."""
        moved = tuple((instead if segment is present else segment, N) for segment, N in self.trunks)
        return replace(self, trunks=moved)


Weights = Mapping[Segment, Array]
"""Of trunks in an estimate, (k, 10) each: the payload is the present trunk less that of the tare."""


class Correction:
    """Corrects estimates that rest on the same p̂ by what is known from outside.

    Args:
        known: what is known, about trunks that have rows. errors: p̂ and Σ. present: the trunk of the present load.
        scatter: as of `Errors.of_rows`, of the estimates that are corrected.
        alike: as of `Errors.difference_covariance`.

    Attributes:
        known: as given.
        apart: how far each of `known` and the log are from each other, the furthest of its values, in standard
            deviations [1].
    """

    def __init__(
        self, known: Sequence[Knowledge], errors: Errors, present: Segment, scatter: float, alike: float
    ) -> None:
        self._errors, self._scatter, self._alike = errors, scatter, alike
        self._trunks: dict[Segment, Array] = {}
        ends = np.cumsum([len(item.value) for item in known]).tolist()
        m, self.known = ends[-1], tuple(known)
        value, covariance, H = np.zeros(m), np.zeros((m, m)), np.zeros((m, errors.mean.size))
        lasting, at = errors.shared(alike), errors.layout.places["common_gain"].start
        parts = [slice(end - len(item.value), end) for end, item in zip(ends, known, strict=True)]
        for part, item in zip(parts, known, strict=True):
            H[part] = item.errors
            if item.of_logs:
                unknown = item.errors[:, at] == 0.0
                H[part, at] -= unknown * (item.errors @ lasting[:, at]) / max(lasting[at, at], 1e-300)
            value[part] = item.value - item.errors @ errors.mean
            covariance[part, part] = item.covariance
            for segment, N in item.trunks:
                trunk = segment or present
                whole = self._trunks.setdefault(trunk, np.zeros((m, 10)))
                whole[part] += N
                value[part] -= N @ trunk.mean(errors.mean)
                H[part] -= N @ trunk.sensitivity
        self._missing, self._lasting = value, lasting @ H.T
        covariance += H @ self._lasting
        for trunk, N in self._trunks.items():
            covariance += N @ self._own(trunk) @ N.T
        self._root = cho_factor(0.5 * (covariance + covariance.T))
        far = np.abs(value) / np.sqrt(np.diag(covariance))
        self.apart = tuple(float(far[part].max()) for part in parts)

    @classmethod
    def by(
        cls, known: Sequence[Knowledge], errors: Errors, present: Segment, scatter: float = 0.0, alike: float = 0.0
    ) -> Correction | None:
        """Of what is about trunks that have rows; None if nothing is."""
        ready = [item for item in known if all((segment or present).blocks for segment, _ in item.trunks)]
        return cls(ready, errors, present, scatter, alike) if ready else None

    def beyond(self, most: float) -> dict[str, float]:
        """Who says what is further from the log than `most`, and how far [standard deviations]."""
        apart = zip(self.known, self.apart, strict=True)
        return {item.what: far for item, far in apart if far > most}

    def _own(self, trunk: Segment) -> Array:
        """Covariance (10, 10) of a trunk's error that no other trunk shares."""
        K = trunk.sensitivity[:, self._errors.layout.changing_at]
        changed = (1.0 - self._alike) * K @ self._errors.of_changing @ K.T
        return np.asarray(self._errors.of_rows(trunk, self._scatter) + changed)

    def _shared(self, weights: Weights) -> Array:
        """C (k, m)."""
        out = sum(-W @ trunk.sensitivity @ self._lasting for trunk, W in weights.items())
        for trunk, W in weights.items():
            if trunk in self._trunks:
                out = out + W @ self._own(trunk) @ self._trunks[trunk].T
        return np.asarray(out)

    def of_trunks(
        self, weights: Weights, value: Array, covariance: Array, by_scale: Array
    ) -> tuple[Array, Array, Array]:
        """An estimate (10,) of trunks with these weights, its covariance (10, 10), and `Errors.by_scale` (10,)."""
        C, at = self._shared(weights), self._errors.layout.places["common_gain"].start
        gain = cho_solve(self._root, C.T).T
        own, seen = self._errors.covariance[at, at], self._lasting[at]
        left = max(own - float(seen @ cho_solve(self._root, seen)), 1e-300)
        by_scale = (by_scale * np.sqrt(own) + gain @ seen) / np.sqrt(left)
        return value + gain @ self._missing, covariance - gain @ C.T, by_scale

    def of_errors(self) -> tuple[Array, Array]:
        """p̂ (errors,) and its covariance (errors, errors)."""
        gain = cho_solve(self._root, self._lasting.T).T
        return self._errors.mean + gain @ self._missing, self._errors.covariance - gain @ self._lasting.T


class Reading:
    """The trunk as estimated at one time, with what is known from outside; computed as far as it is asked for.

    Args:
        robot: the model. start: values of what was not observed.
        segment: the rows. errors: of the model. known: from outside.
    """

    def __init__(
        self,
        robot: Robot,
        start: InertialParameters,
        segment: Segment,
        errors: Errors,
        known: tuple[Knowledge, ...],
    ) -> None:
        self._robot, self._start, self._segment, self._errors, self._known = robot, start, segment, errors, known

    @cached_property
    def vector(self) -> Array:
        """The ten parameters (10,)."""
        return self._corrected[0] if self._known else self._segment.mean(self._errors.mean)

    @property
    def covariance(self) -> Array:
        """Of the ten parameters, (10, 10)."""
        return self._corrected[1]

    @cached_property
    def _corrected(self) -> tuple[Array, Array, Array]:
        """The ten parameters, their covariance, and `Errors.by_scale`."""
        segment, errors = self._segment, self._errors
        found = segment.mean(errors.mean), errors.trunk_covariance(segment), errors.by_scale(segment.sensitivity)
        outside = Correction.by(self._known, errors, segment, errors.scatter, errors.alike(segment))
        return found if outside is None else outside.of_trunks({segment: np.eye(10)}, *found)

    @cached_property
    def parameters(self) -> TrunkParameters:
        """All ten parameters and their uncertainty."""
        robot, (vector, covariance, by_scale) = self._robot, self._corrected
        found = TrunkParameters.of(vector, covariance, self._start, robot.mass, robot.leg_length)
        return replace(found, mass_std_without_scale=without_scale(covariance[0, 0], by_scale[0]))

    def complaint(self, bounds: TrunkBounds, apart: float) -> str | None:
        """Why the trunk, with `start` for unobserved parameters, is implausible; None if plausible. A mass is that
        many standard deviations outside its bounds, observed or not.
        """
        mass, *moment = self.vector[:4].tolist()
        if not mass > 0.0:
            return f"a mass of {mass:.3g} kg"
        least, most = bounds.mass
        if least <= mass <= most:
            within = zip(bounds.low.tolist(), moment, bounds.high.tolist(), strict=True)
            if all(low * mass <= value <= high * mass for low, value, high in within):
                return None  # the start is inside too, so any mixture of the two is
        elif max(least - mass, mass - most) > apart * float(np.sqrt(self.covariance[0, 0])):
            return f"trunk mass {mass:.3f} kg lies outside {least:.3f} to {most:.3f} kg"
        try:
            return bounds.complaint(TrunkModel.of(self.parameters.inertial))
        except ImplausibleError as error:
            return str(error)


def on_scale(robot: Robot, mass: float, std: float, load: Segment | None) -> Knowledge:
    """A robot on a scale.

    Args:
        mass, std: [kg], of the whole robot, and of the scale.
        load: the trunk when it was weighed; None for the present load.
    """
    layout, moved = ErrorLayout.of(robot), robot.tree.links[1:]
    links = np.zeros(layout.count)  # mass of each leg's link
    links[layout.places["link_mass"]] = [robot.inertias[link].mass for link in moved]
    own = mass - (robot.mass - robot.inertias[robot.trunk].mass)
    return Knowledge("the scale", np.array([own]), np.array([[std**2]]), links[None], ((load, np.eye(1, 10)),))


def with_test_weight(
    robot: Robot,
    mass: float,
    com: ArrayLike,
    mass_std: float,
    com_std: float,
    tare: Segment | None,
    load: Segment | None = None,
) -> Knowledge:
    """A payload since the tare that is known.

    Args:
        mass: [kg]. com: (3,) [m]. mass_std, com_std: their standard deviations.
        tare: the trunk without it. load: the trunk with it; None for the present load.

    Raises:
        IdentificationError: no tare, or not a payload.
    """
    if tare is None:
        raise IdentificationError("a test weight is known since a tare, and there is none")
    try:
        given = np.array([mass, mass_std, com_std, *np.ravel(com)], dtype=float)
    except (TypeError, ValueError):
        given = np.full(6, np.nan)
    if not (given.shape == (6,) and np.isfinite(given).all() and given[0] > 0.0 and (given[1:3] >= 0.0).all()):
        raise IdentificationError(f"a test weight needs a mass above zero and x, y, z; got {mass!r} kg, {com!r}")
    mass, mass_std, com_std, *centre = given.tolist()
    slope, four, count = np.diag([1.0, mass, mass, mass]), np.eye(4, 10), ErrorLayout.of(robot).count
    slope[1:, 0] = centre
    covariance = slope @ np.diag([mass_std**2, *[com_std**2] * 3]) @ slope.T + 1e-12 * np.eye(4)
    moments = np.array([mass, *(mass * np.array(centre))])
    return Knowledge(
        "the test weight", moments, covariance, np.zeros((len(moments), count)), ((load, four), (tare, -four))
    )
