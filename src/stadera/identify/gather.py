"""The passes over the training part: what it says of each leg, and how noisy its residuals are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stadera.identify.information import Information
from stadera.identify.job import Job, LegTask
from stadera.identify.log import Part
from stadera.identify.residuals import residual_noise, rows_of

_PENDING = 8  # informations kept before they are merged


@dataclass(frozen=True, eq=False)
class Gathered:
    """What the training part says of one leg.

    Attributes:
        by_joint: information of each joint's rows, in N·m, on the regressor's columns.
        noise: by joint, standard deviation of the torque residual [N·m].
        correlation: by joint, how many samples one independent sample is worth.
        friction_only: the joint terms fitted with the rigid bodies at CAD.
    """

    by_joint: tuple[Information, ...]
    noise: Mapping[str, float]
    correlation: Mapping[str, float]
    friction_only: Mapping[str, float]

    def whitened(self, fixed: Mapping[str, float]) -> Information:
        """All joints' rows in units of their noise, for the parameters that are not fixed (eq. 6); each sample weighs
        what it is worth among its like.
        """
        total = Information.empty(self.by_joint[0].columns)
        for information, (joint, std) in zip(self.by_joint, self.noise.items(), strict=True):
            total = total.merge(information.scaled_noise(std).forget(1.0 / self.correlation[joint]))
        return total.fix(fixed)


def gather(job: Job, training: Part) -> tuple[Gathered, ...]:
    """Sums up the training part, one result for each of the job's legs."""
    by_joint = _summed_up(job, training)
    best = [_best_fits(task, found) for task, found in zip(job.tasks, by_joint, strict=True)]
    regressors = [task.regressor for task in job.tasks]
    noise = residual_noise(job.step("measuring the noise"), training, regressors, best, job.trunk)
    return tuple(
        Gathered(found, std, correlation, _joint_terms(task, found))
        for task, found, (std, correlation) in zip(job.tasks, by_joint, noise, strict=True)
    )


def _summed_up(job: Job, training: Part) -> list[tuple[Information, ...]]:
    """For each leg, the information of each of its joints."""
    pending: list[list[list[Information]]] = [[[] for _ in task.leg.joints] for task in job.tasks]
    step = job.step("summing up the torques")
    for done, chunk in enumerate(training):
        for task, lists in zip(job.tasks, pending, strict=True):
            for waiting, rows in zip(lists, rows_of(task.regressor, chunk, job.trunk), strict=True):
                waiting.append(Information.of([rows], task.regressor.columns))
                if len(waiting) >= _PENDING:
                    waiting[:] = [_merged(waiting)]
        step(done + 1, 0)
    return [tuple(_merged(waiting) for waiting in lists) for lists in pending]


def _best_fits(task: LegTask, by_joint: Sequence[Information]) -> list[dict[str, float]]:
    """Each joint's own best fit, before any noise is known."""
    return [dict(task.fixed) | found.fix(task.fixed).least_squares() for found in by_joint]


def _joint_terms(task: LegTask, by_joint: Sequence[Information]) -> dict[str, float]:
    """The joint terms that fit best with the links at CAD."""
    fitted: dict[str, float] = {}
    for information in by_joint:
        terms = information.fix(task.rigid | dict(task.fixed))
        # terms of the other joints have no influence on this one
        heard = np.linalg.norm(terms.R, axis=0) > 0
        fitted |= {c: v for (c, v), h in zip(terms.least_squares().items(), heard, strict=True) if h}
    return fitted


def _merged(parts: Sequence[Information]) -> Information:
    total = parts[0]
    for other in parts[1:]:
        total = total.merge(other)
    return total
