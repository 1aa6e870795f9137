"""How a supervisor goes about it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stadera.errors import StaderaError, UnknownNameError, require_positive
from stadera.estimate.registry import METHODS
from stadera.supervise.load_test import LoadTestSettings
from stadera.supervise.rest import RestLimits


@dataclass(frozen=True)
class SuperviseSettings:
    """How to notice, how to weigh, and when to give up.

    Attributes:
        method: of finding the centre of mass, a name of `stadera.estimate.registry.METHODS`.
        load_test, rest: see there.
        zero_torques: learn the torques' constant offsets from legs in the air, and take them off before weighing.
        period: between two measurements that are looked at [s].
        stop_within: [s], after which a robot that has not come to stand is set down.
        mass_within, com_within: [s], in which the mass and the centre of mass have to converge.
        restarts: how often a weighing may begin anew because the load changes meanwhile.
        tilt: of the trunk, from which it is set down [rad].
        saturation: for how long a joint's torque may be at its limit before the load counts as too heavy [s].

    Raises:
        UnknownNameError: no such method.
        StaderaError: a limit that is not positive.
    """

    method: str = "contact"
    load_test: LoadTestSettings = field(default_factory=LoadTestSettings)
    rest: RestLimits = field(default_factory=RestLimits)
    zero_torques: bool = True
    period: float = 0.004
    stop_within: float = 5.0
    mass_within: float = 6.0
    com_within: float = 15.0
    restarts: int = 3
    tilt: float = float(np.deg2rad(30.0))
    saturation: float = 0.5

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise UnknownNameError("method", self.method, METHODS)
        require_positive(
            "supervision:", self, ("period", "stop_within", "mass_within", "com_within", "tilt", "saturation")
        )
        if self.restarts < 0:
            raise StaderaError(f"supervision: a weighing begins anew 0 times or more, got {self.restarts}")
