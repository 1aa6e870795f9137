"""Solves for the parameters: the paper's null-space solution (eq. 5), and the physically consistent one.

Both keep unobservable masses at their CAD values. On a held trunk no leg's mass is observable: a change of it would be
an artefact of the method, and the centres of mass, h/m, would change with it. The effect of a wrong mass appears in the
first moments and the inertia instead, on which the torques depend.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stadera.errors import IdentificationError, require_positive
from stadera.identify.observability import Identifiability, Observability, observability
from stadera.identify.prior import Prior
from stadera.inertia import InertialParameters
from stadera.information import Information
from stadera.robot.model import Leg
from stadera.types import Array, Bools, Progress

_NON_NEGATIVE = ("armature", "viscous", "coulomb")


@dataclass(frozen=True)
class SolverSettings:
    """Settings for solving for the physically consistent parameters; all dimensionless."""

    # least eigenvalue of a link's pseudo-inertia in the prior's coordinates, 1 at the model's values
    margin: float = 1e-3
    # prior widths over standard deviation above which a direction is certain compared with the prior
    certain: float = 1e4
    # shift of the solution by the constraints, in standard deviations, that noise cannot explain
    contradicted: float = 1e2
    resolved: float = 1e-7  # ratio of weights that the solver resolves
    # share of the way to the model's values that moves a solution off the border of the consistent set
    inwards: float = 1e-4

    def __post_init__(self) -> None:
        require_positive("solver setting", self, ("margin", "certain", "contradicted", "resolved", "inwards"))
        if self.margin >= 1.0:
            raise IdentificationError(f"solver setting 'margin' must lie below 1, the model's own; got {self.margin}")


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated parameters and their uncertainty."""

    columns: tuple[str, ...]  # names of the n parameters
    values: Array  # (n,), in the parameters' own units
    # (n, n) of the error, from data and prior together; the prior's for parameters without information in the data and
    # for masses fixed at CAD
    covariance: Array
    prior: Prior  # of the parameters
    observability: Observability  # of the parameters
    method: str  # "null-space" or "consistent"
    # (n, errors), columns whose squares are in the covariance: errors that the legs of a log have in common
    shared: Array
    held: tuple[str, ...] = ()  # masses that were fixed at CAD because they are not observable
    unconstrained: Mapping[str, float] = field(default_factory=dict)  # the paper's eq. 5 on the same data, by name

    def by_name(self) -> dict[str, float]:
        """Values by parameter name."""
        return dict(zip(self.columns, self.values.tolist(), strict=True))

    def inertia(self, link: str) -> InertialParameters:
        """One link's ten parameters."""
        return InertialParameters(self.values[self.prior.block(link)])

    @property
    def is_physical(self) -> bool:
        """True if every link is physically possible and no joint has negative friction or rotor inertia."""
        return all(self.inertia(link).is_physical() for link in self.prior.links) and all(
            value >= -1e-9 * scale
            for name, value, scale in zip(self.columns, self.values, self.prior.scales, strict=True)
            if name.rsplit(".", 1)[1] in _NON_NEGATIVE
        )


def null_space_solution(information: Information, prior: Prior) -> Estimate:
    """Least squares in the directions that the data determine, CAD values in the others: the paper's eq. 5.

    φ = Y⁺ τ + N (φ_CAD - Y⁺ τ), with N the projector onto the null space of Y. Each parameter is measured in units of
    its prior width, so that the solution does not depend on units. Within the null space the masses are set to CAD
    first, then the others are brought as close to CAD as possible. Directions that the data determine worse than the
    prior count as null space; for data without noise this is the null space of the regressor. Parameters without
    influence on the data stay exactly at CAD.
    """
    data, seen, held = _posed(information, prior)
    rank, directions = seen.rank, seen.directions
    gap = data.z - data.R @ prior.values
    x = directions[:rank].T @ ((seen.left[:, :rank].T @ gap) / seen.singular_values[:rank])
    null_space = directions[rank:].T
    masses = [prior.columns.index(f"{link}.m") for link in prior.links]
    x -= null_space @ (np.linalg.pinv(null_space[masses], rcond=1e-6) @ x[masses])
    x[[verdict is Identifiability.UNOBSERVABLE for verdict in seen.verdicts()]] = 0.0  # zero except for rounding error
    scaled = directions.T * prior.scales[:, None]
    covariance = (scaled / (seen.singular_values**2 + 1.0)) @ scaled.T
    shared = scaled[:, :rank] @ ((seen.left[:, :rank].T @ data.G) / seen.singular_values[:rank, None])
    covariance += shared @ shared.T
    values = prior.values + prior.scales * x
    positive = signed(prior)
    rounding = (values[positive] < 0) & (values[positive] > -1e-9 * prior.scales[positive])
    values[positive] = np.where(rounding, 0.0, values[positive])
    return Estimate(
        prior.columns, values, covariance, prior, seen, "null-space", shared, tuple(f"{link}.m" for link in held)
    )


