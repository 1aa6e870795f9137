"""Consistency checks on a log, run before estimation. Each finding names the fault and the evidence for it.

Units that are not SI, sensors that stop, an IMU that does not show gravity or is rotated, joints in another order,
torques of another sign: each yields a plausible but wrong weight. So values are compared with what is possible
(`units`, `sensors`), all sensors together with the statics of a robot on its feet (`statics`) and with its motion
(`residual`), and common mistakes are tested as explanations (`hypotheses`, `torques`). A hypothesis is confirmed if the
log without the fault fits itself: on average if all impossible properties are gone and the cost is a small share, in
motion if the cost is reduced by more than chance. Of several, the one of least cost is chosen, and those that fit
equally well are named with it.

Undetectable on a robot that stands still: swapped left and right or front and hind legs, and an IMU rotated about the
vertical. They look right until the trunk tilts or the load shifts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from stadera.checks.finding import Finding
from stadera.checks.hypotheses import Hypothesis, hypotheses_at_rest, hypotheses_in_motion, torque_scales
from stadera.checks.instants import Instants
from stadera.checks.limits import CheckLimits
from stadera.checks.other_robot import carried_by_others
from stadera.checks.residual import Footing, Gain
from stadera.checks.sensors import orientation_findings, sensor_findings
from stadera.checks.statics import Consistency
from stadera.checks.torques import pushing_at_rest, swapped_in_motion, torque_step
from stadera.checks.units import DEGREE, unit_findings
from stadera.errors import listed
from stadera.logs.mend import GYRO, Mend
from stadera.logs.recording import Recording
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
        UnknownNameError: no such frame.
    """
    limits = limits or CheckLimits()
    joints, mount = [j for j in robot.tree.joints if j in recording.joints], _mount(recording, robot, imu_frame)
    blocks = Instants.of(recording, joints, mount, limits)
    found = [*sensor_findings(recording, limits), *unit_findings(recording, robot, blocks, limits)]
    whole = len(joints) == len(robot.tree.joints) and len(recording) > 1
    if not whole or recording.effort is None or any(finding.cause in _BLINDING for finding in found):
        return tuple(found)
    if recording.imu is not None:
        found += orientation_findings(recording.imu, recording.time, limits)
    if len(blocks):
        found += _contradictions(Footing(robot, blocks, limits), mount)
    return tuple(_or_other_robot(finding, recording, robot) for finding in found)


def contradictions(recording: Recording, robot: Robot, imu_frame: str | None = None) -> tuple[str, ...]:
    """Impossible properties of a log of a robot on its feet, one clause each, without a search for the cause.

    Arguments and errors as `diagnose`; the recording has all of the robot's joints and their torques.
    """
    limits = CheckLimits()
    blocks = Instants.of(recording, robot.tree.joints, _mount(recording, robot, imu_frame), limits)
    return tuple(Consistency.of(Footing(robot, blocks, limits)).faults()) if len(blocks) else ()


def _mount(recording: Recording, robot: Robot, imu_frame: str | None) -> ImuMount | None:
    return None if recording.imu is None else ImuMount.of(robot, imu_frame or recording.imu.frame)


