"""What a weighing found, whichever estimator weighed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from stadera.files import written_together
from stadera.results import Result
from stadera.robot.model import Robot
from stadera.trunk.load import LoadChange, Payload
from stadera.trunk.merge import TrunkEvidence
from stadera.trunk.result import TrunkParameters
from stadera.trust import Trust
from stadera.types import Array, Bools

if TYPE_CHECKING:
    from stadera.report.figures import Figure
    from stadera.report.table import TableData


@dataclass(frozen=True)
class Refusal:
    """A time in which nothing was learnt from the log.

    Attributes:
        begin, end: [s].
        reason: one sentence.
    """

    begin: float
    end: float
    reason: str


@dataclass(frozen=True, eq=False)
class Timeline:
    """The trunk over time, with all that is on it; trunk frame.

    Attributes:
        time: (entries,) [s]; at rest the middle of each block.
        mass, mass_std: (entries,) [kg]; at rest of the block alone.
        com, com_std: (entries, 3) [m], as known at that time.
        payload: (entries, 2) [kg], its mass since the tare and the standard deviation, NaN before; None where it is not
            followed.
        load: (entries, 4) [N], at rest the feet's vertical forces, legs in the robot's order; None in motion.

    What was not observed is NaN.
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
    """How the robot stands at the end, in the level plane through the trunk's origin, x where the trunk's x points.

    Attributes:
        to_level: (3, 3), from trunk axes to level ones.
        feet: (4, 3) [m], contacts, trunk frame.
        stance: (4,) bool.
        force: (4,) [N], vertical.
        pressure: (2,) [m], centre of pressure: the feet's places weighed by their forces.
        robot_com: (2,) [m], of the whole robot as found; NaN where not observed.
    """

    to_level: Array
    feet: Array
    stance: Bools
    force: Array
    pressure: Array
    robot_com: Array

    def level(self, point: Array) -> Array:
        """A point of the trunk frame (..., 3) in the level plane, (..., 2) [m]."""
        return np.asarray((point @ self.to_level.T)[..., :2])


@dataclass(frozen=True, eq=False)
class Vertical:
    """The vertical in the trunk at the end, and its source.

    Attributes:
        source: "imu", or "forces" of the feet where there is no IMU.
        up: (3,), unit vector, trunk axes.
        std: (3,), of its components, constant errors included.
    """

    source: Literal["imu", "forces"]
    up: Array
    std: Array

    @property
    def tilt_std(self) -> float:
        """1 σ of its tilt, root of the mean square of both directions [rad]."""
        return float(np.linalg.norm(self.std) / np.sqrt(2.0))


