"""Result of a weighing, the same for every estimator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from stadera.files import written_together
from stadera.results import Result
from stadera.robot.model import Robot
from stadera.trunk.drives import Drives
from stadera.trunk.load import LoadChange, Payload
from stadera.trunk.merge import TrunkEvidence
from stadera.trunk.result import TrunkParameters
from stadera.trust import Trust
from stadera.types import Array, Bools

if TYPE_CHECKING:
    from stadera.report.figures import Figure
    from stadera.report.table import TableData
    from stadera.weigh.truth import Truth


@dataclass(frozen=True)
class Refusal:
    """A period of the log [s] that the estimator could not use, and why, one sentence."""

    begin: float
    end: float
    reason: str


@dataclass(frozen=True, eq=False)
class Timeline:
    """The trunk over time, with all that is on it; trunk frame.

    Attributes:
        time: (entries,) [s]; at rest the middle of each block.
        mass, mass_std: (entries,) [kg]; at rest of the block alone.
        com, com_std: (entries, 3) [m], as estimated at that time.
        payload: (entries, 2) [kg], its mass since the tare and the standard deviation, NaN before the tare; None if it
            is not tracked.
        load: (entries, 4) [N], vertical forces of the feet at rest, legs in the robot's order; None in motion.

    Entries that were not observed are NaN.
    """

    time: Array
    mass: Array
    mass_std: Array
    com: Array
    com_std: Array
    payload: Array | None = None
    load: Array | None = None


@dataclass(frozen=True, eq=False)
class Balance:
    """Balance of the robot at the end of the log.

    `pressure` and `robot_com` are in the level plane through the trunk's origin, x where the trunk's x points.
    """

    to_level: Array  # (3, 3), from trunk axes to level ones
    feet: Array  # (4, 3) [m], contacts, trunk frame
    stance: Bools  # (4,) bool
    force: Array  # (4,) [N], vertical
    pressure: Array  # (2,) [m], centre of pressure: mean position of the feet weighted by their forces
    robot_com: Array  # (2,) [m], estimated centre of mass of the whole robot; NaN where not observed

    def level(self, point: Array) -> Array:
        """Projects points of the trunk frame (..., 3) into the level plane, (..., 2) [m]."""
        return np.asarray((point @ self.to_level.T)[..., :2])


@dataclass(frozen=True, eq=False)
class Vertical:
    """Unit vector upwards (3,) in trunk axes at the end of the log, and the standard deviations of its components,
    constant errors included; from the "imu", or the "forces" of the feet without one.
    """

    source: Literal["imu", "forces"]
    up: Array
    std: Array

    @property
    def tilt_std(self) -> float:
        """Standard deviation of the tilt, the root mean square of both directions [rad]."""
        return float(np.linalg.norm(self.std) / np.sqrt(2.0))


@dataclass(frozen=True, eq=False, repr=False)
class Weighing(Result):
    """Result of a weighing.

    Attributes:
        robot: the robot as given.
        source: name of the log.
        method: name of the method used, from `stadera.trunk.registry.METHODS`.
        status: of the estimator at the end of the log.
        trust: whether the values hold; if "bad", every output marks them.
        trunk: parameters at `time`, including everything attached to the trunk.
        time: of the last sample used [s].
        payload: mass added since the tare; None without a tare.
        changes: changes of the load, in order.
        timeline: see `Timeline`.
        refusals: periods that could not be used, and why, in order.
        begin, end: of the log [s].
        torque_lag: delay of the torques and its standard deviation [s]; None at rest.
        balance, vertical: at the end of the last rest; None in motion.
        notes: remarks, one sentence each.
        evidence: the log's information on the trunk, for `stadera.trunk.merge`; None at rest.
        spikes: number of samples of which single wild values were replaced; None at rest.
        impacts: time left out because the log's rate does not resolve its impacts [s]; None at rest.
        drives: what the motion told about the joints; None at rest.
    """

    robot: Robot
    source: str
    method: str
    status: str
    trust: Trust
    trunk: TrunkParameters
    time: float
    payload: Payload | None
    changes: tuple[LoadChange, ...]
    timeline: Timeline
    refusals: tuple[Refusal, ...]
    begin: float
    end: float
    torque_lag: tuple[float, float] | None = None
    balance: Balance | None = None
    vertical: Vertical | None = None
    notes: tuple[str, ...] = ()
    evidence: TrunkEvidence | None = None
    spikes: int | None = None
    impacts: float | None = None
    drives: Drives | None = None

    @property
    def mass(self) -> float:
        """Mass of the trunk and everything attached to it [kg]."""
        return self.trunk.inertial.mass

    @property
    def mass_std(self) -> float:
        """Standard deviation of the mass [kg], NaN where not observed."""
        return self.trunk.mass_std

    @property
    def com(self) -> Array:
        """Centre of mass of the trunk and everything attached to it, (3,) [m], trunk frame; NaN where not observed."""
        return self.trunk.com

    @property
    def com_std(self) -> Array:
        """Standard deviation of the centre of mass, (3,) [m], NaN where not observed."""
        return self.trunk.com_std

    @property
    def refused(self) -> float:
        """Total time that could not be used [s]."""
        return sum(refusal.end - refusal.begin for refusal in self.refusals)

    @property
    def is_trusted(self) -> bool:
        """True unless the verdict is "bad"."""
        return self.trust.verdict != "bad"

    def since_beginning(self) -> Weighing:
        """A copy with all times in seconds since the log's beginning, as people read them; the values themselves are on
        the log's own clock.
        """
        first = self.begin
        return replace(
            self,
            time=self.time - first,
            changes=tuple(replace(c, time=c.time - first, noticed=c.noticed - first) for c in self.changes),
            timeline=replace(self.timeline, time=self.timeline.time - first),
            refusals=tuple(replace(r, begin=r.begin - first, end=r.end - first) for r in self.refusals),
            begin=0.0,
            end=self.end - first,
            notes=(*self.notes, f"times count from the log's beginning, {first:.3f} s on its own clock")
            if first > 1.0
            else self.notes,
        )

    def widened(self, factor: float) -> Weighing:
        """A copy with all standard deviations of trunk, payload and changes multiplied by `factor`."""
        payload, trunk = self.payload, self.trunk
        if payload is not None:
            std, covariance = factor * payload.mass_std, factor**2 * payload.com_covariance
            shape = None if payload.inertia_std is None else factor * payload.inertia_std
            alone = payload.mass_std_without_scale and factor * payload.mass_std_without_scale
            payload = replace(
                payload, mass_std=std, com_covariance=covariance, inertia_std=shape, mass_std_without_scale=alone
            )
        return replace(
            self,
            trunk=replace(
                trunk,
                covariance=factor**2 * trunk.covariance,
                inertia_std=factor * trunk.inertia_std,
                mass_std_without_scale=trunk.mass_std_without_scale and factor * trunk.mass_std_without_scale,
            ),
            payload=payload,
            changes=tuple(
                replace(
                    change,
                    mass_std=factor * change.mass_std,
                    mass_std_without_scale=change.mass_std_without_scale and factor * change.mass_std_without_scale,
                )
                for change in self.changes
            ),
        )

    def __repr__(self) -> str:
        """Trunk, payload, changes and trust, one line each."""
        lines = [f"Weighing of {self.robot.name} by {self.source} ({self.method}), at {self.time - self.begin:.2f} s"]
        lines.append(f"  trunk: {self.trunk!r}")
        if (payload := self.payload) is not None:
            lines.append(f"  payload: {payload!r}")
        if self.changes:
            last = self.changes[-1]
            lines.append(
                f"  changes of load: {len(self.changes)}, the last {last.kind} at {last.time - self.begin:.2f} s"
            )
        lines.append(f"  trust: {self.trust.verdict}{''.join(f'; {reason}' for reason in self.trust.reasons[:2])}")
        return "\n".join(lines)

    # -- handed on --------------------------------------------------------------------------------------------
    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; see `stadera.weigh.schema`."""
        from stadera.weigh.schema import weighing_dict

        return weighing_dict(self)

    def to_dataframe(self) -> Any:
        """The timeline as a pandas DataFrame: time [s], mass, mass_std [kg], com_x, com_x_std, ... [m], and
        payload_mass, payload_mass_std [kg] if the payload was tracked. Raises MissingExtraError: pandas is not
        installed.
        """
        from stadera.weigh.schema import timeline_frame

        return timeline_frame(self.timeline)

    def to_html(self, truth: Truth | None = None) -> str:
        """The report as one self-contained HTML page; with the truth of a simulated log, if given."""
        from stadera.report.weigh.page import weighing_html

        return weighing_html(*_shown(self, truth))

    def save_urdf(self, path: str | PathLike[str]) -> None:
        """Writes the robot's model file with the weighed trunk and the payload as a separate link, in the format of the
        original.

        Raises:
            IdentificationError: no mass was observed that could be written.
            ModelError: the path's suffix is not that of the robot's model file.
        """
        from stadera.robot.export import export_model
        from stadera.weigh.model import weighed_model

        model = weighed_model(self)
        with written_together([path]) as (draft,):
            export_model(model.robot, draft, model.payload, model.note)

    def to_tables(self) -> list[TableData]:
        """Tables of trunk and payload, of the inertia where it was observed, and of the changes of the load."""
        from stadera.report.weigh.tables import tables

        return tables(self.since_beginning())

    def to_figures(self, truth: Truth | None = None) -> Mapping[str, Figure]:
        """Figures: payload (with a tare, in motion), mass, balance (at rest), convergence (of the centre of mass),
        forces.
        """
        from stadera.report.weigh.plots import figures

        return figures(*_shown(self, truth))


def _shown(result: Weighing, truth: Truth | None) -> tuple[Weighing, Truth | None]:
    """A result and the truth of its log, with times since the log's beginning."""
    return result.since_beginning(), None if truth is None else truth.since(result.begin)
