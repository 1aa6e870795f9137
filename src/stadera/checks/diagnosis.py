"""Consistency checks on a log, run before estimation. Each finding names the fault and the evidence for it.

Units that are not SI, sensors that stop, an IMU that does not show gravity or is rotated, joints in another order,
torques of another sign: each yields a plausible but wrong weight. So values are compared with what is possible
(`signals`), all sensors together with the statics of a robot on its feet (`statics`) and with its motion
(`residual`), and common mistakes are tested as explanations (`hypotheses`, `torques`, `limbs`). A hypothesis is
confirmed if the log without the fault fits itself: on average if all impossible properties are gone and the cost is a
small share, in motion if the cost is reduced by more than chance. Of several, the one of least cost is chosen, and
those that fit equally well are named with it.

Undetectable on a robot that stands still: swapped left and right or front and hind legs, and an IMU rotated about the
vertical. They look right until the trunk tilts or the load shifts.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from stadera.checks.finding import Finding
from stadera.checks.hypotheses import Hypothesis, hypotheses_at_rest, hypotheses_in_motion, torque_scales
from stadera.checks.instants import Instants
from stadera.checks.limbs import LimbFooting, misread_limbs
from stadera.checks.limits import CheckLimits
from stadera.checks.other_robot import or_other_robot
from stadera.checks.residual import Footing, Gain
from stadera.checks.signals import DEGREE, limit_findings, sensor_findings, unit_findings
from stadera.checks.statics import Consistency, hanging, limp
from stadera.checks.torques import likelier, misread_in_motion, pushing_at_rest, torque_step
from stadera.errors import RecordingError, UntrustedError, listed
from stadera.logs.mend import GYRO, Mend, changed
from stadera.logs.reader import stream
from stadera.logs.recording import Recording, take
from stadera.logs.topics import LogFile
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot

_BLINDING = ("time_unit", "position_unit", "imu_gravity")
"""Causes that make all other signals contradict each other as well."""


def diagnose(
    recording: Recording, robot: Robot, imu_frame: str | None = None, limits: CheckLimits | None = None
) -> tuple[Finding, ...]:
    """Finds faults in a log of a robot that is on its feet, standing or walking; silent sensors first.

    Args:
        recording: with all of the robot's joints and efforts, without which only dropouts are found; without an IMU
            torques are compared with the encoders only.
        imu_frame: frame of the IMU's values; None for the recording's own, else the model's.

    Raises:
        RecordingError: fewer than two samples, in which nothing can be seen to stop or to move.
        UnknownNameError: no such frame.
    """
    if len(recording) < 2:
        raise RecordingError(f"{recording.source}: too few samples: {len(recording)}, at least 2 are needed")
    limits = limits or CheckLimits()
    joints, mount = [j for j in robot.tree.joints if j in recording.joints], _mount(recording, robot, imu_frame)
    blocks = Instants.of(recording, joints, mount, limits)
    found = [*sensor_findings(recording, limits), *unit_findings(recording, robot, blocks, limits)]
    if (
        len(joints) < len(robot.tree.joints)
        or recording.effort is None
        or any(finding.cause in _BLINDING for finding in found)
    ):
        return tuple(found)
    if len(blocks):
        found += _contradictions(Footing(robot, blocks, limits), mount)
    if not any(finding.fatal for finding in found):
        stuck = [(recording.time >= begin) & (recording.time <= end) for each in found for begin, end in each.spans]
        found += _of_limbs(take(recording, ~np.any(stuck, axis=0)) if stuck else recording, robot, mount, limits)
    return tuple(or_other_robot(finding, recording, robot) for finding in found)


def contradictions(recording: Recording, robot: Robot, imu_frame: str | None = None) -> tuple[str, ...]:
    """Impossible properties of a log of a robot on its feet, one clause each, without a search for the cause.

    Arguments and errors as `diagnose`; the recording has all of the robot's joints and their torques.
    """
    limits = CheckLimits()
    blocks = Instants.of(recording, robot.tree.joints, _mount(recording, robot, imu_frame), limits)
    return Consistency.of(Footing(robot, blocks, limits)).faults if len(blocks) else ()


def _mount(recording: Recording, robot: Robot, imu_frame: str | None) -> ImuMount | None:
    return None if recording.imu is None else ImuMount.of(robot, imu_frame, recording.imu.frame)


def _contradictions(footing: Footing, mount: ImuMount | None) -> Iterator[Finding]:
    now = Consistency.of(footing)
    faults, imu = listed(now.faults, 3), footing.blocks.specific_force is not None
    if now.hangs or limp(footing):
        yield hanging(footing, now)
    elif not faults:
        yield from _in_motion(footing, mount)
    elif (fitting := explained(footing)) and (without := fitting[0][1]):
        fits = f"it would weigh {without.weighs:.3g} kg, the model {footing.robot.mass:.3g} kg, and nothing contradicts"
        yield _named([one for one, _ in fitting], f"as recorded, {faults}; otherwise {fits}", mount)
    elif named := [*_moved(few := footing.thinned(footing.limits.motion_instants), explained_by_motion(few), mount)]:
        yield from named
    else:
        who = "encoders, torques and IMU" if imu else "encoders and torques"
        yield Finding("contradiction", f"{who} contradict each other: {faults}{now.outlier}")


def _named(hypotheses: Sequence[Hypothesis], evidence: str, mount: ImuMount | None) -> Finding:
    """The finding of the first hypothesis, or of others that fit as well. Its correction turns the IMU in its axes."""
    best, *others = hypotheses
    mend: Mend | None = best.undo if best.known and not others else None
    if mend is not None and mend.turn and mount is not None:
        turn = mount.rotation.T @ np.array(mend.turn) @ mount.rotation
        mend = replace(mend, turn=tuple(map(tuple, turn.tolist())))
    text = ", or ".join(each.text for each in hypotheses)
    return Finding(best.cause, f"{text}: {evidence}", best.option, mend)


def explained(footing: Footing) -> list[tuple[Hypothesis, Consistency]]:
    """The hypothesis that explains what is impossible on average, at most two others that explain it about as well, and
    the figures without each fault, none of which another one beats in motion; none if none does.
    """
    robot, limits = footing.robot, footing.limits
    footing = footing.thinned(limits.trial_instants)
    now = Consistency.of(footing)
    scales = torque_scales(robot, now.loads / footing.weight, limits.lightest, limits.heaviest)
    all_of_them = chain(hypotheses_at_rest(robot, limits.orders, imu=footing.blocks.specific_force is not None), scales)
    logs = ((one, footing.after(one.undo)) for one in all_of_them)
    tried = ((one, Consistency.of(without), without) for one, without in logs)
    fits = [entry for entry in tried if entry[1].cost <= limits.much_better * now.cost and not entry[1].faults]
    if not fits:
        return []
    moves = min((without for *_, without in fits), key=lambda log: np.nansum(log.sliding) + np.nansum(log.unbalance))
    fitting = [(one, fit) for one, fit, log in fits if not Gain.of(log, moves).confirms(footing.least_gain, limits)]
    least = min(fit.cost for _, fit in fitting)
    best = next(entry for entry in fitting if entry[1].cost <= least + limits.same)
    near = sorted((entry for entry in fitting if entry is not best), key=lambda entry: entry[1].cost)
    return [best, *[entry for entry in near if entry[1].cost < least + limits.similar][:2]]


def explained_by_motion(footing: Footing) -> list[tuple[Hypothesis, Gain, Footing]]:
    """The hypothesis that makes the motion of a log with an IMU, possible on average, more consistent, its gain and the
    log without the fault, and at most two others that gain about as much; none if none does. Feet slide less by it, or
    the trunk balances better by more than errors of models explain.
    """
    limits, blocks = footing.limits, footing.blocks
    if blocks.angular_velocity is None or not np.isfinite(blocks.rate).any():
        return []
    most = float(np.nansum(footing.sliding) + np.nansum(footing.unbalance))
    used = np.count_nonzero(np.isfinite(footing.unbalance))
    least = footing.least_gain
    if most < least * used:  # nothing is left to gain
        return []
    fitting = []
    for one in hypotheses_in_motion(footing.robot, limits.orders):
        without = footing.after(one.undo)
        if most - float(np.nansum(without.unbalance)) < least * used:  # as feet that do not slide at all
            continue
        gain = Gain.of(footing, without)
        shown = gain.confirms(least, limits) and (gain.slides > limits.gain or likelier(footing, without))
        if shown and not Consistency.of(without).faults:
            fitting.append((one, gain, without))
    fitting.sort(key=lambda entry: -entry[1].mean)
    return [*fitting[:1], *(entry for entry in fitting[1:3] if entry[1].mean > limits.alike * fitting[0][1].mean)]


def late_imu(footing: Footing) -> tuple[float, Gain] | None:
    """The delay of the IMU against the joints [s] that makes the motion most consistent, and its gain; None if none
    does. A delay by which the feet slide no less than as recorded is none: friction of the drives turns with the motion
    too, so that a sway, a squat or a trot balances better by an accelerometer of a moment before, but no friction moves
    the feet.
    """
    limits, blocks = footing.limits, footing.blocks
    if len(blocks) < limits.order_fewest:
        return None
    step, found = float(np.median(np.diff(blocks.time))), []
    for k in (k for k in range(-limits.late_instants, limits.late_instants + 1) if k):
        pair = [Footing(footing.robot, each, limits) for each in blocks.shifted(k)]
        (now, _), (then, _) = pair[0].costs(pair[1])
        if np.nansum(now - then) >= limits.gain * np.count_nonzero(np.isfinite(now)) > 0:
            found.append((k * step, Gain.of(*pair)))
    best = max(found, key=lambda entry: entry[1].mean, default=None)
    return best if best is not None and best[1].confirms(limits.gain, limits) else None


def _in_motion(footing: Footing, mount: ImuMount | None) -> Iterator[Finding]:
    few = footing.thinned(footing.limits.motion_instants)
    found = explained_by_motion(few)
    if not found:
        yield from _gyro_at_rest(footing)
    if not found or found[0][0].by_torques:
        order = tuple(_of_torques(footing, mount))
        yield from order
        if order or not found:
            return
    (_, gain, _without), late = found[0], late_imu(few)
    if late is not None and late[1].mean > gain.mean:
        text = (
            f"the IMU seems to be about {abs(1e3 * late[0]):.0f} ms {'late' if late[0] > 0.0 else 'early'} against "
            f"the joints: shifted by that, feet that carry do not slide and the trunk is in balance "
            f"({late[1].deviations:.1f} standard deviations)"
        )
        yield Finding("imu_late", text)
    else:
        yield from _moved(few, found, mount)


def _moved(
    few: Footing, found: Sequence[tuple[Hypothesis, Gain, Footing]], mount: ImuMount | None
) -> Iterator[Finding]:
    """The finding of hypotheses that explain the motion, if the first leaves little of its cost or gains plainly."""
    if not found:
        return
    (best, gain, without), limits = found[0], few.limits
    # a robot that moves turns; on soft ground its feet slide by any gyro
    unturned = without.lively > limits.lively_share and without.turning < limits.turns_least
    fits = without.fits(few)
    if not (fits or gain.is_plain(limits)) or (best.cause == "gyro_unit" and unturned):
        return
    text = (
        f"as recorded, feet that carry slide at {100 * few.slides:.2g} cm/s and the trunk is out of balance; otherwise "
        f"at {100 * without.slides:.2g} cm/s, and {'in' if fits else 'nearer to'} balance "
        f"({gain.deviations:.1f} standard deviations)"
    )
    yield _named([one for one, _, _ in found], text, mount)


def _gyro_at_rest(footing: Footing) -> Iterator[Finding]:
    """A gyro in deg/s whose noise alone turns the robot faster than its feet, which stand, allow."""
    limits, turn = footing.limits, footing.blocks.angular_velocity
    if turn is None or not np.isfinite(footing.spread).any():
        return
    converted = footing.after(Mend("", factors={GYRO: DEGREE}))
    if converted.lively > limits.lively_share:  # feet that walk on soft ground slide by any gyro
        return
    now, left = (float(np.nanmedian(each.spread)) for each in (footing, converted))
    if now > (limits.still * footing.robot.leg_length) ** 2 and left < limits.much_better * now:
        slides = f"by it they slide at {100 * np.sqrt(now):.2g} cm/s, otherwise at {100 * np.sqrt(left):.2g} cm/s"
        text = f"the gyro contradicts the feet that stand, which turn less, as one in deg/s would: {slides}"
        yield Finding("gyro_unit", text, "--units gyro=deg/s")


def _of_torques(footing: Footing, mount: ImuMount | None) -> Iterator[Finding]:
    """Torques of legs that are swapped with those of others, or of a joint with the other sign, certain in motion; a
    doubt at rest; and a torque that jumps.
    """
    misread, step = misread_in_motion(footing), torque_step(footing)
    if misread is not None and (step is None or misread[1] > step[1]):
        hypotheses, gain = misread
        odds = f"(likelihood higher by e^{0.5 * gain:.0f}, allowing for friction and other errors of models)"
        known, text = hypotheses[0].known, f"without that the trunk balances as it moves {odds}"
        pushed = "" if known else "; or something pushes or pulls the robot, which looks alike"
        named = _named(hypotheses, f"{text}{pushed}", mount)
        yield named if known else replace(named, cause="torque_order")
    elif step is not None:
        yield step[0]
    elif footing.lively <= footing.limits.lively_share:
        for push in pushing_at_rest(footing):
            yield Finding("pushing", f"{push}; let the robot sway to decide it")


def _of_limbs(recording: Recording, robot: Robot, mount: ImuMount | None, limits: CheckLimits) -> Iterator[Finding]:
    """Arms that are exchanged, joints outside the legs with the other sign, or torques that do not fit their motion."""
    footing = LimbFooting.of(recording, robot, mount, limits)
    if footing is None:
        return
    if misread := misread_limbs(footing):
        odds = f"(likelihood higher by e^{0.5 * misread[1]:.0f}, allowing for friction, loads and errors of models)"
        yield _named(misread[0], f"without that the torques follow from the motion {odds}", mount)
    elif (left := footing.left) > limits.limb_fits:
        text = f"torques of joints outside the legs do not follow from their motion: {100 * left:.2g} % of their limits"
        yield Finding("limb_torques", f"{text} remains; what they say of a load and its place may be wrong")


@dataclass(frozen=True, eq=False)
class Guard:
    """Checks made on a log of a robot by every command before anything else, and the correction of faults with `fix`.

    Units and signs are checked for any motion. Checks that need a robot on its feet are made chunk by chunk during
    weighing, because a log may start before the robot stands up, or end in a fall.
    """

    robot: Robot
    joints: Sequence[str]
    on_feet: bool = True  # True if the robot stands or walks; False if its trunk is held, legs in the air
    imu_frame: str | None = None  # frame of the IMU's values; None for the log's own, else the model's
    rounds: int = 4  # of detection and correction at most; a wrong unit hides other faults until it is corrected

    def units(self, log: LogFile | Recording) -> tuple[Finding, ...]:
        """Faults of units and signs in a log's first chunk."""
        first = self._first(log)
        found = unit_findings(first, self.robot)
        if found or self.on_feet:
            return found
        return tuple(limit_findings(first, self.robot, CheckLimits()))

    def findings(self, log: LogFile | Recording) -> tuple[Finding, ...]:
        """All faults in a log's first chunk. Raises RecordingError: the log cannot be read, or lacks a joint.
        UnknownNameError: no such frame.
        """
        if not self.on_feet:
            return self.units(log)
        return diagnose(self._first(log), self.robot, self.imu_frame)

    def mended(self, log: LogFile | Recording) -> LogFile | Recording:
        """The log with all unambiguous faults corrected, and a note on each; raises as `findings`."""
        for _ in range(self.rounds):
            mends = [finding.mend for finding in self.findings(log) if finding.mend is not None]
            if not mends:
                break
            if isinstance(log, Recording):
                log = changed(log, mends)
            else:
                log = replace(log, reading=replace(log.reading, changes=(*log.reading.changes, *mends)))
        return log

    def admitted(self, log: LogFile | Recording, *, fix: bool, force: bool) -> LogFile | Recording:
        """The log to use: corrected with `fix`, and its units and signs checked unless a result is forced. Raises
        UntrustedError: they are wrong; names the option that corrects them. Also raises as `findings`.
        """
        log = self.mended(log) if fix else log
        wrong = () if force else [finding for finding in self.units(log) if finding.fatal]
        if wrong:
            raise UntrustedError(f"{log.source}: {wrong[0]}")
        return log

    def _first(self, log: LogFile | Recording) -> Recording:
        return next(stream(log, joints=self.joints))
