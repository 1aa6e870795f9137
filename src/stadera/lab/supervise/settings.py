"""Settings of the supervisors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from stadera.errors import StaderaError, UnknownNameError, require_positive
from stadera.lab.supervise.load_test import LoadTestSettings
from stadera.lab.supervise.offsets import OffsetSettings
from stadera.lab.supervise.rest import RestLimits
from stadera.trunk.registry import METHODS


@dataclass(frozen=True)
class PosingSettings:
    """Settings for leading a standing robot through poses."""

    poses: Mapping[str, int] = field(default_factory=lambda: {"poses": 5, "combined": 11})  # number for each method
    move: float = 0.8  # time to move to a pose [s]
    hold: float = 1.2  # time to hold it [s]
    back: float = 0.5  # time to return at the end [s]


@dataclass(frozen=True)
class SuperviseSettings:
    """Settings for detecting and weighing changes of the load, and limits for giving up; all positive."""

    method: str = "contact"  # for the centre of mass, a name of `stadera.trunk.registry.METHODS`
    load_test: LoadTestSettings = field(default_factory=LoadTestSettings)
    rest: RestLimits = field(default_factory=RestLimits)
    offsets: OffsetSettings = field(default_factory=OffsetSettings)
    posing: PosingSettings = field(default_factory=PosingSettings)
    # estimate the torques' constant offsets on legs in the air, and subtract them before weighing
    correct_torques: bool = True
    period: float = 0.004  # interval between measurements used [s]
    stop_within: float = 5.0  # time after which a robot that has not stopped is set down [s]
    mass_within: float = 6.0  # time allowed for the mass to converge [s]
    com_within: float = 15.0  # the same for the centre of mass [s]
    restarts: int = 3  # number of times a weighing may restart because the load changes
    tilt: float = float(np.deg2rad(30.0))  # of the trunk above which it is set down [rad]
    saturation: float = 0.5  # time at the torque limit of a joint after which the load counts as too heavy [s]
    settling: float = 0.5  # time for controller and trunk to settle with a new model of the trunk [s]

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise UnknownNameError("method", self.method, METHODS)
        times = ("period", "stop_within", "mass_within", "com_within", "tilt", "saturation", "settling")
        require_positive("supervision:", self, times)
        if self.restarts < 0:
            raise StaderaError(f"supervision: a weighing begins anew 0 times or more, got {self.restarts}")
