"""Unpacks compressed parts of bags within a budget: four megabytes of zeros can take a hundred bytes."""

from io import BytesIO
from typing import Protocol

from stadera.errors import RecordingError
from stadera.limits import Budget

_PIECE = 1 << 20  # bytes unpacked at a time


class _Readable(Protocol):
    def read(self, size: int, /) -> bytes: ...


def unpacked(data: bytes, compression: str, budget: Budget) -> bytes:
    """Unpacks a chunk or message stored with a compression "zstd", "lz4", "bz2"; "" or "none".

    Raises:
        LimitError: it unpacks to more than the budget allows.
        RecordingError: another compression. The libraries raise errors of many kinds on damaged data.
    """
    match compression:
        case "" | "none":
            return data
        case "zstd":
            import zstandard

            if (size := zstandard.frame_content_size(data)) >= 0:
                budget.require_unpacked(size, "a chunk")
                return zstandard.ZstdDecompressor().decompress(data)
            return _read(zstandard.ZstdDecompressor().stream_reader(data), budget)
        case "lz4":
            import pyarrow as pa

            return _read(pa.CompressedInputStream(pa.BufferReader(data), "lz4"), budget)
        case "bz2":
            from bz2 import BZ2File

            return _read(BZ2File(BytesIO(data)), budget)
    raise RecordingError(f"{budget.path}: a chunk is compressed by {compression!r}; valid: zstd, lz4, bz2")


def _read(stream: _Readable, budget: Budget) -> bytes:
    parts: list[bytes] = []
    size = 0
    while part := stream.read(_PIECE):
        size += len(part)
        budget.require_unpacked(size, "a chunk")
        parts.append(part)
    return b"".join(parts)
