"""Unpack compressed files and chunks, within a limit on their size.

The limit is the user's, else a share of the machine's memory.
"""

from __future__ import annotations

import gzip
import os
import resource
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from tombo_dynamics.errors import InputError

GIGABYTE = 1e9
GZIP_MAGIC = b"\x1f\x8b"
_SHARE = 0.25
"""Of the machine's memory, which messages as bytes and again as columns have to share."""
_PIECE = 4096
"""Compressed bytes that are unpacked at once."""
_LIMIT: ContextVar[int | None] = ContextVar("unpacking limit", default=None)


@contextmanager
def unpacking_up_to(limit: int | None) -> Iterator[None]:
    """Let files be unpacked to this many bytes each; None: to a share of the machine's memory."""
    before = _LIMIT.set(limit)
    try:
        yield
    finally:
        _LIMIT.reset(before)


def memory_limit() -> int:
    """Return how many bytes the messages of one file may take: as given, else by the memory."""
    given = _LIMIT.get()
    if given is not None:
        return given
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    return int(_SHARE * (memory if allowed < 0 else min(memory, allowed)))


class Allowance:
    """Bytes that a file may still be unpacked to."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.left = memory_limit()

    def take(self, size: int) -> None:
        """Count some bytes.

        Raises:
            InputError: beyond the limit.
        """
        self.left -= size
        if self.left < 0:
            raise InputError(
                f"'{self.path}' unpacks to more than {memory_limit() / GIGABYTE:.3g} GB; "
                "accepted: more with --unpack-limit"
            )


def unpack(how: str, data: Any, size: int) -> Any:
    """Unpack a chunk or a message; of one that is cut, its beginning.

    Args:
        how: "zstd", "lz4", "bz2", or nothing.
        data: compressed bytes.
        size: largest size [bytes].

    Raises:
        ValueError: it is more than `size` bytes, or can't be unpacked.
    """
    import bz2

    import zstandard
    from lz4.frame import LZ4FrameDecompressor

    try:
        if how == "zstd":
            with zstandard.ZstdDecompressor().stream_reader(data) as reader:
                plain = reader.read(size + 1)
        elif how == "lz4":
            plain = LZ4FrameDecompressor().decompress(bytes(data), max_length=size + 1)
        elif how == "bz2":
            plain = bz2.BZ2Decompressor().decompress(data, size + 1)
        elif how in ("", "none"):
            plain = data
        else:
            raise ValueError(f"compression '{how}' is none of zstd, lz4, bz2 or none")
    except (zstandard.ZstdError, RuntimeError, OSError, EOFError, MemoryError) as error:
        raise ValueError((str(error) or "not enough memory").splitlines()[0]) from error
    if len(plain) > size:
        raise ValueError(f"it holds more than {size} bytes")
    return plain


def unpack_file(source: BinaryIO, out: BinaryIO, allowance: Allowance) -> str:
    """Unpack a file packed as a whole by zstd or gzip; return its damage, or nothing.

    Raises:
        InputError: it unpacks to more than is allowed.
    """
    import zstandard

    try:
        for piece in _pieces(source):
            allowance.take(len(piece))
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
