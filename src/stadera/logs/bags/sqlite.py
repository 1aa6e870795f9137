"""Reads rosbag2's sqlite3 files."""

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing, suppress
from pathlib import Path

from stadera.boundary import foreign
from stadera.errors import RecordingError
from stadera.limits import Budget
from stadera.logs.bags.container import Message, Topic, salvaged


class SqliteFile:
    """Topics and messages of a .db3 file."""

    name, suffix, magic, encoding = "sqlite3 bag", ".db3", b"SQLite format 3\0", "cdr"

    def topics(self, path: Path, budget: Budget) -> dict[str, Topic]:
        """See `Container`."""
        definitions: dict[str, str] = {}
        try:
            with foreign(path, "no bag that can be read"), closing(_open(path, budget)) as database:
                rows = database.execute("SELECT name, type, serialization_format FROM topics").fetchall()
                with suppress(sqlite3.Error):  # older bags have no definitions
                    query = "SELECT topic_type, encoded_message_definition FROM message_definitions"
                    definitions = {kind: str(text) for kind, text in database.execute(query) if text}
        except RecordingError:
            budget.check_time()
            raise
        return {str(n): Topic(str(kind), definitions.get(kind, "")) for n, kind, form in rows if form == self.encoding}

    def messages(self, path: Path, topics: Collection[str], damage: list[str], budget: Budget) -> Iterator[Message]:
        """See `Container`."""
        return salvaged(path, _rows(path, topics, budget), _message, lambda read: f"{read} messages", damage, budget)


def _message(row: tuple[str, object, object]) -> tuple[Message]:
    """A row's message; the columns of a sqlite table hold values of any type."""
    topic, received, data = row
    if not (isinstance(received, int) and isinstance(data, bytes)):
        raise RecordingError(f"a message is {type(data).__name__} at {type(received).__name__}")
    return (Message(topic, received, data),)


def _rows(path: Path, topics: Collection[str], budget: Budget) -> Iterator[tuple[str, object, object]]:
    with closing(_open(path, budget)) as database:
        names = {number: str(name) for number, name in database.execute("SELECT id, name FROM topics")}
        wanted = [number for number, name in names.items() if name in topics]
        # in the order of the rows, which is that of recording: an index might be damaged
        query = (
            f"SELECT topic_id, timestamp, data FROM messages WHERE +topic_id IN ({','.join('?' * len(wanted))}) "
            "ORDER BY id"
        )
        for number, received, data in database.execute(query, wanted):
            yield names[number], received, data


def _open(path: Path, budget: Budget) -> sqlite3.Connection:
    """Opens the database such that no value is longer and no query takes longer than the budget allows. Raises
    RecordingError: topics or messages are not plain tables: a view or virtual table computes its rows, possibly without
    end.
    """
    database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
    database.setlimit(
        sqlite3.SQLITE_LIMIT_LENGTH, min(int(budget.limits.unpacked), 1_000_000_000)
    )  # sqlite's own limit
    database.set_progress_handler(lambda: budget.is_over, 100_000)  # operations between two checks
    database.execute("PRAGMA trusted_schema=OFF")
    # without this, sqlite rejects a file that is shorter than its header states
    database.execute("PRAGMA writable_schema=ON")
    stored = dict(database.execute("SELECT name, type = 'table' AND rootpage > 0 FROM sqlite_master"))
    if computed := next((name for name in ("topics", "messages") if not stored.get(name, 1)), None):
        raise RecordingError(f"{path}: {computed} is no table but computed from others, which no recorder does")
    return database
