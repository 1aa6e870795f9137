"""Passes over the training part that sum up each leg's information and measure the noise of its residuals.

Rows are made first and low-passed afterwards. The equations hold exactly at every instant but are not linear in the
signals. Low-passing positions first distorts them, above all the steps of Coulomb friction, while unfiltered encoder
noise dominates the accelerations. So signals are filtered lightly, rows are made, and the same linear filter is applied
to both sides of the equations, which then still hold. Thinned to twice the cut-off, neighbouring rows are nearly
independent.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import chain

import numpy as np

from stadera.body import JointMotion, Rows, TrunkMotion
from stadera.constants import SATURATED
from stadera.identify.job import Job, LegTask
from stadera.identify.log import Part
from stadera.identify.result import TorqueTrace
from stadera.identify.solutions import Estimate
from stadera.identify.varying import varying_friction
from stadera.information import Information
from stadera.logs.filters import smooth_rows
from stadera.logs.processing import Processed
from stadera.types import Array

TRACE_S, TRACE_SAMPLES = 60.0, 3000
LAG = "torque_lag"
"""Name of the torques' remaining lag [s] among the parameters of summed rows."""


def rows_of(task: LegTask, chunk: Processed, trunk: TrunkMotion) -> Iterator[Rows]:
    """Yields one set of rows for each joint of a leg, in N·m with unit noise, with the remaining lag δ of the torques:
    Y θ = τ(t - δ), so Y θ + τ̇ δ = τ.
    """
    index = [chunk.joints.index(joint) for joint in task.leg.joints]
    assert chunk.effort is not None
    motion = JointMotion(chunk.position[:, index], chunk.velocity[:, index], chunk.acceleration[:, index])
    for rows in task.rows(motion, chunk.effort[:, index], trunk):
        rate = np.gradient(rows.target, chunk.time) if len(chunk) > 1 else np.zeros(len(chunk))
        mixing = rows.mixing
        if mixing is not None:
            wider = np.zeros((len(mixing) + 1, mixing.shape[1] + 1))
            wider[:-1, :-1], wider[-1, -1] = mixing, 1.0
            mixing = wider
        yield Rows((*rows.columns, LAG), np.column_stack([rows.reduced, rate]), rows.target, rows.std, mixing)


def speed(task: LegTask, chunk: Processed) -> Array:
    """Speed of a leg's fastest joint [rad/s], (samples,)."""
    index = [chunk.joints.index(joint) for joint in task.leg.joints]
    return np.asarray(np.abs(chunk.velocity[:, index]).max(axis=1))


def predicted(rows: Rows, parameters: Mapping[str, float]) -> Array:
    """Torque predicted from parameters without a remaining lag, (samples,)."""
    known = {LAG: 0.0} | dict(parameters)
    return rows.predict(np.array([known[c] for c in rows.columns]))


def residual_noise(
    chunks: Iterable[tuple[Rows, ...]],
    joints: Sequence[str],
    fits: Sequence[Mapping[str, float]],
    ranks: Sequence[int],
    correlated: int = 50_000,
) -> tuple[dict[str, float], dict[str, float]]:
    """Standard deviation of each joint's residuals [N·m], and how many rows count as one independent row.

    `fits` are the parameters of each joint by name, `ranks` the number of directions in which they were fitted to the
    same rows, which reduces the residuals. The correlation is estimated from the first `correlated` rows, see
    `independent_rows`, for the residuals themselves and for each of the joint's own terms.
    """
    kept: list[list[Array]] = [[] for _ in joints]
    own: list[list[Array]] = [[] for _ in joints]
    count, squares, largest = 0, np.zeros(len(joints)), np.zeros(len(joints))
    for every in chunks:
        for k, rows in enumerate(every):
            residual = rows.target - predicted(rows, fits[k])
            squares[k] += residual @ residual
            largest[k] = max(largest[k], np.abs(rows.target).max(initial=0.0))
            if count < correlated:
                kept[k].append(residual)
                of_joint = [i for i, name in enumerate(rows.columns) if name.startswith(f"{joints[k]}.")]
                mixing = np.eye(len(rows.columns)) if rows.mixing is None else rows.mixing
                own[k].append(rows.reduced @ mixing[:, of_joint])
        count += len(every[0])
    std, worth = {}, {}
    for k, joint in enumerate(joints):
        floor = 1e-9 * max(largest[k], 1e-9)  # rounding error, for data without noise
        std[joint] = max(float(np.sqrt(squares[k] / max(count - ranks[k], 1))), floor)
        worth[joint] = independent_rows(np.concatenate(kept[k]), np.concatenate(own[k])) if kept[k] else 1.0
    return std, worth


