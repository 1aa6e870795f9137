"""Checks of single signals: units, by joint limits, gravity and slopes of the positions; gaps in time, and signals that
stop.
"""

from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np

from stadera.checks.finding import Finding
from stadera.checks.instants import Instants
from stadera.checks.limits import CheckLimits
from stadera.constants import GRAVITY
from stadera.errors import listed
from stadera.logs.mend import ACCELEROMETER, Mend
from stadera.logs.recording import Imu, Recording
from stadera.logs.sampling import GAP_FACTOR, usual_step
from stadera.logs.units import FACTORS
from stadera.robot.model import Leg, Robot
from stadera.types import Array, Bools

DEGREE = FACTORS["position"]["deg"]
# of a velocity in this unit, taken for rad/s; of one in rad/s that is taken for deg/s
_RATIOS = {"deg/s": 1.0 / DEGREE, "rpm": 30.0 / np.pi, "rad/ms": 1e-3, "mrad/s": 1e3, "rad/s": DEGREE}


def unit_findings(
    recording: Recording, robot: Robot, blocks: Instants | None = None, limits: CheckLimits | None = None
) -> tuple[Finding, ...]:
    """Finds values in other units than SI or with the wrong sign, for any motion; `blocks` are the recording's instants
    with all joints that both have, None to compute them.
    """
    limits = limits or CheckLimits()
    blocks = blocks or Instants.of(recording, [j for j in robot.tree.joints if j in recording.joints], None, limits)
    found = [*time_findings(recording, limits), *position_findings(recording, robot, limits)]
    if not found and blocks.joints and len(recording) > 1:
        found += velocity_findings(blocks, limits)
    imu = recording.imu if recording.time[-1] - recording.time[0] >= limits.stride else None
    gravity = () if imu is None else gravity_findings(imu, limits)
    return (*found, *gravity)


def time_findings(recording: Recording, limits: CheckLimits) -> Iterator[Finding]:
    """Detects time that is not in seconds."""
    if len(recording) < 2:
        return
    step = float(np.median(np.diff(recording.time)))
    least, most = limits.steps
    factors = FACTORS["time"]
    unit = next((u for u in ("ms", "us", "ns") if least <= factors[u] * step <= most), None)
    if step >= limits.slow and unit is not None:
        mend = Mend(f"time taken to be in {unit}", factors={"time": factors[unit]})
        text = f"samples are {step:.3g} s apart: time seems to be in {unit}, not in s"
        yield Finding("time_unit", text, f"--units {unit}", mend)


def position_findings(recording: Recording, robot: Robot, limits: CheckLimits) -> Iterator[Finding]:
    """Detects joint positions in degrees, of all legs or of some: beyond the limits, and within them once converted."""

    def in_degrees(leg: Leg) -> bool:
        beyond, converted = (
            [_beyond(recording, robot, joint, factor, limits) for joint in leg.joints] for factor in (1.0, DEGREE)
        )
        # a hip may stay within a few degrees, thigh and knee do not
        return sorted(beyond)[-2] > limits.turns and max(converted) < 0.5 * limits.turns

    legs = [leg for leg in robot.legs if set(leg.joints) <= set(recording.joints)]
    degrees = [leg for leg in legs if in_degrees(leg)]
    if not degrees:
        return
    joints = [joint for leg in degrees for joint in leg.joints]
    far, most = max(((j, _beyond(recording, robot, j, 1.0, limits)) for j in joints), key=lambda pair: pair[1])
    evidence = f"{far!r} would be {most:.3g} rad beyond its limits"
    if len(degrees) == len(legs):
        mend = Mend("joint positions taken to be in degrees", factors={"position": DEGREE})
        yield Finding("position_unit", f"joint positions seem to be in degrees: {evidence}", "--units deg", mend)
        return
    whose = f"joint positions of {' and '.join(leg.name for leg in degrees)}"
    mend = Mend(f"{whose} taken to be in degrees", joint_factors={("position", joint): DEGREE for joint in joints})
    text = f"{whose} seem to be in degrees, those of the other legs in radians: {evidence}"
    yield Finding("position_unit", text, "--columns MAP.toml with their unit", mend)


def limit_findings(recording: Recording, robot: Robot, limits: CheckLimits) -> Iterator[Finding]:
    """Legs beyond their joints' limits, and within them with another sign of some: signs, or another joint's values.

    For legs in the air, whose torques say little of what is whose.
    """
    for leg in robot.legs:
        if not set(leg.joints) <= set(recording.joints):
            continue
        beyond, turned = (
            np.array([_beyond(recording, robot, joint, sign, limits) for joint in leg.joints]) for sign in (1.0, -1.0)
        )
        out = beyond > limits.outside
        if out.any() and (turned[out] < limits.outside).all():
            wrong = [repr(joint) for joint, so in zip(leg.joints, out, strict=True) if so]
            text = (
                f"leg {leg.name}: {', '.join(wrong)} {'are' if len(wrong) > 1 else 'is'} {max(beyond):.2f} "
                "rad beyond the joint's limits, and within them with the other sign: the sign is reversed, or the "
                "values are another joint's"
            )
            yield Finding("joint_signs", text, "--columns MAP.toml with factor = -1 or the right names")


