"""Samples of a log as they were taken: without those that repeat the joints' values, of a log that is written faster
than its joints are read; and with the times at which they were taken, of one that was stamped when they arrived.

Between two readings of the joints these seem to rest and then to jump, and their torques are those of an earlier
instant. An IMU that is held for a few samples does no such harm.

All joints tell how long a step between two samples took: with Δq_j = v_j Δt, v_j the mean of the two velocities,

    Δt = Σ_j v_j Δq_j / Σ_j v_j²

so with J joints there are J - 1 equations to test it by. Stamps are corrected only where Δt leaves a small part of what
the stamps' steps, times one factor, leave of Δq; noise, filtered velocities and joints that do not fit leave both about
the same (a ratio of 1 to 3 on logs of a real Go2 and an Aliengo, 150 to 360 on walks of a real Mini Cheetah, where Δt
turns out to be 2 or 8 ms at stamps of 1.2 to 6 ms). In the long run time is the stamps': with e_k what they are ahead,

    e_k+1 = (1 - a) (e_k + s_k - Δt_k),      a = mean step / `memory`      (s: the stamps' steps)

so velocities that are scaled do not stretch time.

Where most stamps follow one another much faster than in the mean, samples arrive in bursts, as over Wi-Fi, and such
stamps tell nothing: steps are all alike, Δt their mean, but for gaps and as far as the motion tells otherwise.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from stadera.errors import require_positive
from stadera.logs.columns import OTHER_CHANNELS
from stadera.logs.recording import Recording, take
from stadera.types import Array, Bools


@dataclass(frozen=True)
class StampSettings:
    """When repeated samples are left out, and when and how stamps are corrected."""

    held: float = 0.05  # longest time for which joints are held [s], between readings at 20 Hz; longer is rest
    repeated: float = 0.2  # share of samples that repeat, from which on they are left out [1]: 200 Hz read at 250 Hz
    different: int = 10  # least number of different samples of joints that are held: fewer may be a robot at rest
    ratio: float = 10.0  # residual of Δq by the stamps over that by Δt, squared, above which stamps are corrected [1]
    scaled: float = 0.25  # most by which both may differ in the mean, either way [1]; more is a wrong unit, not a clock
    lively: float = 0.3  # share of the steps, those of the fastest joints, that decide [1]
    enough: int = 50  # least number of such steps
    memory: float = 1.0  # time constant with which the result follows the stamps [s], longer than samples' bursts
    # steps of the stamps above so many mean ones are kept, as joints do much during them, unless the motion tells that
    # it was a stall, after which what had gathered came at once
    gap: float = 6.0
    # longest time for which samples of a burst may have been held up [s]: a radio that saves power wakes up every
    # 0.1 s; a longer step is a gap
    stall: float = 0.25
    # median step over the mean one, without gaps, below which samples arrive in bursts [1]: 0.1 to 0.005 if ten come at
    # once, 0.48 in logs of a real Go2, two of 14 of which are doubtful if they are made even
    burst: float = 0.25
    shortest: float = 0.1  # least step, share of the mean one [1]

    def __post_init__(self) -> None:
        require_positive("setting of stamps", self, tuple(vars(self)))


def without_repeats(chunks: Iterable[Recording], settings: StampSettings | None = None) -> Iterator[Recording]:
    """Yields the consecutive parts of a log without samples that have the same positions, velocities and efforts as the
    one before; all samples where these are not known, or repeat for long. The first part with any has a note.
    """
    settings = settings or StampSettings()
    last: Array | None = None
    noted = False
    for chunk in chunks:
        if chunk.velocity is None or chunk.effort is None or not chunk.joints:
            yield chunk
            continue
        values = np.hstack([channel for name in OTHER_CHANNELS if (channel := getattr(chunk, name)) is not None])
        first = np.full_like(values[:1], np.nan) if last is None else last
        last, fresh = values[-1:], (np.diff(values, axis=0, prepend=first) != 0.0).any(axis=1)
        kept = _kept(fresh, chunk.time, settings)
        if kept.all():
            yield chunk
        elif kept.any():
            note = f"{100 * (1 - kept.mean()):.0f} % of the samples repeat the joints' values, and are left out"
            yield replace(take(chunk, kept), notes=(*chunk.notes, *([] if noted else [note])))
            noted = True


def _kept(fresh: Bools, time: Array, settings: StampSettings) -> Bools:
    """Which samples (n,) are kept, given those that differ from the one before."""
    begin = np.flatnonzero(np.concatenate([[True], fresh[1:]]))  # of runs of equal samples
    end = np.append(begin[1:], len(fresh))
    short = time[end - 1] - time[begin] <= settings.held
    repeats = ~fresh & np.repeat(short, end - begin)
    held = np.count_nonzero(fresh) >= settings.different and repeats.mean() > settings.repeated
    return ~repeats if held else np.ones(len(fresh), dtype=bool)


def with_steps_of_motion(chunks: Iterable[Recording], settings: StampSettings | None = None) -> Iterator[Recording]:
    """Yields the consecutive parts of a log with corrected times; unchanged where velocities are missing or stamps are
    as good. Where the joints stop, stamps stay as far off as they were, but for bursts. A correction is noted at the
    first part that has one.
    """
    settings, ahead, last, noted = settings or StampSettings(), 0.0, None, False  # type: ignore[assignment]
    for chunk in chunks:
        steps = None if chunk.velocity is None else _steps(chunk, last, settings)
        if chunk.velocity is not None:
            last = chunk.time[-1], chunk.position[-1], chunk.velocity[-1]
        if steps is None:  # as far off as before, so that time goes on
            yield replace(chunk, time=chunk.time - ahead) if ahead else chunk
            continue
        from scipy.signal import lfilter  # takes longer to import than most logs to read, and few need it

        stamped, true = steps
        keep = 1.0 - float(stamped.mean()) / settings.memory
        error, _ = lfilter([keep], [1.0, -keep], stamped - true, zi=[keep * ahead])
        begin = np.full(len(chunk) - len(true), ahead)
        time = chunk.time - np.concatenate([begin, error])
        if (np.diff(time) <= 0.0).any():  # velocities do not fit the positions
            yield replace(chunk, time=chunk.time - ahead) if ahead else chunk
            continue
        ahead, note = float(error[-1]), () if noted else (_note(stamped, true),)
        noted = True
        yield replace(chunk, time=time, notes=(*chunk.notes, *note))


def _note(stamped: Array, true: Array) -> str:
    jitter = 1e3 * float(np.std(stamped - true))
    return (
        f"steps between stamps are {jitter:.1f} ms (rms) off: samples were stamped when they arrived; their times are "
        "taken from the joints' motion, or are even where that tells none"
    )


def _steps(
    chunk: Recording, last: tuple[float, Array, Array] | None, settings: StampSettings
) -> tuple[Array, Array] | None:
    """Steps by the stamps, and by the motion or as even ones of bursts [s], from the sample before the chunk on if
    there is one; None if stamps are as good.
    """
    time, position, velocity = chunk.time, chunk.position, chunk.velocity
    assert velocity is not None
    if last is not None and last[1].shape == position.shape[1:]:
        time, position, velocity = (
            np.concatenate([[before], after]) for before, after in zip(last, (time, position, velocity), strict=True)
        )
    stamped, moved, mean = np.diff(time), np.diff(position, axis=0), 0.5 * (velocity[1:] + velocity[:-1])
    even, joints = _even(stamped, settings), position.shape[1]
    without_motion = None if even is None else (stamped, even)
    if joints < 2 or len(stamped) * settings.lively < settings.enough:
        return without_motion
    usual, square = float(stamped.mean()), (mean * mean).sum(axis=1)
    lively = (square > 0.0) & (square >= np.quantile(square, 1.0 - settings.lively))
    if np.count_nonzero(lively) < settings.enough:
        return without_motion
    step = np.where(square > 0.0, (mean * moved).sum(axis=1) / np.where(square > 0.0, square, 1.0), stamped)
    left = _left(moved, mean, step) * joints / (joints - 1)
    usual_left = max(float(np.median(left[lively])), 1e-300)
    fits = left < settings.ratio * usual_left
    told = fits | (stamped < settings.gap * usual)
    lively &= fits
    scale = float((step * square)[lively].sum() / (stamped * square)[lively].sum())
    ratio = float(np.median(_left(moved, mean, scale * stamped)[lively])) / usual_left
    if ratio < settings.ratio or abs(np.log(max(scale, 1e-9))) > np.log1p(settings.scaled):
        return without_motion
    likely = stamped if even is None else even
    off = float(np.average((step - likely)[lively] ** 2, weights=square[lively]))
    noise = usual_left / joints  # of one joint's Δq, squared
    trusted = off / (off + noise / np.maximum(square, 1e-300))  # slow joints tell little
    if even is not None:  # where the motion does not fit, stamps that are no burst's are no better
        trusted[~fits] = 0.0
    found = likely + trusted * (step - likely)
    return stamped, np.where(told, np.maximum(found, settings.shortest * usual), stamped)


def _even(stamped: Array, settings: StampSettings) -> Array | None:
    """Steps [s] of samples that arrive in bursts, taken to be even but for gaps; None if there are no bursts."""
    waited = stamped < settings.stall
    if np.count_nonzero(waited) < settings.enough:
        return None
    mean = float(stamped[waited].mean())
    return np.where(waited, mean, stamped) if np.median(stamped) < settings.burst * mean else None


def _left(moved: Array, mean: Array, step: Array) -> Array:
    """Sum of squares, over the joints, of Δq - v Δt."""
    return np.asarray(((moved - mean * step[:, None]) ** 2).sum(axis=1))
