"""What the beginning of a bag decides about all of it: who publishes which joints, whether the IMU can be used."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from stadera.errors import RecordingError
from stadera.recording.bag_events import Event
from stadera.recording.columns import IMU_COLUMNS
from stadera.recording.publishers import Publisher, publishers
from stadera.recording.ros_messages import ImuState, JointState

HEAD = 2000
"""Messages of joints that are looked at."""
CLOCKS_APART = 1.0
"""s between the clocks of two topics' headers, above which they are not put together."""

_MOST_AHEAD = 100_000  # messages looked at for the first one of an IMU
_IMU_NAMES = tuple(name for names in IMU_COLUMNS.values() for name in names)


@dataclass(frozen=True, eq=False)
class Beginning:
    """A bag's first messages, and what they decide.

    Attributes:
        events: the messages.
        publishers: of the joints, the one whose stamps count first.
        imu_columns: what the IMU tells, by the flat table's names; empty without an IMU.
        imu_frame: frame_id of its messages, None where empty.
        imu_fault: why an IMU that is there cannot be used; empty where it can.
        clock_offset: of the IMU's headers against the joints', by the time of recording [s]; NaN without an IMU.
    """

    events: tuple[Event, ...]
    publishers: tuple[Publisher, ...]
    imu_columns: tuple[str, ...]
    imu_frame: str | None
    imu_fault: str
    clock_offset: float


def first_events(events: Iterable[Event], *, imu: bool) -> tuple[Event, ...]:
    """The first messages: so many of joints, and one of an IMU if there is to be one."""
    head: list[Event] = []
    joints, imus = 0, 0
    for event in events:
        head.append(event)
        joints += isinstance(event.state, JointState)
        imus += isinstance(event.state, ImuState)
        if (joints >= HEAD and (imus or not imu)) or len(head) >= _MOST_AHEAD:
            break
    return tuple(head)


def beginning_of(events: Sequence[Event], source: str, joints: Sequence[str] | None, *, imu: bool) -> Beginning:
    """What the first messages decide.

    Args:
        events: the first messages.
        source: topic of the joints, for messages.
        joints: that are asked for, None for all.
        imu: whether there is a topic of an IMU.

    Raises:
        RecordingError: no message of joints, or publishers that do not agree.
    """
    states = [event.state for event in events if isinstance(event.state, JointState)]
    if not states:
        raise RecordingError(f"{source}: no message can be read")
    said = [event.state for event in events if isinstance(event.state, ImuState)]
    offset = _clock_offset(events)
    fault = _fault(said, offset) if imu else ""
    return Beginning(
        events=tuple(events),
        publishers=publishers(states, source, joints),
        imu_columns=_imu_columns(said) if imu and not fault else (),
        imu_frame=(said[0].frame or None) if imu and not fault else None,
        imu_fault=fault,
        clock_offset=offset,
    )


def _fault(said: Sequence[ImuState], offset: float) -> str:
    if not said:
        return "it has no messages that can be read"
    if other := next((state.frame for state in said if state.frame != said[0].frame), None):
        return f"its messages are in two frames, {said[0].frame!r} and {other!r}"
    if missing := [name for name in _IMU_NAMES[:6] if name not in _imu_columns(said)]:
        return f"it tells no {missing[0].removeprefix('imu.')}"
    if abs(offset) > CLOCKS_APART:
        return f"the clock of its headers is {offset:+.3f} s off that of the joints'"
    return ""


def _imu_columns(said: Sequence[ImuState]) -> tuple[str, ...]:
    known = np.isfinite(np.stack([state.values for state in said])).sum(axis=0) > 0
    return tuple(name for name, there in zip(_IMU_NAMES, known.tolist(), strict=True) if there)


def _clock_offset(events: Sequence[Event]) -> float:
    """The IMU's stamps less the joints', each against the time of recording, medians [s]."""
    early = {kind: [e.state.stamp - e.received for e in events if isinstance(e.state, kind)]
             for kind in (JointState, ImuState)}  # fmt: skip
    if not all(early.values()):
        return float("nan")
    return 1e-9 * float(np.median(early[ImuState]) - np.median(early[JointState]))
