"""Checks a log's signals against each other, window by window, to locate a fault by channel, joint and time.

Joint by joint, in windows of a second:

- velocity against change of position. Over steps of T = 20 ms, D = Δq / T and M = ∫ q̇ dt / T are equal except for
  noise. Their correlation ρ = Σ DM / √(Σ D² Σ M²) and gain g = Σ DM / Σ D² are 1 wherever the joint moves.
- jump of the position: a single step of q that is missing in ∫ q̇ dt, and that is not reversed soon after. Where three
  joints or more of several legs jump at once, samples are missing, and no encoder's zero is another afterwards.
- impossible torque: several times the drive's limit, or above it and apart from all others of the joint.
- clipped torque: a signal that changes with every sample elsewhere but repeats its maximum bit for bit.
- torque that is only noise: means over 5 and 20 ms are uncorrelated, while those of the other torques are correlated.

Velocity, jumps and noise are looked at where the samples resolve the motion: between those of a trot at 50 Hz a knee
turns by 0.1 to 0.3 rad that no velocity shows, and a hip's torque changes at will.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Self

import numpy as np
from numpy.typing import NDArray

from stadera.body import Body, Motion
from stadera.checks.finding import Finding
from stadera.checks.limits import WindowLimits
from stadera.constants import GRAVITY, MEDIAN_OF_CHI2
from stadera.errors import listed
from stadera.logs.recording import Recording
from stadera.logs.sampling import GAP_FACTOR
from stadera.robot.model import Robot
from stadera.robot.shapes import FLAT
from stadera.trust import Verdict
from stadera.types import Array, Bools

_Jump = tuple[str, float, float]  # joint, time [s], size [rad]
_Wrong = tuple[str, str, tuple[tuple[float, float], ...]]  # joint, how its velocity is wrong, and when
_UNLIKE, _SCALED = "not the change of position", "{:.2g} times the change of position"


@dataclass(frozen=True, eq=False)
class Windows:
    """Division of a log into windows."""

    edges: Array  # (windows + 1,) [s]
    of_sample: NDArray[np.int64]  # (samples,), index of each sample's window

    @classmethod
    def of(cls, time: Array, length: float) -> Self:
        """Divides the time into equal windows of about this length [s], at most one a sample: of a log in µs too."""
        count = max(1, min(round(float(time[-1] - time[0]) / length), len(time)))
        edges = np.linspace(time[0], time[-1], count + 1)
        return cls(edges, np.clip(np.searchsorted(edges, time, side="right") - 1, 0, count - 1))

    def __len__(self) -> int:
        return len(self.edges) - 1

    @property
    def span(self) -> float:
        """Time of all windows [s]."""
        return float(self.edges[-1] - self.edges[0])

    def sums(self, values: Array, where: NDArray[np.int64]) -> Array:
        """Sums over windows (windows, k) of values (n, k) in the windows `where` (n,)."""
        return np.column_stack([np.bincount(where, column, len(self)) for column in values.T])

    def spans(self, chosen: Bools) -> tuple[tuple[float, float], ...]:
        """Begin and end of the chosen windows."""
        return tuple((float(self.edges[k]), float(self.edges[k + 1])) for k in np.flatnonzero(chosen))


def window_faults(recording: Recording, robot: Robot, limits: WindowLimits | None = None) -> tuple[Finding, ...]:
    """Finds contradictions between the signals of each joint of a log with all of the robot's joints, window by window.
    Velocities as measured, None if they were not.
    """
    limits = limits or WindowLimits()
    if len(recording) < limits.fewest:
        return ()
    windows, joints = Windows.of(recording.time, limits.length), robot.tree.joints
    resolved = _resolved(recording.channel("position", joints), limits)
    found: list[Finding] = []
    if recording.velocity is not None and resolved:
        some = (joints[k : k + limits.at_once] for k in range(0, len(joints), limits.at_once))
        jumps, wrong = zip(*(_by_velocity(recording, names, windows, limits) for names in some), strict=True)
        near = limits.undone * float(np.median(np.diff(recording.time)))
        found += [*_of_jumps([*chain(*jumps)], robot, near, limits), *_of_velocities(chain(*wrong))]
    if recording.effort is not None:
        effort = recording.channel("effort", joints)
        for check in (_beyond, _clipped):
            found += check(effort, robot, windows, limits)
        tested = resolved & (np.abs(_holding(recording, robot)) > _white(effort))
        found += _noise(effort, robot, windows, limits, tested)
    return tuple(found)


def _of_jumps(jumps: Sequence[_Jump], robot: Robot, near: float, limits: WindowLimits) -> Iterator[Finding]:
    """Findings of jumps; those within a time [s] of each other, in several legs, are one that is worth a note."""
    leg_of, missing = {joint: leg.name for leg in robot.legs for joint in leg.joints}, list[float]()
    for joint, at, size in jumps:
        others = [leg_of.get(name) for name, when, _ in jumps if abs(when - at) <= near]
        if len(others) >= limits.together and len(set(others)) > 1:
            missing.append(at)
        else:
            text = f"the position of {joint!r} jumps by {size:.2g} rad"
            yield Finding("position", text, spans=((at, at),), lasting=True)
    if missing:
        text = "positions of several joints jump at once: samples are missing"
        yield Finding("position", text, at=min(missing))


def _of_velocities(wrong: Iterable[_Wrong]) -> Iterator[Finding]:
    """One finding for all joints whose velocities are wrong in the same way at the same times."""
    alike: dict[tuple[str, tuple[tuple[float, float], ...]], list[str]] = {}
    for joint, text, spans in wrong:
        alike.setdefault((text, spans), []).append(repr(joint))
    for (text, spans), names in alike.items():
        whose = listed(names, 3)
        said = f"the velocities of {whose} are {text}" if names[1:] else f"the velocity of {whose} is {text}"
        yield Finding("velocity", said, spans=spans)


def _resolved(position: Array, limits: WindowLimits) -> bool:
    """Whether positions (samples, n) turn by less from one step to the next than what counts as a jump, but for a few
    samples, and for one joint, whose encoder may be broken.

    Of 60 simulated trots half do at 100 Hz, and all but one at 200; of 30 crawls 24 at 60 Hz, and all at 100.
    """
    turns = sorted(float(np.quantile(np.abs(np.diff(own, 2)), 1.0 - limits.few)) for own in position.T)
    return max(turns[:-1], default=0.0) < limits.jump


def with_verdicts(
    faults: Sequence[Finding], duration: float, limits: WindowLimits
) -> Iterator[tuple[Finding, Verdict | None]]:
    """Yields each fault of parts of a log with its verdict on the log; None if these are skipped instead.

    They are skipped as long as all skipped ones cover a small part of the log [s].
    """
    out: set[tuple[float, float]] = set()
    for fault in sorted(faults, key=lambda fault: len(fault.spans)):
        with_it = out | set(fault.spans)
        if fault.lasting:
            yield fault, "doubtful"
        elif sum(end - begin for begin, end in with_it) <= limits.left_out * duration:
            out = with_it
            yield fault, None
        else:
            yield fault, "bad"


def _by_velocity(
    recording: Recording, joints: tuple[str, ...], windows: Windows, limits: WindowLimits
) -> tuple[list[_Jump], list[_Wrong]]:
    """Jumps of these joints' positions, and velocities that are not the change of the positions."""
    time, q = recording.time, recording.channel("position", joints)
    step = np.diff(time)[:, None]
    v = recording.channel("velocity", joints)
    way = np.vstack([np.zeros(len(joints)), np.cumsum(0.5 * (v[1:] + v[:-1]) * step, axis=0)])  # ∫ q̇ dt
    period = float(np.median(step))
    m = max(1, round(limits.step / period))
    span = time[m:] - time[:-m]
    whole = span < GAP_FACTOR * m * period
    by_q, by_v = ((x[m:] - x[:-m])[whole] / span[whole, None] for x in (q, way))
    where = windows.of_sample[m:][whole]
    apart = np.abs(by_q - by_v)
    spike = apart > limits.spike * np.median(apart, axis=0)
    by_q, by_v = (np.where(spike & (spike.mean(axis=0) < limits.few), 0.0, x) for x in (by_q, by_v))
    dd, mm, dm = (windows.sums(product, where) for product in (by_q**2, by_v**2, by_q * by_v))
    count = np.maximum(np.bincount(where, minlength=len(windows)), 1)[:, None]
    noise = np.hypot(np.sqrt(2.0) * _white(q) / limits.step, _white(v) / np.sqrt(m))
    moving = np.sqrt(np.maximum(dd, mm) / count) > np.maximum(limits.moving, limits.above * noise)
    correlation = dm / np.maximum(np.sqrt(dd * mm), 1e-12)
    gain = np.where(dd > 1e-12, dm / np.maximum(dd, 1e-12), 0.0)
    still = (mm < limits.still**2 * dd) | (dd < limits.still**2 * mm)
    unlike = still | (correlation < limits.correlation)
    scaled = ~unlike & ((gain < limits.gain[0]) | (gain > limits.gain[1]))
    wrong_anywhere = (moving & (unlike | scaled)).sum(axis=0) > 1
    jumps = list(_jumps(np.where(wrong_anywhere, 0.0, q - way), np.diff(way, axis=0), time, joints, limits))
    found: list[_Wrong] = []
    for j, joint in enumerate(joints):
        for wrong, said in ((unlike, _UNLIKE), (scaled, _SCALED)):
            chosen = moving[:, j] & wrong[:, j]
            if chosen.any():
                found.append((joint, said.format(float(np.median(gain[chosen, j]))), windows.spans(chosen)))
    return jumps, found


