"""Consistency checks on a log, run before estimation. Each finding names the fault and the evidence for it.

Units that are not SI, sensors that stop, an IMU that does not show gravity or is rotated, joints in another order,
torques of another sign: each yields a plausible but wrong weight. So values are compared with what is possible
(`units`), the log with the statics of a robot on its feet (`statics`) and with its motion (`motion`), and common
mistakes are tested as explanations (`hypotheses`).

Undetectable on a robot that stands still: swapped left and right or front and hind legs, and an IMU rotated about the
vertical. They look right until the trunk tilts or the load shifts.
"""

from collections.abc import Iterator

import numpy as np

from stadera.checks.explain import explain, explain_motion, late_imu
from stadera.checks.finding import Finding
from stadera.checks.footing import Footing
from stadera.checks.instants import Instants
from stadera.checks.limits import CheckLimits
from stadera.checks.other_robot import carried_by_others
from stadera.checks.statics import Consistency, ConsistencyModel, block_means, blocks_of
from stadera.checks.torque_order import SwappedTorques, pushing_at_rest, swapped_in_motion
from stadera.checks.torque_steps import TorqueStep, torque_step
from stadera.checks.units import gravity_findings, gyro_findings, position_findings, time_findings, velocity_findings
from stadera.errors import listed
from stadera.logs.mend import Mend, upwards
from stadera.logs.recording import Imu, Recording
from stadera.logs.sampling import GAP_FACTOR
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.types import Array


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
    found = [*_silences(recording), *_stuck(recording, limits), *unit_findings(recording, robot, limits)]
    whole = set(robot.tree.joints) <= set(recording.joints) and len(recording) > 1
    if not whole or recording.effort is None or any(finding.cause in _BLINDING for finding in found):
        return tuple(found)
    if recording.imu is not None:
        found += _orientation(recording.imu, recording.time, limits)
    if not robot.quadruped:
        return tuple(found)
    blocks = Instants.of(recording, robot.tree.joints, _mount(recording, robot, imu_frame), limits)
    found += _contradictions(blocks, ConsistencyModel(robot, limits))
    return tuple(_or_other_robot(finding, recording, robot) for finding in found)


_BLINDING = ("time_unit", "position_unit", "imu_gravity")
"""Causes that make all other signals contradict each other as well."""


def unit_findings(recording: Recording, robot: Robot, limits: CheckLimits | None = None) -> tuple[Finding, ...]:
    """Finds values in other units than SI or with the wrong sign, for any motion."""
    limits = limits or CheckLimits()
    found = [*time_findings(recording, limits), *position_findings(recording, robot, limits)]
    joints = tuple(joint for joint in robot.tree.joints if joint in recording.joints)
    if not found and joints and len(recording) > 1:
        found += velocity_findings(Instants.of(recording, joints, None, limits), joints, limits)
    gravity = () if recording.imu is None else tuple(gravity_findings(recording.imu, limits))
    gyro = () if found or gravity else tuple(gyro_findings(recording, limits))
    return (*found, *gravity, *gyro)


def contradictions(recording: Recording, robot: Robot, imu_frame: str | None = None) -> tuple[str, ...]:
    """Impossible properties of a log of a quadruped on its feet, one clause each, without a search for the cause.

    Arguments and errors as `diagnose`; the recording has all of the robot's joints and their torques.
    """
    limits = CheckLimits()
    if not robot.quadruped:
        return ()
    blocks = Instants.of(recording, robot.tree.joints, _mount(recording, robot, imu_frame), limits)
    return tuple(ConsistencyModel(robot, limits).evaluate(Footing(robot, blocks)).faults()) if len(blocks) else ()


def _mount(recording: Recording, robot: Robot, imu_frame: str | None) -> ImuMount | None:
    return None if recording.imu is None else ImuMount.of(robot, imu_frame or recording.imu.frame)


# -- silent sensors ------------------------------------------------------------------------------------------------


