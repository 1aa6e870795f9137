"""Settings of the supervisors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from stadera.errors import StaderaError, UnknownNameError, require_positive
from stadera.supervise.load_test import LoadTestSettings
from stadera.supervise.offsets import OffsetSettings
from stadera.supervise.rest import RestLimits
from stadera.trunk.registry import METHODS


@dataclass(frozen=True)
class PosingSettings:
    """How a standing robot is led through poses: how many by each method, and times [s] to a pose, in it, and at the
    end until the trunk has come back.
    """

    poses: Mapping[str, int] = field(default_factory=lambda: {"poses": 5, "combined": 11})
    move: float = 0.8
    hold: float = 1.2
    back: float = 0.5


@dataclass(frozen=True)
class SuperviseSettings:
    """How changes of the load are detected and weighed, and when a weighing is given up.

    Attributes:
        method: of finding the centre of mass, a name of `stadera.trunk.registry.METHODS`.
        load_test, rest, offsets, posing: see there.
        correct_torques: estimate the torques' constant offsets on legs in the air, and subtract them before weighing.
        period: between two measurements that are used [s].
        stop_within: [s], after which a robot that has not come to stand is set down.
        mass_within, com_within: [s], in which the mass and the centre of mass have to converge.
        restarts: how often a weighing may begin anew because the load changes meanwhile.
        tilt: of the trunk, from which it is set down [rad].
        saturation: for how long a joint's torque may be at its limit before the load counts as too heavy [s].
        settling: that controller and trunk get to come to rest with a new model of the trunk [s].

    Raises:
        UnknownNameError: no such method.
        StaderaError: a limit that is not positive.
    """

    method: str = "contact"
    load_test: LoadTestSettings = field(default_factory=LoadTestSettings)
    rest: RestLimits = field(default_factory=RestLimits)
    offsets: OffsetSettings = field(default_factory=OffsetSettings)
    posing: PosingSettings = field(default_factory=PosingSettings)
    correct_torques: bool = True
    period: float = 0.004
    stop_within: float = 5.0
    mass_within: float = 6.0
    com_within: float = 15.0
    restarts: int = 3
    tilt: float = float(np.deg2rad(30.0))
    saturation: float = 0.5
    settling: float = 0.5

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise UnknownNameError("method", self.method, METHODS)
        times = ("period", "stop_within", "mass_within", "com_within", "tilt", "saturation", "settling")
        require_positive("supervision:", self, times)
        if self.restarts < 0:
            raise StaderaError(f"supervision: a weighing begins anew 0 times or more, got {self.restarts}")
