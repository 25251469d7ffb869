"""Unpack what a file holds compressed: against the size that it states, and against a total.

A few kilobytes can stand for gigabytes. Whatever is unpacked is streamed, and ends where the file
said that it would, or at the limit. The limit is the user's, else what the machine's memory allows
and, of a file, a multiple of its own size: no recording packs as well as a bomb.
"""

from __future__ import annotations

import bz2
import os
import resource
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from tombo_dynamics.errors import InputError

GIGABYTE = 1e9
GZIP_MAGIC = b"\x1f\x8b"
_SHARE = 0.25
"""Of the machine's memory, which messages as bytes and again as columns have to share."""
_PLAIN = 1 << 25
"""Bytes to which any file may be unpacked."""
_RATIO = 100
"""To how many times its size a file may be unpacked; flights pack to a half or a tenth."""
_SMALL_PIECE, _PIECE, _LARGE_PIECE = 1 << 12, 1 << 20, 1 << 24
_GIVEN: ContextVar[int | None] = ContextVar("unpacking limit", default=None)


@contextmanager
def unpacking_up_to(limit: int | None) -> Iterator[None]:
    """Let files be unpacked to this many bytes each; None: to what the machine's memory allows."""
    before = _GIVEN.set(limit)
    try:
        yield
    finally:
        _GIVEN.reset(before)


def memory_limit() -> int:
    """Return how many bytes the messages of one file may take: as given, else by the memory."""
    given = _GIVEN.get()
    if given is not None:
        return given
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    return int(_SHARE * (memory if allowed < 0 else min(memory, allowed)))


def plausible_size(packed: int) -> int:
    """Return to how many bytes `packed` bytes may be unpacked in all, if piece by piece."""
    given = _GIVEN.get()
    return max(_PLAIN, _RATIO * packed) if given is None else given


def implausible(size: int, packed: int) -> bool:
    """Return whether a part that states this size is damaged, or a bomb: it is left out."""
    return _GIVEN.get() is None and size > plausible_size(packed)


def unpacking_limit(packed: int) -> int:
    """Return to how many bytes `packed` bytes may be unpacked that stay in memory, or on disk."""
    return min(memory_limit(), plausible_size(packed))


@dataclass
class Allowance:
    """What one file may still be unpacked to, or its messages may still take.

    Attributes:
        path: the file.
        left: [bytes].
    """

    path: Path
    left: int

    def take(self, size: int) -> None:
        """Count some bytes.

        Raises:
            InputError: beyond the limit.
        """
        self.left -= size
        if self.left < 0 or size > memory_limit():
            raise _too_large(self.path)


def _too_large(path: Path) -> InputError:
    given = _GIVEN.get()
    limit = f"{(memory_limit() if given is None else given) / GIGABYTE:.3g} GB"
    why = "as --unpack-limit says" if given is not None else (
        f"{_RATIO} times its size or {limit}; more with --unpack-limit"
    )  # fmt: skip
    return InputError(f"'{path}' unpacks to too much; accepted: up to {limit}, {why}")


def unzstd(data: Any, size: int) -> bytes:
    """Return what zstd has packed, of a cut frame what is there.

    Raises:
        ValueError: it is more than `size` bytes, states another size, or is none.
    """
    import zstandard

    try:
        stated = zstandard.frame_content_size(bytes(data[:32]))
        if stated > size:
            raise ValueError(f"{stated} bytes instead of {size}")
        with zstandard.ZstdDecompressor().stream_reader(data) as reader:
            return _all_of(reader.read, size, size if stated < 0 else stated)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error


def unlz4(data: Any, size: int) -> bytes:
    """Return what lz4 has packed: see `unzstd`."""
    from lz4.frame import LZ4FrameDecompressor

    try:
        unpacked: bytes = LZ4FrameDecompressor().decompress(bytes(data), max_length=size + 1)
    except (RuntimeError, EOFError) as error:
        raise ValueError(str(error)) from error
    return _checked(unpacked, size)


def unbz2(data: Any, size: int) -> bytes:
    """Return what bzip2 has packed: see `unzstd`."""
    try:
        return _checked(bz2.BZ2Decompressor().decompress(data, size + 1), size)
    except (OSError, EOFError) as error:
        raise ValueError(str(error)) from error


UNPACK: dict[str, Callable[[Any, int], bytes]] = {"zstd": unzstd, "lz4": unlz4, "bz2": unbz2}


def unpack_file(source: BinaryIO, out: BinaryIO, allowance: Allowance) -> str:
    """Unpack a file that zstd has packed as a whole; return what is wrong with it, or nothing.

    Raises:
        InputError: it unpacks to more than is allowed.
    """
    import zstandard

    with zstandard.ZstdDecompressor().stream_reader(source, closefd=False) as reader:
        try:
            while piece := reader.read(_PIECE):
                allowance.take(len(piece))
                out.write(piece)
        except zstandard.ZstdError as error:
            return f"{error}; what was unpacked before that is read"
    return "" if _ends_whole(source) else "the compressed file is cut off"


def _ends_whole(source: BinaryIO) -> bool:
    """Walk over the blocks of a frame of zstd, to its last (RFC 8878, section 3.1.1)."""
    import zstandard

    source.seek(0)
    start = source.read(18)
    at = zstandard.frame_header_size(start) if len(start) == 18 else 0
    ends_with = 4 * bool(len(start) > 4 and start[4] & 4)  # a checksum
    size = source.seek(0, os.SEEK_END)
    last = False
    while at and not last and at + 3 <= size:
        source.seek(at)
        head = int.from_bytes(source.read(3), "little")
        last, kind = bool(head & 1), head >> 1 & 3
        at += 3 + (1 if kind == 1 else head >> 3)
    return last and at + ends_with <= size


def ungzip(raw: bytes, allowance: Allowance) -> tuple[bytes, str]:
    """Return what gzip has packed, of a damaged file what is there; and what is wrong with it.

    Raises:
        InputError: it unpacks to more than is allowed.
    """
    parts: list[bytes] = []
    left = memoryview(raw)
    while left:
        unpacker, at = zlib.decompressobj(wbits=31), 0
        try:
            while not unpacker.eof:
                packed: Any = unpacker.unconsumed_tail
                if not packed:
                    packed = left[at : at + _SMALL_PIECE]
                    at += len(packed)
                if not packed:
                    return b"".join(parts), "the compressed file is cut off; read up to there"
                part = unpacker.decompress(packed, _PIECE)
                allowance.take(len(part))
                parts.append(part)
        except zlib.error as error:
            if parts and bytes(left[:2]) != GZIP_MAGIC:
                return b"".join(parts), "bytes behind its end are left out"
            return b"".join(parts), f"the compressed file is damaged ({error}); read up to there"
        left = left[at - len(unpacker.unused_data) :]
    return b"".join(parts), ""


def _all_of(read: Callable[[int], bytes], size: int, stated: int) -> bytes:
    """Read to the end, which comes after at most `size` bytes; memory is taken as it comes."""
    parts, total = [], 0
    while part := read(min(max(stated, 1), _LARGE_PIECE)):
        parts.append(part)
        total += len(part)
        if total > size:
            raise ValueError(f"more than {size} bytes")
    return parts[0] if len(parts) == 1 else b"".join(parts)


def _checked(unpacked: bytes, size: int) -> bytes:
    if len(unpacked) > size:
        raise ValueError(f"more than {size} bytes")
    return unpacked
