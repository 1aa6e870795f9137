"""Records received and sent messages as an MCAP file that every command of this package reads."""

import threading
import time
from pathlib import Path

from stadera.live import messages
from stadera.live.state import LiveState
from stadera.live.topics import KINDS, Arrival

_JSON = "json"


class MessageRecorder:
    """Writes one file, which is complete after `close`; thread-safe."""

    def __init__(self, path: Path) -> None:
        from mcap.writer import Writer

        self._file, self._lock = path.open("wb"), threading.Lock()
        self._writer, self._channels = Writer(self._file, chunk_size=1 << 18), dict[str, int]()
        self._writer.start(profile="ros2", library="stadera")

    def keep(self, arrival: Arrival) -> None:
        """Writes a received message, with its time of sending as time of recording."""
        if arrival.kind in KINDS:
            self._write(arrival.topic, arrival.kind, arrival.received, arrival.data)

    def sent(self, state: LiveState) -> None:
        """Writes the messages sent for a state."""
        now = time.time_ns()
        for topic, data in messages.of_state(state).items():
            self._write(f"/{topic}", _JSON if topic == messages.STATE else messages.KINDS[topic], now, data)

    def close(self) -> None:
        """Completes the file with its index."""
        with self._lock:
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._file.close()

    def _write(self, topic: str, kind: str, stamp: int, data: bytes) -> None:
        with self._lock:
            if topic not in self._channels:
                self._channels[topic] = self._channel(topic, kind)
            self._writer.add_message(self._channels[topic], stamp, data, stamp)

    def _channel(self, topic: str, kind: str) -> int:
        if kind == _JSON:
            return self._writer.register_channel(topic, "json", 0)
        definition = messages.types().generate_msgdef(kind, ros_version=2)[0].encode()
        return self._writer.register_channel(topic, "cdr", self._writer.register_schema(kind, "ros2msg", definition))