def _contradictions(footing: Footing, mount: ImuMount | None) -> Iterator[Finding]:
    now = Consistency.of(footing)
    faults = listed([*now.faults()], 3)
    if now.hangs:
        yield _hanging(footing, now)
    elif not faults:
        yield from _in_motion(footing, mount)
    elif (fitting := explained(footing)) and (without := fitting[0][1]):
        fits = f"it would weigh {without.weighs:.3g} kg, the model {footing.robot.mass:.3g} kg, and nothing contradicts"
        yield _named([one for one, _ in fitting], f"as recorded, {faults}; otherwise {fits}", mount)
    else:
        who = "encoders, torques and IMU" if now.imu else "encoders and torques"
        yield Finding("contradiction", f"{who} contradict each other: {faults}{_outlier(now)}")


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
    the figures without each fault; none if none does.
    """
    robot, limits = footing.robot, footing.limits
    footing = replace(footing, blocks=footing.blocks.thinned(limits.trial_instants, limits))
    now = Consistency.of(footing)
    scales = torque_scales(robot, now.loads / now.weight, limits.lightest, limits.heaviest)
    all_of_them = chain(hypotheses_at_rest(robot, limits.orders, imu=now.imu), scales)
    tried = ((one, Consistency.of(footing.after(one.undo))) for one in all_of_them)
    fitting = [(one, fit) for one, fit in tried if fit.cost <= limits.much_better * now.cost and not any(fit.faults())]
    if not fitting:
        return []
    least = min(fit.cost for _, fit in fitting)
    best = next(entry for entry in fitting if entry[1].cost <= least + limits.same)
    near = sorted((entry for entry in fitting if entry is not best), key=lambda entry: entry[1].cost)
    return [best, *[entry for entry in near if entry[1].cost < least + limits.similar][:2]]


def explained_by_motion(footing: Footing) -> list[tuple[Hypothesis, Gain, Footing]]:
    """The hypothesis that makes the motion of a log with an IMU, possible on average, more consistent, its gain and the
    log without the fault, and at most two others that gain about as much; none if none does.
    """
    limits, blocks = footing.limits, footing.blocks
    if blocks.angular_velocity is None or not np.isfinite(blocks.rate).any():
        return []
    most = float(np.nansum(footing.sliding) + np.nansum(footing.unbalance))
    used = np.count_nonzero(np.isfinite(footing.unbalance))
    least = limits.gain if footing.lively > limits.lively_share else limits.gain_at_rest
    if most < least * used:  # nothing is left to gain
        return []
    fitting = []
    for one in hypotheses_in_motion(footing.robot, limits.orders):
        needed, without = least * limits.rare if one.rare else least, footing.after(one.undo)
        if most - float(np.nansum(without.unbalance)) < needed * used:  # as feet that do not slide at all
            continue
        gain = Gain.of(footing, without)
        if gain.confirms(needed, limits) and not any(Consistency.of(without).faults()):
            fitting.append((one, gain, without))
    fitting.sort(key=lambda entry: -entry[1].mean)
    return [*fitting[:1], *(entry for entry in fitting[1:3] if entry[1].mean > limits.alike * fitting[0][1].mean)]


def _late_imu(footing: Footing) -> tuple[float, Gain] | None:
    """The delay of the IMU against the joints [s] that makes the motion most consistent, and its gain; None if none
    does.
    """
    limits, blocks = footing.limits, footing.blocks
    if len(blocks) < limits.order_fewest:
        return None
    step, found = float(np.median(np.diff(blocks.time))), []
    for k in (k for k in range(-limits.late_instants, limits.late_instants + 1) if k):
        pair = [Footing(footing.robot, each, limits) for each in blocks.shifted(k)]
        found.append((k * step, Gain.of(*pair)))
    best = max(found, key=lambda entry: entry[1].mean)
    return best if best[1].confirms(limits.gain, limits) else None


def _in_motion(footing: Footing, mount: ImuMount | None) -> Iterator[Finding]:
    few = replace(footing, blocks=footing.blocks.thinned(footing.limits.motion_instants, footing.limits))
    found = explained_by_motion(few)
    if not found:
        yield from _gyro_at_rest(footing)
    if not found or found[0][0].torques_alone:
        order = tuple(_of_torques(footing, mount))
        yield from order
        if order or not found:
            return
    (_, gain, without), late = found[0], _late_imu(few)
    if late is not None and late[1].mean > gain.mean:
        text = (
            f"the IMU seems to be about {abs(1e3 * late[0]):.0f} ms {'late' if late[0] > 0.0 else 'early'} against "
            f"the joints: shifted by that, feet that carry do not slide and the trunk is in balance "
            f"({late[1].deviations:.1f} standard deviations)"
        )
        yield Finding("imu_late", text)
    elif without.fits(few):
        text = (
            f"as recorded, feet that carry slide at {100 * few.slides:.2g} cm/s and the trunk is out of balance; "
            f"otherwise at {100 * without.slides:.2g} cm/s, and in balance ({gain.deviations:.1f} standard deviations)"
        )
        yield _named([one for one, _, _ in found], text, mount)


def _gyro_at_rest(footing: Footing) -> Iterator[Finding]:
    """A gyro in deg/s whose noise alone turns the robot faster than its feet, which stand, allow."""
    limits, turn = footing.limits, footing.blocks.angular_velocity
    if turn is None or not np.isfinite(footing.spread).any():
        return
    converted = footing.after(Mend("", factors={GYRO: DEGREE}))
    now, left = (float(np.nanmedian(each.spread)) for each in (footing, converted))
    if now > (limits.still * footing.robot.leg_length) ** 2 and left < limits.much_better * now:
        slides = f"by it they slide at {100 * np.sqrt(now):.2g} cm/s, otherwise at {100 * np.sqrt(left):.2g} cm/s"
        text = f"the gyro contradicts the feet that stand, which turn less, as one in deg/s would: {slides}"
        yield Finding("gyro_unit", text, "--units gyro=deg/s")


def _of_torques(footing: Footing, mount: ImuMount | None) -> Iterator[Finding]:
    """Torques of legs that are swapped with those of others, certain in motion and a doubt at rest, and a torque that
    jumps.
    """
    found, step = swapped_in_motion(footing), torque_step(footing)
    if found is not None and (step is None or found.gain > step.deviations**2):
        odds = f"(likelihood higher by e^{0.5 * found.gain:.0f}, allowing for friction and other errors of models)"
        text = f"with them in the right order the trunk balances as it moves {odds}"
        pushed = "" if found.certain else "; or something pushes or pulls the robot, which looks alike"
        yield _named([replace(found.hypothesis, known=found.certain)], f"{text}{pushed}", mount)
    elif step is not None:
        first, *others = map(repr, step.joints)
        text = f"the torque of {first}{''.join(f' or {other}' for other in others[:2])} jumps"
        how = f"by {step.size:.3g} N·m at about {step.time:.1f} s, which neither the motion nor a load explains"
        said = f"{text} {how} ({step.deviations:.1f} standard deviations)"
        yield Finding("torque_step", f"{said}; or something pushes or pulls the robot since then, which looks alike")
    else:
        for push in pushing_at_rest(footing):
            yield Finding("pushing", f"{push}; let the robot sway to decide it")


def _or_other_robot(finding: Finding, recording: Recording, robot: Robot) -> Finding:
    """The finding; torques in another unit may be those of another robot, whose log is not scaled."""
    others = carried_by_others(recording, robot) if finding.cause == "torque_unit" else ()
    if not others:
        return finding
    names = " or ".join(f"{one.name} ({one.mass:.3g} kg, its legs carry {one.carried:.3g})" for one in others[:2])
    text = f"the robot is another one, perhaps {names}; or {finding.message}"
    return Finding(finding.cause, text, f"--robot {others[0].name}, or {finding.option or '--gear RATIO'}")


def _hanging(footing: Footing, now: Consistency) -> Finding:
    """Distinguishes a robot in the air from torques that are too small.

    In the air the torques only carry the legs; on the ground, in whatever unit, they follow those for an equal share of
    the robot's weight on each foot.
    """
    robot, body, effort = footing.robot, footing.body, footing.blocks.effort[:, footing.body.in_legs]
    share = robot.mass * footing.specific_force / len(robot.legs)
    arm = footing.contact[:, body.leg_of[body.in_legs]] - footing.state.origin[:, body.in_legs]
    pushed = (np.cross(footing.state.axis[:, body.in_legs], arm) * share[:, None]).sum(axis=2)
    taken = footing.state.torque[:, body.in_legs] - pushed
    size = float(np.sqrt((effort**2).sum() * (taken**2).sum())) or 1.0
    factor = float((taken**2).sum() / ((effort * taken).sum() or 1.0))
    if (effort * taken).sum() / size > footing.limits.standing_torques:
        text = (
            f"the torques are those of a robot on its feet, but about {factor:.2g} times too small: of motors before "
            "the gear, or in another unit"
        )
        return Finding("torque_unit", text, "--gear RATIO")
    return Finding(
        "not_on_feet",
        f"the feet carry {now.weighs:.2g} kg of {robot.mass:.3g} kg: the robot is not on its feet but in the "
        "air, which is a log for `stadera identify`",
    )


def _outlier(now: Consistency) -> str:
    """Names the one of three sources of the vertical that disagrees with the other two."""
    close, far = now.limits.close, now.limits.far
    if not now.imu:
        return "; check the joints' names, and the torques' signs and units"
    if now.plane_force_angle < close and now.plane_angle > far:
        return "; the feet's plane and their forces agree, so that it is the IMU's frame that seems wrong"
    if now.plane_angle < close and now.force_angle > far:
        return "; IMU and the feet's plane agree, so that it is the torques that seem wrong"
    if max(now.plane_force_angle, now.plane_angle, now.force_angle) < close and (now.loads > 0).all():
        return "; all directions agree, so that it is the torques' unit or scale, or the model, that seems wrong"
    return "; check the joints' names, the torques' signs and units, and the IMU's frame"