@dataclass(frozen=True, eq=False, repr=False)
class Weighing(Result):
    """What a weighing found.

    Attributes:
        robot: as it was given.
        source: the log.
        method: that weighed, a name of `stadera.trunk.registry.METHODS`.
        status: of the estimator at the end.
        trust: whether the figures hold; where it is "bad" they are marked everywhere.
        trunk: with all that was on it, at `time`.
        time: of the last sample that was learnt from [s].
        payload: added since the tare; None without a tare.
        changes: of the load, in order.
        timeline: see `Timeline`.
        refusals: when nothing was learnt from the log, and why, in order.
        begin, end: of the log [s].
        torque_lag: delay of the torques and its standard deviation [s]; None at rest.
        balance, vertical: at the end of the last rest; None in motion.
        notes: one sentence each.
        evidence: what the log says of the trunk, for `stadera.trunk.merge`; None at rest.
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

    @property
    def mass(self) -> float:
        """Of the trunk with all that is on it [kg]."""
        return self.trunk.inertial.mass

    @property
    def mass_std(self) -> float:
        """[kg], NaN where not observed."""
        return self.trunk.mass_std

    @property
    def com(self) -> Array:
        """Centre of mass of the trunk with all that is on it, (3,) [m], trunk frame; NaN where not observed."""
        return self.trunk.com

    @property
    def com_std(self) -> Array:
        """(3,) [m], NaN where not observed."""
        return self.trunk.com_std

    @property
    def refused(self) -> float:
        """For how long nothing was learnt from the log [s]."""
        return sum(refusal.end - refusal.begin for refusal in self.refusals)

    @property
    def is_trusted(self) -> bool:
        """Whether figures may be shown without a mark."""
        return self.trust.verdict != "bad"

    def widened(self, factor: float) -> Weighing:
        """The same with all standard deviations of trunk, payload and changes multiplied."""
        payload, trunk = self.payload, self.trunk
        if payload is not None:
            std, covariance = factor * payload.mass_std, factor**2 * payload.com_covariance
            shape = None if payload.inertia_std is None else factor * payload.inertia_std
            payload = replace(payload, mass_std=std, com_covariance=covariance, inertia_std=shape)
        return replace(
            self,
            trunk=replace(trunk, covariance=factor**2 * trunk.covariance, inertia_std=factor * trunk.inertia_std),
            payload=payload,
            changes=tuple(replace(change, mass_std=factor * change.mass_std) for change in self.changes),
        )

    def __repr__(self) -> str:
        """Trunk, payload, changes and trust, a line each."""
        from stadera.report.numbers import with_std

        def body(mass: float, mass_std: float, com: Array, com_std: Array) -> str:
            seen = zip("xyz", com, com_std, strict=True)
            shown = ", ".join(f"{axis} {with_std(v, s)}" for axis, v, s in seen if isfinite(s))
            return f"{with_std(mass, mass_std)} kg, com {shown or 'not observed'} m"

        lines = [f"Weighing of {self.robot.name} by {self.source} ({self.method}), at {self.time:.2f} s"]
        lines.append(f"  trunk: {body(self.mass, self.mass_std, self.com, self.com_std)}")
        if (payload := self.payload) is not None:
            lines.append(f"  payload: {body(payload.mass, payload.mass_std, payload.com, payload.com_std)}")
        if self.changes:
            last = self.changes[-1]
            lines.append(f"  changes of load: {len(self.changes)}, the last {last.kind} at {last.time:.2f} s")
        lines.append(f"  trust: {self.trust.verdict}{''.join(f'; {reason}' for reason in self.trust.reasons[:2])}")
        return "\n".join(lines)

    # -- handed on --------------------------------------------------------------------------------------------
    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, see `stadera.weigh.schema`."""
        from stadera.weigh.schema import weighing_dict

        return weighing_dict(self)

    def to_dataframe(self) -> Any:
        """The timeline as a pandas DataFrame: time [s], mass, mass_std [kg], com_x, com_x_std, ... [m], and
        where it was followed payload_mass, payload_mass_std [kg].

        Raises:
            StaderaError: pandas is not installed.
        """
        from stadera.weigh.schema import timeline_frame

        return timeline_frame(self.timeline)

    def to_html(self) -> str:
        """The report: one page that loads nothing."""
        from stadera.report.weigh.page import weighing_html

        return weighing_html(self)

    def save_urdf(self, path: str | PathLike[str]) -> None:
        """Writes the robot's model file as weighed, URDF or MJCF as it came, the payload as a separate link.

        Raises:
            IdentificationError: nothing was weighed that could be written.
            ModelError: the path's ending is not that of the robot's model file.
        """
        from stadera.robot.export import export_model
        from stadera.weigh.model import weighed_model

        model = weighed_model(self)
        with written_together([path]) as (draft,):
            export_model(model.robot, draft, model.payload, model.note)

    def to_tables(self) -> list[TableData]:
        """Trunk and payload, inertia where it was observed, changes of the load."""
        from stadera.report.weigh.tables import tables

        return tables(self)

    def to_figures(self) -> Mapping[str, Figure]:
        """payload (with a tare, in motion), mass, balance (at rest), convergence (of the centre of mass), forces."""
        from stadera.report.weigh.plots import figures

        return figures(self)