def consistent_solution(information: Information, prior: Prior, settings: SolverSettings | None = None) -> Estimate:
    """The most plausible parameters that are physically possible.

    minimise    ‖R θ - z‖² + ‖x‖²,    θ = θ_CAD + S x
    subject to  J_i ⪰ margin · J_i,CAD for every link; rotor inertia, viscous and Coulomb friction ≥ 0;
                masses that are not observable at CAD

    This is the maximum a-posteriori estimate under the Gaussian prior, invariant to the choice of frames and units. In
    the prior's coordinates the matrix inequality is 1 + D_i ⪰ margin, equally well scaled for any robot. The covariance
    is that of the unconstrained estimate. Raises IdentificationError: the solver found no solution.
    """
    (data, seen, links), settings = _posed(information, prior), settings or SolverSettings()
    held = [prior.mass_coordinates[link] for link in links]
    free = [k for k in range(len(prior.columns)) if k not in held]
    root = prior.root[:, free]
    U, s, Vt = np.linalg.svd(data.R @ root, full_matrices=False)
    gap = data.z - data.R @ prior.values
    weight = np.sqrt(s**2 + 1.0)
    best = Vt.T @ (s * (U.T @ gap) / weight**2)  # the unconstrained optimum
    x = np.zeros(len(prior.columns))
    x[free] = best
    if not _is_consistent(x, prior, settings.margin):
        x[free] = _constrained(best, Vt, weight, free, prior, settings)
    values = prior.values + prior.root @ x
    positive = signed(prior)
    values[positive] = np.maximum(values[positive], 0.0)  # within the solver's tolerance
    scaled, ahead = root @ Vt.T, prior.root[:, held]
    # a fixed mass has an error of its prior width, which propagates to the parameters correlated with it
    moved = ahead - (scaled / weight**2) @ (s[:, None] * (U.T @ (data.R @ ahead)))
    shared = (scaled * (s / weight**2)) @ (U.T @ data.G)
    covariance = (scaled / weight**2) @ scaled.T + moved @ moved.T + shared @ shared.T
    return Estimate(
        prior.columns, values, covariance, prior, seen, "consistent", shared, tuple(f"{link}.m" for link in links)
    )


def _constrained(
    best: Array, Vt: Array, weight: Array, free: list[int], prior: Prior, settings: SolverSettings
) -> Array:
    """Minimises Σ weight² (v·(x - best))² under the constraints, over the free x.

    The solver cannot resolve an arbitrary range of weights, so the problem is posed in up to four ways, and the
    solution of least cost is returned:

    * certain directions fixed at the data's values, which is right if the constraints do not affect them;
    * all directions together;
    * if data and constraints contradict each other strongly, all together in units of the best-determined direction;
    * and then the other directions again, with the certain ones fixed at that solution.
    """
    margin = settings.margin

    def solve(moving: Bools, used: Array, centre: Array) -> Array | None:
        """Optimises along some directions from `centre`; None if there is no valid solution."""
        if not moving.any():
            return None
        found = _nearest_consistent(centre, Vt[moving], used[moving], free, prior, margin)
        x = np.zeros(len(prior.columns))
        if found is not None:
            x[free] = found
        return found if found is not None and _is_consistent(x, prior, margin, slack=0.5 * margin) else None

    def cost(x: Array) -> float:
        return float(np.linalg.norm(weight * (Vt @ (x - best))))

    loose, every = weight <= settings.certain, np.ones(len(weight), dtype=bool)
    found: list[Array] = []

    def add(candidate: Array | None) -> float:
        found.extend([] if candidate is None else [candidate])
        return min(map(cost, found), default=np.inf)

    if add(solve(loose, weight, best)) > 1.0 and add(solve(every, weight, best)) > settings.contradicted:
        settled = solve(every, np.maximum(weight / weight.max(), settings.resolved), best)
        add(settled)
        if settled is not None:
            inside = (1.0 - settings.inwards) * settled
            add(solve(loose, weight, best + Vt[~loose].T @ (Vt[~loose] @ (inside - best))))
    # x = 0, the model, is consistent; differences below one in χ² are negligible
    if add(None) > max(cost(np.zeros(len(best))), 1.0):
        raise IdentificationError(
            "the physically consistent problem could not be solved: the data contradict it by far"
        )
    return min(found, key=cost)


