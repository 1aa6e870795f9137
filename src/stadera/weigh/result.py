"""Result of a weighing, the same for every estimator."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar

from stadera.body import FRICTION_UNITS
from stadera.files import written_together
from stadera.results import Result, data_frame
from stadera.robot.model import Robot
from stadera.trunk.drives import Drives
from stadera.trunk.load import LoadChange, Payload, plain, quantity
from stadera.trunk.memory import Memory
from stadera.trunk.result import TrunkParameters
from stadera.trunk.standing.estimator import Balance, Stance, Vertical
from stadera.trust import Trust
from stadera.types import Array
from stadera.weigh.next_steps import NextStep, UseLimits, next_steps

if TYPE_CHECKING:
    from stadera.lab.truth import Truth

_UNITS = {
    "time": "s",
    "mass": "kg",
    "com": "m",
    "inertia": "kg·m²",
    "torque_lag": "s",
    "tilt_std": "rad",
} | FRICTION_UNITS


@dataclass(frozen=True)
class Refusal:
    """A period of the log [s] that the estimator could not use, and why, one sentence."""

    begin: float
    end: float
    reason: str


@dataclass(frozen=True, eq=False)
class Timeline:
    """The trunk over time, with all that is on it; trunk frame.


    Entries that were not observed are NaN.
    """

    time: Array  # (entries,) [s]
    # mass, mass_std: (entries,) [kg], com, com_std: (entries, 3) [m], as estimated at that time
    mass: Array
    mass_std: Array
    com: Array
    com_std: Array
    # (entries, 2) [kg], its mass since the tare and the standard deviation, NaN before the tare; None if it is not
    # tracked
    payload: Array | None = None

    @property
    def columns(self) -> dict[str, Array]:
        """Time, mass and centre of mass by name, and the payload's mass if it was tracked."""
        found = {"time": self.time, "mass": self.mass, "mass_std": self.mass_std}
        for k, axis in enumerate("xyz"):
            found |= {f"com_{axis}": self.com[:, k], f"com_{axis}_std": self.com_std[:, k]}
        if self.payload is not None:
            found |= {"payload_mass": self.payload[:, 0], "payload_mass_std": self.payload[:, 1]}
        return found

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        found = {name: plain(values) for name, values in self.columns.items() if not name.startswith("com_")}
        return found | {"com": [plain(com) for com in self.com], "com_std": [plain(std) for std in self.com_std]}


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
        stance: mean pose over the log; None if the robot was never on its feet.
        notes: remarks, one sentence each.
        spikes: number of samples of which single wild values were replaced; None at rest.
        impacts: time left out because the log's rate does not resolve its impacts [s]; None at rest.
        drives: what the motion showed about the joints; None at rest.
        memory: the robot's memory with this log, if one was asked for and the log does not contradict it.
        steps_known: of `next`, those whose bars this log's own information tells.
        truth: of a simulated log, shown with the result.
    """

    report: ClassVar[str] = "stadera.report.weigh.page"
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
    stance: Stance | None = None
    vertical: Vertical | None = None
    notes: tuple[str, ...] = ()
    spikes: int | None = None
    impacts: float | None = None
    drives: Drives | None = None
    memory: Memory | None = None
    steps_known: tuple[NextStep, ...] = ()
    truth: Truth | None = None

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

    @cached_property
    def next(self) -> tuple[NextStep, ...]:
        """What would make a wide bar narrower, the best first; computed within seconds when it is first asked for."""
        return next_steps(self.robot, self.trunk, self.payload, self.steps_known) if self.is_trusted else ()

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
            truth=None if self.truth is None else self.truth.since(first),
        )

    def determined(self, limits: UseLimits | None = None) -> dict[str, bool]:
        """For "payload" (with a tare only) and "trunk", whether the mass is known well enough to be of use. A bar may
        be honest and still say next to nothing: a robot that stands holds a load by the static friction of its drives
        as well as by their torques.
        """
        return (limits or UseLimits()).determined(self.robot, self.mass_std, self.payload)

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
        """Plain values for JSON: SI units, null for unobserved quantities; keys are only ever added.

        The trunk's centre of mass is in the trunk frame ("frame"), its inertia about that frame's origin
        ("inertia_about") in its axes, null at rest. The payload's centre of mass is in its own "frame", its inertia
        about that centre in that frame's axes: the trunk's, or that of the link "at" which it is; "places" are the
        probabilities of all places that were compared. The trunk is without a payload that is elsewhere. "joints" are
        rotor inertia, friction and offsets that the motion showed; with "links", which weighing leaves as they are,
        they are what `--legs` takes. In a result that cannot be trusted,
        every mass and centre of mass of trunk, payload and changes has "trusted": false. "determined" says whether
        masses are known well enough to be of use, "next" what to do where not.
        """
        mark = {} if self.is_trusted else {"trusted": False}
        trunk = self.trunk.to_dict(mark) | {"frame": self.robot.trunk, "inertia_about": "frame origin"}
        return {
            "robot": self.robot.name,
            "source": self.source,
            "method": self.method,
            "status": self.status,
            "trust": self.trust.to_dict(),
            "determined": self.determined(),
            "next": [step.to_dict() for step in self.next],
            "time": self.time,
            "trunk": trunk | ({"inertia": None} if self.torque_lag is None else {}),
            "payload": None if self.payload is None else self.payload.to_dict(self.robot.trunk, mark),
            "changes": [change.to_dict(mark) for change in self.changes],
            "timeline": self.timeline.to_dict(),
            "torque_lag": None if self.torque_lag is None else quantity(*self.torque_lag),
            "links": {},
            "joints": {} if self.drives is None else self.drives.to_dict(),
            "spikes": self.spikes,
            "impacts": self.impacts,
            "vertical": None if self.vertical is None else self.vertical.to_dict(),
            "refused": [asdict(refusal) for refusal in self.refusals],
            "notes": list(self.notes),
            "units": _UNITS,
        }

    def to_dataframe(self) -> Any:
        """The timeline as a pandas DataFrame: time [s], mass, mass_std [kg], com_x, com_x_std, ... [m], and
        payload_mass, payload_mass_std [kg] if the payload was tracked. Raises MissingExtraError: pandas is not
        installed.
        """
        return data_frame(self.timeline.columns)

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
