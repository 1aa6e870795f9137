"""Checks the sizes that pages of a Parquet file state before a library allocates memory for them.

Footer and page headers (https://parquet.apache.org/docs/file-format) are structs in Thrift's compact protocol: a field
is a byte, the difference to the last field's number above its type; integers are zigzag varints. They are parsed here
and not by pyarrow, which ends the process if the statistics of a column contradict its type.
"""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from stadera.errors import RecordingError
from stadera.limits import Budget

_STOP, _TRUE, _FALSE, _BYTE, _DOUBLE, _BINARY, _LIST, _SET, _STRUCT = 0, 1, 2, 3, 7, 8, 9, 10, 12
_INTEGERS = (4, 5, 6)
_UNPACKED, _STORED = 2, 3  # fields of a page's header [bytes]
_GROUPS, _COLUMNS, _CHUNK = 4, 1, 3  # fields of the footer, of a row group, of a column in it
_PATH, _LENGTH, _DATA, _DICTIONARY = (
    3,
    7,
    9,
    11,
)  # fields of a column's chunk: names, size and starts of its pages [bytes]
_TAIL = 8  # bytes after the footer: its length and the magic bytes
_HEADER = 1 << 16  # bytes of a page's header that are read, including statistics
_DEEPEST = 20  # nested structs


def check_pages(path: Path, columns: Collection[str], budget: Budget) -> None:
    """Checks the pages of these columns. Raises LimitError if a page's stated unpacked size exceeds the budget,
    RecordingError if it is longer than its column; IndexError, KeyError, TypeError, ValueError if footer or header are
    damaged.
    """
    with path.open("rb") as file:
        for chunk in _chunks(_footer(file)):
            budget.tick()
            if b".".join(chunk[_PATH]).decode() in columns:
                start = min(at for at in (chunk[_DATA], chunk.get(_DICTIONARY)) if at)
                _check_chunk(file, start, chunk[_LENGTH], budget)


def _footer(file: BinaryIO) -> dict[int, Any]:
    end = file.seek(-_TAIL, 2)
    length = int.from_bytes(file.read(4), "little")
    file.seek(end - length)
    return _Thrift(file.read(length)).struct()


def _chunks(footer: dict[int, Any]) -> Iterator[dict[int, Any]]:
    """The fields of every column's chunk."""
    for group in footer[_GROUPS]:
        for column in group[_COLUMNS]:
            yield column[_CHUNK]


def _check_chunk(file: BinaryIO, start: int, size: int, budget: Budget) -> None:
    at, end = start, start + size
    while at < end:
        budget.tick()
        file.seek(at)
        head = _Thrift(file.read(min(_HEADER, end - at)))
        found = head.struct()
        unpacked, stored = found.get(_UNPACKED, -1), found.get(_STORED, -1)
        if not 0 <= stored <= end - at or unpacked < 0:
            raise RecordingError(f"{budget.path}: damaged Parquet file: a page of {stored} bytes in {end - at}")
        budget.require_unpacked(unpacked, "a page")
        at += head.at + stored


class _Thrift:
    """Reads Thrift's compact protocol, so far up to `at`. Raises IndexError or ValueError for other data."""

    def __init__(self, data: bytes) -> None:
        self._data, self.at = data, 0

    def struct(self, deep: int = 0) -> dict[int, Any]:
        """The fields of a struct by number: integers, strings as bytes, lists, structs, and None for others."""
        if deep > _DEEPEST:
            raise ValueError("structs are nested too deeply")
        found: dict[int, Any] = {}
        field = 0
        while (head := self._byte()) != _STOP:
            field = field + (head >> 4) if head >> 4 else self._zigzag()
            kind = head & 15
            found[field] = None if kind in (_TRUE, _FALSE) else self._value(kind, deep)
        return found

    def _value(self, kind: int, deep: int) -> Any:
        if kind in _INTEGERS:
            return self._zigzag()
        if kind == _STRUCT:
            return self.struct(deep + 1)
        if kind == _BINARY:
            return self._bytes(self._varint())
        if kind in (_TRUE, _FALSE, _BYTE, _DOUBLE):  # a truth value in a list takes a byte
            self._bytes(8 if kind == _DOUBLE else 1)
            return None
        if kind in (_LIST, _SET):
            if deep > _DEEPEST:
                raise ValueError("lists are nested too deeply")
            head = self._byte()
            count = head >> 4 if head >> 4 < 15 else self._varint()
            return [self._value(head & 15, deep + 1) for _ in range(count)]
        raise ValueError(f"a field of type {kind}")

    def _bytes(self, count: int) -> bytes:
        found = self._data[self.at : self.at + count]
        if len(found) < count:
            raise IndexError("the data end within a value")
        self.at += count
        return found

    def _byte(self) -> int:
        self.at += 1
        return self._data[self.at - 1]

    def _varint(self) -> int:
        value = shift = 0
        while True:
            byte = self._byte()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value
            if shift > 63:
                raise ValueError("a number of more than 64 bits")

    def _zigzag(self) -> int:
        value = self._varint()
        return value >> 1 ^ -(value & 1)