def _silences(recording: Recording) -> Iterator[Finding]:
    steps = np.diff(recording.time)
    if not len(steps):
        return
    period = float(np.median(steps))
    wide = np.flatnonzero(steps > GAP_FACTOR * period)
    if len(wide):
        longest = wide[np.argmax(steps[wide])]
        yield Finding(
            "dropout",
            f"{len(wide)} gap{'s' * (len(wide) > 1)} in time of more than {GAP_FACTOR:g} samples, "
            f"{steps[wide].sum():.3g} s altogether, the longest {steps[longest]:.3g} s at "
            f"{recording.time[longest] - recording.time[0]:.3f} s: sensors or the logger dropped out",
        )


def _stuck(recording: Recording, limits: CheckLimits) -> Iterator[Finding]:
    """Finds signals that repeat bit for bit for a while but not elsewhere, and torques that are zero."""
    if recording.effort is not None:
        silent = [j for j, values in zip(recording.joints, recording.effort.T, strict=True) if not values.any()]
        if silent:
            yield Finding("no_torque", f"the torque of {listed([*map(repr, silent)], 4)} is zero throughout")
    groups: dict[tuple[float, float], list[str]] = {}
    for name, values in _signals(recording):
        span = _longest_repeat(recording.time, values, limits)
        if span is not None and not _rests(recording, name, span, limits):
            groups.setdefault(span, []).append(name)
    first = float(recording.time[0]) if groups else 0.0
    for (begin, end), names in groups.items():
        yield Finding(
            "stuck",
            f"{listed([*map(repr, names)], 4)} stand{'s' * (len(names) == 1)} still bit for bit from "
            f"{begin - first:.3f} to {end - first:.3f} s, and change{'s' * (len(names) == 1)} with every sample "
            "elsewhere: a sensor that dropped out",
            span=(begin, end),
        )


def _rests(recording: Recording, name: str, span: tuple[float, float], limits: CheckLimits) -> bool:
    """True for a signal of a joint that rests meanwhile by its other signals: drives report a rest as zero velocity,
    and a torque that is computed from a position that stands is as still.
    """
    joint, _, channel = name.rpartition(".")
    if joint not in recording.joints or recording.velocity is None:
        return False
    inside, at = (recording.time >= span[0]) & (recording.time <= span[1]), recording.index(joint)
    moved = float(np.ptp(recording.position[inside, at]))
    if channel == "effort":
        return moved == 0.0
    silent = recording.velocity[:, at] == 0.0
    return moved < limits.rests and bool(silent[inside].all() and not silent.all())


def _signals(recording: Recording) -> Iterator[tuple[str, Array]]:
    for channel in ("position", "velocity", "effort"):
        values = getattr(recording, channel)
        if values is not None:
            yield from ((f"{joint}.{channel}", values[:, i]) for i, joint in enumerate(recording.joints))
    if recording.imu is not None:
        for quantity in ("angular_velocity", "linear_acceleration"):
            rows = getattr(recording.imu, quantity)
            yield from ((f"imu.{quantity}.{axis}", rows[:, i]) for i, axis in enumerate("xyz"))


def _longest_repeat(time: Array, values: Array, limits: CheckLimits) -> tuple[float, float] | None:
    """Begin and end of the longest repetition of a lively signal, if it is too long."""
    changes = np.flatnonzero(np.diff(values))
    edges = np.concatenate([[-1], changes, [len(values) - 1]])
    runs = np.diff(edges)  # samples of equal value
    at = int(np.argmax(runs))
    begin, end = time[edges[at] + 1], time[edges[at + 1]]
    others = len(values) - runs[at]
    lively = others > 1 and len(runs) - 1 >= limits.lively * others
    return (float(begin), float(end)) if lively and end - begin > limits.stuck and runs[at] > 5 else None


# -- the IMU by itself ----------------------------------------------------------------------------------------------


