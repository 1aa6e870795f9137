"""Coulomb friction that varies with the joint's position, with the torque it carries, and after a reversal, where a log
shows it.

    (τ_c + a (cos q - c̄) + b (sin q - s̄) + μ (|h| - h̄)) d

in place of τ_c s(q̇), with h the torque of the links at the model's values: the measured torque has noise, and friction
itself, in it. With c̄, s̄, h̄ the means over the sliding samples τ_c is the mean friction, which is what model files hold.
On a real Go2 the hind calves' residual falls by half with a and b: gears that are not round, cables that bend. d is the
direction s(q̇) of sliding, or with presliding the Dahl state (`stadera.body.friction`): what lies behind the give of
gear and belt slips only after that has been wound up over the travel x_s. The Dahl state starts anew with each chunk of
a log, and forgets its start within a few x_s.

Which terms a joint has is chosen by evidence (`stadera.identify.evidence`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np

from stadera.body import Rows
from stadera.body.friction import direction, presliding
from stadera.types import Array

VARYING_UNITS: dict[str, str] = {"coulomb_cos": "N·m", "coulomb_sin": "N·m", "coulomb_load": "1"}
"""Names of a, b and μ as joint terms, and their units."""


@dataclass(frozen=True)
class VaryingFriction:
    """Terms by which one joint's friction varies.

    Attributes:
        centres: mean of cos q [1], sin q [1] or |h| [N·m], by term.
        travel: x_s [rad] over which friction builds up after a reversal; zero if it acts at once.
        travel_std: of its error [rad].
        tried: more travels, whose columns are added to compare them, named `<joint>.<term>@1` and so on.
        ratio: held-out RMSE with the terms over that without, of blocks and of halves.
    """

    centres: Mapping[str, float]
    travel: float = 0.0
    travel_std: float = np.nan
    tried: tuple[float, ...] = ()
    ratio: tuple[float, float] = (1.0, 1.0)

    @property
    def words(self) -> str:
        """How friction varies, without a subject."""
        by = ["position"] * ("coulomb_cos" in self.centres) + ["load"] * ("coulomb_load" in self.centres)
        varies = [f"varies with {' and '.join(by)}"] * bool(by)
        built = f"builds up over {1e3 * self.travel:.2g} mrad of travel after a reversal"
        return " and ".join((*varies, *([built] if self.travel else [])))


def with_varying(
    rows: Rows, joint: str, varying: VaryingFriction, position: Array, velocity: Array, rigid: Mapping[str, float]
) -> Rows:
    """One joint's rows with friction that varies; position and velocity are the joint's (samples,), `rigid` the
    parameters of the links.
    """
    found = {"coulomb_cos": np.cos(position), "coulomb_sin": np.sin(position)}
    if "coulomb_load" in varying.centres:
        found["coulomb_load"] = np.abs(rows.predict(np.array([rigid.get(c, 0.0) for c in rows.columns])))
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
