"""Settings of a simulated run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from stadera.errors import StaderaError, UnknownNameError, positive
from stadera.lab.plant import OutsideForce, SensorErrors, sensor_errors
from stadera.lab.plant.payload import Payload, RigidMass, VirtualForce
from stadera.lab.plant.whole import on_link
from stadera.lab.reality import REAL_SETS, RealSizes
from stadera.lab.sensor_errors import ERROR_SETS
from stadera.logs.recording import Recording
from stadera.robot.model import Robot
from stadera.trunk.model import TrunkBounds


@dataclass(frozen=True)
class Load:
    """A load on the trunk, or on another link."""

    amount: float  # positive
    # "kg" for a rigid cube of 10 cm fixed to the trunk; "N" for the paper's virtual force, without inertia
    unit: Literal["kg", "N"] = "kg"
    # [m], of its centre in the frame of what it is on; None for that frame's origin, on the trunk for a quarter of the
    # feet's rectangle behind and to the left of the middle, at the height of the hips
    at: tuple[float, float, float] | None = None
    on: str | None = None  # link or frame of the model; None for the trunk

    def __post_init__(self) -> None:
        positive("a load", self.amount, self.unit)
        if self.unit not in ("kg", "N"):
            raise StaderaError(f"a load is in kg or N, got {self.unit!r}")
        if self.at is not None and not np.isfinite(self.at).all():
            raise StaderaError(f"a load's place must be three finite numbers, got {self.at}")
        if self.on is not None and self.unit == "N":
            raise StaderaError("a virtual force is on the trunk; a load on a link is in kg")

    def payload(self, robot: Robot) -> Payload:
        """Converts it to a payload of the test-bed."""
        size = (0.1, 0.1, 0.1)
        if self.on is not None:
            link, rotation, origin = on_link(robot, self.on)
            x, y, z = (rotation @ np.asarray(self.at or (0.0, 0.0, 0.0)) + origin).tolist()
            return RigidMass.box(self.amount, size, (x, y, z), link if link != robot.trunk else None)
        at = self.at or _behind(robot)
        return VirtualForce(self.amount, at) if self.unit == "N" else RigidMass.box(self.amount, size, at)


@dataclass(frozen=True)
class SimulateSettings:
    """Settings of a run."""

    # ideal, standard or harsh, of the sensors; or real, real-unit-gain, real-varying: of robot, sensors and ground
    errors: str = "standard"
    load: Load | None = None  # None for the scenario's own
    slope: float | None = None  # of the ground [rad]; None for the scenario's own, or with real errors the drawn one
    duration: float | None = None  # [s]; None for the scenario's own
    # of the log [Hz]; the test-bed itself runs at 1 kHz, and the log keeps every n-th sample. None for 250 Hz, or with
    # real errors the drawn one.
    rate: float | None = None
    seed: int = 0  # of all sensor errors
    load_time: float | None = None  # [s], at which the load is added; None for the scenario's own
    speed: float | None = None  # of a walk, forwards [m/s]; None for the scenario's own
    turn: float = 0.0  # of a walk, to the left [rad/s]
    amplitude: float = 1.0  # of a shake, times 3° and 3 % of the robot's height
    stones: float = 0.0  # [m], largest deviation of the stepping stones' heights; 0 for a plane
    hold: int = 1  # periods of the test-bed for which the controller's torques are held, see `TestBed`
    outside: OutsideForce | None = None  # an external force other than a load; None for none
    arms: float = 0.0  # amplitude with which joints outside the legs swing [rad]
    motion: Recording | None = None  # a table of joint positions, of the scenario "motion"

    def __post_init__(self) -> None:
        if self.errors.lower() not in (*ERROR_SETS, *REAL_SETS):
            raise UnknownNameError("set of errors", self.errors, (*ERROR_SETS, *REAL_SETS))
        every = 1.0 if self.rate is None else 1000.0 / self.rate if np.isfinite(self.rate) and self.rate > 0 else 0.0
        if every < 1 or abs(every - round(every)) > 1e-9:
            raise StaderaError(
                f"a log's rate must be 1000 Hz over a whole number (1000, 500, 250, ...), got {self.rate}"
            )
        if self.duration == 0.0:
            raise StaderaError("a run's duration must be positive, got 0.0 s")
        _require(0.0, duration=self.duration, seed=self.seed, load_time=self.load_time, stones=self.stones)
        _require(-np.inf, speed=self.speed, turn=self.turn, amplitude=self.amplitude, arms=self.arms)

    @property
    def sensor_errors(self) -> SensorErrors:
        """Errors of the controller's sensors; with real errors it has separate sensors of `standard` quality."""
        return sensor_errors("standard" if self.real_sizes else self.errors)

    @property
    def real_sizes(self) -> RealSizes | None:
        """Sizes from which real errors are drawn; None for errors of another kind."""
        return REAL_SETS.get(self.errors.lower())

    @property
    def every(self) -> int:
        """Periods of the test-bed per sample of the log."""
        return round(1000.0 / (self.rate or 250.0))


def _require(least: float, **values: float | None) -> None:
    """Checks that given values are finite, and at least `least`."""
    for name, value in values.items():
        if value is not None and not (np.isfinite(value) and value >= least):
            wanted = "finite" if least == -np.inf else f"finite and at least {least:g}"
            raise StaderaError(f"a run's {name} must be {wanted}, got {value}")


def _behind(robot: Robot) -> tuple[float, float, float]:
    bounds = TrunkBounds.of(robot)
    middle, half = 0.5 * (bounds.low + bounds.high), 0.5 * (bounds.high - bounds.low)
    return float(middle[0] - 0.5 * half[0]), float(middle[1] + 0.5 * half[1]), float(middle[2])
