"""Unpack compressed files, chunks and messages, up to a size; of a cut one, its beginning."""

from __future__ import annotations

import gzip
import os
import zlib
from collections.abc import Iterator
from functools import partial
from typing import Any, BinaryIO

GZIP_MAGIC = b"\x1f\x8b"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_PIECE = 4096
"""Compressed bytes that are unpacked at once."""
_MEMORY_SHARE = 0.25
"""Of the memory for a file, whose messages are there as bytes and again as columns."""


def largest_size() -> int:
    """Return how many bytes a file, a chunk or a message is unpacked to."""
    return int(_MEMORY_SHARE * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))


def unpack(how: str, data: Any, size: int | None = None) -> Any:
    """Unpack a chunk or a message; of one that is cut, its beginning.

    Args:
        how: "zstd", "lz4", "bz2", or nothing.
        data: compressed bytes.
        size: that it should have [bytes], if known.

    Raises:
        ValueError: it can't be unpacked, or is larger than `size` or `largest_size`.
    """
    import bz2

    import zstandard
    from lz4.frame import LZ4FrameDecompressor

    largest = largest_size()
    most = largest if size is None else min(size, largest)
    try:
        if how == "zstd":
            if zstandard.frame_content_size(data) > most:
                raise ValueError(f"it holds more than {most} bytes")
            plain = zstandard.ZstdDecompressor().decompressobj().decompress(data)
        elif how == "lz4":
            plain = LZ4FrameDecompressor().decompress(bytes(data), max_length=most + 1)
        elif how == "bz2":
            plain = bz2.BZ2Decompressor().decompress(data, most + 1)
        elif how in ("", "none"):
            return data
        else:
            raise ValueError(f"compression '{how}' is none of zstd, lz4, bz2 or none")
    except (zstandard.ZstdError, RuntimeError, OSError, EOFError, MemoryError) as error:
        raise ValueError((str(error) or "not enough memory").splitlines()[0]) from error
    if len(plain) > most:
        raise ValueError(f"it holds more than {most} bytes")
    return plain


def unpack_file(source: BinaryIO, out: BinaryIO) -> str:
    """Unpack a file packed as a whole by zstd or gzip; return its damage, or nothing.

    Beyond `largest_size` it counts as damaged.
    """
    import zstandard

    left = largest_size()
    try:
        for piece in _pieces(source):
            out.write(piece[:left])
            left -= len(piece)
            if left < 0:
                return (
                    "the compressed file holds more than a quarter of the memory; read up to there"
                )
    except EOFError:
        return "the compressed file is cut off; read up to there"
    except (zstandard.ZstdError, zlib.error, gzip.BadGzipFile) as error:
        return f"the compressed file is damaged ({error}); read up to there"
    return ""


def _pieces(source: BinaryIO) -> Iterator[bytes]:
    """Yield the plain bytes of a file by zstd, or by gzip with all its members.

    Raises:
        EOFError: the file is cut off.
    """
    import zstandard

    packed = source.read(_PIECE)
    if packed.startswith(GZIP_MAGIC):
        source.seek(0)
        with gzip.GzipFile(fileobj=source) as file:
            yield from iter(partial(file.read1, _PIECE << 8), b"")
        return
    unpacker = zstandard.ZstdDecompressor().decompressobj()
    while packed and not unpacker.eof:
        yield unpacker.decompress(packed)
        packed = source.read(_PIECE)
    if not unpacker.eof:
        raise EOFError
