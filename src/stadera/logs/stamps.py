"""Corrects stamps: of a table whose time repeats or runs back, row by row; and of a log whose samples were stamped when
they arrived, by what its joints did between them.

All joints tell how long a step between two samples took: with Δq_j = v_j Δt, v_j the mean of the two velocities,

    Δt = Σ_j v_j Δq_j / Σ_j v_j²

so with J joints there are J - 1 equations to test it by. Stamps are corrected only where Δt leaves a small part of what
the stamps' steps, times one factor, leave of Δq; noise, filtered velocities and joints that do not fit leave both about
the same (a ratio of 1 to 3 on logs of a real Go2 and an Aliengo, 150 to 360 on walks of a real Mini Cheetah, where Δt
turns out to be 2 or 8 ms at stamps of 1.2 to 6 ms). In the long run time is the stamps': with e_k what they are ahead,

    e_k+1 = (1 - a) (e_k + s_k - Δt_k),      a = mean step / `memory`      (s: the stamps' steps)

so velocities that are scaled do not stretch time.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError, require_positive
from stadera.logs.recording import Recording
from stadera.logs.sampling import GAP_FACTOR
from stadera.types import Array, Bools


@dataclass
class RowClock:
    """Makes the time of consecutive chunks of one log strictly increasing.

    A sample at most GAP_FACTOR mean steps earlier than the previous one is skipped: a repeated row, or one out of
    order. If it is further back, the clock was set back, by an unknown amount: what follows is placed after a gap. If
    more than this share of the steps so far stands still or runs back, the column is not a clock.
    """

    source: str
    most_wrong: float = 0.01
    _first: float = np.nan  # s
    _last: float = -np.inf  # s, of the last sample kept, after shifts
    _previous: float = -np.inf  # s, of the last sample read, kept or not, before shifts
    _shift: float = 0.0  # s
    _wrong: int = 0

    def __call__(self, time: Array, samples: NDArray[np.int64]) -> tuple[Array, Bools, tuple[str, ...]]:
        """Corrects a chunk's time (samples,) [s], given the samples' indices in the log. Returns time, the samples to
        keep, and notes. Raises RecordingError: too many samples repeat or run back.
        """
        raw, time, kept = time, time + self._shift, np.ones(len(time), dtype=bool)
        falls = np.diff(raw, prepend=self._previous) <= 0
        self._first = float(time[0]) if np.isnan(self._first) else self._first
        dropped, notes, at = 0, [], 0
        while at < len(time):
            wrong = np.flatnonzero(np.diff(time[at:], prepend=self._last) <= 0)
            stop = at + int(wrong[0]) if len(wrong) else len(time)
            self._last = float(time[stop - 1]) if stop > at else self._last
            if stop == len(time):
                break
            if falls[stop]:
                self._count(float(time[stop]), int(samples[stop]))
            if back := self._set_back(float(time[stop]), int(samples[stop])):
                notes.append(
                    f"time is set back at sample {samples[stop]}, {self._last - self._shift:.3f} to {raw[stop]:.3f} s: "
                    f"the log is split there, what follows is put {back:.3g} s later"
                )
                self._shift += back
                time[stop:] = raw[stop:] + self._shift
                at = stop
            else:
                kept[stop], dropped, at = False, dropped + 1, stop + 1
        self._previous = float(raw[-1]) if len(raw) else self._previous
        if dropped:
            notes.append(f"left out {dropped} samples whose time repeats or runs back")
        return time, kept, tuple(notes)

    def _set_back(self, time: float, sample: int) -> float:
        """Shift for this sample and all after it [s]; 0 for a single sample out of order."""
        gap = GAP_FACTOR * (self._last - self._first) / sample
        return 0.0 if time >= self._last - gap else self._last + 2.0 * gap - time

    def _count(self, time: float, sample: int) -> None:
        self._wrong += 1
        if self._wrong <= self.most_wrong * sample:
            return
        what = "stands still" if time == self._last else "runs back"
        raise RecordingError(
            f"{self.source}: column 'time' {what} at sample {sample} ({self._last:.6f} to {time:.6f} s)"
        )


@dataclass(frozen=True)
class StampSettings:
    """When and how stamps are corrected.

    Attributes:
        ratio: residual of Δq by the stamps over that by Δt, in squares, above which stamps are corrected [1].
        scaled: most by which both may differ in the mean, either way [1]; more is a wrong unit, not a clock.
        lively: share of the steps, those of the fastest joints, that decide [1].
        enough: least number of such steps.
        memory: time constant with which the result follows the stamps [s], longer than the bursts in which samples
            arrive.
        gap: steps of the stamps above so many mean ones are kept: joints do much during them.
        shortest: least step, share of the mean one [1].
    """

    ratio: float = 10.0
    scaled: float = 0.25
    lively: float = 0.3
    enough: int = 50
    memory: float = 1.0
    gap: float = 6.0
    shortest: float = 0.1

    def __post_init__(self) -> None:
        require_positive("setting of stamps", self, tuple(vars(self)))


def with_steps_of_motion(chunks: Iterable[Recording], settings: StampSettings | None = None) -> Iterator[Recording]:
    """Yields the consecutive parts of a log with corrected times; unchanged where velocities are missing or stamps are
    as good. Where the joints stop, stamps stay as far off as they were. A correction is noted at the first part that
    has one.
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
        f"steps between stamps are {jitter:.1f} ms (rms) off positions and velocities: samples were stamped when they "
        "arrived; their times are taken from the joints' motion"
    )


