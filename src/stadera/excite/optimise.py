"""Optimises a leg's motion for information within its bounds.

    maximise    ½ log det(1 + Sᵀ Y(q, q̇, q̈)ᵀ Σ⁻¹ Y S)                   the information gain
    subject to  position, velocity, predicted torque and clearance within the leg's bounds

over the coefficients of a Fourier series (`FourierSeries`), at samples of both fades and of one period that represents
the time between. The series' band is the paper's: faster motion excites structural vibrations, which are not modelled.
Bounds enter as a quadratic penalty on each sample's violation, first small and then so large that less than about a
hundredth remains. The optimisation is quasi-Newton (L-BFGS), with forward differences that are evaluated as one batch.

Clearance is interpolated in a table over joint space, which may overestimate it: along the best motion it is corrected
by exact distances, and the search continues, until the two agree. A motion that still violates a bound on a dense grid
is scaled towards the rest pose.

With Gaussian noise of known size and the prior θ = θ_CAD + S x, x ~ N(0, 1), a log whose rows compress to R θ = z
lowers the entropy of the prior, for any torques, by::

    gain = ½ log det(1 + Sᵀ Rᵀ R S) = Σ_k ½ log(1 + s_k²)        [nat], s_k the singular values of R S

This is the mutual information of log and parameters, and the criterion of D-optimality with a prior. It does not depend
on units or frames; directions that no motion can excite add nothing instead of minus infinity; and a direction counts
by the factor by which its standard deviation shrinks, not by its initial size as in sums of variances.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import count

import numpy as np
from scipy.optimize import minimize

from stadera.body import FrictionModel, JointMotion, JointTorqueRegressor
from stadera.errors import IdentificationError, positive, require_positive
from stadera.excite.bounds import ClearanceMap, LegBounds, fitting_factor
from stadera.excite.sinusoids import FREQUENCIES, Reference, Sinusoids, check_duration, window
from stadera.identify.observability import Observability, observability
from stadera.identify.prior import Prior, robot_prior
from stadera.information import Information
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class LegExperiment:
    """A leg on a held trunk and its sensors."""

    bounds: LegBounds  # of the leg
    noise: Array  # (n,) [N·m], standard deviation of one torque sample, independent from sample to sample
    rate: float = 1000.0  # sampling rate of the log [Hz]
    # joint-side terms identified together with the rigid bodies
    friction: FrictionModel = field(default_factory=FrictionModel.full)

    @classmethod
    def usual(
        cls, bounds: LegBounds, rate: float = 1000.0, noise: float = 0.0033, noise_of_gravity: float = 0.02
    ) -> LegExperiment:
        """Torque noise as shares of each joint's effort limit, or of its largest gravity torque if it has none."""
        limits = np.array([bounds.robot.limits[joint].effort for joint in bounds.joints])
        poses = np.random.default_rng(0).uniform(bounds.lower, bounds.upper, (500, len(bounds.joints)))
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
        data = self._information(reference, self.noise)
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
        shape = 500, len(self.bounds.joints)
        position = rng.uniform(self.bounds.lower, self.bounds.upper, shape)
        motion = JointMotion(position, *rng.normal(0.0, (2.0, 10.0), (*shape, 2)).transpose(2, 0, 1))
        return observability(self._information(motion, 1e-6 * self.noise), self.prior)

    def _information(self, motion: JointMotion, noise: Array) -> Information:
        torque = np.zeros_like(motion.position)
        return Information.of(self.regressor.rows(motion, torque, std=noise), self.regressor.columns)


