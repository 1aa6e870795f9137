"""Passes over the training part that sum up each leg's information and measure the noise of its residuals.

Rows are made first and low-passed afterwards. The equations hold exactly at every instant but are not linear in the
signals. Low-passing positions first distorts them, above all the steps of Coulomb friction, while unfiltered encoder
noise dominates the accelerations. So signals are filtered lightly, rows are made, and the same linear filter is applied
to both sides of the equations, which then still hold. Thinned to twice the cut-off, neighbouring rows are nearly
independent.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import chain

import numpy as np

from stadera.body import Rows, TrunkMotion
from stadera.identify.job import Job, LegTask
from stadera.identify.log import Part
from stadera.identify.residuals import residual_noise, rows_of, speed
from stadera.identify.solutions import Estimate
from stadera.identify.varying import varying_friction
from stadera.information import Information
from stadera.logs.filters import smooth_rows
from stadera.logs.processing import Processed
from stadera.types import Array


def smoothed_rows(
    task: LegTask, part: Part, trunk: TrunkMotion, cutoff_hz: float | None, drop_below: float
) -> Iterator[tuple[Array, tuple[Rows, ...]]]:
    """Yields times [s] and one set of rows for each joint of a leg, chunk by chunk, in N·m with unit noise.

    The part includes its samples at rest, since a filter must not run across gaps; `cutoff_hz` is that of the rows,
    None for no filter. Rows in which all joints are slower than `drop_below` [rad/s] are removed after filtering.
    """
    for stream in part.streams():
        first = next(stream, None)
        if first is None:
            continue
        chunks = chain([first], stream)
        if cutoff_hz is None:
            yield from (_plain(task, chunk, trunk, drop_below) for chunk in chunks)
        else:
            yield from _filtered(task, chunks, trunk, first.report.rate_hz, cutoff_hz, drop_below)


def _plain(task: LegTask, chunk: Processed, trunk: TrunkMotion, drop_below: float) -> tuple[Array, tuple[Rows, ...]]:
    moving = speed(task, chunk) >= drop_below
    every = tuple(rows_of(task, chunk, trunk))
    return chunk.time[moving], tuple(rows.replaced(rows.reduced[moving], rows.target[moving]) for rows in every)


def _filtered(
    task: LegTask,
    chunks: Iterator[Processed],
    trunk: TrunkMotion,
    rate_hz: float,
    cutoff_hz: float,
    drop_below: float,
) -> Iterator[tuple[Array, tuple[Rows, ...]]]:
    kinds: list[Rows] = []

    def stacked() -> Iterator[tuple[Array, Array]]:
        for chunk in chunks:
            every = list(rows_of(task, chunk, trunk))
            kinds[:] = every
            sides = [side for rows in every for side in (rows.reduced, rows.target[:, None])]
            yield chunk.time, np.concatenate([*sides, speed(task, chunk)[:, None]], axis=1)

    for time, values in smooth_rows(stacked(), rate_hz, cutoff_hz):
        moving = values[:, -1] >= drop_below
        values = values[moving]
        edges = np.cumsum([0, *(kind.reduced.shape[1] + 1 for kind in kinds)])
        yield (
            time[moving],
            tuple(
                kind.replaced(values[:, start : stop - 1], values[:, stop - 1])
                for kind, start, stop in zip(kinds, edges[:-1], edges[1:], strict=True)
            ),
        )


_PENDING = 8  # informations kept before they are merged


@dataclass(frozen=True, eq=False)
class Gathered:
    """Information of the training part on one leg."""

    by_joint: tuple[Information, ...]  # information of each joint's rows, in N·m, on the regressor's columns
    noise: Mapping[str, float]  # by joint, standard deviation of the torque residual [N·m]
    correlation: Mapping[str, float]  # by joint, number of samples that count as one independent sample
    friction_only: Mapping[str, float]  # the joint terms fitted with the rigid bodies at CAD

    def whitened(self, fixed: Mapping[str, float]) -> Information:
        """All joints' rows in units of their noise (eq. 6) and correlation, for the parameters that are not fixed."""
        weighted = (
            information.scaled_noise(std).forget(1.0 / self.correlation[joint])
            for information, (joint, std) in zip(self.by_joint, self.noise.items(), strict=True)
        )
        return reduce(Information.merge, weighted, Information.empty(self.by_joint[0].unknowns)).fix(fixed)