def _white(values: Array) -> Array:
    """Standard deviation of each column's white noise, from third differences, to which smooth motion hardly
    contributes.
    """
    return np.sqrt(np.median(np.diff(values, 3, axis=0) ** 2, axis=0) / (20.0 * MEDIAN_OF_CHI2))


def _jumps(apart: Array, way: Array, time: Array, joints: tuple[str, ...], limits: WindowLimits) -> Iterator[_Jump]:
    """Yields each joint's first step of the position that the velocity lacks, except spikes, whose end reverses their
    beginning: of `apart` (samples, n), position minus ∫ q̇ dt [rad], with steps `way` of the latter (samples - 1, n).
    """
    step, gaps = np.diff(apart, axis=0), np.diff(time)
    usual, period = np.median(np.abs(step), axis=0), np.median(gaps)
    nearby = np.max([np.abs(way), np.abs(np.roll(way, 1, axis=0)), np.abs(np.roll(way, -1, axis=0))], axis=0)
    big = np.abs(step) > np.maximum(limits.jump, 20.0 * usual + limits.late * nearby)
    big &= (gaps < GAP_FACTOR * period)[:, None]
    for j, joint in enumerate(joints):
        for k in np.flatnonzero(big[:, j])[: limits.most]:
            before, later = max(k - limits.undone, 0), min(k + 1 + limits.undone, len(apart) - 1)
            size, rest = float(step[k, j]), float(apart[later, j] - apart[before, j])
            if limits.kept < rest / size < 1.0 / limits.kept:
                yield joint, float(time[k]), rest
                break


