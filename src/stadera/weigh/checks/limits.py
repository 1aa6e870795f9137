"""When a log contradicts itself."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import radians

from stadera.errors import require_positive


@dataclass(frozen=True)
class CheckLimits:
    """Limits of the consistency checks.

    They are wide: clean logs of HyQ and Go2, with harsh sensor errors and loads up to 60 % of the robot, stay inside,
    and every fault that the tests make is outside.

    Attributes:
        lightest, heaviest: share of the robot's mass that the feet may carry on average.
        hanging: share of it below which the robot is not on its feet.
        force_angle: between the feet's forces and the accelerometer's vertical [rad].
        plane_angle: between the feet's plane and the accelerometer's vertical [rad]; a slope is part of it.
        pull: share of the weight with which a leg may seem to pull at the ground.
        sliding: sideways force of a foot as a share of its load, `sliding_floor`: plus this share of the weight.
        off_centre: of the centre of mass from the model's, as a share of half the diagonal between the feet.
        outside: mean angle beyond a joint's limit [rad].
        block: over which is averaged before tilts are compared [s].
        quiet: deviation of the specific force from gravity in a block whose tilt counts [m/s²].
        fewest_blocks: such blocks that a comparison of tilts needs.
        tilt: of the IMU from which tilts are compared [rad].
        unlike, like: similarity of the tilts of feet's plane and IMU that is too little, and that is enough if the
            plane is turned or mirrored.
        gravity: of the mean specific force from gravity [m/s²].
        upright: between orientation and accelerometer on where up is [rad].
        stuck: time for which a value may repeat bit for bit in a signal that elsewhere does not [s].
        lively: share of its steps at which a signal changes that is measured anew each time.
        samples, trial_samples: to which a log is thinned out, and once more for trying fault hypotheses.
        much_better: share of the cost that may be left where a hypothesis is confirmed.
        same, similar: differences of cost within which the simpler hypothesis counts, and within which both are named.
    """

    lightest: float = 0.6
    heaviest: float = 2.2
    hanging: float = 0.15
    force_angle: float = radians(10.0)
    plane_angle: float = radians(30.0)
    pull: float = 0.08
    sliding: float = 1.5
    sliding_floor: float = 0.1
    off_centre: float = 0.35
    outside: float = 0.1
    block: float = 0.25
    quiet: float = 1.0
    fewest_blocks: int = 4
    tilt: float = radians(1.5)
    unlike: float = 0.3
    like: float = 0.7
    gravity: float = 0.6
    upright: float = radians(10.0)
    stuck: float = 0.05
    lively: float = 0.9
    samples: int = 4000
    trial_samples: int = 200
    much_better: float = 0.25
    same: float = 0.02
    similar: float = 0.3

    def __post_init__(self) -> None:
        require_positive("check limit", self, [field.name for field in fields(self)])
