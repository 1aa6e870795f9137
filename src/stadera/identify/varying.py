"""Coulomb friction that varies with the joint's position and with the torque it carries, where a log shows it.

    τ_c(q, τ) = τ_c + a (cos q - c̄) + b (sin q - s̄) + μ (|h| - h̄)

in place of τ_c, with h the torque of the links at the model's values: the measured torque has noise, and friction
itself, in it. With c̄, s̄, h̄ the means over the sliding samples τ_c is the mean friction, which is what model files hold.
On a real Go2 the hind calves' residual falls by half with a and b: gears that are not round, cables that bend.

A term is taken only if it helps to predict torques that it was not fitted to, in two ways: every other block of 1.5 s,
and the other half of the training part. The fits are regularised by the prior, as the solution itself is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import chain, pairwise

import numpy as np

from stadera.body import Rows
from stadera.body.friction import direction
from stadera.errors import require_positive
from stadera.identify.prior import Prior
from stadera.information import Information
from stadera.types import Array

VARYING_UNITS: dict[str, str] = {"coulomb_cos": "N·m", "coulomb_sin": "N·m", "coulomb_load": "1"}
"""Names of a, b and μ as joint terms, and their units."""

_POSITION, _LOAD = ("coulomb_cos", "coulomb_sin"), ("coulomb_load",)


@dataclass(frozen=True)
class VaryingSettings:
    """When Coulomb friction is taken to vary."""

    block: float = 1.5  # length of the blocks fitted and predicted alternately [s]
    gain: float = 0.02  # least relative fall of the held-out error by position, in both ways [1]
    # the same by load, which a link's wrong mass resembles: on a real Aliengo in the air 9 % did not last
    load_gain: float = 0.1
    least: float = 1e-3  # least fall of it as a share of the torque's root mean square [1]
    longest: float = 300.0  # length of the training part that is used [s]

    def __post_init__(self) -> None:
        require_positive("setting of varying friction", self, self.__dataclass_fields__)


@dataclass(frozen=True)
class VaryingFriction:
    """Terms by which one joint's friction varies.

    Attributes:
        centres: mean of cos q [1], sin q [1] or |h| [N·m], by term.
        ratio: held-out RMSE with the terms over that without, of blocks and of halves.
    """

    centres: Mapping[str, float]
    ratio: tuple[float, float]


def with_varying(
    rows: Rows, joint: str, centres: Mapping[str, float], position: Array, velocity: Array, rigid: Mapping[str, float]
) -> Rows:
    """One joint's rows with the columns of some terms, by name and centre; position and velocity are the joint's
    (samples,), `rigid` the parameters of the links.
    """
    if not centres:
        return rows
    found = {"coulomb_cos": np.cos(position), "coulomb_sin": np.sin(position)}
    if "coulomb_load" in centres:
        found["coulomb_load"] = np.abs(rows.predict(np.array([rigid.get(c, 0.0) for c in rows.columns])))
    more = np.column_stack([direction(velocity) * (found[term] - centre) for term, centre in centres.items()])
    kept, n = rows.reduced.shape[1], len(rows.columns)
    mixing = np.eye(kept + len(centres), n + len(centres), n - kept)
    mixing[:kept, :n] = np.eye(n) if rows.mixing is None else rows.mixing
    columns = (*rows.columns, *(f"{joint}.{term}" for term in centres))
    return Rows(columns, np.hstack([rows.reduced, more]), rows.target, rows.std, mixing)


def varying_friction(
    chunks: Iterable[tuple[Array, tuple[Rows, ...]]],
    joints: Sequence[str],
    prior: Prior,
    fixed: Mapping[str, float],
    settings: VaryingSettings,
) -> dict[str, VaryingFriction]:
    """The joints whose friction varies, from time [s] and rows of each joint with all terms at centres of zero.

    `prior` is that of all parameters but the `fixed` ones, the varying terms among them.
    """
    blocks = list(_blocks(chunks, settings))
    out: dict[str, VaryingFriction] = {}
    for k, joint in enumerate(joints):
        if f"{joint}.coulomb" in prior.columns and len(blocks) >= 4:
            found = _evidence(joint, [block[k] for block in blocks], prior, fixed, settings)
            out |= {} if found is None else {joint: found}
    return out


def _blocks(
    chunks: Iterable[tuple[Array, tuple[Rows, ...]]], settings: VaryingSettings
) -> Iterator[tuple[Information, ...]]:
    """Information of each joint's rows, by block."""
    waiting: list[tuple[Rows, ...]] = []
    last, yielded = None, 0

    def summed() -> tuple[Information, ...]:
        return tuple(Information.of(rows, rows[0].columns) for rows in zip(*waiting, strict=True))

    for time, every in chunks:
        number = np.floor(time / settings.block)
        edges = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(time)]
        for start, stop in pairwise(edges):
            if stop > start and last is not None and number[start] != last:
                yield summed()
                waiting, yielded = [], yielded + 1
                if yielded * settings.block >= settings.longest:
                    return
            if stop > start:
                last = number[start]
                waiting.append(tuple(r.replaced(r.reduced[start:stop], r.target[start:stop]) for r in every))
    if waiting:
        yield summed()


