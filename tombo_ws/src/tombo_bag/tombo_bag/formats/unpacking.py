"""Unpack compressed files, chunks and messages; of a cut one, its beginning."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from functools import partial
from typing import Any, BinaryIO

GZIP_MAGIC = b"\x1f\x8b"
_PIECE = 4096
"""Compressed bytes that are unpacked at once."""


def unpack(how: str, data: Any) -> Any:
    """Unpack a chunk or a message; of one that is cut, its beginning.

    Args:
        how: "zstd", "lz4", "bz2", or nothing.
        data: compressed bytes.

    Raises:
        ValueError: it can't be unpacked.
    """
    import bz2

    import zstandard
    from lz4.frame import LZ4FrameDecompressor

    try:
        if how == "zstd":
            return zstandard.ZstdDecompressor().decompressobj().decompress(data)
        if how == "lz4":
            return LZ4FrameDecompressor().decompress(bytes(data))
        if how == "bz2":
            return bz2.BZ2Decompressor().decompress(data)
    except (zstandard.ZstdError, RuntimeError, OSError, EOFError, MemoryError) as error:
        raise ValueError((str(error) or "not enough memory").splitlines()[0]) from error
    if how in ("", "none"):
        return data
    raise ValueError(f"compression '{how}' is none of zstd, lz4, bz2 or none")


def unpack_file(source: BinaryIO, out: BinaryIO) -> str:
    """Unpack a file packed as a whole by zstd or gzip; return its damage, or nothing."""
    import zstandard

    try:
        for piece in _pieces(source):
            out.write(piece)
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
