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
        samples: to which signals are thinned out, where instants are not needed.
        instant: over which signals are averaged and differentiated [s]; a trot's steps last five or more.
        instants, trial_instants: to which a log is thinned out, and once more for trying fault hypotheses on averages.
        much_better: share of the cost that may be left where a hypothesis is confirmed.
        same, similar: differences of cost within which the simpler hypothesis counts, and within which both are named.
        slide: usual speed of a foot that carries, in lengths of the leg a second: encoder noise, and rolling.
        carries: share of the weight above which a foot carries for certain, whatever its swing takes.
        lively_motion: times `slide` above which the robot moves.
        unbalance: usual wrench that is left over, as a share of the weight.
        lively_share: of the instants in which the robot moves, above which it is not at rest.
        gain, gain_at_rest: by which a hypothesis lowers the cost of an instant (see `motion`) to be confirmed. In clean
            logs of eight robots in motion none gains more than 0.05, and 0.2 at rest, where constant errors count.
        deviations: of that gain from zero.
        alike: share of the largest gain from which another hypothesis is named with it.
        slow: step between samples from which time is not in seconds [s].
        turns: angle beyond the limits from which a position is in degrees, if it is within them once converted [rad].
        turning: root mean square of velocities above which they are compared with slopes of positions [rad/s].
        correlation: of velocities and slopes below which they are not each other's.
        standing_torques: correlation of torques with those of a robot on its feet, above which it is on its feet.
        unit_tolerance: of a ratio from that of two units, as a share.
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
    instant: float = 0.04
    instants: int = 1500
    trial_instants: int = 200
    much_better: float = 0.25
    same: float = 0.02
    similar: float = 0.3
    slide: float = 0.03
    carries: float = 0.15
    lively_motion: float = 3.0
    unbalance: float = 0.05
    lively_share: float = 0.3
    gain: float = 0.08
    gain_at_rest: float = 0.3
    deviations: float = 2.5
    alike: float = 0.9
    slow: float = 0.5
    turns: float = 0.7
    turning: float = 0.2
    correlation: float = 0.5
    standing_torques: float = 0.8
    unit_tolerance: float = 0.3

    def __post_init__(self) -> None:
        require_positive("check limit", self, [field.name for field in fields(self)])


@dataclass(frozen=True)
class WindowLimits:
    """Limits of the checks over windows, wide enough for the noise, lags and quantisation of real logs.

    Attributes:
        length: of a window [s]. fewest: samples that a window needs.
        step: over which velocity and change of position are compared [s].
        moving: speed of a joint from which they are [rad/s], and `above` times what noise makes of a joint at rest.
        still: share of the other's size below which one of the two stands still.
        correlation: of the two, at least. Velocities that are 20 ms late keep 0.95 at a trot of 2 Hz.
        gain: of the two, least and largest.
        spike: times the usual difference of the two, from which a sample is a wild one; few: share of such samples.
        jump: step of a position beyond the velocity [rad]; undone: samples within which the end of a spike undoes it.
        kept: share of the step that must still be there then.
        beyond: share of a drive's limit above which a torque is none; models often state a third of what drives give.
        weights: torque that no drive gives, in weights of the robot at the length of a leg.
        own_limit: share within which the largest torque is the drive's own limit, which is no fault.
        repeats: samples at the largest torque that are no coincidence, and `crowd` times those at the next smaller.
        lively: share of steps at which a signal changes that is measured anew each time.
        white, coloured: correlation from sample to sample of a torque that is only noise, and of the other torques.
        raised: height of a foot above its lowest that a swinging one has, as a share of the leg's length, and its speed
            against the standing feet [m/s].
        carries: share of the weight that a raised foot must seem to carry, and of what it carries when it is low.
        share: of a window that samples of raised and of low feet need each; often: of such windows that show the fault.
        slip: relative speed of standing feet beyond which they slip [m/s].
        repeated: samples at 100 Hz that repeat one error. evidence: χ² from which another gyro is the right one.
        better: share of the feet's relative motion that may be left where they turn less than the gyro says.
        left_out: share of the log that may be left out for faults in part of it.
    """

    length: float = 1.0
    fewest: int = 20
    step: float = 0.02
    moving: float = 0.1
    above: float = 5.0
    still: float = 0.2
    correlation: float = 0.7
    gain: tuple[float, float] = (0.7, 1.4)
    spike: float = 10.0
    few: float = 0.05
    jump: float = 0.03
    undone: int = 8
    kept: float = 0.7
    beyond: float = 4.0
    weights: float = 3.0
    own_limit: float = 0.02
    repeats: int = 5
    crowd: float = 5.0
    lively: float = 0.9
    white: float = 0.2
    coloured: float = 0.7
    raised: tuple[float, float] = (0.03, 0.15)
    carries: tuple[float, float] = (0.15, 1.5)
    share: float = 0.1
    often: float = 0.5
    slip: float = 0.3
    repeated: float = 10.0
    evidence: float = 20.0
    better: float = 0.4
    left_out: float = 0.3
