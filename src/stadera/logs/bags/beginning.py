"""Determines from the beginning of a bag which topics are read and which publisher provides which columns."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stadera.errors import RecordingError
from stadera.logs.bags.container import Sample
from stadera.logs.bags.decode import IMU_NAMES
from stadera.logs.bags.settings import BagSettings
from stadera.types import Array

Columns = tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Beginning:
    """A bag's first messages and the layout derived from them. Columns are named as in the flat table."""

    samples: tuple[Sample, ...]
    # for each publisher of joints, identified by its samples' columns, the columns that ever have a value. The
    # publisher whose stamps are used comes first.
    joints: Mapping[frozenset[str], Columns]
    imu: Columns | None  # columns of the IMU's own topic; None without a usable one
    imu_frame: str | None  # frame_id of its messages, None if empty
    imu_fault: str  # why an existing IMU cannot be used; empty if it can
    # of the IMU's stamps relative to the joints', from the times of recording [s]; NaN without an IMU
    clock_offset: float

    @property
    def columns(self) -> Columns:
        """Columns of all publishers."""
        return (*(name for columns in self.joints.values() for name in columns), *(self.imu or ()))


def first_samples(
    samples: Iterable[Sample], joint_topic: str, imu_topic: str | None, settings: BagSettings
) -> tuple[Sample, ...]:
    """The first messages: a number of joints' messages, and one of an IMU if it has a topic."""
    head: list[Sample] = []
    counts = {joint_topic: 0, imu_topic: imu_topic is None}
    for sample in samples:
        head.append(sample)
        counts[sample.topic] += 1
        if (counts[joint_topic] >= settings.head and counts[imu_topic]) or len(head) >= settings.most_ahead:
            break
    return tuple(head)


def beginning_of(
    head: Sequence[Sample], joint_topic: str, imu_topic: str | None, joints: Sequence[str] | None
) -> Beginning:
    """Derives the layout for the requested joints (None: all) from the first messages. Raises RecordingError: the
    publishers contradict each other.
    """
    of_joints = [sample for sample in head if sample.topic == joint_topic]
    of_imu = [sample for sample in head if sample.topic == imu_topic]
    offset = _delay(of_joints) - _delay(of_imu)
    fault = _fault(of_imu) if imu_topic is not None else ""
    usable = bool(of_imu) and not fault
    return Beginning(
        samples=tuple(head),
        joints=_publishers(of_joints, joints, imu=imu_topic is None),
        imu=_known(of_imu) if usable else None,
        imu_frame=(of_imu[0].frame or None) if usable else None,
        imu_fault=fault,
        clock_offset=offset,
    )


def joints_in(columns: Iterable[str]) -> Columns:
    """Joints with a position among these columns."""
    return tuple(name.removesuffix(".position") for name in columns if name.endswith(".position"))


def _publishers(samples: Sequence[Sample], joints: Sequence[str] | None, *, imu: bool) -> dict[frozenset[str], Columns]:
    """Publishers of one topic, the one with most of the requested joints first.

    Publishers of none of these joints are skipped, unless all are. With `imu`, columns of an IMU in the same messages
    are kept.
    """
    groups = _grouped(samples)
    if not groups:
        raise RecordingError(f"{samples[0].topic}: its messages name no joints")
    named = {key: joints_in(group[0].columns) for key, group in groups.items()}
    asked = frozenset(joints or ()) & frozenset().union(*named.values())
    shared = {key: len(asked.intersection(named[key]) if asked else key) for key in groups}
    kept = sorted(filter(shared.get, groups), key=lambda key: -shared[key])
    _check_agreement([named[key] for key in groups if key in kept], samples[0].topic)
    left_out = () if imu else IMU_NAMES
    return {key: tuple(name for name in _known(groups[key]) if name not in left_out) for key in kept}


def _grouped(samples: Iterable[Sample]) -> dict[frozenset[str], list[Sample]]:
    """Groups samples by their columns in any order; samples without columns are skipped."""
    groups: dict[frozenset[str], list[Sample]] = {}
    for sample in samples:
        groups.setdefault(frozenset(sample.columns), []).append(sample)
    groups.pop(frozenset(), None)
    return groups


def _check_agreement(named: Sequence[Columns], topic: str) -> None:
    """Raises if two publishers have a joint in common, or one names a joint twice."""
    for k, names in enumerate(named):
        if len(set(names)) < len(names):
            twice, _ = Counter(names).most_common(1)[0]
            raise RecordingError(f"{topic}: a message names joint {twice!r} twice")
        for other in named[:k]:
            if both := sorted(set(names).intersection(other)):
                raise RecordingError(
                    f"{topic}: joint {both[0]!r} comes in messages of {len(other)} and in messages of {len(names)} "
                    "joints: two publishers that do not agree share the topic"
                )


def _known(samples: Sequence[Sample]) -> Columns:
    """Columns that ever have a value, for samples with the same columns in any order."""
    ordered: dict[Columns, list[Array]] = {}
    for sample in samples:
        ordered.setdefault(sample.columns, []).append(sample.values)
    known: set[str] = set()
    for columns, values in ordered.items():
        known.update(columns[k] for k in np.flatnonzero(np.isfinite(values).any(axis=0)))
    return tuple(name for name in samples[0].columns if name in known)


def _fault(samples: Sequence[Sample]) -> str:
    if not samples:
        return "it has no messages that can be read"
    if other := next((sample.frame for sample in samples if sample.frame != samples[0].frame), None):
        return f"its messages are in two frames, {samples[0].frame!r} and {other!r}"
    if missing := [name for name in IMU_NAMES[:6] if name not in _known(samples)]:
        return f"it has no {missing[0].removeprefix('imu.')}"
    return ""


def _delay(samples: Sequence[Sample]) -> float:
    """Median time from stamp to recording [s]; NaN without samples."""
    return 1e-9 * float(np.median([s.received - s.stamp for s in samples])) if samples else float("nan")