def _evidence(
    joint: str, blocks: Sequence[Information], prior: Prior, fixed: Mapping[str, float], settings: VaryingSettings
) -> VaryingFriction | None:
    whole = reduce(Information.merge, blocks)
    known = {name: value for name, value in fixed.items() if name in whole.names}
    free = whole.fix(known)
    at = [prior.columns.index(name) for name in free.names]
    covariance = (prior.root @ prior.root.T)[np.ix_(at, at)]
    varying = {term: free.names.index(f"{joint}.{term}") for term in VARYING_UNITS}
    freedom = max(free.count - free.rank(), 1.0)
    noise = max(np.sqrt(free.residual_squared(np.array(list(free.least_squares().values()))) / freedom), 1e-9)
    half = len(blocks) // 2
    ways = [(blocks[::2], blocks[1::2]), (blocks[:half], blocks[half:])]
    parts = [[reduce(Information.merge, part).fix(known) for part in way] for way in ways]

    def errors(terms: tuple[str, ...]) -> Array:
        """Root of the summed squares of held-out residuals, by way, with some of the terms."""
        left_out = {column for term, column in varying.items() if term not in terms}
        kept = [k for k in range(len(free)) if k not in left_out]
        sizes = np.sqrt(np.diag(covariance)[kept])
        ridge = np.linalg.cholesky(np.linalg.inv(covariance[np.ix_(kept, kept)] / np.outer(sizes, sizes))).T / sizes
        before = prior.values[at][kept]

        def across(first: Information, second: Information) -> float:
            values = np.zeros(len(free))
            stacked = np.vstack([first.R[:, kept] / noise, ridge])
            values[kept] = np.linalg.lstsq(stacked, np.concatenate([first.z / noise, ridge @ before]))[0]
            return second.residual_squared(values)

        return np.sqrt([across(first, second) + across(second, first) for first, second in parts])

    plain = best = errors(())
    least = settings.least * np.sqrt(whole.residual_squared(np.zeros(len(whole))))
    chosen: tuple[str, ...] = ()
    for terms in (_POSITION, _LOAD, (*_POSITION, *_LOAD)):
        found = errors(terms)
        gain = settings.gain if terms is _POSITION else settings.load_gain
        if (best - found > np.maximum(gain * best, least)).all():
            chosen, best = terms, found
    if not chosen:
        return None
    slides = free.R[:, free.names.index(f"{joint}.coulomb")]
    centres = {term: float(slides @ free.R[:, varying[term]] / (slides @ slides)) for term in chosen}
    return VaryingFriction(centres, (float(best[0] / plain[0]), float(best[1] / plain[1])))


def columns_of(varying: Mapping[str, Mapping[str, float]]) -> tuple[str, ...]:
    """Names of the columns of some joints' terms."""
    return tuple(chain.from_iterable((f"{joint}.{term}" for term in terms) for joint, terms in varying.items()))
