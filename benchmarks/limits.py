"""How well the best linear estimate could weigh logs of `stadera reproduce reality`, beside `stadera.TrunkEstimator`.

**Floor.** All rows of a log, those of the loaded legs and those of the legs in the air (`limits_rows.py`), are linear
in the trunk before the load θ, the load Δ, and the model errors p:

    A θ + A Δ [t > t_load] + C p = b + e,      S p = -(h - τ) + e_s

With p = mean + F u, F Fᵀ the covariance that the test-bed draws p from (`limits_truth.law_of_errors`), θ and Δ with
wide priors in the same way, and rows divided by the noise's factor, the unknowns x have unit priors, and

    N = XᵀX + 1,      x̂ = N⁻¹ Xᵀ y,      cov (x̂ - x) = N⁻¹

The part of θ and Δ in N⁻¹ is the inverse of its Schur complement: p is free. Mass and centre c = h / m follow by
δc = (δh - c δm) / m. Static friction has a covariance of its own before and after the load, as wide as Coulomb friction
allows. The floor is the square root of the diagonal: no linear estimate of these rows has smaller errors in the root
mean square, if the errors' sizes and means and the noise are as stated.

**Noise.** The truth gives e = b - A θ - C p itself: white noise, and what the linear model lacks, such as impacts
between samples, the direction of friction near standstill, and contact points that turn with the shank. It is taken to
have the covariance of its six components (the variance of e_s, for each joint) over the log, to repeat for two
successive blocks, whose windows overlap, and to be independent of p. A covariance by lags promises up to a third less,
and is wrong: e is no noise but follows the columns of C, and the best estimate by it misses its floor by 2 to 5.

**Check.** Errors of the best estimate itself, by these sizes and this noise, over its floor. One in the root mean
square if all is as stated; above it, as for mass and height, e is not that noise, and the floor is not reached, but it
remains one. Those of `weigh` cannot be far below.

Standing still, friction takes part of every load, always in one direction, which no covariance says: there the floor of
a payload does not hold. So the default is robots that move.

**Joint estimate.** The same without the truth: sizes of `ModelErrors` and means of zero, and the noise's covariance
from its own residuals, iterated, repeated ten times. It is what a joint estimate could be in practice.

**Shares.** Each kind of error alone, its true value times its columns, in least squares by rows of equal weight before
and after the load; and e, the rows' own.

**Detection.** The average of e over half a second, projected on the specific force, is an apparent mass. A load of 5 %
of the robot is so many of its standard deviations z over the log's time before the load. With one false alarm in ten
minutes, of some 1200 such averages, the threshold is 3.3, and 95 % are found if z is above 5.

**Causes.** `--without coulomb`, `noise` or `delay` and `--rate` simulate the same draws without that error, or logged
at another rate; such logs are not kept.

The truth is used here only. Logs are those of the experiment, seeds and loads too, and are kept with `--keep`. Run
`python benchmarks/limits.py --seed 900 --seeds 2 --keep runs [--json F]`.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is loaded: every process has a core

import numpy as np
from limits_rows import LogRows
from limits_tables import FIGURES, tables
from limits_truth import PLACES, WITHOUT, ErrorLaw, Truths, law_of_errors, log_of, usual_errors

from stadera import TrunkEstimator
from stadera.cli.terminal import progress, show
from stadera.files import written_together
from stadera.fleet.pool import Pool
from stadera.inertia import InertialParameters
from stadera.lab.control.com_plan import PlanError
from stadera.lab.control.reference import ControlError
from stadera.lab.experiments.reality import HOW, ROBOTS, SCENARIOS, SHARES, RealityCase
from stadera.lab.experiments.runner import run_grid
from stadera.lab.plant.plant import SimulationError
from stadera.lab.reality.draw import REAL_SETS
from stadera.report.table import rich_table
from stadera.robot import Robot, load_robot
from stadera.trunk.samples import Samples
from stadera.trunk.settings import TrunkSettings
from stadera.types import Array


@dataclass(frozen=True)
class LimitSettings:
    """Assumptions.

    Attributes:
        repeated: successive blocks in which the rows' own errors are the same [1]: windows overlap by half.
        repeated_joint: the same of the joint estimate, which knows the errors' law less well and so trusts rows less.
        begin: time left out at the log's beginning [s]. spoilt: time left out after the load [s].
        load: share of the robot's mass that is to be detected [1]. window: of the average that detects it [blocks].
        outlier: median deviations beyond which rows of legs in the air are left out [1].
        iterations: of the noise's covariance, where it comes from residuals.
        without: kind of error that is not simulated, see `WITHOUT`; empty for none.
        rate: of the logs [Hz], None for that drawn.
    """

    repeated: float = 2.0
    repeated_joint: float = 10.0
    begin: float = 0.3
    spoilt: float = 0.06
    load: float = 0.05
    window: int = 25
    outlier: float = 8.0
    iterations: int = 4
    without: str = ""
    rate: float | None = None


@dataclass(frozen=True, eq=False)
class Best:
    """The best linear estimate: x̂ (k,) of unknowns with unit priors, and the covariance (k, k) of its error."""

    value: Array
    covariance: Array

    @classmethod
    def of(cls, X: Array, y: Array) -> Best:
        """From rows (n, k) and targets (n,) with unit noise."""
        covariance = np.linalg.inv(X.T @ X + np.eye(X.shape[1]))
        return cls(covariance @ (X.T @ y), np.asarray(covariance))


def best_of(
    rows: LogRows, truth: Truths, law: ErrorLaw, mass: float, settings: LimitSettings, informed: bool = True
) -> tuple[Array, Array]:
    """Errors of the best estimate (8,) and their floor (8,), in SI units by `FIGURES`.

    Args:
        mass: of the robot [kg].
        informed: takes the noise's covariance from the truth; else from residuals.
    """
    wide = mass * np.array([1.0, *[0.5] * 9])
    loaded = (rows.time > HOW.loaded_at)[:, None, None]
    sticking = rows.errors @ law.sticking
    own = [rows.matrix * wide, rows.matrix * loaded * wide, rows.errors @ law.factor]
    X = np.concatenate([*own, sticking * ~loaded, sticking * loaded], axis=2)
    # y is that of the true trunk and load, so what is estimated of them are errors
    y = rows.target - rows.matrix @ truth.trunk - (rows.matrix @ truth.load) * loaded[:, :, 0]
    air = np.zeros((len(rows.swing), X.shape[2]))
    air[:, 20 : 20 + law.factor.shape[1]] = rows.swing @ law.factor
    y_air = rows.swing_target - rows.swing @ law.mean
    e = _without_sticking(y - rows.errors @ truth.errors, X[:, :, -2 * sticking.shape[2] :])
    e_air = rows.swing_target - rows.swing @ truth.errors
    y = y - rows.errors @ law.mean
    if not informed:
        e, e_air = y, y_air
    for _ in range(1 if informed else settings.iterations):
        factor = np.linalg.inv(np.linalg.cholesky(settings.repeated * e.T @ e / len(e)))
        scale = _scales(e_air, rows.swing_at[:, 1], settings)
        best = Best.of(
            np.vstack([(factor @ X).reshape(-1, X.shape[2]), scale[:, None] * air]),
            np.concatenate([(y @ factor.T).ravel(), scale * y_air]),
        )
        e, e_air = y - X @ best.value, y_air - air @ best.value
    parts = [slice(0, 10), slice(10, 20)]
    maps = [_figures(truth.trunk) * wide, _figures(truth.load) * wide]
    errors = [J @ best.value[part] for J, part in zip(maps, parts, strict=True)]
    squares = [np.diag(J @ best.covariance[part, part] @ J.T) for J, part in zip(maps, parts, strict=True)]
    return np.concatenate(errors), np.sqrt(np.concatenate(squares))


def _scales(e: Array, joint: Array, settings: LimitSettings) -> Array:
    """One over the noise (n,) of rows of legs in the air, by joint; zero for outliers."""
    usual = np.abs(e) < settings.outlier * np.median(np.abs(e)) if len(e) else np.zeros(0, dtype=bool)
    scale = np.zeros(len(e))
    for k in range(12):
        chosen = usual & (joint == k)
        if chosen.sum() > 1:
            scale[chosen] = 1.0 / np.sqrt(settings.repeated * np.mean(e[chosen] ** 2))
    return scale


def _without_sticking(e: Array, columns: Array) -> Array:
    """The rows' own errors (B, 6) without what static friction, columns (B, 6, k) of unit priors, explains of them."""
    if not columns.any():
        return e
    scale, X = 1.0 / e.std(), columns.reshape(e.size, -1)
    return np.asarray(e - (X @ Best.of(scale * X, scale * e.ravel()).value).reshape(e.shape))


