"""Checks the sizes that pages of a Parquet file state before a library allocates memory for them.

A page's header (https://parquet.apache.org/docs/file-format/data-pages) is a struct in Thrift's compact protocol: a
field is a byte, the difference to the last field's number above its type; integers are zigzag varints. Fields 2 and 3
are the page's size unpacked and stored [bytes].
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from stadera.errors import RecordingError
from stadera.limits import Budget

if TYPE_CHECKING:
    from pyarrow import parquet

_STOP, _TRUE, _FALSE, _BYTE, _DOUBLE, _BINARY, _LIST, _SET, _STRUCT = 0, 1, 2, 3, 7, 8, 9, 10, 12
_INTEGERS = (4, 5, 6)
_UNPACKED, _STORED = 2, 3
_HEADER = 1 << 16  # bytes of a page's header that are read, including statistics
_DEEPEST = 20  # nested structs


def check_pages(path: Path, metadata: parquet.FileMetaData, columns: Iterable[str], budget: Budget) -> None:
    """Checks the pages of these columns.

    Raises:
        LimitError: a page's stated unpacked size exceeds the budget.
        RecordingError: a page is longer than its column.
    """
    wanted = set(columns)
    with path.open("rb") as file:
        for group in range(metadata.num_row_groups):
            for number in range(metadata.num_columns):
                chunk = metadata.row_group(group).column(number)
                if chunk.path_in_schema in wanted:
                    starts = [chunk.data_page_offset]
                    if chunk.has_dictionary_page and chunk.dictionary_page_offset:
                        starts.append(chunk.dictionary_page_offset)
                    _check_chunk(file, min(starts), chunk.total_compressed_size, budget)


def _check_chunk(file: BinaryIO, start: int, size: int, budget: Budget) -> None:
    at, end = start, start + size
    while at < end:
        budget.tick()
        file.seek(at)
        head = _Thrift(file.read(min(_HEADER, end - at)))
        found = head.integers()
        unpacked, stored = found.get(_UNPACKED, -1), found.get(_STORED, -1)
        if not 0 <= stored <= end - at or unpacked < 0:
            raise RecordingError(f"{budget.path}: damaged Parquet file: a page of {stored} bytes in {end - at}")
        budget.require_unpacked(unpacked, "a page")
        at += head.at + stored


class _Thrift:
    """Reads Thrift's compact protocol. Raises IndexError or ValueError for other data."""

    def __init__(self, data: bytes) -> None:
        self._data, self.at = data, 0

    def integers(self, deep: int = 0) -> dict[int, int]:
        """The integers of a struct by field; other fields are skipped."""
        if deep > _DEEPEST:
            raise ValueError("structs are nested too deeply")
        found: dict[int, int] = {}
        field = 0
        while (head := self._byte()) != _STOP:
            field = field + (head >> 4) if head >> 4 else self._zigzag()
            if (kind := head & 15) in _INTEGERS:
                found[field] = self._zigzag()
            else:
                self._pass(kind, deep)
        return found

    def _pass(self, kind: int, deep: int) -> None:
        if kind in (_TRUE, _FALSE):
            return
        if kind == _STRUCT:
            self.integers(deep + 1)
        elif kind in (_BYTE, _DOUBLE):
            self.at += 1 if kind == _BYTE else 8
        elif kind == _BINARY:
            length = self._varint()
            self.at += length
        elif kind in (_LIST, _SET):
            head = self._byte()
            count = head >> 4 if head >> 4 < 15 else self._varint()
            for _ in range(min(count, len(self._data))):
                self._pass_item(head & 15, deep)
        else:
            raise ValueError(f"a field of type {kind}")

    def _pass_item(self, kind: int, deep: int) -> None:
        if kind in (_TRUE, _FALSE):  # in a list each takes a byte
            self.at += 1
        elif kind in _INTEGERS:
            self._zigzag()
        else:
            self._pass(kind, deep + 1)

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
