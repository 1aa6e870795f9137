"""rosbag2's sqlite3 files."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing, suppress
from pathlib import Path

from stadera.errors import RecordingError
from stadera.logs.bags.container import Message, Topic, salvaged


class SqliteFile:
    """Topics and messages of a .db3 file."""

    name, suffix, magic, encoding = "sqlite3 bag", ".db3", b"SQLite format 3\0", "cdr"

    def topics(self, path: Path) -> dict[str, Topic]:
        """See `Container`."""
        definitions: dict[str, str] = {}
        try:
            with closing(_open(path)) as database:
                rows = database.execute("SELECT name, type, serialization_format FROM topics").fetchall()
                with suppress(sqlite3.Error):  # older bags have no definitions
                    query = "SELECT topic_type, encoded_message_definition FROM message_definitions"
                    definitions = dict(database.execute(query).fetchall())
        except sqlite3.Error as error:
            raise RecordingError(f"{path}: no bag that can be read ({error})") from None
        return {str(n): Topic(str(kind), definitions.get(kind, "")) for n, kind, form in rows if form == self.encoding}

    def messages(self, path: Path, topics: Collection[str], damage: list[str]) -> Iterator[Message]:
        """See `Container`."""
        messages = _messages(path, topics)
        return salvaged(path, messages, lambda message: (message,), lambda read: f"{read} messages", damage)


def _messages(path: Path, topics: Collection[str]) -> Iterator[Message]:
    with closing(_open(path)) as database:
        names = {number: str(name) for number, name in database.execute("SELECT id, name FROM topics")}
        wanted = [number for number, name in names.items() if name in topics]
        # in the order of the rows, which is that of recording: an index might be what is damaged
        query = (
            f"SELECT topic_id, timestamp, data FROM messages WHERE +topic_id IN ({','.join('?' * len(wanted))}) "
            "ORDER BY id"
        )
        for number, received, data in database.execute(query, wanted):
            yield Message(names[number], received, data)


def _open(path: Path) -> sqlite3.Connection:
    database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
    # without this, sqlite refuses a file that is shorter than its header says altogether
    database.execute("PRAGMA writable_schema=ON")
    return database
