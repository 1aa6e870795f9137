"""rosbag2's sqlite3 files; one that is cut off or damaged is read as far as it goes."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path

from stadera.errors import RecordingError
from stadera.recording.bag import Message

MAGIC = b"SQLite format 3\0"
ENCODING = "cdr"


class SqliteStorage:
    """Topics and messages of a .db3 file."""

    def topics(self, path: Path) -> dict[str, str]:
        """See `stadera.recording.bag.Storage`."""
        try:
            with closing(_open(path)) as database:
                rows = database.execute("SELECT name, type, serialization_format FROM topics").fetchall()
        except sqlite3.Error as error:
            raise RecordingError(f"{path}: no bag that can be read ({error})") from None
        return {str(name): str(kind) for name, kind, encoding in rows if encoding == ENCODING}

    def messages(self, path: Path, topics: Collection[str], damage: list[str]) -> Iterator[Message]:
        """See `stadera.recording.bag.Storage`."""
        read = 0
        try:
            with closing(_open(path)) as database:
                names = dict(database.execute("SELECT id, name FROM topics").fetchall())
                wanted = {number: str(name) for number, name in names.items() if name in topics}
                marks = ",".join("?" * len(wanted))
                # in the order of the rows, which is that of recording: an index might be what is damaged
                query = f"SELECT topic_id, timestamp, data FROM messages WHERE +topic_id IN ({marks}) ORDER BY id"
                for number, received, data in database.execute(query, tuple(wanted)):
                    yield Message(wanted[number], received, data)
                    read += 1
        except sqlite3.Error as error:
            damage.append(f"{path}: cut off or damaged after {read} messages ({error}); read up to there")


def _open(path: Path) -> sqlite3.Connection:
    database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
    # without this, sqlite refuses a file that is shorter than its header says altogether
    database.execute("PRAGMA writable_schema=ON")
    return database