def _figures(theta: Array) -> Array:
    """Derivatives (4, 10) of mass and centre of mass by the ten parameters."""
    J, mass = np.zeros((4, 10)), max(float(theta[0]), 1e-9)
    J[0, 0], J[1:, 0], J[1:, 1:4] = 1.0, -theta[1:4] / mass**2, np.eye(3) / mass
    return J


def shares_of(rows: LogRows, truth: Truths, mass: float) -> dict[str, Array]:
    """By kind of error, what its true value adds to least squares of the trunk before the load, and of the load: (8,),
    in SI units by `FIGURES`.
    """
    wide, loaded = mass * np.array([1.0, *[0.5] * 9]), rows.time > HOW.loaded_at
    kinds = {name: rows.errors[:, :, place] @ truth.errors[place] for name, place in PLACES.items()}
    kinds = {name: effect for name, effect in kinds.items() if effect.any()}
    y = rows.target - rows.matrix @ truth.trunk - (rows.matrix @ truth.load) * loaded[:, None]
    kinds["rows' own"] = y - rows.errors @ truth.errors
    effects = np.stack(list(kinds.values()), axis=-1)
    found = []
    for part in (~loaded, loaded):
        X = (rows.matrix[part] * wide).reshape(-1, 10)
        normal = X.T @ X + np.eye(10)
        found.append(wide[:, None] * np.linalg.solve(normal, X.T @ effects[part].reshape(len(X), -1)))
    both = np.vstack([_figures(truth.trunk) @ found[0], _figures(truth.load) @ (found[1] - found[0])])
    return dict(zip(kinds, both.T, strict=True))