def _nearest_consistent(
    best: Array, Vt: Array, weight: Array, free: list[int], prior: Prior, margin: float
) -> Array | None:
    """The nearest consistent point along some directions, the rows of Vt; None if the solver found none.

    Uses y = weight · V (x - best), for which the objective is isotropic whatever the ratio of data to prior.
    """
    try:
        import cvxpy as cp  # takes a second to import, and most solutions do not need it
    except ImportError as error:
        raise IdentificationError(
            f"physical consistency needs cvxpy with Clarabel (pip install cvxpy-base clarabel): {error}"
        ) from None
    y = cp.Variable(len(weight))
    x_free = best + Vt.T @ cp.multiply(1.0 / weight, y)
    spread = np.zeros((len(prior.columns), len(free)))
    spread[free, range(len(free))] = 1.0
    x = spread @ x_free
    constraints = []
    for link in prior.links:
        block = prior.block(link)
        flat = prior.coordinates[link].reshape(10, 16).T
        D = cp.reshape(flat @ x[block], (4, 4), order="C")
        constraints.append((D + D.T) / 2 + np.eye(4) * (1.0 - margin) >> 0)
    positive = signed(prior)
    if positive:
        constraints.append(x[positive] >= -prior.values[positive] / prior.scales[positive])
    problem = cp.Problem(cp.Minimize(cp.sum_squares(y)), constraints)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # about inaccuracy, which the caller checks
            problem.solve(solver=cp.CLARABEL)
    except cp.error.SolverError:
        return None
    if problem.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE) or x_free.value is None:
        return None
    return np.asarray(x_free.value)


def _is_consistent(x: Array, prior: Prior, margin: float, slack: float = 0.0) -> bool:
    """True if x satisfies the constraints, to within `slack` of D and of the joint terms' prior widths."""
    for link in prior.links:
        D = np.tensordot(x[prior.block(link)], prior.coordinates[link], axes=1)
        if np.linalg.eigvalsh(D).min() < margin - 1.0 - slack:
            return False
    positive = signed(prior)
    return bool(np.all((x[positive] + slack) * prior.scales[positive] >= -prior.values[positive]))


def signed(prior: Prior) -> list[int]:
    """Indices of the parameters that cannot be negative."""
    return [k for k, c in enumerate(prior.columns) if c.rsplit(".", 1)[1] in _NON_NEGATIVE]


def _posed(information: Information, prior: Prior) -> tuple[Information, Observability, list[str]]:
    """The information on the prior's columns, what it determines of them, and the links whose masses it does not."""
    data = information if information.names == prior.columns else information.marginal(prior.columns)
    seen = observability(data, prior)
    verdicts = dict(zip(prior.columns, seen.verdicts(), strict=True))
    return data, seen, [k for k in prior.links if verdicts[f"{k}.m"] is not Identifiability.OBSERVABLE]


@dataclass(frozen=True)
class KindSpread:
    """Spread τ between drives of one type, a standard deviation relative to their mean, before a log's legs tell it.

    Rotor inertia and viscous friction are set by the drive's design; Coulomb friction also depends on wear and preload.
    """

    # median of each, and the standard deviation of ln τ [1]
    armature: float = 0.1
    viscous: float = 0.1
    coulomb: float = 0.5
    factor: float = 0.55

    def __post_init__(self) -> None:
        require_positive("spread of", self, self.__dataclass_fields__)

    def tried(self, term: str) -> tuple[Array, Array]:
        """Values of τ of a term for sums over it, and the logarithm of their probability."""
        at = np.linspace(-3.0, 3.0, 31)
        return getattr(self, term) * np.exp(self.factor * at), -0.5 * at**2


