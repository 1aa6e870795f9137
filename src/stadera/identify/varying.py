"""Coulomb friction that varies with the joint's position, with the torque it carries, and after a reversal.

    (τ_c + a (cos q - c̄) + b (sin q - s̄) + μ |h|) d

in place of τ_c s(q̇), with h the torque of the links at the model's values: the measured torque has noise, and friction
itself, in it. With c̄, s̄ the means over the sliding samples, τ_c is the mean friction, over the positions of the log, of
a drive without load. It is the same quantity in the air and under load (`stadera.trunk.swing`), and so in any log; with
μ times the mean |h| it is what a simulator's constant friction should be. d is the direction s(q̇) of sliding, or with
presliding the Dahl state (`stadera.body.friction`): what lies behind the give of gear and belt slips only after that
has been wound up over the travel x_s. The Dahl state starts anew with each chunk of a log, and forgets its start within
a few x_s.

a, b and μ are unknowns of every joint whose Coulomb friction is, with a prior of zero mean (`PriorWidth`). Where a log
does not tell them apart from τ_c, they are in its bar: friction of a few per cent of the torque is a quarter of τ_c of
a drive that runs easily. On a real Go2's hind calves a and b halve the residual: gears that are not round, cables that
bend.

Whether a joint has presliding is chosen by predicting torques that it was not fitted to. It is taken only if it
predicts better in two ways: every other block of 1.5 s from the others, and each half of the training part from the
other. The fits are regularised by the prior, as the solution itself is. The travel x_s is the vertex of the held-out
error of blocks over log x_s; its standard deviation is that of the vertex with one block left out at a time
(jackknife). The shortest and the longest travel tried only bracket it: friction that is merely sharper than the
smoothed sign of a filtered velocity, with no travel of its own, is predicted best by the shortest.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import chain, pairwise

import numpy as np

from stadera.body import Rows
from stadera.body.friction import direction, presliding
from stadera.errors import IdentificationError, require_positive
from stadera.identify.prior import Prior
from stadera.information import Information
from stadera.types import Array

VARYING_UNITS: dict[str, str] = {"coulomb_cos": "N·m", "coulomb_sin": "N·m", "coulomb_load": "1"}
"""Names of a, b and μ as joint terms, and their units."""


@dataclass(frozen=True)
class VaryingFriction:
    """How one joint's friction varies, besides the values of a, b and μ."""

    centres: Mapping[str, float]  # by term, what is subtracted from cos q [1], sin q [1] and |h| [N·m]
    load: float = 0.0  # mean of |h| over the sliding samples [N·m]
    travel: float = 0.0  # x_s [rad] over which friction builds up after a reversal; zero if it acts at once
    travel_std: float = np.nan  # of its error [rad]
    # more travels, whose columns are added to compare them, named `<joint>.<term>@1` and so on
    tried: tuple[float, ...] = ()
    # held-out RMSE with the travel over that without, of blocks and of halves
    ratio: tuple[float, float] = (1.0, 1.0)


def with_varying(
    rows: Rows, joint: str, varying: VaryingFriction, position: Array, velocity: Array, rigid: Mapping[str, float]
) -> Rows:
    """One joint's rows with friction that varies; position and velocity are the joint's (samples,), `rigid` the
    parameters of the links.
    """
    load = np.abs(rows.predict(np.array([rigid.get(c, 0.0) for c in rows.columns])))
    found = dict(zip(VARYING_UNITS, (np.cos(position), np.sin(position), load), strict=True))
    factors = [found[term] - centre for term, centre in varying.centres.items()]
    n, kept = len(rows.columns), rows.reduced.shape[1]
    old = np.eye(n) if rows.mixing is None else rows.mixing
    sliding = int(np.argmax(np.abs(old[:, rows.columns.index(f"{joint}.coulomb")])))
    reduced, names = rows.reduced.copy(), list(rows.columns)
    more: list[Array] = []
    for k, travel in enumerate((varying.travel, *varying.tried)):
        acting = presliding(position, travel) if travel else direction(velocity)
        if k:
            more.append(acting)
            names.append(f"{joint}.coulomb@{k}")
        else:
            reduced[:, sliding] = acting
        more += [acting * factor for factor in factors]
        names += [f"{joint}.{term}@{k}" if k else f"{joint}.{term}" for term in varying.centres]
    mixing = np.eye(kept + len(more), len(names), n - kept)
    mixing[:kept, :n] = old
    return Rows(tuple(names), np.column_stack([reduced, *more]), rows.target, rows.std, mixing)


