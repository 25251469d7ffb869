"""MAVLink 2 signatures: only who has the key is accepted, and no packet twice.

pymavlink is used for signing only. Its check takes the timestamp of a packet before it verifies
the signature, so one forged packet locks the partner out; and it begins with time zero, so packets
recorded earlier open a new stream.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.link.framing import Frame

KEY_SIZE = 32
_ACCEPTED = f"a file of {KEY_SIZE} bytes, or of {2 * KEY_SIZE} hexadecimal digits, not all zero"
_EPOCH_S = 1_420_070_400
"""1 January 2015, where the timestamps begin."""
_UNIT_NS = 10_000
_LAST = (1 << 48) - 1
_SIGNATURE = 6


class KeyFile(NamedTuple):
    """A key, and what is wrong with the file it came from ("": nothing)."""

    key: bytes
    warning: str


def read_key(path: Path) -> KeyFile:
    """Read a key from a file.

    Raises:
        InputError: no such file, or no key in it.
    """
    try:
        with path.open("rb") as file:
            content = file.read(4 * KEY_SIZE)
            mode = path.stat().st_mode
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise InputError(f"key '{path}' can't be read ({why}); accepted: {_ACCEPTED}") from error
    warning = ""
    if mode & 0o077:
        warning = f"key '{path}' can be read or written by others; chmod 600 it"
    key = content
    if len(content) != KEY_SIZE:
        try:
            key = bytes.fromhex(content.decode("ascii"))
        except ValueError:
            key = b""
    return KeyFile(check_key(key, f"key '{path}'"), warning)


def key_of(path: str, warn: Callable[[str], None]) -> bytes | None:
    """Return the key of a file, None for an empty path; `warn` is told what is wrong with it.

    Raises:
        InputError: no such file, or no key in it.
    """
    if not path:
        return None
    key, warning = read_key(Path(path))
    if warning:
        warn(warning)
    return key


def check_key(key: bytes, what: str = "key") -> bytes:
    """Return the key.

    Raises:
        InputError: it has not 32 bytes, or is zero, which to MAVLink means none.
    """
    if len(key) != KEY_SIZE or not any(key):
        raise InputError(f"{what} is no key; accepted: {_ACCEPTED}")
    return key


def timestamp_of(time_ns: int) -> int:
    """Return a CLOCK_REALTIME as a signature has it: 10 µs since the begin of 2015."""
    return min(max((time_ns - _EPOCH_S * SECOND_NS) // _UNIT_NS, 0), _LAST)


class SignatureVerifier:
    """Accepts signed frames, each once.

    Attributes:
        latest: the newest timestamp known; what we send must not be older.
    """

    def __init__(self, key: bytes, now_ns: int) -> None:
        """Begin.

        Args:
            key: of 32 bytes.
            now_ns: CLOCK_REALTIME. A sender's first frame may not be older: what was recorded
                before we listened is worth nothing. A sender whose clock is behind takes over our
                time when it hears us, as the protocol has it.
        """
        self.latest = timestamp_of(now_ns)
        self._key = check_key(key)
        self._begin = self.latest
        self._last: dict[tuple[int, int, int], int] = {}

    def refusal(self, frame: Frame) -> str:
        """Return "" for an accepted frame, else the counter of the reason."""
        if not frame.signed:
            return "unsigned"
        data = frame.data
        wanted = hashlib.sha256(self._key + data[:-_SIGNATURE]).digest()[:_SIGNATURE]
        if not hmac.compare_digest(wanted, data[-_SIGNATURE:]):
            return "bad_signature"
        sender = (frame.system, frame.component, data[-_SIGNATURE - 7])
        timestamp = int.from_bytes(data[-_SIGNATURE - 6 : -_SIGNATURE], "little")
        if timestamp <= self._last.get(sender, self._begin - 1):
            return "replayed"
        self._last[sender] = timestamp
        self.latest = max(self.latest, timestamp)
        return ""

    def next_timestamp(self, now_ns: int) -> int:
        """Return the timestamp of a frame that is sent now: newer than all before."""
        self.latest = min(max(self.latest + 1, timestamp_of(now_ns)), _LAST)
        return self.latest