def pooled_prior(leg: Leg, prior: Prior, drives: Sequence[tuple[Leg, Estimate]], spread: KindSpread) -> Prior:
    """A leg's prior, with centre and width of its drives' terms taken from the other legs among `drives`, if there are
    any. The leg's own drives count in how alike they are: the one of four that differs is not drawn to the others.
    """
    values, root = prior.values.copy(), prior.root.copy()
    others = np.array([other is not leg for other, _ in drives], dtype=bool)
    for term in _NON_NEGATIVE if others.any() else ():
        kinds = [k for k, joint in enumerate(leg.joints) if f"{joint}.{term}" in prior.columns]
        at = [prior.columns.index(f"{leg.joints[k]}.{term}") for k in kinds]
        found, variance = np.zeros((2, len(drives), len(kinds)))
        for row, own, (other, estimate) in zip(found, variance, drives, strict=True):
            places = [estimate.columns.index(f"{other.joints[k]}.{term}") for k in kinds]
            row[:] = estimate.values[places]
            own[:] = np.diag(estimate.covariance)[places] - (estimate.shared[places] ** 2).sum(axis=1)
        values[at], root[at, at] = _drawn_about(found, variance, others, *spread.tried(term), root[at, at])
    return replace(prior, values=values, root=root)


def _drawn_about(
    found: Array, variance: Array, others: Bools, spreads: Array, prior: Array, widest: Array
) -> tuple[Array, Array]:
    """Mean and standard deviation (kinds,) of another drive of each kind than those `found` (drives, kinds) among the
    `others` (drives,).

    Drives of a kind are drawn about a mean m with the standard deviation τ m, and `found` with an error of `variance`.
    The marginal likelihood of τ, the means integrated out, is that of all kinds together (Patterson and Thompson 1971).
    Given τ, a drive follows the others with N(m_τ, v_τ). The logarithm of that density is averaged over τ, as in
    variational Bayes: v is the inverse of the mean of 1/v_τ, so drives that differ do not pull each other.
    """
    between = (spreads[:, None] * np.median(np.abs(found), axis=0)) ** 2  # (spreads, kinds)
    weights = 1.0 / (variance + between[:, None] + 1e-12 * widest**2)

    def means(of: Bools | slice) -> tuple[Array, Array]:
        whole = weights[:, of].sum(axis=1)
        return (weights[:, of] * found[of]).sum(axis=1) / whole, whole

    mean, whole = means(slice(None))
    squares = (weights * (found - mean[:, None]) ** 2).sum(axis=1)
    likely = prior + 0.5 * (np.log(weights).sum(axis=1) - np.log(whole) - squares).sum(axis=1)
    mean, whole = means(others)
    share = np.exp(likely - likely.max())
    known = (share / share.sum())[:, None] / (between + 1.0 / whole)
    total = known.sum(axis=0)
    return np.maximum((known * mean).sum(axis=0) / total, 0.0), np.minimum(1.0 / np.sqrt(total), widest)


def with_scale(information: Information, std: float) -> Information:
    """Information by torques whose scale has an error that no row shows, of this standard deviation [1]."""
    return replace(information, G=np.column_stack([information.G, std * information.z]))


def solve_legs(
    legs: Sequence[tuple[Leg, Information, Prior]],
    method: str,
    spread: KindSpread | None,
    solver: SolverSettings,
    progress: Progress,
) -> list[Estimate]:
    """The requested solution for each leg, from rows in units of their noise and the prior.

    `spread` is that between the drives of the legs; None to solve for each leg separately.
    """
    priors = [prior for _, _, prior in legs]
    if spread is not None and len(legs) > 1:
        alone = [consistent_solution(information, prior, solver) for _, information, prior in legs]
        drives = [(leg, estimate) for (leg, _, _), estimate in zip(legs, alone, strict=True)]
        priors = [pooled_prior(leg, prior, drives, spread) for leg, _, prior in legs]
    out = []
    for done, ((_, information, _), prior) in enumerate(zip(legs, priors, strict=True)):
        free = null_space_solution(information, prior)
        found = free if method == "null-space" else consistent_solution(information, prior, solver)
        out.append(replace(found, unconstrained=free.by_name()))
        progress("solving", done + 1, len(legs))
    return out