def _beyond(effort: Array, robot: Robot, windows: Windows, limits: WindowLimits) -> Iterator[Finding]:
    strongest = limits.weights * robot.mass * GRAVITY * robot.leg_length
    for j, joint in enumerate(robot.tree.joints):
        size, limit = np.abs(effort[:, j]), robot.limits[joint].effort
        apart = limits.apart * max(limit, float(np.quantile(size, limits.most_usual)))
        wild = size > min(limits.beyond * limit, strongest, apart)
        if wild.any():
            chosen = np.bincount(windows.of_sample[wild], minlength=len(windows)) > 0
            peak = float(size.max())
            text = f"is up to {peak:.3g} N·m in {np.count_nonzero(wild)} samples, more than any drive of it gives"
            yield Finding("effort", f"the torque of {joint!r} {text}", spans=windows.spans(chosen))


def _clipped(effort: Array, robot: Robot, windows: Windows, limits: WindowLimits) -> Iterator[Finding]:
    for j, joint in enumerate(robot.tree.joints):
        values = effort[:, j]
        for end in (values.max(), values.min()):
            at = values == end
            own = abs(abs(float(end)) / robot.limits[joint].effort - 1.0) < limits.own_limit
            if np.count_nonzero(at) < limits.repeats or own:
                continue
            others = np.diff(values[~at])
            if not len(others):
                continue
            lively = np.count_nonzero(others) >= limits.lively * len(others)
            next_to_it = values[~at][np.argmin(np.abs(values[~at] - end))]  # for a quantised signal the next level
            crowded = at.sum() > limits.crowd * np.count_nonzero(values == next_to_it)
            if lively and crowded and (at[1:] & at[:-1]).any():
                chosen = np.bincount(windows.of_sample[at], minlength=len(windows)) > 0
                text = f"stands at its largest value, {float(end):.3g} N·m, in {at.sum()} samples: it is clipped"
                yield Finding("effort", f"the torque of {joint!r} {text}", spans=windows.spans(chosen))
                break


