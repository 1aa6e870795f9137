"""Estimates the lag of recorded torques: how much later than its stamp a torque acted.

Commands and sensor readings are delayed. A few milliseconds appear as friction and rotor inertia that do not exist,
since the torque then looks like a function of the earlier velocity. The lag, common to all joints, is the one with
which the model explains the torques best:

    minimise over δ   (δ / σ_δ)² + Σ_joints N log ρ_j²(δ),     ρ_j²(δ) = min_x ‖Y (θ₀ + S x) - τ_j(t - δ)‖² + σ² ‖x‖²

the log-likelihood of Gaussian residuals with a separate variance σ² for each joint, with the prior θ = θ₀ + S x of the
identification: the 27 free columns of a hip explain what a wrong lag leaves in a few seconds of noisy torques. Of
signals low-passed at f_c, N counts 2 f_c independent samples a second. Y is factored once; the lags are right-hand
sides of one least-squares problem.

Two errors of the rows pull the lag, both towards torques that act later. Friction brakes a joint before a reversal and
holds it back after, so the slope before is steeper and a low-passed velocity changes its sign late, by
T (a₁ - a₂) / (a₁ + a₂) with T = 0.09 / f_c; and while a joint sticks, static friction takes any value up to
Coulomb's. So samples near standstill are excluded, as far to both sides as the filter reaches. The noise of q̈ makes a
smaller inertia look better, and a lag δ makes -δ b q̈ of viscous friction b: the noise term (I - δ b)² σ_q̈² falls with
δ. It grows with the fifth power of the cut-off (36 % of the variance of q̈ at 25 Hz, 5 % at 15 Hz, in the slow half of a
real Go2's log), so the cut-off is no higher than the motion needs. Of several minima the one reached downhill from zero
lag is used, since over long shifts one joint term can mimic another.

The standard deviation of the lag is that of the likelihood, of curvature c, with what the model's errors do to it: a
friction law that is not quite the drive's moves each joint's minimum, differently. With δ_(j) the lag without joint j
of n, the jackknife's variance (Tukey 1958) is added:

    σ² = 2 / c + (n - 1)/n Σ_j (δ_(j) - mean δ_(j))²,      c = N V''/V,  V = exp(cost / N)

On a real Go2, Aliengo and Mini Cheetah in the air, which lag by 11 to 16 ms, it is 0.4 to 1.2 ms; a log of 4 s whose
torques do not change fast leaves several ms, which as viscous friction are as large as the drive's own.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import qr

from stadera.body import JointMotion, JointTorqueRegressor, TrunkMotion
from stadera.identify.prior import Prior
from stadera.identify.settings import LagSettings
from stadera.logs.processing import Processed
from stadera.types import Array, Bools


def estimate_lag(
    processed: Sequence[Processed],
    legs: Sequence[tuple[JointTorqueRegressor, Prior]],
    trunk_up: Array,
    settings: LagSettings | None = None,
) -> tuple[float, float, float]:
    """Estimates the lag of the efforts [s], its standard deviation, and the ratio of the residuals' variance with it to
    that without it. A lag that is not significant is zero, and the deviation is from that.

    The stretches have no gaps, are preprocessed alike without lag compensation, and keep samples at rest. Each leg has
    a regressor and the prior of its columns; `trunk_up` (3,) is the vertical in trunk axes.
    """
    search = settings or LagSettings()
    lags = np.arange(search.earliest, search.latest + search.step / 2, search.step)
    at_zero, usual = int(np.argmin(np.abs(lags))), (lags / search.usual) ** 2
    costs: list[Array] = []
    counts: list[float] = []
    long = [stretch for stretch in processed if stretch.time[-1] - stretch.time[0] > search.latest - search.earliest]
    for regressor, prior in legs if long else ():
        by_joint = zip(*(_delayed(stretch, regressor, lags, trunk_up, search) for stretch in long), strict=True)
        for parts in by_joint:
            columns, block = parts[0][0], np.concatenate([values for _, values in parts])
            if len(block) > 2 * len(columns):
                counts.append(len(block) * _worth(long[0]))
                costs.append(counts[-1] * _log_residuals(block, columns, prior, counts[-1]))
    if not costs:
        return 0.0, search.usual, 1.0
    whole, samples = usual + np.sum(costs, axis=0), sum(counts)

    def lag(cost: Array, count: float) -> tuple[float, float, float]:
        return _vertex(lags, np.exp((cost - cost[at_zero]) / max(count, 1.0)), at_zero)

    best, ratio, curvature = lag(whole, samples)
    without = np.array([lag(whole - own, samples - count)[0] for own, count in zip(costs, counts, strict=True)])
    if curvature <= 0.0:  # at the end of the search there is no vertex: nothing is known but what is usual
        return best, search.usual, ratio
    square = 2.0 * ratio / (samples * curvature) + (len(costs) - 1) * without.var()
    std = min(float(np.sqrt(square)), search.usual)
    if abs(best) < max(search.resolution, search.significant * std):
        return 0.0, float(np.hypot(std, best)), 1.0
    return best, std, ratio


def _worth(stretch: Processed) -> float:
    """Number of independent samples that a low-passed one is worth."""
    cutoff = stretch.report.cutoff_hz
    return 1.0 if cutoff is None else min(2.0 * cutoff / stretch.report.rate_hz, 1.0)


def _delayed(
    stretch: Processed, regressor: JointTorqueRegressor, lags: Array, up: Array, search: LagSettings
) -> Iterator[tuple[tuple[str, ...], Array]]:
    """For each joint its columns, and where it slides their values and its efforts at all lags, (samples, columns +
    lags).
    """
    names = regressor.tree.joints
    index = [stretch.joints.index(name) for name in names]
    inner = (stretch.time >= stretch.time[0] + search.latest) & (stretch.time <= stretch.time[-1] + search.earliest)
    joints = JointMotion(*(getattr(stretch, c)[inner][:, index] for c in ("position", "velocity", "acceleration")))
    assert stretch.effort is not None
    effort = CubicSpline(stretch.time, stretch.effort[:, index])
    delayed = np.stack([effort(stretch.time[inner] - lag) for lag in lags], axis=-1)
    rows = regressor.rows(joints, delayed[:, :, 0], TrunkMotion.held(up))
    for k, row in enumerate(rows):
        slides = _slides_throughout(stretch.time[inner], joints.velocity[:, k], search, stretch.report.cutoff_hz)
        yield row.columns, np.column_stack((row.matrix, delayed[:, k]))[slides]


def _slides_throughout(time: Array, velocity: Array, search: LagSettings, cutoff_hz: float | None) -> Bools:
    """True where a joint slides throughout the interval around the sample that the filter mixes."""
    reach = 0.0 if cutoff_hz is None else search.reach / cutoff_hz
    slow = np.concatenate(([0], np.cumsum(np.abs(velocity) < search.sliding)))
    first = np.searchsorted(time, time - reach)
    last = np.searchsorted(time, time + reach, side="right")
    return np.asarray(slow[last] == slow[first])


def _log_residuals(block: Array, columns: Sequence[str], prior: Prior, independent: float) -> Array:
    """log ρ² of each of the last columns of a joint's block, regressed on those before them under their prior; so many
    of its samples are `independent`.
    """
    n, at = len(columns), [prior.columns.index(name) for name in columns]
    matrix, delayed = block[:, :n], block[:, n:]
    scale = np.linalg.norm(matrix, axis=0)
    Q, R, _ = qr(matrix / np.where(scale > 0, scale, 1.0), mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(R))
    Q = Q[:, : int(np.sum(diagonal > 1e-10 * diagonal[0]))]
    floor = 1e-13 * np.maximum((delayed**2).sum(axis=0), np.finfo(float).tiny)  # rounding error
    free = np.maximum((delayed**2).sum(axis=0) - ((Q.T @ delayed) ** 2).sum(axis=0), floor)
    noise = np.sqrt(free.min() / independent)  # of a sample, as if all were independent
    shaped, gap = matrix @ prior.root[at], delayed - (matrix @ prior.values[at])[:, None]
    Q = np.linalg.qr(np.vstack([shaped, noise * np.eye(shaped.shape[1])]))[0][: len(shaped)]
    left = (gap**2).sum(axis=0) - ((Q.T @ gap) ** 2).sum(axis=0)
    return np.asarray(np.log(np.maximum(left, floor)))


def _vertex(lags: Array, variance: Array, start: int) -> tuple[float, float, float]:
    """Minimum of the residuals' variance nearest downhill from `start`, refined by a parabola: position, value and
    curvature, zero at the ends.
    """
    k = start
    while k > 0 and variance[k - 1] < variance[k]:
        k -= 1
    while k < len(lags) - 1 and variance[k + 1] < variance[k]:
        k += 1
    if not 0 < k < len(lags) - 1:
        return float(lags[k]), float(variance[k]), 0.0
    before, here, after = variance[k - 1 : k + 2]
    bend, step = before - 2 * here + after, lags[1] - lags[0]
    shift = 0.5 * (before - after) / bend if bend > 0 else 0.0
    least = max(float(here - 0.25 * (before - after) * shift), 0.0)
    return float(lags[k] + shift * step), least, float(bend / step**2)
