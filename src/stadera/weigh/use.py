"""Whether a weighing is of use, apart from trust: what is determined, and what to do where it is not.

A bar may be honest and still say next to nothing: a robot that stands holds a load by the static friction of its
drives as well as by their torques.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import TYPE_CHECKING, Any

from stadera.trunk.settings import ModelErrors

if TYPE_CHECKING:
    from stadera.weigh.result import Weighing


@dataclass(frozen=True)
class UseLimits:
    """When a mass is determined.

    Attributes:
        share: largest standard deviation, as a share of the payload's own mass [1].
        payload, trunk: one that is always small enough, as a share of the robot's mass [1].
        swayed: standard deviation of a payload, as a share of the robot's mass, after five seconds of sway without and
            with it: median of 12 drawn robots whose drives have friction up to 3 % of their limits.
    """

    share: float = 0.25
    payload: float = 0.02
    trunk: float = 0.1
    swayed: float = 0.009


@dataclass(frozen=True)
class NextStep:
    """What to do, and the payload's standard deviation [kg] to expect from it."""

    do: str
    payload_std: float

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {"do": self.do, "then": {"payload_std": self.payload_std}}


def determined(result: Weighing, limits: UseLimits | None = None) -> dict[str, bool]:
    """For "payload" (with a tare only) and "trunk", whether the mass is known well enough to be of use."""
    limits, robot = limits or UseLimits(), result.robot.mass
    found = {"trunk": result.mass_std <= limits.trunk * robot}
    if (payload := result.payload) is not None:
        found["payload"] = payload.mass_std <= max(limits.share * abs(payload.mass), limits.payload * robot)
    return found


def next_steps(result: Weighing, limits: UseLimits | None = None) -> tuple[NextStep, ...]:
    """What would determine the payload; nothing if it is determined, or if there is no tare."""
    limits = limits or UseLimits()
    if result.payload is None or determined(result, limits)["payload"]:
        return ()
    std = hypot(limits.swayed * result.robot.mass, ModelErrors().common_gain * result.payload.mass)
    do = "let the trunk sway by 3° for 5 s without and with the load, or walk ten steps: friction holds what stands"
    return (NextStep(do, std),) if std < result.payload.mass_std else ()
