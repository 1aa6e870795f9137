"""Zenoh session: finds and subscribes to topics, publishes states, answers requests.

Everything is published with the topic's name as key ("stadera/trunk"), which zenoh-bridge-ros2dds and plain Zenoh
programs read. After the first message from rmw_zenoh, also with rmw_zenoh's keys in its domain, attachments and tokens.
"""

from __future__ import annotations

import json
import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from stadera.errors import StaderaError, of_extra
from stadera.live import keys, messages
from stadera.live.keys import Key, Sent
from stadera.live.session import Answer
from stadera.live.state import LiveState
from stadera.live.topics import KINDS, Arrival
from stadera.logs.bags.decode import IMU, JOINT_STATE
from stadera.logs.bags.unitree import LOW_STATES
from stadera.logs.topics import Topics

if TYPE_CHECKING:
    import zenoh

_EPOCH = datetime.fromtimestamp(0, UTC)

DEFAULT = "tcp/localhost:7447"
"""Default address of rmw_zenoh's router and of zenoh-bridge-ros2dds."""


@dataclass(frozen=True)
class Endpoints:
    """Connection to the Zenoh network."""

    # connect, listen: endpoints such as "tcp/192.168.123.18:7447". Without any of them and without a file: `DEFAULT`.
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    # base Zenoh configuration file (JSON5); None for Zenoh's defaults. Multicast scouting, which would reach
    # every robot on the network, is off unless the file asks for it.
    config: Path | None = None

    def open(self) -> zenoh.Session:
        """Opens a session; connections are made, and restored, in the background. MissingExtraError if zenoh is not
        installed, StaderaError if it rejects an endpoint or the file.
        """
        with of_extra("eclipse-zenoh", "live", "stadera live"):
            import zenoh
        try:
            return zenoh.open(self._configured())
        except zenoh.ZError as error:
            reason = re.sub(r" at /\S+\.rs:\d+\.?", "", " ".join(str(error).split()))  # position in Zenoh's source
            given = ", ".join(map(str, (*self.connect, *self.listen, *([self.config] if self.config else []))))
            raise StaderaError(f"Zenoh cannot be started with {given or 'its defaults'}: {reason}") from None

    def _configured(self) -> zenoh.Config:
        import zenoh

        config = zenoh.Config() if self.config is None else zenoh.Config.from_file(self.config)
        connect = self.connect or (() if self.listen or self.config else (DEFAULT,))
        if config.get_json("scouting/multicast/enabled") == "null":  # a file may ask for it
            config.insert_json5("scouting/multicast/enabled", "false")
        if self.config is None or self.listen:
            config.insert_json5("listen/endpoints", json.dumps(list(self.listen)))
        if connect:
            config.insert_json5("connect/endpoints", json.dumps(list(connect)))
        return config