def with_varying_friction(job: Job, training: Part) -> Job:
    """The job with the terms by which the joints' friction varies, where the training part shows that it does."""
    asked, width = job.settings.varying, job.settings.width
    if asked is None:
        return job
    tasks, notes = [], []
    for task in job.tasks:
        joints = task.leg.joints
        tried = task.with_varying(job.robot, dict.fromkeys(joints, asked.tried), width)
        rows = smoothed_rows(tried, training, job.trunk, job.rows_cutoff, job.drop_below)
        found = varying_friction(rows, joints, tried.prior, task.fixed, asked)
        tasks.append(task.with_varying(job.robot, found, width))
        notes += [
            f"friction of {joint} {f.words}: held-out torque error times {max(f.ratio):.2f}"
            for joint, f in found.items()
        ]
    return replace(job, tasks=tuple(tasks), notes=(*job.notes, *notes))


def gather(job: Job, training: Part) -> tuple[Gathered, ...]:
    """Sums up the training part for each of the job's legs. The noise is the residual of each joint's own best fit."""
    out = []
    for done, task in enumerate(job.tasks):
        by_joint = _summed_up(_rows(job, task, training), task)
        free = [found.fix(task.fixed) for found in by_joint]
        best = [dict(task.fixed) | found.least_squares() for found in free]
        ranks = [found.rank() for found in free]
        noise = residual_noise(_rows(job, task, training), task.leg.joints, best, ranks)
        constant = _summed_up(_rows(job, task.constant, training), task.constant) if task.varying else by_joint
        out.append(Gathered(by_joint, *noise, _joint_terms(task, constant)))
        job.progress("summing up the torques", done + 1, len(job.tasks))
    return tuple(out)


def with_noise_of(
    job: Job, training: Part, gathered: Sequence[Gathered], estimates: Sequence[Estimate]
) -> tuple[Gathered, ...]:
    """The same sums, with the noise given by these estimates' residuals, with all that no model explains."""
    out = []
    for done, (task, data, estimate) in enumerate(zip(job.tasks, gathered, estimates, strict=True)):
        parameters = dict(task.fixed) | estimate.by_name()
        joints = task.leg.joints
        noise = residual_noise(_rows(job, task, training), joints, [parameters] * len(joints), [0] * len(joints))
        out.append(Gathered(data.by_joint, *noise, data.friction_only))
        job.progress("measuring the noise", done + 1, len(job.tasks))
    return tuple(out)


def information_of(job: Job, part: Part, gathered: Sequence[Gathered]) -> list[Information]:
    """Information of a part of one log on each leg, weighted by the noise and correlation of the training part."""
    return [
        replace(data, by_joint=_summed_up(_rows(job, task, part), task)).whitened(task.fixed)
        for task, data in zip(job.tasks, gathered, strict=True)
    ]


def _rows(job: Job, task: LegTask, training: Part) -> Iterator[tuple[Rows, ...]]:
    return (rows for _, rows in smoothed_rows(task, training, job.trunk, job.rows_cutoff, job.drop_below))


def _summed_up(chunks: Iterable[tuple[Rows, ...]], task: LegTask) -> tuple[Information, ...]:
    """Sums up the information of each of a leg's joints."""
    columns = task.columns
    pending: list[list[Information]] = [[Information.empty(columns)] for _ in task.leg.joints]
    for every in chunks:
        for waiting, rows in zip(pending, every, strict=True):
            waiting.append(Information.of([rows], columns))
            if len(waiting) >= _PENDING:
                waiting[:] = [_merged(waiting)]
    return tuple(_merged(waiting) for waiting in pending)


def _joint_terms(task: LegTask, by_joint: Sequence[Information]) -> dict[str, float]:
    """Joint terms that fit best with the links at their CAD values, friction constant."""
    fitted: dict[str, float] = {}
    for information in by_joint:
        terms = information.fix(task.rigid | dict(task.fixed))
        # the other joints' terms do not affect this one
        heard = np.linalg.norm(terms.R, axis=0) > 0
        fitted |= {c: v for (c, v), h in zip(terms.least_squares().items(), heard, strict=True) if h}
    return fitted


def _merged(parts: Sequence[Information]) -> Information:
    return reduce(Information.merge, parts)
