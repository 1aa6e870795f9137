"""What to do next where a mass is not determined, or known to more than a few percent, and the error bars to expect.

Bars are computed for this robot and load: those of a sway and of steps by the estimator on a made log of a robot whose
errors are drawn (`stadera.excite.trunk.planted`), those of a known weight or of a memory by this log's own information
and that weight, or that of more such logs (`stadera.trunk.outside`).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import hypot, inf, isfinite
from typing import Any

from stadera.errors import StaderaError
from stadera.results import finite_or_none
from stadera.robot.model import Robot
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.load import SIGNIFICANT, Payload
from stadera.trunk.protocol import Weigher
from stadera.trunk.result import ObservedLimits, TrunkParameters
from stadera.weigh.settings import weight_std


@dataclass(frozen=True)
class UseLimits:
    """When a mass is determined, and when it could be known better."""

    share: float = 0.25  # largest standard deviation of a payload that is determined, as a share of its own mass [1]
    # payload, trunk: one that is always small enough, as a share of the robot's mass [1]
    payload: float = 0.02
    trunk: float = 0.1
    fine: float = 0.05  # one above which a load that is determined is worth more effort, as a share of its own mass [1]
    gained: float = 2 / 3  # largest bar to expect of a step worth its effort, as a share of the present one [1]
    test_weight: float = 0.1  # mass of a test weight, as a share of the robot's [1]
    remembered: int = 3  # earlier logs like this one, of a memory that is offered [1]

    def determined(self, robot: Robot, trunk_std: float, payload: Payload | None) -> dict[str, bool]:
        """For "trunk" and, with a tare, "payload", whether the mass is known well enough to be of use."""
        found = {"trunk": trunk_std <= self.trunk * robot.mass}
        if payload is not None:
            found["payload"] = payload.mass_std <= max(self.share * abs(payload.mass), self.payload * robot.mass)
        return found


@dataclass(frozen=True)
class NextStep:
    """What to do, and the standard deviations of payload and trunk [kg] to expect from it; infinite if not known."""

    do: str
    payload_std: float = inf
    trunk_std: float = inf

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "do": self.do,
            "then": {"payload_std": finite_or_none(self.payload_std), "trunk_std": finite_or_none(self.trunk_std)},
        }


def steps_known(robot: Robot, estimator: Weigher, limits: UseLimits | None = None) -> tuple[NextStep, ...]:
    """A scale, a test weight and a memory, whose bars the estimator's own information tells; nothing if the payload's
    bar, or without a tare the trunk's, is narrow.
    """
    limits = limits or UseLimits()
    if not isinstance(estimator, TrunkEstimator) or _narrow(robot, estimator.trunk, estimator.payload, limits):
        return ()
    tared = estimator.payload is not None
    scale = f"put the robot{' as it was at the tare' * tared} on a scale and weigh with --weight"
    again = f"weigh {limits.remembered} logs like this one, and then this load, with the same --memory"
    found = [NextStep(scale, *estimator.bars_on_scale(weight_std(robot.mass)))]
    if tared:
        weight = limits.test_weight * robot.mass
        known = (
            f"put a known weight of {weight:.2g} kg on after the tare, in a log that moves like this one, weigh it "
            "with --known and --memory, and then this load with the same memory"
        )
        found.append(NextStep(known, *estimator.bars_calibrated(weight)))
    return (*found, NextStep(again, *estimator.bars_remembered(limits.remembered)))


def next_steps(
    robot: Robot,
    trunk: TrunkParameters,
    payload: Payload | None,
    known: tuple[NextStep, ...] = (),
    limits: UseLimits | None = None,
) -> tuple[NextStep, ...]:
    """What makes the payload's bar narrower, or without a tare the trunk's, the best first; nothing if it is narrow.
    Motions are added to the `known` steps, whose bars an estimator computes on made logs, within seconds. A mass that
    was not observed has to be so by a step.
    """
    limits = limits or UseLimits()
    if _narrow(robot, trunk, payload, limits):
        return ()
    found = (*known, *(() if payload is None else _moves(robot, payload, limits)))

    def bar(step: NextStep) -> float:
        return step.trunk_std if payload is None else step.payload_std

    std = trunk.mass_std if payload is None else payload.mass_std
    most = limits.gained * std if isfinite(std) else ObservedLimits().mass * robot.mass
    return tuple(sorted((step for step in found if bar(step) < most), key=bar))


def _narrow(robot: Robot, trunk: TrunkParameters, payload: Payload | None, limits: UseLimits) -> bool:
    """Whether the bar that counts is too narrow for a step to be worth its effort."""
    mass, std = (trunk.inertial.mass, trunk.mass_std) if payload is None else (abs(payload.mass), payload.mass_std)
    enough = limits.determined(robot, trunk.mass_std, payload)["trunk" if payload is None else "payload"]
    return enough and (std <= limits.fine * mass or mass < SIGNIFICANT * std)


def _moves(robot: Robot, payload: Payload, limits: UseLimits) -> Iterator[NextStep]:
    """Five seconds of sway, and ten steps, without and with the load."""
    from stadera.excite.trunk.design import bars_of_steps, undesigned_bars

    best = f"best by `stadera excite --robot {robot.argument} --trunk`"
    load = round(max(abs(payload.mass), limits.fine * robot.mass) / robot.mass, 2)
    for do, bars_of in (
        (f"let the trunk sway for 5 s without and with the load, {best}", undesigned_bars),
        ("let it take ten slow steps without and with the load", bars_of_steps),
    ):
        try:
            bars = bars_of(robot, load)
        except StaderaError:
            continue
        if bars is not None:
            yield NextStep(do, hypot(bars.mass, bars.scale * payload.mass))