def _steps(
    chunk: Recording, last: tuple[float, Array, Array] | None, settings: StampSettings
) -> tuple[Array, Array] | None:
    """Steps by the stamps and by the motion [s], from the sample before the chunk on if there is one; None if stamps
    are as good.
    """
    time, position, velocity = chunk.time, chunk.position, chunk.velocity
    assert velocity is not None
    if last is not None and last[1].shape == position.shape[1:]:
        time, position, velocity = (
            np.concatenate([[before], after]) for before, after in zip(last, (time, position, velocity), strict=True)
        )
    stamped, moved, mean = np.diff(time), np.diff(position, axis=0), 0.5 * (velocity[1:] + velocity[:-1])
    joints = position.shape[1]
    if joints < 2 or len(stamped) * settings.lively < settings.enough:
        return None
    usual, square = float(stamped.mean()), (mean * mean).sum(axis=1)
    short = stamped < settings.gap * usual
    lively = short & (square > 0.0) & (square >= np.quantile(square, 1.0 - settings.lively))
    if np.count_nonzero(lively) < settings.enough:
        return None
    step = np.where(square > 0.0, (mean * moved).sum(axis=1) / np.where(square > 0.0, square, 1.0), stamped)
    factor = float(np.median(step[lively] / stamped[lively]))
    by_stamps = _left(moved, mean, factor * stamped)[lively]
    by_motion = _left(moved, mean, step)[lively] * joints / (joints - 1)
    ratio = float(np.median(by_stamps) / max(np.median(by_motion), 1e-300))
    scale = float((step * square)[lively].sum() / (stamped * square)[lively].sum())
    if ratio < settings.ratio or abs(np.log(max(scale, 1e-9))) > np.log1p(settings.scaled):
        return None
    noise = float(np.median(by_motion)) / joints  # of one joint's Δq, squared
    jitter = float(np.var((step - stamped)[lively]))
    trusted = jitter / (jitter + noise / np.maximum(square, 1e-300))  # slow joints tell little
    found = stamped + trusted * (step - stamped)
    return stamped, np.where(short, np.maximum(found, settings.shortest * usual), stamped)


def _left(moved: Array, mean: Array, step: Array) -> Array:
    """Sum of squares, over the joints, of Δq - v Δt."""
    return np.asarray(((moved - mean * step[:, None]) ** 2).sum(axis=1))