class ZenohLink:
    """Topics of a session, in and out. `announced` has, by name, types of the topics that publishers have announced.

    Args:
        topics: the requested ones.
        put: receives every message of a known type, in Zenoh's thread; None to read none.
        requests: by key, the handler of a request, passed to `ask`, which queues it, with the reply function.
    """

    def __init__(
        self,
        endpoints: Endpoints,
        topics: Topics,
        put: Callable[[Arrival], None] | None,
        requests: dict[str, Callable[[], Answer]],
        ask: Callable[[Callable[[], Answer], Callable[[Answer], None]], None],
    ) -> None:
        self._put, self._ask, self._requests = put, ask, requests
        self.announced: dict[str, str] = {}
        joints = LOW_STATES[0] if (topics.joint or "").lower().endswith("lowstate") else JOINT_STATE
        asked = {topics.imu: IMU, topics.joint: joints} if put is not None else {}
        self._asked = {name.strip("/"): kind for name, kind in asked.items() if name is not None}
        self._by_key: dict[str, Key] = {}
        self._to_subscribe: set[str] = set()
        self._subscribed: set[str] = set()
        self._lock = threading.Lock()
        self._ros: _RosNames | None = None
        self._heard: Key | None = None
        self._session = endpoints.open()
        self._callbacks: list[threading.Event] = []
        self._open()

    def publish(self, state: LiveState) -> None:
        """Publishes a state, see `stadera.live.messages.of_state`."""
        self._follow_announcements()
        for topic, data in messages.of_state(state).items():
            self._session.put(topic, data)
            if self._ros is not None:
                self._ros.put(topic, messages.text_message(data.decode()) if topic == messages.STATE else data)

    def close(self, patience: float = 2.0) -> None:
        """Closes the session; returns when no callback can run any more, or after `patience` [s] for each."""
        self._session.close()  # type: ignore[no-untyped-call]
        for ended in self._callbacks:  # their threads must end before the interpreter does
            ended.wait(patience)

    # -- inside -----------------------------------------------------------------------------------------------
    def _open(self) -> None:
        session = self._session
        for kind in KINDS if self._put is not None else ():
            session.declare_subscriber(f"*/**/{keys.dds_type(kind)}/*", self._calling(self._arrived))
        for key, kind in self._asked.items():  # a plain key does not contain its type, and no token may arrive
            self._by_key[key] = Key(f"/{key}", kind)
            self._to_subscribe.add(key)
        self._follow_announcements()
        for tokens in keys.TOKENS if self._put is not None else ():
            session.liveliness().declare_subscriber(tokens, self._calling(self._announced), history=True)
        for key, do in self._requests.items():
            session.declare_queryable(key, self._answering(do))

    def _arrived(self, sample: zenoh.Sample) -> None:
        name = str(sample.key_expr)
        key = self._by_key.get(name) or self._by_key.setdefault(name, keys.read_key(name))
        if key.domain is not None and self._heard is None:
            self._heard = key
        sent = _sent(sample)
        received = sent.stamp if sent is not None else _stamp(sample)
        assert self._put is not None
        self._put(Arrival(key.topic, key.kind, received, sample.payload.to_bytes(), time.monotonic(), sent))

    def _announced(self, sample: zenoh.Sample) -> None:
        import zenoh

        found = keys.read_token(str(sample.key_expr))
        if found is None or found[1].topic.startswith("/stadera/"):
            return
        name, key = found
        if sample.kind == zenoh.SampleKind.DELETE:
            self.announced.pop(key.topic, None)
            return
        self.announced[key.topic] = key.kind
        if key.domain is None and key.kind in KINDS:  # keys of rmw_zenoh are subscribed to by their types
            with self._lock:
                self._by_key[name] = key
                self._to_subscribe.add(name)

    def _follow_announcements(self) -> None:
        """Subscribes to announced topics, and starts answering rmw_zenoh once it has been detected.

        Must not be called in Zenoh's threads, which cannot declare anything.
        """
        with self._lock:
            new, self._to_subscribe = self._to_subscribe - self._subscribed, set()
        for key in new:
            self._session.declare_subscriber(key, self._calling(self._arrived))
            self._subscribed.add(key)
        if self._ros is None and self._heard is not None and self._heard.domain is not None:
            self._ros = _RosNames(self._session, self._heard.domain, self._heard.type_hash == keys.NO_HASH)
            for topic, do in self._requests.items():
                self._session.declare_queryable(self._ros.keys[topic], self._answering(do), complete=True)

    def _calling(self, function: Callable[[Any], None]) -> Any:
        """A handler that calls a function in a separate thread, so that the network never waits."""
        from zenoh.handlers import Callback

        ended = threading.Event()
        self._callbacks.append(ended)
        return Callback(function, ended.set)

    def _answering(self, do: Callable[[], Answer]) -> Any:
        def answer(query: zenoh.Query) -> None:
            sent = _sent(query)
            attachment = None if sent is None else keys.attachment(sent._replace(stamp=time.time_ns()))

            def reply(found: Answer) -> None:
                data = messages.answer_message(found.success, found.message)
                with query:
                    query.reply(query.key_expr, data, attachment=attachment)

            self._ask(do, reply)

        return self._calling(answer)


class _RosNames:
    """Our topics and services under rmw_zenoh's keys, announced by its tokens."""

    def __init__(self, session: zenoh.Session, domain: int, without_hash: bool) -> None:
        self._session = session
        self.keys = {
            topic: keys.topic_key(domain, topic, kind, keys.NO_HASH if without_hash else messages.type_hash(kind))
            for topic, kind in messages.KINDS.items()
        }
        own = str(session.zid())
        tokens = [keys.token(domain, own, 0, "NN")]
        for entity, (topic, key) in enumerate(self.keys.items(), start=1):
            what = "SS" if messages.KINDS[topic] == messages.TRIGGER else "MP"
            tokens.append(keys.token(domain, own, entity, what, key))
        self._tokens = [session.liveliness().declare_token(token) for token in tokens]
        self._publisher = {topic: uuid4().bytes for topic in self.keys}
        self._numbers = dict.fromkeys(self.keys, 0)

    def put(self, topic: str, data: bytes) -> None:
        self._numbers[topic] += 1
        sent = Sent(self._numbers[topic], time.time_ns(), self._publisher[topic])
        self._session.put(self.keys[topic], data, attachment=keys.attachment(sent))


def _sent(message: zenoh.Sample | zenoh.Query) -> Sent | None:
    attached = message.attachment
    return None if attached is None else keys.read_attachment(attached.to_bytes())


def _stamp(sample: zenoh.Sample) -> int:
    """Time of sending from Zenoh's timestamp, which the bridge's router adds; else now [ns]."""
    if sample.timestamp is None:
        return time.time_ns()
    return (sample.timestamp.get_time() - _EPOCH) // timedelta(microseconds=1) * 1000