def _beyond(recording: Recording, robot: Robot, joint: str, factor: float, limits: CheckLimits) -> float:
    """Angle by which a joint is beyond its limits for half of the time [rad]."""
    found, most = robot.limits[joint], limits.unlimited
    bounded = bool(np.isfinite([found.lower, found.upper]).all())
    lower, upper = (max(found.lower, -2 * most), min(found.upper, 2 * most)) if bounded else (-most, most)
    q = factor * recording.position[:, recording.index(joint)]
    beyond = np.maximum(np.maximum(q - upper, lower - q), 0.0)
    return float(np.median(beyond)) if 2 * np.count_nonzero(beyond) >= len(q) - 1 else 0.0


def velocity_findings(blocks: Instants, limits: CheckLimits) -> Iterator[Finding]:
    """Compares joint velocities with the slopes of the positions: unit, sign, order."""
    if blocks.velocity is None or not len(blocks) or not np.isfinite(blocks.rate).all():
        return
    rate, velocity = _without_spikes(blocks.rate), _without_spikes(blocks.velocity)
    moves = np.sqrt((rate**2).mean(axis=0)) > limits.turning
    both = (rate * velocity).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = both / (rate**2).sum(axis=0)
        correlation = both / np.sqrt((rate**2).sum(axis=0) * (velocity**2).sum(axis=0))
    related = moves & (np.abs(correlation) > limits.correlation)

    for unit, ratio in _RATIOS.items():
        if (so := related & (np.abs(slope / ratio - 1.0) < limits.unit_tolerance)).any():
            found = f"{np.median(slope[so]):.3g} times the slopes of the positions"
            yield _velocity_unit(unit, 1.0 / ratio, found, _chosen(blocks, so) if (moves & ~so).any() else ())
    if (wrong := related & (slope < 0)).any():
        everywhere = not (moves & ~wrong).any()
        joints = blocks.joints if everywhere else _chosen(blocks, wrong)
        whose = "all joints" if everywhere else _listed(joints)
        text = f"the sign of the velocities of {whose} is reversed: positions move the other way"
        mend = Mend(f"sign of the velocities of {whose} turned", joint_factors={("velocity", j): -1.0 for j in joints})
        yield Finding("velocity_unit", text, "--columns MAP.toml with factor = -1", mend)
    if (strange := moves & ~related & velocity.any(axis=0)).any():
        whose = f"velocities of {_listed(_chosen(blocks, strange))}"
        text = f"{whose} are not the slopes of their positions: their columns are swapped, or belong to other joints"
        without = "--columns MAP.toml without velocities, which are then made of the positions"
        yield Finding("velocity_order", text, without)


def _velocity_unit(unit: str, factor: float, found: str, joints: Sequence[str]) -> Finding:
    """Velocities in another unit, of some joints; none for all."""
    whose = f"velocities of {_listed(joints)}" if joints else "joint velocities"
    option = "--columns MAP.toml with their unit" if joints else f"--units velocity={unit}"
    all_of_them, some = {} if joints else {"velocity": factor}, {("velocity", joint): factor for joint in joints}
    mend = Mend(f"{whose} taken to be in {unit}", all_of_them, some)
    seem = f"seem to be in {unit}{', and to be taken for deg/s' * (unit == 'rad/s')}"
    return Finding("velocity_unit", f"{whose} {seem}: {found}", "" if unit == "rad/ms" else option, mend)


def _chosen(blocks: Instants, chosen: Bools) -> list[str]:
    return [joint for joint, one in zip(blocks.joints, chosen, strict=True) if one]


def _listed(joints: Sequence[str]) -> str:
    return listed([*map(repr, joints)], 3)


def _without_spikes(values: Array) -> Array:
    """Values (instants, n) clipped at three times the 95 % quantile of each column."""
    largest = 3.0 * np.quantile(np.abs(values), 0.95, axis=0)
    return np.clip(values, -largest, largest)


def gravity_findings(imu: Imu, limits: CheckLimits) -> Iterator[Finding]:
    """Checks that the mean specific force is gravity: its unit, and whether gravity was removed."""
    size = float(np.median(np.linalg.norm(imu.linear_acceleration, axis=1)))
    mean = float(np.linalg.norm(imu.linear_acceleration.mean(axis=0)))
    # of a lively robot the norms are too large on average, and the whole log's mean too small where it turns
    starts = np.arange(0, len(imu.linear_acceleration), limits.gravity_samples)
    sums = np.add.reduceat(imu.linear_acceleration, starts, axis=0)
    counts = np.diff(starts, append=len(imu.linear_acceleration))[:, None]
    lately = float(np.median(np.linalg.norm(sums / counts, axis=1)))
    if min(abs(value - GRAVITY) for value in (size, mean, lately)) < limits.gravity:
        return
    option, mend = "", None
    factors = FACTORS["accelerometer"]
    unit = next((u for u in ("g", "mg") if abs(factors[u] * mean / GRAVITY - 1.0) < 0.1), None)
    if unit is not None:
        why = f"it seems to be in units of {unit}; m/s² are needed"
        option = f"--units {unit}"
        mend = Mend(f"specific force taken to be in {unit}", factors={ACCELEROMETER: factors[unit]})
    elif mean < 0.5:
        why = "gravity seems to have been taken out; what an accelerometer reads itself is needed"
        if imu.orientation is not None:
            mend = Mend("gravity put back into the specific force by the IMU's orientation", gravity=True)
    else:
        why = "its unit or scale is wrong"
    text = f"the specific force is {size:.3g} m/s² where gravity is {GRAVITY:g} m/s²: {why}"
    yield Finding("imu_gravity", text, option, mend)


