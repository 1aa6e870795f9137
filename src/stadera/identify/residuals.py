"""What models leave unexplained: the noise of the residuals, RMSE by joint, and traces for plots."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stadera.identify.result import TorqueTrace
from stadera.recording.preprocess import Processed
from stadera.regressors import JointMotion, JointTorqueRegressor, Rows, TrunkMotion

Array = NDArray[np.float64]

BATCH_S = 1.0
"""Length of the batches whose means tell how correlated residuals are [s]."""
TRACE_S, TRACE_SAMPLES = 60.0, 3000
OUTLIER = 6.0  # standard deviations


def rows_of(regressor: JointTorqueRegressor, chunk: Processed, trunk: TrunkMotion) -> Iterator[Rows]:
    """One set of rows a joint of the regressor's tree, in N·m with unit noise."""
    index = [chunk.joints.index(joint) for joint in regressor.tree.joints]
    assert chunk.effort is not None
    motion = JointMotion(chunk.position[:, index], chunk.velocity[:, index], chunk.acceleration[:, index])
    return regressor.rows(motion, chunk.effort[:, index], trunk)


def predicted(rows: Rows, parameters: Mapping[str, float]) -> Array:
    """The torque that parameters give, (samples,)."""
    return rows.predict(np.array([parameters[c] for c in rows.columns]))


def residual_noise(
    step: Callable[[int, int], None],
    training: Iterable[Processed],
    regressors: Sequence[JointTorqueRegressor],
    fits: Sequence[Sequence[Mapping[str, float]]],
    trunk: TrunkMotion,
) -> list[tuple[dict[str, float], dict[str, float]]]:
    """By leg: each joint's residual standard deviation [N·m], and how many samples one independent sample is worth.

    Both of the residuals that each joint's own best fit leaves, which is what no parameters explain. The correlation is
    from the variance of the means of batches of length B: τ = B var(mean) / var(sample).

    Args:
        fits: by leg and joint, the best fit's parameters by name.
    """
    spreads = [[_Spread() for _ in r.tree.joints] for r in regressors]
    largest = [np.zeros(len(r.tree.joints)) for r in regressors]
    for done, chunk in enumerate(training):
        batch = max(1, round(BATCH_S * chunk.report.rate_hz))
        for leg, regressor in enumerate(regressors):
            for k, rows in enumerate(rows_of(regressor, chunk, trunk)):
                spreads[leg][k].add(rows.target - predicted(rows, fits[leg][k]), batch)
                largest[leg][k] = max(largest[leg][k], np.abs(rows.target).max(initial=0.0))
        step(done + 1, 0)
    out = []
    for regressor, found, top in zip(regressors, spreads, largest, strict=True):
        floors = 1e-9 * np.maximum(top, 1e-9)  # rounding, for data without noise
        names = regressor.tree.joints
        std = {j: max(spread.std, f) for j, spread, f in zip(names, found, floors.tolist(), strict=True)}
        out.append((std, {j: spread.correlation for j, spread in zip(names, found, strict=True)}))
    return out


@dataclass
class _Spread:
    """Variance of samples, and of the means of consecutive batches."""

    count: int = 0
    total: float = 0.0
    squares: float = 0.0
    batch: int = 1
    means: list[float] = field(default_factory=list)

    def add(self, values: Array, batch: int) -> None:
        self.count += len(values)
        self.total += float(values.sum())
        self.squares += float(values @ values)
        self.batch = batch
        whole = len(values) // batch * batch
        self.means.extend(values[:whole].reshape(-1, batch).mean(axis=1).tolist())

    @property
    def variance(self) -> float:
        return max(self.squares / self.count - (self.total / self.count) ** 2, 0.0) if self.count else 0.0

    @property
    def std(self) -> float:
        return float(np.sqrt(self.squares / self.count)) if self.count else 0.0

    @property
    def correlation(self) -> float:
        if len(self.means) < 4 or self.variance == 0.0:
            return 1.0
        return max(1.0, self.batch * float(np.var(self.means)) / self.variance)


@dataclass(frozen=True, eq=False)
class LegModels:
    """The models of one leg that are held against data: parameters by model, noise and torque limit by joint."""

    regressor: JointTorqueRegressor
    parameters: Mapping[str, Mapping[str, float]]
    noise: Mapping[str, float]
    limits: Mapping[str, float]


@dataclass
class LegScore:
    """How well the models of one leg explain one part.

    Attributes:
        joints: names.
        samples: how many.
        squares: by model, the sum of squared errors of each joint [N²·m²].
        outliers, saturated: by joint, samples beyond six standard deviations, and at the torque limit.
        kept: time, measured and predicted torques of the first minute, chunk by chunk.
    """

    joints: tuple[str, ...]
    samples: int = 0
    squares: dict[str, Array] = field(default_factory=dict)
    outliers: dict[str, int] = field(default_factory=dict)
    saturated: dict[str, int] = field(default_factory=dict)
    kept: list[tuple[Array, Array, dict[str, Array]]] = field(default_factory=list)

    @property
    def rmse(self) -> dict[str, dict[str, float]]:
        """By model and joint [N·m]."""
        return {
            model: dict(zip(self.joints, np.sqrt(s / max(self.samples, 1)).tolist(), strict=True))
            for model, s in self.squares.items()
        }

    def trace(self, part: str) -> TorqueTrace:
        """The first minute, thinned out."""
        time = np.concatenate([t for t, _, _ in self.kept])
        measured = np.concatenate([m for _, m, _ in self.kept])
        models = {k: np.concatenate([p[k] for _, _, p in self.kept]) for k in self.squares}
        every = max(1, -(-len(time) // TRACE_SAMPLES))
        return TorqueTrace(part, time[::every], measured[::every], {k: v[::every] for k, v in models.items()})

    def add(self, chunk: Processed, models: LegModels, trunk: TrunkMotion) -> None:
        """Holds the models against one more chunk."""
        if not len(chunk):
            return
        rows = list(rows_of(models.regressor, chunk, trunk))
        measured = np.column_stack([r.target for r in rows])
        guesses = {
            name: np.column_stack([predicted(r, parameters) for r in rows])
            for name, parameters in models.parameters.items()
        }
        self.samples += len(chunk)
        for name, guess in guesses.items():
            self.squares[name] = self.squares.get(name, 0.0) + np.sum((measured - guess) ** 2, axis=0)
        error = np.abs(measured - guesses["identified"])
        for k, joint in enumerate(self.joints):
            beyond = int(np.sum(error[:, k] > OUTLIER * models.noise[joint]))
            at_limit = int(np.sum(np.abs(measured[:, k]) >= 0.98 * models.limits[joint]))
            self.outliers[joint] = self.outliers.get(joint, 0) + beyond
            self.saturated[joint] = self.saturated.get(joint, 0) + at_limit
        begun = self.kept[0][0][0] if self.kept else chunk.time[0]
        early = chunk.time < begun + TRACE_S
        if early.any():
            self.kept.append((chunk.time[early], measured[early], {k: v[early] for k, v in guesses.items()}))


def scored(
    step: Callable[[int, int], None], part: Iterable[Processed], models: Sequence[LegModels], trunk: TrunkMotion
) -> list[LegScore]:
    """Holds each leg's models against a part."""
    scores = [LegScore(m.regressor.tree.joints) for m in models]
    for done, chunk in enumerate(part):
        for score, leg_models in zip(scores, models, strict=True):
            score.add(chunk, leg_models, trunk)
        step(done + 1, 0)
    return scores