def _holding(recording: Recording, robot: Robot) -> Array:
    """Torques (n,) [N·m] of joints in legs on flat feet while the robot stands upright in its mean posture, each foot
    with as much of its weight in the middle; infinite in other legs, whose joints all carry a point foot's force. A
    joint that holds next to nothing then, such as an ankle's roll, may be idle for a whole log.
    """
    out, joints = np.full(len(robot.tree.joints), np.inf), robot.tree.joints
    flat = [k for k, leg in enumerate(robot.legs) if leg.contact == FLAT]
    if not flat:
        return out
    up, still, body = np.array([0.0, 0.0, 1.0]), np.zeros((1, 3)), Body.of(robot, others=False)
    position = recording.channel("position", joints).mean(axis=0, keepdims=True)
    none = np.zeros_like(position)
    state = body.at(Motion(position, none, none, still, still, GRAVITY * up[None], up))
    for k in flat:
        J = list(body.legs[k])
        arm = np.cross(state.axis[0, J], state.feet[0, k] - state.origin[0, J])
        out[J] = state.torque[0, J] - GRAVITY * robot.mass / len(robot.legs) * arm[:, 2]
    return out


def _noise(effort: Array, robot: Robot, windows: Windows, limits: WindowLimits, tested: Bools) -> Iterator[Finding]:
    """Detects noise, whose successive means are uncorrelated over short times and over long ones, `averaged`; swings of
    a trot change sign within the long ones. `tested` (n,): joints that are not idle. One that is as noisy while its
    torque means something has a sensor that works, and carries nothing since a load has moved the weight, say.
    """
    found = [_correlation(effort, windows, round(windows.span / time)) for time in limits.averaged]
    correlation = np.max([own for own, _, _ in found], axis=0)
    _, holds, count = found[-1]
    for j in np.flatnonzero(tested):
        joint, others = robot.tree.joints[j], np.median(np.delete(correlation, j, axis=1), axis=1)
        chosen = (correlation[:, j] < limits.white) & (others > limits.coloured) & (count > limits.fewest)
        chosen &= holds[:, j] < limits.holds
        if np.count_nonzero(chosen) <= min(1, len(windows) - 1):  # a joint may be idle for a moment
            continue
        works = (holds[:, j] >= limits.holds) | (correlation[:, j] > limits.coloured)
        noise, usual = (_noise_in(effort[:, j], windows, of) for of in (chosen, works))
        if not usual / limits.as_noisy < noise < usual * limits.as_noisy:
            yield Finding("effort", f"the torque of {joint!r} is only noise", spans=windows.spans(chosen))


def _noise_in(values: Array, windows: Windows, chosen: Bools) -> float:
    """Standard deviation of the white noise of values (samples,) in these windows, zero without any."""
    return float(_white(values[chosen[windows.of_sample]])) if chosen.any() else 0.0


def _correlation(effort: Array, windows: Windows, parts: int) -> tuple[Array, Array, Array]:
    """Correlation ρ = 1 - Σ (τ_k+1 - τ_k)² / 2 Σ (τ_k - τ̄)² of successive ones of so many means, (windows, n); their
    mean over its standard deviation, likewise, as a joint that rests holds something, and one that carries little does
    so for longer; and their number (windows,).
    """
    edges = np.linspace(0, len(effort), min(len(effort), parts) + 1).astype(np.int64)
    of_mean = windows.of_sample[edges[:-1]]
    number = np.bincount(of_mean, minlength=len(windows)).astype(float)
    count, same = np.maximum(number, 1)[:, None], of_mean[1:] == of_mean[:-1]
    own = np.add.reduceat(effort, edges[:-1]) / np.diff(edges)[:, None]
    mean = windows.sums(own, of_mean) / count
    away = np.maximum(windows.sums((own - mean[of_mean]) ** 2, of_mean), 1e-300)
    steps = windows.sums(np.diff(own, axis=0)[same] ** 2, of_mean[1:][same])
    return 1.0 - 0.5 * steps / away, count * np.abs(mean) / np.sqrt(away), number