def _orientation(imu: Imu, time: Array, limits: CheckLimits) -> Iterator[Finding]:
    """Compares the vertical from the orientation with that from the accelerometer, on average in IMU axes."""
    if imu.orientation is None:
        return
    quaternion = _thin(imu.orientation, limits.samples)
    block = blocks_of(_thin(time, limits.samples), limits.block)
    force = block_means(_thin(imu.linear_acceleration, limits.samples), block)

    def angle(xyzw: Array) -> float:
        up = block_means(upwards(xyzw), block)
        across, along = np.linalg.norm(np.cross(up, force), axis=1), (up * force).sum(axis=1)
        return float(np.median(np.arctan2(across, along)))

    now = angle(quaternion)
    if now <= limits.upright:
        return
    ways = {
        "the quaternion seems to be in the order w, x, y, z": ("wxyz", quaternion[:, [1, 2, 3, 0]]),
        "the quaternion seems to be of the world in the IMU's frame, the inverse": (
            "inverse",
            quaternion * [-1, -1, -1, 1],
        ),
    }
    angles = {why: angle(other) for why, (_, other) in ways.items()}
    why = min(angles, key=lambda w: angles[w])
    text = f"the IMU's orientation has up {np.degrees(now):.0f}° off its own accelerometer"
    if angles[why] < limits.upright:
        yield Finding("orientation", f"{text}: {why}", mend=Mend(f"{why}, and put right", quaternion=ways[why][0]))
    else:
        yield Finding("orientation", text)


# -- all sensors together -------------------------------------------------------------------------------------------


def _contradictions(blocks: Instants, model: ConsistencyModel) -> Iterator[Finding]:
    if not len(blocks):
        return
    footing = Footing(model.robot, blocks)
    now = model.evaluate(footing)
    faults = list(now.faults())
    if now.hangs:
        yield _hanging(footing, now, model)
    elif not faults:
        yield from _in_motion(footing, model)
    elif (found := explain(blocks, model)) is not None:
        others = "".join(f", or {other.text}" for other in found.others)
        text = f"{found.hypothesis.text}{others}: as recorded, {listed(faults, 3)}; otherwise {_fit(found.without)}"
        mend = None if found.others else found.hypothesis.mend
        yield Finding(found.hypothesis.cause, text, found.hypothesis.option, mend)
    else:
        who = "encoders, torques and IMU" if now.imu else "encoders and torques"
        yield Finding("contradiction", f"{who} contradict each other: {listed(faults, 3)}{_outlier(now)}")


def _or_other_robot(finding: Finding, recording: Recording, robot: Robot) -> Finding:
    """The finding; torques in another unit may be those of another robot, whose log is not scaled."""
    others = carried_by_others(recording, robot) if finding.cause == "torque_unit" else ()
    if not others:
        return finding
    names = " or ".join(
        f"{other.name} ({other.mass:.3g} kg, its legs carry {other.carried:.3g})" for other in others[:2]
    )
    text = f"the robot is another one, perhaps {names}; or {finding.message}"
    return Finding(finding.cause, text, f"--robot {others[0].name}, or {finding.option or '--gear RATIO'}")


def _in_motion(footing: Footing, model: ConsistencyModel) -> Iterator[Finding]:
    found = explain_motion(footing, model)
    if found is None or found.hypothesis.torques_alone:
        order = tuple(_torque_order(footing, model))
        yield from order
        if order or found is None:
            return
    late = late_imu(footing, model.limits)
    if late is not None and late.gain.mean > found.gain.mean:
        text = (
            f"the IMU seems to be about {abs(1e3 * late.late):.0f} ms {'late' if late.late > 0.0 else 'early'} against "
            f"the joints: shifted by that, feet that carry do not slide and the trunk is in balance "
            f"({late.gain.deviations:.1f} standard deviations)"
        )
        yield Finding("imu_late", text)
        return
    if not found.fits:
        return
    others = "".join(f", or {other.text}" for other in found.others)
    text = (
        f"{found.hypothesis.text}{others}: as recorded, feet that carry slide at {100 * found.slides:.2g} cm/s and the "
        f"trunk is out of balance; otherwise at {100 * found.would_slide:.2g} cm/s, and in balance "
        f"({found.gain.deviations:.1f} standard deviations)"
    )
    mend = None if found.others else found.hypothesis.mend
    yield Finding(found.hypothesis.cause, text, found.hypothesis.option, mend)


