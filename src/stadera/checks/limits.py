"""Limits of the consistency checks."""

from dataclasses import dataclass, fields
from math import pi, radians

from stadera.errors import require_positive


@dataclass(frozen=True)
class CheckLimits:
    """Limits of the consistency checks.

    They are wide: clean logs of HyQ and Go2, with harsh sensor errors and loads up to 60 % of the robot, stay within
    them, while every fault injected in the tests exceeds them.
    """

    # lightest, heaviest: mean load on the feet as a share of the robot's mass
    lightest: float = 0.6
    heaviest: float = 2.2
    hanging: float = 0.15  # share of the robot's mass below which it is not on its feet
    limp: float = 0.2  # share of the torques that carry the legs alone: a G1 with motors off has 0.06, one that hangs 1
    # between the feet's forces and the accelerometer's vertical [rad]: sound walks of eight robots have up to 11°, as
    # their stance legs' friction always pulls backwards. IMUs turned by 8 to 14° are found by the fit, which sees the
    # motion too.
    force_angle: float = radians(15.0)
    # between the feet's plane and the accelerometer's vertical [rad]; includes a slope
    plane_angle: float = radians(30.0)
    pull: float = 0.08  # apparent pull of a leg at the ground, as a share of the weight
    # horizontal force of a foot as a share of its load; `sliding_floor`: plus this share of the weight
    sliding: float = 1.5
    sliding_floor: float = 0.1
    # distance of the centre of mass from the model's, as a share of half the diagonal between the feet: a load of 60 %
    # of a Go2 between its front hips shifts it by 0.3, one leg of four whose torques are zero by 0.33; it is below 0.1
    # in sound logs without a load, and up to 0.23 with one of 40 % near the front hips
    off_centre: float = 0.3
    outside: float = 0.1  # mean angle beyond a joint's limit [rad]
    unfelt: float = 1e-4  # det J of a leg, in its cubed length, below which its torques do not tell its foot's force
    rounds: int = 6  # of solving for the vertical without an IMU; each leaves a tenth of its error or less
    block: float = 0.25  # averaging time before tilts are compared [s]
    quiet: float = 1.0  # deviation of the specific force from gravity in a block whose tilt is used [m/s²]
    fewest_blocks: int = 4  # number of such blocks needed to compare tilts
    tilt: float = radians(1.5)  # of the IMU above which tilts are compared [rad]
    # unlike, like: similarity of the tilts of feet's plane and IMU below which they contradict each other, and above
    # which they agree after rotating or mirroring the plane
    unlike: float = 0.3
    like: float = 0.7
    gravity: float = 0.6  # deviation of the mean specific force from gravity [m/s²]
    stride: float = 0.5  # least duration over which the mean specific force of a trot is gravity [s]
    gravity_samples: int = 250  # over which specific forces are averaged: a quarter of a second to a second, a step
    # close, far: angles within which two verticals agree, and beyond which a third one is the one that is wrong [rad]
    close: float = radians(15.0)
    far: float = radians(25.0)
    stuck: float = 0.05  # time for which a value may repeat bit for bit in a signal that does not repeat elsewhere [s]
    # change of a joint's position [rad] below which a velocity or gyro of exactly zero is a rest; and its velocity's
    # integral, below which a position that stands is one
    rests: float = 0.005
    lively: float = 0.9  # share of steps with a change above which a signal counts as newly measured at each sample
    instant: float = 0.04  # over which signals are averaged and differentiated [s]; a step of a trot has five or more
    # least number of samples in an instant with slopes, which is twice as long at most: 50 Hz have them by any clock
    instant_samples: int = 3
    whole: float = 1.5  # multiple of the nominal length above which an instant contains a gap
    # number of successive instants, one second, within which nothing is thinned out, and that share a trunk
    second: int = 25
    fewest: int = 6  # instants needed to fit a second's trunk
    # precision of the prior of a second's trunk where torques of other legs are tried, in units of the robot's mass and
    # leg length
    loose: float = 0.01
    # instants, trial_instants, motion_instants: numbers to which a log is thinned out, and again for testing hypotheses
    # on averages and in motion
    instants: int = 1500
    trial_instants: int = 200
    motion_instants: int = 375
    orders: int = 4  # legs, or joints of a leg, of which all orders are tried; of more only exchanges of two
    much_better: float = 0.25  # largest share of the cost that remains under a confirmed hypothesis
    better: float = 0.75  # the same in motion, where rough steps and friction leave more
    # same, similar: differences in cost within which the simpler hypothesis is chosen, and within which both are named
    same: float = 0.02
    similar: float = 0.3
    slide: float = 0.03  # usual sliding speed of a loaded foot, in leg lengths per second: encoder noise, and rolling
    # the same above which feet at rest contradict a gyro; the noise of sound gyros adds a tenth of it
    still: float = 0.015
    # share of the weight above which a foot is certainly loaded, despite the torques of its swing
    carries: float = 0.15
    lively_motion: float = 3.0  # multiple of `slide` above which the robot moves
    unbalance: float = 0.05  # usual residual wrench, as a share of the weight
    # rotation of a trunk that moves, root mean square [rad/s]: ten walks of a real Mini Cheetah have 0.4 to 0.7, slow
    # sways 0.05. Feet that sink into soft ground do not tell a gyro of less from a gyro in other units.
    turns_least: float = 0.01
    lively_share: float = 0.3  # share of instants with motion above which the robot is not at rest
    # gain, gain_at_rest: decrease of an instant's cost (see `residual`) that confirms a hypothesis, in motion of the
    # part by feet that slide, or else with `order_gain`. In 160 clean logs of 14 robots, 1 to 10 s, no hypothesis gains
    # so much; at rest, where static friction of the drives counts, hips of the other sign gain up to 0.56 on logs of
    # sound robots (18 stands with drawn errors).
    gain: float = 0.08
    gain_at_rest: float = 1.0
    # of that gain from zero, in standard deviations, from the means of half seconds, since gains of neighbours are
    # correlated
    deviations: float = 2.5
    # plain_gain, plain_deviations: the same, from which on a hypothesis is right however much it leaves: feet slip and
    # friction turns with the motion in a trot. In 315 simulated logs of sound robots (13 robots, drawn errors) none
    # gains over 0.22, and none anything in 20 logs of a real Mini Cheetah and real Go2s; swapped legs and IMUs turned
    # about the vertical gain 0.24 to 1.6 in 21 simulated trots of 6 to 14 s. It names 15 of these, three times of it 5;
    # half of it accuses two of the 315.
    plain_gain: float = 0.4
    plain_deviations: float = 3.5
    alike: float = 0.9  # share of the largest gain above which another hypothesis is named with it
    # least number of instants to test the order of the legs' torques, and whether the IMU is late
    order_fewest: int = 50
    order_repeated: float = 2.5  # number of successive instants that share one model error: a tenth of a second
    # -2 log of the likelihood's ratio, to the recorded order and to all others that are possible, above which the
    # torques may be those of other legs or of another sign: 2 ln(23 / 0.001), one in a thousand with 23 orders
    order_gain: float = 20.0
    # residual of a row, share of the weight, up to which an order explains the motion. The right order leaves 0.6 to
    # 3.7 % on drawn robots that trot, crawl and sway, and 7 to 12 % on walks of a real Mini Cheetah, whose torques are
    # commands that lead the motion.
    order_fits: float = 0.05
    # the same with an unknown force from outside in every second, above which such a force is not mistaken for the
    # order, and `--fix` corrects it. Pushes of a swaying Go2 reach 60.
    order_certain: float = 150.0
    # the same for joints of limbs with the other sign, or in degrees. In 15 sound simulated logs of three robots, also
    # with 8 % of the limits more friction in all joints of arms, or 12 % in wrists, as a G1's have, the largest is 42.
    # Of 90 signs that are reversed in them half of it names 62, this 53, three times 39.
    limb_gain: float = 100.0
    # what remains of the limbs' torques, share of their limits, above which something is wrong with them. These sound
    # logs leave up to 0.029, with 12 % more friction in wrists 0.039, with 8 % in all joints 0.045; torques of a G1's
    # arms in another order 0.039 to 0.092, in degrees 0.08. Half of it doubts two of the 15, three times nothing.
    limb_fits: float = 0.05
    # number of instants, of 40 ms, by which the IMU may be late or early
    late_instants: int = 5
    # step_span, step_side: time before and after a possible step of a torque that is tested, most and least [s]
    step_span: float = 2.5
    step_side: float = 1.0
    step_every: float = 0.24  # time between tests [s]
    # z² of a step above which it is one, less 2 ln of the number of tests. Of 92 sound logs of nine robots, with drawn
    # errors and a load, two are beyond it, both of a B1 with an arm and the same errors, and one of 41 humanoids that
    # sway on a plant of its own; half of it accuses four more. Of 59 logs with a fault that shows as a step if instants
    # are as independent as `order_repeated` says, it names 46, and all but a Talos' of those whose bars do not contain
    # their errors, of which two are close to it; three times of it 25. It was set by these logs.
    step_gain: float = 12.0
    # correlation from instant to instant of what a step leaves, below which these share no error. Half of it names one
    # of these faults less, three times of it three more, and accuses one humanoid more.
    step_alone: float = 0.05
    step_slides: float = 0.1  # speed below which static friction may hold a joint [rad/s]
    # step_least, offset_least: least size of a step, and of an offset all the time, as a share of the torque's limit;
    # such offsets of clean trots and crawls seem to be up to 0.12
    step_least: float = 0.03
    offset_least: float = 0.15
    # share of a step's effect on the rows that no load and no other error explains, below which it is not seen
    step_seen: float = 0.02
    step_alike: float = 10.0  # difference in z² within which other joints are named with it
    step_alike_most: int = 3  # number of joints named above which it is no joint's own
    # share of instants with motion before and after; and in all, for a joint's sign: squats rest too long for it
    step_lively: float = 0.6
    # scatter of a joint's torque, share of its limit, above which its sign shows: twice Coulomb friction as assumed.
    # Joints whose sign is reversed scatter by 0.02 to 0.35 in walks, by 0.007 to 0.06 in sways. On a plant of its own,
    # of 96 sound logs and 95 with a reversed joint, half of it accuses 5 and names 67, this none and 44, three times
    # none and 13.
    sign_torque: float = 0.04
    # scatter of the rows, in % of the weight, above which they are too rough for the test: by legs that swing fast in
    # an instant, a sound crawl with 4 to 5 seems to have knees off by a third of their limit. Clean trots have 1 to
    # 6.5, real walks of a Mini Cheetah, whose torques are commands, 8 to 18.
    step_scatter: float = 3.0
    # force of two feet against each other as a share of their load that swapped torques would explain; push_left: share
    # of it that may remain once they are swapped. In clean logs it is below 0.05, in a real walk of a Go2 0.2.
    pushing: float = 0.25
    push_left: float = 0.25
    slow: float = 0.5  # step between samples above which time is not in seconds [s]
    steps: tuple[float, float] = (5e-5, 0.2)  # shortest and longest step between samples of a log [s]
    unlimited: float = 1.2 * pi  # range to both sides of a joint whose model states no limits [rad]
    # angle beyond the limits above which a position is in degrees, if it is within them once converted [rad]
    turns: float = 0.7
    # root mean square of velocities above which they are compared with slopes of positions [rad/s]
    turning: float = 0.2
    correlation: float = 0.5  # between velocities and slopes below which they do not belong to the same joint
    standing_torques: float = 0.8  # correlation of torques with those of a standing robot above which it is on its feet
    unit_tolerance: float = 0.3  # relative deviation of a ratio from that of two units
    # bare, loaded: share of a model's mass by which a robot may be lighter or heavier: batteries, cameras, a model of
    # another version, torques with an error in common; and in which it may be with a load, for which quadrupeds are
    # built up to a half of their mass
    bare: float = 0.2
    loaded: float = 1.6

    def __post_init__(self) -> None:
        numbers = [field.name for field in fields(self) if field.name != "steps"]
        require_positive("check limit", self, numbers)


