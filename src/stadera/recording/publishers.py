"""Who publishes which joints: several may share a topic, and each may name its joints in any order."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.recording.ros_messages import JointState

Array = NDArray[np.float64]

_CHANNELS = ("position", "velocity", "effort")


@dataclass(frozen=True, eq=False)
class Publisher:
    """Joints that come in one message.

    Attributes:
        joints: in the order of the first message.
        present: (3 joints,), which of their positions, velocities, efforts are ever numbers.
    """

    joints: tuple[str, ...]
    present: NDArray[np.bool_]

    @property
    def columns(self) -> tuple[str, ...]:
        """What a row holds, by the flat table's names."""
        names = (f"{joint}.{channel}" for channel in _CHANNELS for joint in self.joints)
        return tuple(name for name, there in zip(names, self.present, strict=True) if there)

    def row(self, state: JointState) -> Array:
        """The values of a message with these joints; NaN where a channel is left empty."""
        return _in_order(state, self.joints)[self.present]


def publishers(states: Iterable[JointState], source: str, joints: Sequence[str] | None) -> tuple[Publisher, ...]:
    """The publishers behind some messages, the one with most of the joints first.

    Args:
        states: from the beginning of a log.
        source: of the messages, for errors.
        joints: that are asked for; publishers of none of them are left out, unless it is all. None: all joints.

    Raises:
        RecordingError: a joint that two publishers have, or that a message names twice, or messages without joints.
    """
    order: dict[frozenset[str], tuple[str, ...]] = {}
    present: dict[frozenset[str], NDArray[np.bool_]] = {}
    for state in states:
        key = frozenset(state.names)
        if len(key) < len(state.names):
            twice = next(name for name in state.names if state.names.count(name) > 1)
            raise RecordingError(f"{source}: a JointState names joint {twice!r} twice")
        if not key:
            continue
        names = order.setdefault(key, state.names)
        present[key] = present.get(key, False) | ~np.isnan(_in_order(state, names))
    if not order:
        raise RecordingError(f"{source}: its messages name no joints")
    asked = frozenset(joints or ()) & frozenset().union(*order)
    kept = [key for key in order if not asked or key & asked]
    for i, key in enumerate(kept):
        for other in kept[:i]:
            if both := sorted(key & other):
                raise RecordingError(
                    f"{source}: joint {both[0]!r} comes in messages of {len(other)} and in messages of {len(key)} "
                    "joints: two publishers that do not agree share the topic"
                )
    kept.sort(key=lambda key: -len(key & asked if asked else key))
    return tuple(Publisher(order[key], present[key]) for key in kept)


def _in_order(state: JointState, joints: tuple[str, ...]) -> Array:
    place = {name: i for i, name in enumerate(state.names)}
    order = [place[joint] for joint in joints]
    blank = np.full(len(order), np.nan)
    return np.concatenate([values[order] if len(values) else blank for values in state.channels])