def independent_rows(residual: Array, terms: Array) -> float:
    """Number of rows that count as one independent row, for the residuals (n,) and the worst of the terms (n, k).

    The least-squares error of the factor of a term x is Σ x r / Σ x², so its variance depends on the correlation of the
    products s = x r, not of the residuals r: τ_s E[s²] / (E[x²] E[r²]) rows are worth one, with τ_s by
    `correlation_length`. Residuals of a friction law that is not quite that of the drive follow the motion that excites
    it, and are worth much less than their own correlation suggests: on the real Go2 and Aliengo in the air up to five
    times less (heteroscedastic and autocorrelated errors: Newey and West 1987).
    """
    square, most = float(residual @ residual), correlation_length(residual)
    for term in terms.T:
        seen, scale = term * residual, float(term @ term) * square
        if scale > 0.0:
            most = max(most, correlation_length(seen) * len(seen) * float(seen @ seen) / scale)
    return most


def correlation_length(values: Array) -> float:
    """Number of samples of a series that count as one independent sample: τ = 1 + 2 Σ_k ρ_k.

    The autocorrelations ρ_k are summed in pairs while the pairs stay positive (Geyer 1992), since the tail of an
    estimated autocorrelation is noise.
    """
    n = len(values)
    centred = values - values.mean() if n else values
    if n < 8 or not centred.any():
        return 1.0
    spectrum = np.fft.rfft(centred, 2 * n)
    covariance = np.fft.irfft(np.abs(spectrum) ** 2)[:n]
    pairs = (covariance[: n // 2 * 2] / covariance[0]).reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0)
    stop = int(negative[0]) if len(negative) else len(pairs)
    return max(1.0, float(2.0 * pairs[:stop].sum() - 1.0))


@dataclass
class LegScore:
    """Residuals of one leg's models on one part."""

    task: LegTask
    parameters: Mapping[str, Mapping[str, float]]  # by model
    limits: Mapping[str, float]  # of the torque, by joint [N·m]
    samples: int = 0  # number of moving samples
    squares: dict[str, Array] = field(default_factory=dict)  # by model, sums of squared errors of each joint [N²·m²]
    saturated: dict[str, int] = field(default_factory=dict)  # by joint, samples at the torque limit
    # time, measured and predicted torques of the first minute, chunk by chunk, samples at rest included
    kept: list[tuple[Array, Array, dict[str, Array]]] = field(default_factory=list)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the leg's joints."""
        return self.task.leg.joints

    @property
    def rmse(self) -> dict[str, dict[str, float]]:
        """RMSE by model and joint [N·m]."""
        return {
            model: dict(zip(self.joints, np.sqrt(s / max(self.samples, 1)).tolist(), strict=True))
            for model, s in self.squares.items()
        }

    def outliers(self, beyond: float) -> dict[str, float]:
        """By joint, the share of the first minute's samples whose error exceeds `beyond` times the RMSE."""
        trace, rmse = self.trace(""), self.rmse["identified"]
        error = np.abs(trace.measured - trace.predicted["identified"])
        return {joint: float(np.mean(error[:, k] > beyond * rmse[joint])) for k, joint in enumerate(self.joints)}

    def excess(self, least: float) -> dict[str, float]:
        """By how many standard deviations the identified model's squared error exceeds that of CAD with friction, whose
        errors are enlarged by a share `least`, in the first minute, by joint, and of all joints together as "".

        The mean of the differences x of squared errors has the variance var(x) τ / n, with τ samples of them worth one.
        """
        _, measured, models = self._first_minute
        found, cad = models["identified"], models["prior_friction"]
        worse = (measured - found) ** 2 - ((1.0 + least) * (measured - cad)) ** 2
        series = {"": worse.sum(axis=1)} | dict(zip(self.joints, worse.T, strict=True))
        stds = {k: float(x.std()) * np.sqrt(correlation_length(x) / len(x)) for k, x in series.items()}
        return {name: float(x.mean()) / stds[name] if stds[name] > 0.0 else 0.0 for name, x in series.items()}

    def trace(self, part: str) -> TorqueTrace:
        """Torques over the first minute, thinned out."""
        time, measured, models = self._first_minute
        every = max(1, -(-len(time) // TRACE_SAMPLES))
        return TorqueTrace(part, time[::every], measured[::every], {k: v[::every] for k, v in models.items()})

    @property
    def _first_minute(self) -> tuple[Array, Array, dict[str, Array]]:
        time, measured, predicted = zip(*self.kept, strict=True)
        models = {name: np.concatenate([p[name] for p in predicted]) for name in predicted[0]}
        return np.concatenate(time), np.concatenate(measured), models

    def add(self, chunk: Processed, trunk: TrunkMotion, drop_below: float) -> None:
        """Evaluates the models on one more chunk."""
        if not len(chunk):
            return
        rows = list(rows_of(self.task, chunk, trunk))
        constant = list(rows_of(self.task.constant, chunk, trunk)) if self.task.varying else rows
        measured = np.column_stack([r.target for r in rows])
        guesses = {
            name: np.column_stack([predicted(r, parameters) for r in (rows if name == "identified" else constant)])
            for name, parameters in self.parameters.items()
        }
        moving = speed(self.task, chunk) >= drop_below
        self.samples += int(np.count_nonzero(moving))
        for name, guess in guesses.items():
            self.squares[name] = self.squares.get(name, 0.0) + np.sum((measured - guess)[moving] ** 2, axis=0)
        for k, joint in enumerate(self.joints):
            at_limit = int(np.sum(np.abs(measured[:, k]) >= SATURATED * self.limits[joint]))
            self.saturated[joint] = self.saturated.get(joint, 0) + at_limit
        begun = self.kept[0][0][0] if self.kept else chunk.time[0]
        early = chunk.time < begun + TRACE_S
        if early.any():
            self.kept.append((chunk.time[early], measured[early], {k: v[early] for k, v in guesses.items()}))


def smoothed_rows(job: Job, task: LegTask, part: Part) -> Iterator[tuple[Array, tuple[Rows, ...]]]:
    """Yields times [s] and one set of rows for each joint of a leg, in N·m with unit noise, filtered as the job says.

    The part includes its samples at rest, since a filter must not run across gaps. Rows in which all joints are slower
    than `Job.drop_below` are removed after filtering.
    """
    kinds: list[Rows] = []

    def stacked(chunks: Iterable[Processed]) -> Iterator[tuple[Array, Array]]:
        for chunk in chunks:
            kinds[:] = rows_of(task, chunk, job.trunk)
            sides = [side for rows in kinds for side in (rows.reduced, rows.target[:, None])]
            yield chunk.time, np.concatenate([*sides, speed(task, chunk)[:, None]], axis=1)

    for stream in part.streams():
        for first in stream:  # the stream goes on inside
            sides = stacked(chain([first], stream))
            if job.rows_cutoff is not None:
                sides = smooth_rows(sides, first.report.rate_hz, job.rows_cutoff)
            for time, values in sides:
                moving = values[:, -1] >= job.drop_below
                ends = np.cumsum([kind.reduced.shape[1] + 1 for kind in kinds])[:-1]
                each = zip(kinds, np.split(values[moving, :-1], ends, axis=1), strict=True)
                yield time[moving], tuple(kind.replaced(own[:, :-1], own[:, -1]) for kind, own in each)


@dataclass(frozen=True, eq=False)
class Gathered:
    """Information of the training part on one leg."""

    # information of each joint's rows, in N·m, on the regressor's columns and the remaining lag
    by_joint: tuple[Information, ...]
    noise: Mapping[str, float]  # by joint, standard deviation of the torque residual [N·m]
    correlation: Mapping[str, float]  # by joint, number of samples that count as one independent sample
    friction_only: Mapping[str, float]  # the joint terms fitted with the rigid bodies at CAD
    lag_std: float = 0.0  # standard deviation of the remaining lag before the rows [s]

    def whitened(self, fixed: Mapping[str, float]) -> Information:
        """All joints' rows in units of their noise (eq. 6) and correlation, for the parameters that are not fixed; the
        remaining lag is considered.
        """
        weighted = (
            information.scaled_noise(std).forget(1.0 / self.correlation[joint])
            for information, (joint, std) in zip(self.by_joint, self.noise.items(), strict=True)
        )
        whole = reduce(Information.merge, weighted, Information.empty(self.by_joint[0].unknowns)).fix(fixed)
        return whole.consider(np.full((1, 1), self.lag_std), (LAG,))


def with_varying_friction(job: Job, training: Part) -> Job:
    """The job with the terms by which the joints' friction varies, and its travel where the training part shows one."""
    asked, width = job.settings.varying, job.settings.width
    if asked is None:
        return job
    tasks, notes = [], []
    for task in job.tasks:
        joints = task.leg.joints
        tried = task.with_varying(job.robot, dict.fromkeys(joints, asked.tried), width)
        known = dict(task.fixed) | {LAG: 0.0}
        found = varying_friction(smoothed_rows(job, tried, training), joints, tried.prior, known, asked)
        tasks.append(task.with_varying(job.robot, found, width))
        notes += [
            f"friction of {joint} builds up over {1e3 * f.travel:.2g} mrad of travel after a reversal: held-out torque "
            f"error times {max(f.ratio):.2f}"
            for joint, f in found.items()
            if f.travel
        ]
    return replace(job, tasks=tuple(tasks), notes=(*job.notes, *notes))


def gather(job: Job, training: Part, solve: Callable[[Sequence[Gathered]], Sequence[Estimate]]) -> tuple[Gathered, ...]:
    """Sums up the training part for each of the job's legs. The noise is the residual of what `solve` estimates with
    each joint's own best fit's: with all that no model explains.
    """
    gathered, out = _summed(job, training), []
    for done, (task, data, estimate) in enumerate(zip(job.tasks, gathered, solve(gathered), strict=True)):
        parameters = dict(task.fixed) | estimate.by_name()
        joints = task.leg.joints
        noise = residual_noise(_rows(job, task, training), joints, [parameters] * len(joints), [0] * len(joints))
        out.append(replace(data, noise=noise[0], correlation=noise[1]))
        job.progress("measuring the noise", done + 1, len(job.tasks))
    return tuple(out)


def _summed(job: Job, training: Part) -> tuple[Gathered, ...]:
    """The sums, with the noise that each joint's own best fit leaves."""
    out = []
    for done, task in enumerate(job.tasks):
        by_joint = _summed_up(_rows(job, task, training), task)
        known = dict(task.fixed) | {LAG: 0.0}
        free = [found.fix(known) for found in by_joint]
        # of no more rows than unknowns a fit leaves nothing: their noise is at most what the model leaves
        ranks = [rank if found.count > (rank := found.rank()) else 0 for found in free]
        best = [dict(task.nominal) | known | (f.least_squares() if r else {}) for f, r in zip(free, ranks, strict=True)]
        noise = residual_noise(_rows(job, task, training), task.leg.joints, best, ranks)
        constant = _summed_up(_rows(job, task.constant, training), task.constant) if task.varying else by_joint
        out.append(Gathered(by_joint, *noise, _joint_terms(task, constant), job.lag_std))
        job.progress("summing up the torques", done + 1, len(job.tasks))
    return tuple(out)


def information_of(job: Job, part: Part, gathered: Sequence[Gathered]) -> list[Information]:
    """Information of a part of one log on each leg, weighted by the noise and correlation of the training part."""
    return [
        replace(data, by_joint=_summed_up(_rows(job, task, part), task)).whitened(task.fixed)
        for task, data in zip(job.tasks, gathered, strict=True)
    ]


def _rows(job: Job, task: LegTask, training: Part) -> Iterator[tuple[Rows, ...]]:
    return (rows for _, rows in smoothed_rows(job, task, training))


def _summed_up(chunks: Iterable[tuple[Rows, ...]], task: LegTask) -> tuple[Information, ...]:
    """Sums up the information of each of a leg's joints."""
    columns = (*task.columns, LAG)
    found = [Information.empty(columns)] * len(task.leg.joints)
    for every in chunks:
        found = [known.merge(Information.of([rows], columns)) for known, rows in zip(found, every, strict=True)]
    return tuple(found)


def _joint_terms(task: LegTask, by_joint: Sequence[Information]) -> dict[str, float]:
    """Joint terms that fit best with the links at their CAD values, friction constant."""
    fitted: dict[str, float] = {}
    for information in by_joint:
        terms = information.fix(task.rigid | dict(task.fixed) | {LAG: 0.0})
        heard = np.linalg.norm(terms.R, axis=0) > 0  # the other joints' terms do not affect this one
        fitted |= {c: v for (c, v), h in zip(terms.least_squares().items(), heard, strict=True) if h}
    return fitted