@dataclass(frozen=True)
class WindowLimits:
    """Limits of the checks over windows, wide enough for the noise, lags and quantisation of real logs."""

    length: float = 1.0  # of a window [s]
    fewest: int = 20  # least number of samples in a window
    most: int = 20  # steps of one joint that are examined
    at_once: int = 3  # joints examined at a time, which bounds the memory
    step: float = 0.02  # time over which velocity and change of position are compared [s]
    # speed of a joint above which they are compared [rad/s], at least `above` times the noise of a joint at rest
    moving: float = 0.1
    above: float = 5.0
    still: float = 0.2  # share of the other's magnitude below which one of the two stands still
    # least correlation of the two. Velocities that are 20 ms late keep 0.95 at a trot of 2 Hz.
    correlation: float = 0.7
    gain: tuple[float, float] = (0.7, 1.4)  # least and largest gain between the two
    # multiple of the usual difference between the two above which a sample is an outlier; few: share of outliers
    spike: float = 10.0
    few: float = 0.05
    # step of a position beyond the velocity [rad]; undone: samples within which the end of a spike reverses it
    jump: float = 0.03
    undone: int = 8
    together: int = 3  # joints of several legs that jump within so many samples only where samples are missing
    # number of samples that may be lost or late without a gap in the stamps, during which a joint moves on; a real Mini
    # Cheetah's log loses up to five
    late: float = 5.0
    kept: float = 0.7  # share of the step that must remain then
    # multiple of a drive's limit above which a torque is impossible; models often state a third of the true limit
    beyond: float = 4.0
    # the same of a few samples, which also exceed the joint's `most_usual` quantile so many times
    apart: float = 2.0
    most_usual: float = 0.98
    weights: float = 3.0  # torque that no drive gives, in robot weights times leg length
    # relative tolerance within which the largest torque is the drive's own limit, which is not a fault
    own_limit: float = 0.02
    # number of samples at the largest torque that is no coincidence, at least `crowd` times the number at the next
    repeats: int = 5
    crowd: float = 5.0
    lively: float = 0.9  # share of steps with a change above which a signal counts as newly measured at each sample
    # times over which torques are averaged before they are compared with noise [s], the longest last. The ankle's roll
    # of a G1 that sways has a correlation of 0 to 0.2 from sample to sample at 500 Hz, for its noise is louder, and
    # from 0.24 on in means of 20 ms; a hip of an A1 that trots 0.1 in these, which are a tenth of its steps.
    averaged: tuple[float, ...] = (0.005, 0.02)
    # white, coloured: correlation of a torque that is only noise, from mean to mean, and of the other torques
    white: float = 0.2
    coloured: float = 0.7
    holds: float = 4.0  # standard deviations of a window's mean torque above which the joint holds something
    as_noisy: float = 1.5  # ratio within which a sensor's noise is what it is at other times, up or down
    left_out: float = 0.3  # largest share of the log that may be excluded because of faults in part of it