def _torque_order(footing: Footing, model: ConsistencyModel) -> Iterator[Finding]:
    """Torques of legs that are swapped with those of others, certain in motion and a doubt at rest, and a torque that
    jumps.
    """
    limits = model.limits
    found, step = swapped_in_motion(footing, limits), torque_step(footing, limits)
    if found is not None and (step is None or found.gain > step.deviations**2):
        yield _swapped(found)
    elif step is not None:
        yield _jump(step)
    else:
        for push in pushing_at_rest(footing, limits):
            yield Finding("pushing", f"{push}; let the robot sway to decide it")


def _swapped(found: SwappedTorques) -> Finding:
    why = found.hypothesis
    text = f"{why.text}: with them in the right order the trunk balances as it moves"
    odds = f"{text} (likelihood higher by e^{0.5 * found.gain:.0f}, allowing for friction and other errors of models)"
    if found.certain:
        return Finding(why.cause, odds, why.option, why.mend)
    return Finding(why.cause, f"{odds}; or something pushes or pulls the robot, which looks alike", why.option)


def _jump(step: TorqueStep) -> Finding:
    first, *others = map(repr, step.joints)
    text = f"the torque of {first}{''.join(f' or {other}' for other in others[:2])} jumps"
    how = f"by {step.size:.3g} N·m at about {step.time:.1f} s, which neither the motion nor a load explains"
    said = f"{text} {how} ({step.deviations:.1f} standard deviations)"
    return Finding("torque_step", f"{said}; or something pushes or pulls the robot since then, which looks alike")


def _hanging(footing: Footing, now: Consistency, model: ConsistencyModel) -> Finding:
    """Distinguishes a robot in the air from torques that are too small.

    In the air the torques only carry the legs; on the ground, in whatever unit, they follow those for a quarter of the
    robot's weight on each foot.
    """
    blocks, columns = footing.blocks, footing.legs.columns
    effort, a = blocks.effort[:, columns], footing.specific_force
    statics = footing.legs.statics(blocks.position[:, columns], footing.up)
    push = 0.25 * model.robot.mass * a
    taken = (statics.torque(a) - (statics.jacobian * push.T[:, None, None]).sum(axis=0)).transpose(2, 0, 1)
    size = float(np.sqrt((effort**2).sum() * (taken**2).sum())) or 1.0
    factor = float((taken**2).sum() / ((effort * taken).sum() or 1.0))
    if (effort * taken).sum() / size > model.limits.standing_torques:
        text = (
            f"the torques are those of a robot on its feet, but about {factor:.2g} times too small: of motors before "
            "the gear, or in another unit"
        )
        return Finding("torque_unit", text, "--gear RATIO")
    return Finding(
        "not_on_feet",
        f"the feet carry {now.weighs:.2g} kg of {model.robot.mass:.3g} kg: the robot is not on its feet but in the "
        "air, which is a log for `stadera identify`",
    )


def _outlier(now: Consistency) -> str:
    """Names the one of three sources of the vertical that disagrees with the other two."""
    if not now.imu:
        return "; check the joints' names, and the torques' signs and units"
    close, far = np.radians(15.0), np.radians(25.0)
    if now.plane_force_angle < close and now.plane_angle > far:
        return "; the feet's plane and their forces agree, so that it is the IMU's frame that seems wrong"
    if now.plane_angle < close and now.force_angle > far:
        return "; IMU and the feet's plane agree, so that it is the torques that seem wrong"
    if max(now.plane_force_angle, now.plane_angle, now.force_angle) < close and (now.loads > 0).all():
        return "; all directions agree, so that it is the torques' unit or scale, or the model, that seems wrong"
    return "; check the joints' names, the torques' signs and units, and the IMU's frame"


def _thin(values: Array, most: int) -> Array:
    return values[:: -(-len(values) // most)]


def _fit(figures: Consistency) -> str:
    return f"it would weigh {figures.weighs:.3g} kg, the model {figures.robot.mass:.3g} kg, and nothing contradicts"
