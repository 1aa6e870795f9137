"""Settings of the estimator of the trunk, each with its unit and its source."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf

from stadera.errors import ModelError, StaderaError, require_positive


def _positive(settings: ChangeSettings | OutlierSettings | SwingDetection | TrunkSettings, *or_zero: str) -> None:
    """Raises StaderaError where a number is not finite and above zero; those named may be zero."""
    numbers = [name for name, value in vars(settings).items() if isinstance(value, int | float)]
    require_positive(type(settings).__name__, settings, numbers, or_zero)


@dataclass(frozen=True)
class ModelErrors:
    """Prior standard deviations of the differences between real robots and their models.

    They describe robots in general, not one log, which scales the kinds that it shows (see `stadera.trunk.sizes`).
    Torques are given as shares of the joint's effort limit.

    Attributes:
        rotor: rotor inertia, as a share of the leg's mass times squared length [1]. Assumed; identified on the real Go2
            calf: of the order of 0.01 kg·m².
        viscous: viscous friction, share of the effort limit per rad/s [s/rad]. Assumed.
        coulomb: Coulomb friction [1]. Identified on a real Go2: 0.55 to 1.24 N·m on calves of 45 N·m, 1.2 to 2.8 %.
        offset: constant torque error [1]. `identify` on the logs of real legs in the air that come with the package
            gives root mean squares of 0.33 % (Go2) and 0.41 % (Aliengo), their own uncertainty of 0.3 % included.
        gain: scale of each joint's torque [1]: tolerances of motor and gear. Assumed: of no legged robot was a measured
            one found.
        common_gain: scale of all torques together [1]. It cannot be separated from weight. Assumed, as `gain`.
        encoder: zero of each joint's encoder [rad]; calibration by end stops is good to about half a degree. Of a
            quadruped whose foot tips were up to 14 mm off, calibrated zeros left 2.3 mm (Zhao et al., Accurate joint
            offset calibration for quadrupedal robots, ROBIO 2022): half a degree at three joints makes 5 mm.
        contact: position of each foot's contact point, each component [m]: those 2.3 mm, and a rubber ball that rolls
            and yields.
        link_mass: of each leg link [1]. link_com: of its centre of mass, each component [m]. Cables, screws and
            grease, which CAD lacks; assumed.
        imu_lever: position of the IMU, each component [m]. imu_rotation: of its axes, each component [rad]. Assumed: a
            board in a housing, whose place model files state to a centimetre.
        accelerometer: constant error along the trunk's x and y axes [m/s²], where it acts as a turn of the IMU does, of
            which `imu_rotation` has twice as much. Assumed for a MEMS sensor that was calibrated at rest and has warmed
            up by 20 K since: 0.25 mg/K, as is quoted of Bosch's BMI270 (second hand; the data sheet was not read).
        accelerometer_vertical: along its z axis [m/s²], which acts on the trunk's mass like a gain of 1 %. At rest
            real Go2s of two laboratories read 9.48 to 9.56 m/s², 0.3 less than gravity, a real G1 9.82 and 9.84.
            With 0.05, 0.1 and 0.15 bars of trunks of a real Mini Cheetah are 9.6, 9.7 and 9.8 % (medians).
        gravity: deviation of the mean specific force of a robot at rest from gravity, without that error [m/s²]: 9.78
            to 9.83 on Earth, and 0.015 from stand to stand of the Go2.
        settles: vertical velocity of its trunk at the beginning and the end of a rest [m/s]. Assumed. Half and three
            times either move a real Go2's trunk by up to 0.25 of 9.9 kg.
        imu_response: share of the changes of the specific force, each axis, that the torques do not follow [1]:
            vibration, touchdowns between two samples, an accelerometer's filter, torques that are commands. 0.3 to 0.9
            on five walks of a real Mini Cheetah; of a robot whose IMU is good it is estimated to be next to nothing.
        torque_lag: delay of the torques relative to encoders and IMU [s]. Real Go2 and Aliengo: 10 to 15 ms, as
            commands act, which is a delay below zero.
        velocity_lag: delay of the joint velocities [s].
        friction_drift: of joints with identified legs, change of viscous and Coulomb friction from log to log, share of
            their values [1]. Friction of a gear changes with temperature: Bittencourt and Gunnarsson, Static friction
            in a robot joint, J. Dyn. Syst. Meas. Control 134 (2012) 051013. Its size is assumed.
        offset_drift: likewise of the torque's offset, share of the effort limit [1]. A laboratory's torque transducer
            (HBK T10F) states 0.05 % of its range per 10 K; strain gauges in a joint that warms up by 20 K are taken to
            be twice as bad.
        rotor_drift: likewise of rotor inertia, share of its value [1]: it is constant, but takes up errors of the link.
        drift: change of a torque's offset within a log, from one load to the next, share of the effort limit [1]. From
            half to half of 24 s, without a load, it is 0.038 % on the real Go2 and 0.021 % on the real Aliengo, root
            mean squares, and from quarter to quarter, 6 and 18 s apart, 0.028 and 0.059 %, 0.014 and 0.029 %: it grows
            at least with the square root of the time. Loaded drives warm up more.
        surest: least standard deviation of these terms of an identified joint, share of an unidentified one's [1]: the
            floor rises with `gears`, so friction that is assumed larger makes no joint better known.
        alike: correlation of rotor inertia and friction between the legs' joints of one kind [1], which have drives of
            one type.
        alike_loaded: the same of friction by load [1]. With 0, 0.35, 0.7 trunks of seven logs of a real Go2 spread by
            0.41, 0.57, 0.66 kg, those of ten walks of a real Mini Cheetah by 0.20, 0.21, 0.22 kg; changes of the load
            in fourteen of another Go2, which wires and hands catch, are 3, 3, 5; payloads of 57 simulated trots are
            0.59, 0.56, 0.56 % of the robot off (rms).
        load_friction: friction as a share of the torque that a joint carries [1], in addition to Coulomb friction.
            Planetary gears lose about 3 % a stage, harmonic drives 10 to 20 %; on real walks of a Mini Cheetah and legs
            of a Go2 friction that grows with the torque leaves half to three quarters of the knees' residual.
        friction_law: share of a payload's correction for friction that friction's law does not explain [1]: friction
            varies with position and temperature, and the direction of a joint that slides slowly is lost in noise. On
            24 joints of a real Go2 and Aliengo in the air the residual is 0.09 to 0.42 of Coulomb friction. With 0,
            0.15, 0.3, 0.5, 0.9 masses on 36 simulated logs are at most 6.5, 4.6, 2.9, 1.9, 1.4 standard deviations off,
            and these are 0.58, 0.62, 0.66, 0.69, 0.89 % of the robot in the median.
        held: static friction, as a share of the joint's friction [1], which bounds it: a robot that sags as it is
            loaded comes to rest with friction at its bound. The same of joints that rest in each stance: abduction
            joints of a trot stand still for two thirds of the time. Without it masses of a real Mini Cheetah's walks
            spread by 3.1 % instead of 2.4, and simulated trots' trunks are wrong by 3.9 % instead of 3.1 (rms).
        sagging: correlation of static friction between joints of one kind [1]: in a robot that sags under a load,
            friction holds all knees alike.
        renewed: correlation of static friction under two loads, of a robot that walks [1]: each step makes it anew, in
            the same way. Of one that stands or sways it may hide a load, and is another. Assumed: half of it, as no
            measured one was found. Of loads on 27 simulated crawls 63, 67, 70, 85, 100 % are noticed with 0, 0.5, 0.75,
            0.9, 1; places of payloads are at most 1.9, 1.9, 2.3, 4.2, 6.2 standard deviations off.
        rests: the same of a joint that has slid both ways under a load, in which each rest has another friction: the
            deviation of their mean over some rests, as a share of `held` [1]. Assumed, as of two rests. With 0.5 places
            of payloads on 22 simulated crawls are 1.5 standard deviations off (rms), with 0.7 at most 1.1; with one
            bars of masses are a quarter wider.
        gears: factor on the friction of legs on flat feet while they slide, and on what their fit allows for at rest
            [1]. A model does not say whether their gears are planetary, as a G1's, whose static friction is 1.7 to
            2.4 % of the limits (its maker's drives for simulators, Unitree RL Lab), or harmonic, as Talos' and iCub's,
            which lose 2.5 times what two planetary stages do. All of a robot's are of one kind, and friction is
            positive, so it is alike in all joints (`stadera.trunk.error_model`). With 1.25, 2.5, 7.5 masses of 36
            simulated squats, sways and stands with harmonic gears are at most 4.5, 3.1, 1.9 standard deviations off.
        stated: rotor inertia and friction that a model file states, as a share of them [1], where that is more. Damping
            of a file may be there to keep a simulator stable; with 0.5 none at all is two standard deviations away. A
            simulated OP3 whose file has 50 times its damping is refused without this, and its payload is 0.4, 0.2 and
            0.1 % of the robot off with 0.25, 0.5 and 1.5. Of the robots by name it moves iCub only.
        limbs: factor on the friction of joints in arms and other limbs [1]. Static friction of a G1's arms is 2.4 % of
            the limits, of its wrists 12 % (its maker's drives for simulators, Unitree RL Lab), of an arm's seven joints
            6.6 % root mean square.
    """

    rotor: float = 0.1
    viscous: float = 0.005
    coulomb: float = 0.02
    offset: float = 0.005
    gain: float = 0.03
    common_gain: float = 0.03
    encoder: float = 0.007
    contact: float = 0.005
    link_mass: float = 0.05
    link_com: float = 0.005
    imu_lever: float = 0.015
    imu_rotation: float = 0.01
    accelerometer: float = 0.05
    accelerometer_vertical: float = 0.1
    gravity: float = 0.03
    settles: float = 0.05
    imu_response: float = 0.4
    torque_lag: float = 0.01
    velocity_lag: float = 0.001
    friction_drift: float = 0.3
    offset_drift: float = 0.002
    rotor_drift: float = 0.1
    drift: float = 0.0005
    surest: float = 0.1
    alike: float = 0.7
    alike_loaded: float = 0.35
    load_friction: float = 0.06
    friction_law: float = 0.3
    held: float = 1.0
    sagging: float = 0.9
    renewed: float = 0.5
    rests: float = 0.7
    gears: float = 2.5
    stated: float = 0.5
    limbs: float = 3.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0.0 <= value < inf:
                raise ModelError(f"model error {name!r} must be finite and not negative, got {value}")
            if name in ("alike", "alike_loaded", "sagging", "renewed") and value >= 1.0:
                raise ModelError(f"model error {name!r} is a correlation below 1, got {value}")


@dataclass(frozen=True)
class SwingDetection:
    """Criteria for a swinging leg, whose rows determine its joints' rotor inertia, friction and offsets.

    A foot that is lifted, or moves relative to the loaded ones, is in the air if it carries next to nothing while the
    others carry the robot. Low feet that move are half of all swings: a trot lifts its feet by a few centimetres.

    Attributes:
        lift: height of the foot above the loaded feet, along the ground's normal, share of the leg's length [1].
        speed: of the foot relative to the loaded feet, share of √(g · leg length) [1]; 0.2 to 0.3 m/s. Feet that stand
            differ by the noise of the joints' velocities, 0.02 to 0.06 rad/s.
        part: time over which forces and velocities of a foot are averaged before they are evaluated [s], as long as an
            impact. Accelerations from noisy velocities then differ no more than in a log of 200 Hz, where single
            samples at 1 kHz seem to carry a third of the weight.
        load: contact force computed from the joint torques below which the leg may be in the air, and above which a
            foot that is not lifted stands, share of the weight [1]. Half of what each foot carries on four; friction of
            3 % of the effort limit and offsets of 1 % mimic up to 0.1 on a light robot.
        carried: share of the weight that the other legs must carry [1].
        residual: standard deviation of a row's residual beyond white noise, share of the effort limit [1]: the error of
            a friction law at low speed.
        repeated: number of successive rows with the same model error, in the air and under load [1]: a swing or stance
            of 0.2 s in blocks of 20 ms (with other blocks change it too). Errors of friction laws and of the links
            persist that long, and return with every step.
        returning: number of rows under load after which such errors have returned, so that more of them tell nothing
            new [1], of a robot that sways: four seconds. Assumed.
        strides: the same of rows in which a foot moves relative to the others, a second, three strides of a trot, and,
            for drives, of a joint's rows in the air [1]. The masses of seven walks of a real Mini Cheetah spread by
            19 % with 200, by 8 % with 50, by 6 % with 25; payloads of simulated trots err by 0.7, 0.4, 0.4 % of the
            robot (rms).
        enough: rows for each unknown, needed to evaluate the fit of the joints' law [1].
        quietest: share of the stated variance below which smaller residuals do not sharpen the estimate [1].
        freedom: degrees of freedom of Student's t, by which rows that fit worse than usual count for less [1]: a foot
            that scuffs or lands within a block. Lange et al. (1989), see `RobustWeights`, take four for data of
            unknown law.
        recent: rows of a joint, over which its latest residual is averaged. step: average residual that friction laws
            do not have, and a torque sensor that jumps does, share of the effort limit [1]. wild_step: the same, times
            the usual residual of all joints [1].
        fewest_swings: blocks of a leg from which on it is compared with the others, three steps of a trot. usual_air:
            share of them in which half of the legs are in the air, above which one with less than half the square of it
            has a torque that is off [1]. In 18 simulated sound walks that show so much, and in 13 of a real Go2, the
            least leg has 0.85 of the square; ten of a real Mini Cheetah show up to 0.14. Of 144 offsets by a fifth of
            the limit in trots of six robots four more are named than with half of the share, above 0.6.
    """

    lift: float = 0.03
    speed: float = 0.1
    part: float = 0.005
    load: float = 0.125
    carried: float = 0.5
    residual: float = 0.005
    repeated: float = 10.0
    returning: float = 200.0
    strides: float = 50.0
    enough: float = 4.0
    quietest: float = 0.02
    freedom: float = 4.0
    recent: float = 12.0
    step: float = 0.04
    wild_step: float = 6.0
    fewest_swings: float = 20.0
    usual_air: float = 0.3

    def __post_init__(self) -> None:
        _positive(self)
        if self.repeated < 1.0:
            raise StaderaError(f"SwingDetection.repeated counts rows, at least 1, got {self.repeated}")


@dataclass(frozen=True)
class ChangeSettings:
    """Criteria for reporting a change of the load.

    Attributes:
        least_change: change of mass as a share of the robot's mass, or of first moment over mass times leg length [1].
        deviations: number of standard deviations that a change must exceed.
        windows: numbers of latest blocks that are compared with the estimate before them.
        every: blocks after which they are compared. confirmed: number of times in succession that a change must show.
        history, history_walking: earlier blocks that are needed, of any weight: 1 s; in a walk 1.5 s, since after 1 s a
            stride may pass for a change.
        pending: latest blocks excluded from what is learnt about a constant load, as changes may be detected in them.
        back: one of `windows`, by which, and by the next one, a load that is back to what it was before a change is
            recognised [blocks]: the shorter, the less of the push stays in the estimate. By one alone a load on a Go2
            that sways on a plant of its own is withdrawn 1.9 s later, by friction that hides it for 0.1 s.
        agreeing: number of standard deviations within which it is back.
        sliding: share of the joints that must slide for a block to be compared with an estimate from blocks in motion
            [1]: friction of joints that stop passes for a load of 5 % and more.
        transient: time within which a change that goes back is withdrawn [s]: nobody loads and unloads a robot that
            fast; people push and feet are caught for up to a second.
        spoilt: blocks skipped after the change, which contain both loads.
        means: number of successive means of limbs' rows that a change must show, 0.2 s each. With 2 the masses and
            places of nine simulated loads in hands are alike, with 9 two of nine changes are missed; six logs without a
            load have none with any.
        trusted: number of independent ratios that honest bars count as, against those that the log shows [1].
        shifted: change of mass, as a share of the robot's mass, below which a change is reported as a shift [1].
    """

    least_change: float = 0.015
    deviations: float = 5.0
    windows: tuple[int, ...] = (8, 16, 25, 40, 60, 100)
    every: int = 3
    confirmed: int = 2
    history: int = 50
    history_walking: int = 75
    pending: int = 56
    back: int = 8
    agreeing: float = 3.0
    sliding: float = 0.5
    transient: float = 2.0
    spoilt: int = 2
    means: int = 3
    trusted: float = 4.0
    shifted: float = 0.005

    def __post_init__(self) -> None:
        _positive(self, "least_change", "history", "history_walking", "spoilt")
        windows = self.windows
        if list(windows) != sorted(set(windows)) or not windows or windows[0] < 2:
            raise StaderaError(f"ChangeSettings.windows need lengths of 2 blocks and more that grow, got {windows}")
        if windows[-1] > 2 * self.pending:
            raise StaderaError(f"ChangeSettings.windows must fit into {2 * self.pending} pending blocks, got {windows}")
        if self.back not in windows:
            raise StaderaError(f"ChangeSettings.back must be one of the windows {windows}, got {self.back}")
        if self.agreeing > self.deviations:
            raise StaderaError(f"ChangeSettings.agreeing exceeds deviations: {self.agreeing} > {self.deviations}")


@dataclass(frozen=True)
class OutlierSettings:
    """Criteria for blocks that fit far worse than usual.

    Attributes:
        enough: number of blocks needed before blocks are compared with the estimate: half a second.
        afresh: number of blocks of a new load, against which a block is compared with what was usual before.
        freedom: degrees of freedom of Student's t, by which blocks that fit worse than usual count for less [1]. Lange
            et al. (1989), see `RobustWeights`, take four for data of unknown law. Residuals of six rows at once
            are less heavy-tailed, and phases of a step with small residuals, where joints stick, must not decide alone.
        explained: most that residuals may be, in mean squares over what uncertain errors explain of a robot that does
            not walk, not to be compared with usual ones [1]: six of them are that far once in 2,000 draws.
        least_usual: least mean square of usual residuals, in the rows' unit [1]: residuals below 0.5 % of the weight
            do not define the usual ones.
        sliding: share of the joints that must slide for a block to count in full [1]. A quarter: of the blocks of real
            trots and walks one in eleven has fewer.
        held: weight of a block in which fewer slide, relative to one in which they slide [1]; with one, blocks count
            alike whatever friction may hold. Static friction takes any torque up to its bound, 2 % of the limit, while
            what is wrong with a sliding joint is 0.3 %: the square of their ratio. Without it a robot that moves, stops
            and is loaded is weighed by friction.
        remembered: number of blocks over which usual residuals are averaged: two seconds, several steps.
    """

    enough: int = 25
    afresh: int = 6
    freedom: float = 10.0
    explained: float = 4.0
    least_usual: float = 0.25
    sliding: float = 0.25
    held: float = 0.02
    remembered: float = 100.0

    def __post_init__(self) -> None:
        _positive(self)


@dataclass(frozen=True)
class TrunkSettings:
    """Settings of `TrunkEstimator`.

    Attributes:
        block: length of a block [s], 10 to 200 ms.
        memory: time constant of the exponential forgetting [s].
        model: prior standard deviations of model errors.
        swing: criteria for a swinging leg.
        changes: criteria for reporting a change of the load.
        outliers: criteria for blocks that fit far worse than usual.
        after_change: standard deviation of the trunk after a change, as a share of the widest prior [1].
        settled: time of data after which an estimate counts as converged [s].
        size_spread: standard deviation of the logarithm of the size of each kind of model errors before any data [1],
            see `stadera.trunk.sizes`. The sizes in `ModelErrors` come from few robots; they are taken to be right for
            others within a factor of three (95 %).
        lies: share of the model's weight that feet carry at least where the trunk is as low as they are; with less the
            robot lies on its trunk, and blocks are left out. As light as a robot may be to be taken for this model.
        impact: half the difference between the forces of odd and of even samples above which a block is left out, share
            of the weight [1]: as much as a foot carries on four. The log's rate does not resolve the accelerations of
            such a block, and noise of that size in the equations' matrix makes the trunk lighter, which no error bar
            contains.
        stop: distance from its mechanical stop within which a joint may touch it [rad]: end stops are calibrated to
            half a degree, and give by as much.
        updated, updated_late: number of blocks between two updates of model errors and fit, at first and at last.
        grown: growth of the rows after which they are updated, between these numbers [1].
        evaluated: time of rows before the fit is judged [s].
        lost, bridged: step between samples above which samples are missing, in usual steps [1], and one that is always
            short enough [s]: a little over half a block.
        slow: step above which samples do not follow on each other at any rate [s], as a time that is not in seconds.
        first_steps: number of steps whose median is the usual one.
        lost_ground: length of a gap after which ground normal and gravity are estimated anew [s].
        explained: largest model error that is tried as an explanation of the residual, in prior standard deviations.
        doubtful, bad: misfit above which a result is doubtful, or bad, see `stadera.trust.Trust` [1]. A result is
            doubtful, too, if a leg's torque offsets have more than that beyond its friction, see `Fit`: sound robots
            have up to 1.3 in motion and 2.4 in stands (54 simulated logs), ten walks of a real Mini Cheetah 0.8, six
            sways and crawls with a torque off by a fifth of its limit 6 to 19. With harmonic gears that the model
            lacks, 3 to 8 % of the limit, four of 58 quadrupeds have more than 3, and none of 12 humanoids.
        turned: standard deviations of its mount about one axis beyond which a turn of the IMU makes a result doubtful.
            Of 36 simulated logs with drawn errors one has 2.5 and the others less, walks of a real Mini Cheetah 0.7.
        overweight: weight on a scale over that of the model, which no load explains, but grams do [1].
        lag_share, lag_least: uncertainty of the torques' lag beyond what its rows show, share of it [1] and [s], where
            the misfit is one or more; less by its root below. Rows are linear in the lag, as torques are for a few
            milliseconds only, and what is wrong with the model takes up the rest. Torques of two walks of real Go2s
            and two simulated trots, shifted by -6 to 9 ms, move it by 0.6 (median, 0.1 to 1.2) of that; so five trots
            and two walks are at most 2.4 of these bars off. Of a robot as its model it is right within 0.3 ms.
        apart: standard deviations between a scale, test weight or memory and the log, beyond which it is left out, and
            between a trunk's mass and its bounds, beyond which it is impossible.
        compared: time between two comparisons of the places where a load may be [s]; a change of the load compares
            them at once.
        placed: probability above which a load is taken to be at one place and not another [1]: 19 to 1.
    """

    block: float = 0.02
    memory: float = 60.0
    model: ModelErrors = field(default_factory=ModelErrors)
    swing: SwingDetection = field(default_factory=SwingDetection)
    changes: ChangeSettings = field(default_factory=ChangeSettings)
    outliers: OutlierSettings = field(default_factory=OutlierSettings)
    after_change: float = 0.3
    settled: float = 0.5
    size_spread: float = 0.55
    lies: float = 0.6
    impact: float = 0.25
    stop: float = 0.015
    updated: int = 10
    updated_late: int = 50
    grown: float = 0.06
    evaluated: float = 1.0
    lost: float = 3.5
    bridged: float = 0.012
    slow: float = 0.5
    first_steps: int = 50
    lost_ground: float = 0.2
    explained: float = 10.0
    doubtful: float = 3.0
    bad: float = 9.0
    turned: float = 3.5
    overweight: float = 5.0
    lag_share: float = 0.7
    lag_least: float = 0.003
    apart: float = 4.0
    compared: float = 1.0
    placed: float = 0.95

    def __post_init__(self) -> None:
        _positive(self, "grown")
        if not 0.01 <= self.block <= 0.2:
            raise StaderaError(f"TrunkSettings.block is a time of 0.01 to 0.2 s, got {self.block}")
        if not 2 <= self.updated <= self.updated_late:
            raise StaderaError(f"TrunkSettings need 2 ≤ updated ≤ updated_late, got {self}")

    def at_rest(self, block: float) -> TrunkSettings:
        """For a robot that only stands, in blocks of so long [s]: all count alike, and changes need no averages as long
        as strides; these are shorter by 2.5.
        """
        changes, shorter = self.changes, 2.5 * block / self.block
        windows = tuple(sorted({max(round(n / shorter), 2) for n in changes.windows}))
        changes = replace(
            changes,
            windows=windows,
            back=windows[0],
            pending=max(round(changes.pending / shorter), windows[-1]),
            every=max(round(changes.every / shorter), 1),
            history=max(round(changes.history / shorter), 1),
            sliding=1e-9,
        )
        return replace(self, block=block, changes=changes, outliers=replace(self.outliers, held=1.0))

    def wait(self, blocks: int) -> int:
        """Number of blocks until model errors and fit are updated, after so many; the first ones update every time."""
        if blocks < self.updated:
            return 1
        return min(max(self.updated, int(self.grown * blocks)), self.updated_late)
