"""Chooses the topics of a bag: by type, by the requested joints and by namespace; else the user must choose."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice

from stadera.errors import RecordingError
from stadera.logs.bags.container import BagSettings, Message, Topic
from stadera.logs.bags.decode import IMU, JOINT_STATE, decoder, has_states, is_low_state, joints_in
from stadera.logs.topics import Topics

_SLOW_TWIN = "lf"
"""Unitree's robots publish /lf/lowstate, the same messages at a lower rate, in addition to /lowstate."""


@dataclass(frozen=True)
class Offer:
    """What a log offers: its name for messages, the encoding of its messages, its topics, and a function that yields
    the first messages of some of them. A stream is not `whole`: the few messages of each attempt tell no rate.
    """

    source: str
    encoding: str
    topics: Mapping[str, Topic]
    first: Callable[[Sequence[str]], Iterable[Message]]
    whole: bool = True


@dataclass(frozen=True)
class Choice:
    """The topics to read: of the joints' states; of the IMU, None if there is none, or if the joints' messages include
    it; and notes on the topics chosen and others available.
    """

    joint: str
    imu: str | None
    notes: tuple[str, ...]


def choose(offer: Offer, topics: Topics, joints: Sequence[str] | None, settings: BagSettings) -> Choice:
    """Chooses the topics of joints and IMU. Raises RecordingError: a topic does not exist or has another type, there is
    none of joints, or several match.

    Of several topics of joints, Unitree's slow copies are excluded, then those without the requested joints. Of several
    IMUs, the one in the joints' namespace is read.
    """
    found = offer.topics
    states = _states(offer, topics.joint)
    joint = topics.joint
    if joint is not None:
        _check_asked(offer, states, joint, "--joint-topic", "of joints' states")
    else:
        joint = _joint_topic(offer, states, joints, settings)
    imu = None
    if not is_low_state(found[joint]) or topics.imu not in (None, joint):
        imu = _imu_topic(offer, topics.imu, joint, states, settings)
    own = "the same messages" if is_low_state(found[joint]) else "none"
    read = f"joints read from {joint} ({found[joint].kind}), IMU from {imu or own}"
    others = sorted(set(states) - {joint})
    left = f"; other topics of joints: {', '.join(others)}; --joint-topic chooses" if others else ""
    return Choice(joint, imu, (read + left,))


def _states(offer: Offer, asked: str | None) -> list[str]:
    """Topics of joints' states; those of unusual types only if there are no others or one is requested."""
    usual = [name for name, topic in offer.topics.items() if topic.kind == JOINT_STATE or is_low_state(topic)]
    if usual and asked in (None, *usual):
        return sorted(usual)
    others = ((name, topic) for name, topic in offer.topics.items() if name not in usual)
    return sorted([*usual, *(name for name, topic in others if has_states(topic, offer.encoding))])


def _joint_topic(offer: Offer, states: Sequence[str], joints: Sequence[str] | None, settings: BagSettings) -> str:
    if not states:
        there = ", ".join(f"{name} ({topic.kind})" for name, topic in sorted(offer.topics.items())) or "none"
        raise RecordingError(
            f"{offer.source}: no topic of type unitree_go/msg/LowState or {JOINT_STATE}, nor of another one with "
            f"names, positions and efforts of joints; topics: {there}"
        )
    fitting = [name for name in states if _fast_twin(name) not in states]
    if len(fitting) == 1:
        return fitting[0]
    found = _measured(offer, fitting, joints, settings)
    whole = [name for name in fitting if joints and found[name][1].issuperset(joints)]
    if len(whole) == 1:
        return whole[0]
    said = ", ".join(found[name][0] for name in whole or fitting)
    raise RecordingError(f"{offer.source}: several topics of joints' states: {said}; choose one with --joint-topic")


def _imu_topic(offer: Offer, asked: str | None, joint: str, states: Sequence[str], settings: BagSettings) -> str | None:
    fitting = sorted(name for name, topic in offer.topics.items() if topic.kind == IMU)
    if asked is not None:
        _check_asked(offer, fitting, asked, "--imu-topic", f"of type {IMU}")
        return asked
    # the IMU belongs to the topic of joints with which it shares most of its namespace
    own = [name for name in fitting if all(_shared(name, joint) >= _shared(name, other) for other in states)]
    nearest = max((_shared(name, joint) for name in own), default=0)
    own = [name for name in own if _shared(name, joint) == nearest]
    if len(own) > 1:
        said = ", ".join(text for text, _ in _measured(offer, own, None, settings).values())
        raise RecordingError(f"{offer.source}: several topics of {IMU}: {said}; choose one with --imu-topic")
    return own[0] if own else None


def _fast_twin(name: str) -> str:
    """The topic of which this one may be the slow copy."""
    parts = name.split("/")
    return "/".join(part for part in parts if part != _SLOW_TWIN) if _SLOW_TWIN in parts[:-1] else ""


def _shared(one: str, other: str) -> int:
    """Number of namespaces that two topics have in common."""
    parts = zip(one.strip("/").split("/")[:-1], other.strip("/").split("/")[:-1], strict=False)
    return next((k for k, (a, b) in enumerate(parts) if a != b), min(one.count("/"), other.count("/")) - 1)


def _check_asked(offer: Offer, fitting: Sequence[str], asked: str, option: str, what: str) -> None:
    listed = f"topics {what}: {', '.join(fitting) or 'none'}"
    if asked not in offer.topics:
        raise RecordingError(f"{offer.source}: {option} {asked}: no such topic; {listed}")
    if asked not in fitting:
        raise RecordingError(f"{offer.source}: {option} {asked} is a {offer.topics[asked].kind}; {listed}")


def _measured(
    offer: Offer, names: Sequence[str], joints: Sequence[str] | None, settings: BagSettings
) -> dict[str, tuple[str, set[str]]]:
    """By topic, its description, with the rate of a whole log, and the joints in it, measured at the beginning."""
    first: dict[str, list[Message]] = {name: [] for name in names}
    for message in islice(offer.first(names), settings.most_ahead):
        if len(first[message.topic]) < settings.head:
            first[message.topic].append(message)
        elif all(len(messages) > 1 for messages in first.values()):
            break
    found = {}
    for name, messages in first.items():
        topic, rate = offer.topics[name], ", fewer than two messages"
        if not offer.whole:
            rate = ""
        elif len(messages) > 1 and (span := messages[-1].received - messages[0].received):
            rate = f", {1e9 * (len(messages) - 1) / span:.4g} Hz"
        known: set[str] = set()
        decode = decoder(topic, offer.encoding, joints, settings)
        for message in messages[:8] if topic.kind != IMU else ():
            with suppress(Exception):  # the libraries raise many kinds of errors on damaged bytes
                known.update(joints_in(decode([message])[0].columns))
        found[name] = f"{name} ({topic.kind}{rate}{f', {len(known)} joints' if known else ''})", known
    return found