def detection_of(rows: LogRows, truth: Truths, mass: float, settings: LimitSettings) -> float:
    """z of a load, by the scatter of averages before it."""
    before = rows.time < HOW.loaded_at
    A = rows.matrix[before]
    e = rows.target[before] - A @ truth.trunk - rows.errors[before] @ truth.errors
    along, ones = (A[:, :3, 0] * e[:, :3]).sum(axis=1), np.ones(settings.window)
    apparent = np.convolve(along, ones, "valid") / np.convolve((A[:, :3, 0] ** 2).sum(axis=1), ones, "valid")
    return float(settings.load * mass / apparent.std())


def weighed(robot: Robot, samples: Samples, truth: Truths) -> Array:
    """Errors of `TrunkEstimator` (8,), in SI units by `FIGURES`; NaN for what it does not observe."""
    estimator = TrunkEstimator(robot)
    estimator.add(samples[samples.time < HOW.loaded_at])
    trunk = estimator.trunk
    estimator.tare()
    estimator.add(samples[samples.time >= HOW.loaded_at])
    load, centre = estimator.payload, truth.trunk[1:4] / truth.trunk[0]
    assert load is not None
    seen = np.where(trunk.observed[1:4], trunk.inertial.com - centre, np.nan)
    place = load.com - truth.load[1:4] / max(truth.load[0], 1e-9)
    return np.array([trunk.inertial.mass - truth.trunk[0], *seen, load.mass - truth.load[0], *place])