def columns_of(varying: Mapping[str, VaryingFriction]) -> tuple[str, ...]:
    """Names of the columns of some joints' terms."""
    return tuple(chain.from_iterable((f"{joint}.{term}" for term in v.centres) for joint, v in varying.items()))


@dataclass(frozen=True)
class VaryingSettings:
    """When friction is taken to build up after a reversal."""

    block: float = 1.5  # length of the blocks fitted and predicted alternately [s]
    # least relative fall of the held-out error, in both ways [1]: with a real Go2 and Aliengo, falls of 6 to 10 % in
    # the slower half of a log were rises of up to 6 % in the faster half; falls of more lasted, and so the other way
    # round
    presliding_gain: float = 0.12
    least: float = 1e-3  # least fall of it as a share of the torque's root mean square [1]
    longest: float = 300.0  # length of the training part that is used [s]
    travels: tuple[float, ...] = (3e-4, 6e-4, 1.2e-3, 2.4e-3, 4.8e-3)  # x_s that are tried [rad]

    def __post_init__(self) -> None:
        numbers = [name for name in self.__dataclass_fields__ if name != "travels"]
        require_positive("setting of varying friction", self, numbers)
        if len(self.travels) < 3 or not all(0.0 < a < b for a, b in pairwise(self.travels)):
            raise IdentificationError(
                f"travels of presliding are three or more, positive and rising, got {self.travels}"
            )

    @property
    def tried(self) -> VaryingFriction:
        """All terms, at centres of zero, with friction that acts at once and with each travel."""
        return VaryingFriction(dict.fromkeys(VARYING_UNITS, 0.0), tried=self.travels)


def varying_friction(
    chunks: Iterable[tuple[Array, tuple[Rows, ...]]],
    joints: Sequence[str],
    prior: Prior,
    fixed: Mapping[str, float],
    settings: VaryingSettings,
) -> dict[str, VaryingFriction]:
    """How friction varies, by joint with Coulomb friction, from time [s] and rows of each joint with all terms
    (`VaryingSettings.tried`).

    `prior` is that of all parameters but the `fixed` ones, the varying terms among them.
    """
    blocks = list(_blocks(chunks, settings))
    out: dict[str, VaryingFriction] = {}
    for k, joint in enumerate(joints):
        if blocks and f"{joint}.coulomb" in prior.columns:
            out[joint] = _chosen(_Evidence.of(joint, [block[k] for block in blocks], prior, fixed), settings)
    return out


def _blocks(
    chunks: Iterable[tuple[Array, tuple[Rows, ...]]], settings: VaryingSettings
) -> Iterator[tuple[Information, ...]]:
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