def dropouts(time: Array) -> Iterator[Finding]:
    """Finds gaps in time (samples,) [s]."""
    steps = np.diff(time)
    wide = np.flatnonzero(steps > GAP_FACTOR * usual_step(time)) if len(steps) else np.empty(0, dtype=np.int64)
    if len(wide):
        longest = wide[np.argmax(steps[wide])]
        yield Finding(
            "dropout",
            f"{len(wide)} gap{'s' * (len(wide) > 1)} in time of more than {GAP_FACTOR:g} samples, "
            f"{steps[wide].sum():.3g} s altogether, the longest {steps[longest]:.3g} s at "
            f"{time[longest] - time[0]:.3f} s: sensors or the logger dropped out",
        )


def sensor_findings(recording: Recording, limits: CheckLimits) -> Iterator[Finding]:
    """Finds gaps in time, torques and a gyro that are zero, and signals that repeat bit for bit for a while but not
    elsewhere.
    """
    yield from dropouts(recording.time)
    if recording.effort is not None:
        silent = [j for j, values in zip(recording.joints, recording.effort.T, strict=True) if not values.any()]
        if silent:
            yield Finding("no_torque", f"the torque of {listed([*map(repr, silent)], 4)} is zero throughout")
    moves = bool((np.ptp(recording.position, axis=0) > limits.rests).any())
    if moves and recording.imu is not None and not recording.imu.angular_velocity.any():
        yield Finding("no_gyro", "the gyro is zero throughout, so how the trunk turns is not known")
    groups: dict[tuple[float, float], list[str]] = {}
    arrays = ("position", "velocity", "effort", "others.effort", "imu.angular_velocity", "imu.linear_acceleration")
    known = [(recording.columns(name), values.T) for name, values in recording.arrays().items() if name in arrays]
    for name, values in chain.from_iterable(zip(*each, strict=True) for each in known):
        span = _longest_repeat(recording.time, values, limits)
        if span is not None and not _rests(recording, name, span, limits):
            groups.setdefault(span, []).append(repr(name))
    for span, names in groups.items():
        s = "s" * (len(names) == 1)
        text = f"{listed(names, 4)} stand{s} still bit for bit, and change{s} with every sample elsewhere"
        yield Finding("stuck", f"{text}: a sensor that dropped out", spans=(span,))


def _rests(recording: Recording, name: str, span: tuple[float, float], limits: CheckLimits) -> bool:
    """True for a signal of a joint that rests meanwhile by its other signals: friction holds it within a step of its
    encoder, drives report a rest as zero velocity, and a torque that is computed from a position that stands is as
    still. A torque of zero of a joint outside the legs is not known (`stadera.trunk.limbs`).
    """
    joint, _, channel = name.rpartition(".")
    others, inside = recording.others, (recording.time >= span[0]) & (recording.time <= span[1])
    if others is not None and others.effort is not None and joint in others.names:
        at = others.names.index(joint)
        return not np.ptp(others.position[inside, at]) or not others.effort[inside, at].any()
    if joint not in recording.joints or recording.velocity is None:
        return False
    at = recording.index(joint)
    moved, measured = float(np.ptp(recording.position[inside, at])), recording.velocity[inside, at]
    if channel == "effort":
        return moved == 0.0
    if channel == "position":
        moved = float(np.ptp(np.cumsum(measured[1:] * np.diff(recording.time[inside]))))
    elif measured.any():
        return False
    return moved < limits.rests and bool(recording.velocity[:, at].any())


def _longest_repeat(time: Array, values: Array, limits: CheckLimits) -> tuple[float, float] | None:
    """Begin and end of the longest repetition of a lively signal, if it is too long."""
    edges = np.concatenate([[-1], np.flatnonzero(np.diff(values)), [len(values) - 1]])
    runs = np.diff(edges)  # samples of equal value
    at = int(np.argmax(runs))
    begin, end = time[edges[at] + 1], time[edges[at + 1]]
    others = len(values) - runs[at]
    lively = others > 1 and len(runs) - 1 >= limits.lively * others
    return (float(begin), float(end)) if lively and end - begin > limits.stuck and runs[at] > 5 else None