def limits_of(case: RealityCase, logs: Path | None, settings: LimitSettings) -> dict[str, Any]:
    """Results of a run, in the unit of `FIGURES`: the floor, errors of the best estimate, of the joint one and of
    `weigh`, the shares of each kind of error, and the detection's z; `fell` alone for a robot that did.
    """
    robot = load_robot(case.robot)
    try:
        log, said, sizes = log_of(case, robot, logs, settings.without, settings.rate)
    except (ControlError, PlanError, SimulationError) as error:
        return {"fell": str(error)}
    samples = Samples.of_recording(log, robot)
    truth = Truths.of(robot, said, samples)
    rows = LogRows.of(robot, samples, InertialParameters(truth.trunk), truth.errors, TrunkSettings())
    late = (rows.time > HOW.loaded_at) & (rows.time < HOW.loaded_at + settings.spoilt)
    rows = rows.chosen((rows.time > settings.begin) & ~late)
    assert said.drawn is not None
    best, floor = best_of(rows, truth, law_of_errors(robot, sizes, said.drawn, truth.errors), robot.mass, settings)
    cautious = replace(settings, repeated=settings.repeated_joint)
    joint, _ = best_of(rows, truth, usual_errors(robot, sizes), robot.mass, cautious, informed=False)
    unit = np.tile([100.0 / robot.mass, 1e3, 1e3, 1e3], 2)
    unit[5:] *= 1.0 if case.share >= HOW.heavy else np.nan  # places of heavy loads
    return {
        "floor": _plain(unit * floor),
        "best": _plain(unit * best),
        "joint": _plain(unit * joint),
        "weigh": _plain(unit * weighed(robot, samples, truth)),
        "shares": {kind: _plain(unit * of) for kind, of in shares_of(rows, truth, robot.mass).items()},
        "detection": detection_of(rows, truth, robot.mass, settings),
    }


def _plain(values: Array) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


def main() -> None:
    """Runs the grid, prints tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=900)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--robots", default=",".join(ROBOTS))
    parser.add_argument("--gaits", default="trot,crawl,shake", help=f"of {', '.join(SCENARIOS)}")
    parser.add_argument("--errors", default="real-unit-gain", choices=list(REAL_SETS))
    parser.add_argument("--repeated", type=float, default=LimitSettings.repeated)
    parser.add_argument("--repeated-joint", type=float, default=LimitSettings.repeated_joint)
    parser.add_argument("--without", default="", choices=list(WITHOUT), help="simulate without a kind of error")
    parser.add_argument("--rate", type=float, help="simulate logs of this rate [Hz]")
    parser.add_argument("--keep", type=Path, help="folder of logs, that of `stadera reproduce reality --keep`")
    parser.add_argument("--workers", type=int, help="processes; 0 for this one")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    cases = [
        RealityCase(robot, gait, SHARES[k % len(SHARES)], args.errors, args.seed + k)
        for k in range(args.seeds)
        for robot in args.robots.split(",")
        for gait in args.gaits.split(",")
    ]
    logs = None if args.keep is None else args.keep.absolute() / "reality-logs"
    settings = LimitSettings(args.repeated, args.repeated_joint, without=args.without, rate=args.rate)
    run = partial(limits_of, logs=logs, settings=settings)
    with progress() as watch:
        found = run_grid("limits", run, cases, watch or (lambda *_: None), pool=Pool(workers=args.workers))
    pairs = list(zip(cases, found, strict=True))
    show(*(rich_table(table) for table in tables(pairs)))
    if args.json:
        runs = [{"case": vars(case), **outcome} for case, outcome in pairs]
        with written_together([args.json]) as (draft,):
            draft.write_text(json.dumps({"figures": FIGURES, "runs": runs}, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