@dataclass(frozen=True, eq=False)
class FourierSeries:
    """Motions of a leg parametrised by x (n (2K + 1),): o, then a, then b, each joint by joint.

        c_j(t) = o_j + Σ_k a_jk sin(2π k f t) + b_jk cos(2π k f t),    k = 1..K        (Swevers et al. 1997)
        q(t) = q_0 + w(t) (c(t) - q_0)

    with q_0 the rest pose and w the window of `sinusoids`: the motion, fades included, is linear in (o - q_0, a, b), so
    many motions are evaluated at once by one matrix product for each derivative. x is in units of half the width of the
    position bounds, with o measured from their middle: |o| ≤ 1 is within them.
    """

    bounds: LegBounds  # of the leg
    harmonics: int  # K
    period: float  # 1/f [s]
    duration: float  # from rest to rest [s]
    longest_fade: float = 2.0  # longest fade at each end [s]; a third of a short motion

    @property
    def unknowns(self) -> int:
        """Length of x."""
        return len(self.bounds.joints) * (2 * self.harmonics + 1)

    @property
    def fade(self) -> float:
        """Length of each of the two fades [s]."""
        return min(self.longest_fade, self.duration / 3.0)

    @property
    def swing(self) -> float:
        """Time after the first fade during which the motion does not repeat [s]."""
        return min(self.period, self.duration - 2.0 * self.fade)

    @cached_property
    def half(self) -> Array:
        """Half the width of the position bounds, (n,) [rad]."""
        half = 0.5 * (self.bounds.upper - self.bounds.lower)
        if not (half > 1e-3).all():
            raise IdentificationError(f"leg {self.bounds.leg}: a joint has no room to move within its bounds")
        return half

    def basis(self, time: Array) -> tuple[Array, Array, Array]:
        """Matrices that map coefficients to q - q_0 and its two derivatives, (samples, 1 + 2K) each."""
        omega = 2.0 * np.pi / self.period * np.arange(1, self.harmonics + 1)
        angle, zero = time[:, None] * omega, np.zeros((len(time), 1))
        sine, cosine = np.sin(angle), np.cos(angle)
        c = np.hstack((zero + 1.0, sine, cosine))
        dc = np.hstack((zero, omega * cosine, -omega * sine))
        ddc = np.hstack((zero, -(omega**2) * sine, -(omega**2) * cosine))
        w, dw, ddw = (v[:, None] for v in window(time, 0.0, self.duration - self.fade, self.fade))
        return w * c, dw * c + w * dc, ddw * c + 2.0 * dw * dc + w * ddc

    def coefficients(self, x: Array) -> Array:
        """(o - q_0, a, b) of each row of x (batch, unknowns), (batch, 1 + 2K, n) [rad]."""
        n = len(self.bounds.joints)
        swings = x[:, n:].reshape(len(x), 2, n, self.harmonics).transpose(0, 1, 3, 2)
        out = np.empty((len(x), 1 + 2 * self.harmonics, n))
        out[:, 0] = self.half * x[:, :n] + 0.5 * (self.bounds.upper + self.bounds.lower) - self.bounds.rest
        out[:, 1:] = self.half * swings.reshape(len(x), -1, n)
        return out

    def motion(self, x: Array) -> Sinusoids:
        """The same motion as sinusoids: a sin + b cos = √(a² + b²) sin(· + atan2(b, a))."""
        K, n = self.harmonics, len(self.bounds.joints)
        constant, *swings = self.coefficients(x[None])[0]
        a, b = np.array(swings).reshape(2, K, n).transpose(0, 2, 1)
        frequency = np.broadcast_to(np.arange(1, K + 1) / self.period, (1, n, K))
        return Sinusoids(
            joints=self.bounds.joints,
            rest=self.bounds.rest,
            origins=(self.bounds.rest + constant)[None],
            amplitudes=np.hypot(a, b)[None],
            frequencies=frequency,
            phases=np.arctan2(b, a)[None],
            starts=np.array([0.0, self.duration - self.fade]),
            fade=self.fade,
        )

    def instants(self, rate: float) -> Array:
        """Increasing times [s] that cover the whole motion: its start, the first period, its end."""
        rise, fall = self.fade + self.swing, self.duration - self.fade
        first = np.linspace(0.0, rise, int(np.ceil(rise * rate)), endpoint=False)
        return np.concatenate((first, np.linspace(fall, self.duration, int(np.ceil(self.fade * rate)))))

    def quadrature(self, samples: int) -> tuple[Array, Array]:
        """Times [s] and their weights in the whole duration [s]: one period, and a third as many in each fade."""
        fading = (np.arange(samples // 3) + 0.5) / (samples // 3)
        swinging = self.fade + (np.arange(samples) + 0.5) / samples * self.swing
        times = np.concatenate((self.fade * fading, swinging, self.duration - self.fade + self.fade * fading))
        ends = np.full(len(fading), self.fade / len(fading))
        return times, np.concatenate((ends, np.full(samples, (self.duration - 2.0 * self.fade) / samples), ends))


@dataclass(frozen=True)
class FourierSearch:
    """Settings of the parametrisation and the search."""

    harmonics: int = 6  # K
    top_frequency: float = FREQUENCIES[1]  # K f [Hz]
    samples: int = 72  # evaluated in one period
    starts: int = 4  # number of local searches
    iterations: int = 80  # largest number of steps in each
    poses: int = 50  # number tried for each start
    # successive weights, for one sample that exceeds a bound by its whole size [nat]
    penalties: tuple[float, ...] = (50.0, 2000.0)
    spare: float = 0.01  # share of each bound left unused [1]
    clearance_unit: float = 0.1  # missing clearance that counts as one whole bound [m]
    clearance_rate: float = 50.0  # sampling rate of exact distances along the motion [Hz]
    clearance_spare: float = 0.002  # margin for the motion between two samples [m]
    tightenings: int = 8  # largest number of corrections of the clearance map
    step: float = 1e-6  # of the finite differences, in the unknowns' own scale [1]

    def __post_init__(self) -> None:
        if min(self.harmonics, self.starts, self.iterations) < 1:
            raise IdentificationError(f"a search needs at least one harmonic, start and iteration, got {self}")
        if self.samples < 4 * self.harmonics:
            raise IdentificationError(f"a search needs at least 4 samples a harmonic, got {self}")
        positive("the highest frequency", self.top_frequency, "Hz", IdentificationError)
        if not self.penalties or min(self.penalties) <= 0.0:
            raise IdentificationError(f"a search needs penalties above 0, got {self.penalties}")
        names = ("poses", "spare", "clearance_unit", "clearance_rate", "clearance_spare", "tightenings", "step")
        require_positive("setting of a search", self, names)


def optimal_excitation(
    experiment: LegExperiment,
    rng: np.random.Generator,
    duration: float = 180.0,
    search: FourierSearch | None = None,
    progress: Callable[[float], None] | None = None,
) -> Sinusoids:
    """The most informative motion found for this experiment, at rest at both ends of its duration [s].

    The same state of `rng`, which draws the starts, gives the same motion; `progress` is called with the share of the
    work done. Raises IdentificationError: a duration under two seconds, or a leg that cannot move within its bounds.
    """
    search = search or FourierSearch()
    check_duration(duration)
    period = search.harmonics / search.top_frequency
    series = FourierSeries(experiment.bounds, search.harmonics, period, duration)
    problem = _Problem(experiment, series, experiment.bounds.clearance_map, search)
    most, report = search.iterations * len(search.penalties), progress or (lambda share: None)

    def stepping(part: int) -> Callable[[], None]:
        """Tells of the steps of a part of the work: of a start, or of the corrections after them."""
        steps = count(1)
        return lambda: report((part + min(1.0, next(steps) / most)) / (search.starts + 1))

    found: list[tuple[float, Array]] = []
    for start in range(search.starts):
        x = problem.solve(problem.start(rng), search.penalties, stepping(start))
        found.append((problem.merit(x), x))
    best = max(found, key=lambda pair: pair[0])[1]
    motion = series.motion(problem.tightened(best, stepping(search.starts)))
    report(1.0)
    return motion.drawn_in(fitting_factor(motion, experiment.bounds))


@dataclass(frozen=True, eq=False)
class _Problem:
    """Gain and bound violation as functions of the series' x (unknowns,)."""

    experiment: LegExperiment
    series: FourierSeries
    clearance: ClearanceMap
    search: FourierSearch

    def start(self, rng: np.random.Generator) -> Array:
        """A small motion around a random clear pose."""
        bounds = self.experiment.bounds
        joints = len(bounds.joints)
        poses = rng.uniform(-0.7, 0.7, (self.search.poses, joints))
        clear = self.clearance.slack(0.5 * (bounds.lower + bounds.upper) + self.series.half * poses)
        swings = rng.normal(0.0, 0.2 / self.series.harmonics, self.series.unknowns - joints)
        return np.concatenate((poses[int(np.argmax(clear > 0.5 * clear.max()))], swings))

    def solve(self, x: Array, penalties: tuple[float, ...], step: Callable[[], None]) -> Array:
        """A local optimum near `x`, with one penalty on bound violations after the other; `step` is called after each
        step.
        """
        most = self.search.iterations
        for weight in penalties:
            cost = partial(self._cost_and_slope, weight=weight)
            x = minimize(cost, x, method="L-BFGS-B", jac=True, callback=lambda xk: step(), options={"maxiter": most}).x
        return x

    def tightened(self, x: Array, step: Callable[[], None]) -> Array:
        """The optimum near `x` after correcting the clearance map along the motion."""
        problem, search = self, self.search
        for _ in range(search.tightenings):
            path = self.series.motion(x).at(self.series.instants(search.clearance_rate)).position
            slack = self.experiment.bounds.clearance.slack(path) - search.clearance_spare
            if slack.min() >= 0.0:
                break
            problem = replace(problem, clearance=problem.clearance.lowered(path, slack))
            x = problem.solve(x, search.penalties[-1:], step)
        return x

    def merit(self, x: Array) -> float:
        gain, over = self._values(x[None])
        return float(gain[0] - self.search.penalties[-1] * over[0])

    def _cost_and_slope(self, x: Array, weight: float) -> tuple[float, Array]:
        gain, over = self._values(np.vstack((x, x + self.search.step * np.eye(len(x)))))
        cost = weight * over - gain
        return float(cost[0]), (cost[1:] - cost[0]) / self.search.step

    def _values(self, x: Array) -> tuple[Array, Array]:
        """For each row of x (batch, unknowns): gain [nat], and the sum of squared relative bound violations."""
        bounds, batch = self.experiment.bounds, len(x)
        coefficients = self.series.coefficients(x)
        q, dq, ddq = (basis @ coefficients for basis in self._basis)
        motion = JointMotion(*(v.reshape(-1, len(bounds.joints)) for v in (bounds.rest + q, dq, ddq)))
        gram, torque = self._gram_and_torque(motion, batch)
        gain = 0.5 * np.linalg.slogdet(np.eye(gram.shape[1]) + gram)[1]
        path = bounds.rest + self._dense_basis @ coefficients
        slack = self.clearance.slack(path.reshape(-1, len(bounds.joints))).reshape(batch, -1, 1)
        middle = 0.5 * (bounds.lower + bounds.upper) - bounds.rest
        shares = (
            np.abs(q - middle) / self.series.half,
            np.abs(dq) / bounds.velocity,
            np.abs(torque) / bounds.effort,
            1.0 - slack / self.search.clearance_unit,
        )
        over = [(np.maximum(share - 1.0 + self.search.spare, 0.0) ** 2).sum(axis=(1, 2)) for share in shares]
        return gain, np.sum(over, axis=0)

    def _gram_and_torque(self, motion: JointMotion, batch: int) -> tuple[Array, Array]:
        """Sᵀ Yᵀ Σ⁻¹ Y S over the whole duration (batch, n, n), and the predicted torque (batch, samples, n) [N·m]."""
        experiment = self.experiment
        columns, prior = experiment.regressor.columns, experiment.prior
        counts = experiment.rate * self._quadrature[1]
        gram = np.zeros((batch, len(columns), len(columns)))
        torque = np.empty((batch, len(counts), motion.position.shape[1]))
        for k, row in enumerate(experiment.regressor.rows(motion, np.zeros_like(motion.position))):
            picks = [columns.index(name) for name in row.columns]
            torque[..., k] = row.predict(prior.values[picks]).reshape(batch, -1)
            Y = row.matrix.T.reshape(len(picks), batch, -1).transpose(1, 0, 2) * (np.sqrt(counts) / experiment.noise[k])
            gram[np.ix_(range(batch), picks, picks)] += Y @ Y.transpose(0, 2, 1)
        return prior.root.T @ gram @ prior.root, torque

    @cached_property
    def _quadrature(self) -> tuple[Array, Array]:
        return self.series.quadrature(self.search.samples)

    @cached_property
    def _basis(self) -> tuple[Array, Array, Array]:
        return self.series.basis(self._quadrature[0])

    @cached_property
    def _dense_basis(self) -> Array:
        return self.series.basis(self.series.instants(self.search.clearance_rate))[0]