@dataclass(frozen=True, eq=False)
class _Evidence:
    """Blocks of one joint's rows, and the prior of their parameters, to predict some from others."""

    joint: str
    blocks: Sequence[Information]  # with all terms and states
    covariance: Array  # of the prior, with a state's columns like the sliding one's
    mean: Array  # of the prior
    noise: float  # of the rows [N·m]

    @classmethod
    def of(cls, joint: str, blocks: Sequence[Information], prior: Prior, fixed: Mapping[str, float]) -> _Evidence:
        known = {name: value for name, value in fixed.items() if name in blocks[0].names}
        free = [block.fix(known) for block in blocks]
        whole = reduce(Information.merge, free)
        at = [prior.columns.index(name.partition("@")[0]) for name in whole.names]
        squared = whole.residual_squared(np.array(list(whole.least_squares().values())))
        noise = max(float(np.sqrt(squared / max(whole.count - whole.rank(), 1.0))), 1e-9)
        return cls(joint, free, (prior.root @ prior.root.T)[np.ix_(at, at)], prior.values[at], noise)

    @cached_property
    def whole(self) -> Information:
        return reduce(Information.merge, self.blocks)

    @cached_property
    def _ways(self) -> list[tuple[tuple[range, Information], ...]]:
        """Blocks and their sum, of both parts, for each way to part them."""
        n = len(self.blocks)
        ways = ((range(0, n, 2), range(1, n, 2)), (range(n // 2), range(n // 2, n)))
        return [
            tuple((part, reduce(Information.merge, [self.blocks[k] for k in part])) for part in way) for way in ways
        ]

    def place(self, term: str, at: int = 0) -> int:
        return self.whole.names.index(f"{self.joint}.{term}@{at}" if at else f"{self.joint}.{term}")

    def _columns(self, at: int) -> tuple[list[int], Array]:
        """The parameters with a travel, and how all columns follow from them, (columns, parameters)."""
        terms = ("coulomb", *VARYING_UNITS)
        kept = [k for k, name in enumerate(self.whole.names) if "@" not in name]
        spread = np.zeros((len(self.whole.names), len(kept)))
        spread[kept, range(len(kept))] = 1.0
        for term in terms if at else ():
            column = kept.index(self.place(term))
            spread[kept[column], column], spread[self.place(term, at), column] = 0.0, 1.0
        return kept, spread

    def errors(self, at: int) -> Array:
        """Squared residuals of blocks predicted from others, (ways, blocks) [N²·m²]: alternate blocks, and halves.

        Args:
            at: the travel's place among those tried, from 1, or 0 for friction that acts at once.
        """
        kept, spread = self._columns(at)
        sizes = np.sqrt(np.diag(self.covariance)[kept])
        ridge = (
            np.linalg.cholesky(np.linalg.inv(self.covariance[np.ix_(kept, kept)] / np.outer(sizes, sizes))).T / sizes
        )
        before = ridge @ self.mean[kept]
        out = np.zeros((len(self._ways), len(self.blocks)))
        for way, parts in zip(out, self._ways, strict=True):
            for (predicted, _), (_, fitted) in (parts, parts[::-1]):
                stacked = np.vstack([fitted.R @ spread / self.noise, ridge])
                values = spread @ np.linalg.lstsq(stacked, np.concatenate([fitted.z / self.noise, before]))[0]
                way[predicted] = [self.blocks[k].residual_squared(values) for k in predicted]
        return out


def _chosen(evidence: _Evidence, settings: VaryingSettings) -> VaryingFriction:
    """The joint's law, with the travel that predicts best if it predicts better than none."""
    R, slides = evidence.whole.R, evidence.whole.R[:, evidence.place("coulomb")]
    sliding = max(float(slides @ slides), 1e-300)
    means = {term: float(slides @ R[:, evidence.place(term)]) / sliding for term in VARYING_UNITS}
    at_once = VaryingFriction(means | {"coulomb_load": 0.0}, means["coulomb_load"])
    if len(evidence.blocks) < 4:
        return at_once
    count = len(settings.travels)
    squares = np.array([evidence.errors(at) for at in range(count + 1)])
    plain, *others = np.sqrt(squares.sum(axis=2))
    built = np.array(others)
    least = settings.least * np.sqrt(evidence.whole.residual_squared(np.zeros(len(evidence.whole))))
    best = int(np.argmin(np.log(built).sum(axis=1)))
    # a travel at the end of those tried, or next to it, is not one if that one predicts better
    bracketed = 0 < best < count - 1 and (built[[best - 1, best + 1], 0] >= built[best, 0]).all()
    if not bracketed or (plain - built[best] <= np.maximum(settings.presliding_gain * plain, least)).any():
        return at_once
    travel, std = _travel(settings.travels[best - 1 : best + 2], squares[best : best + 3, 0])
    ratio = built[best] / plain
    return replace(at_once, travel=travel, travel_std=std, ratio=(float(ratio[0]), float(ratio[1])))


def _travel(near: Sequence[float], squares: Array) -> tuple[float, float]:
    """The travel among three [rad] that predicts best, by squared errors (3, blocks), and its standard deviation."""
    at, whole = np.log(near), squares.sum(axis=1)
    vertices = np.array([_vertex(at, whole - block) for block in squares.T])
    travel = float(np.exp(_vertex(at, whole)))
    return travel, travel * float(np.sqrt((len(vertices) - 1) * vertices.var()))


def _vertex(at: Array, values: Array) -> float:
    """Where the parabola through three points is least, within them."""
    a, b, _ = np.polyfit(at - at[1], values, 2)
    if a <= 0.0:
        return float(at[np.argmin(values)])
    return float(np.clip(at[1] - 0.5 * b / a, at[0], at[2]))
