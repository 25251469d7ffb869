"""A ROS 1 bag (format 2.0), record by record: also one that was never closed or is cut off.

`rosbags` turns each message into the form of ROS 2; its own reader wants the index that a bag gets
only when it is closed, so the records are walked through here.
(http://wiki.ros.org/Bags/Format/2.0)
"""

from __future__ import annotations

import re
import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from tombo_bag.formats.bag_files import BagFile, RawMessages, TopicSummary, in_log_order
from tombo_bag.formats.unpacking import UNPACK, Allowance, implausible, unpacking_limit
from tombo_bag.schemas import Types, extended_store, known_types, type_store
from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

MAGIC = b"#ROSBAG V2.0\n"
_LENGTH = struct.Struct("<I")
_MESSAGE, _CHUNK, _CONNECTION = 0x02, 0x05, 0x07


class Ros1Bag(BagFile):
    """A ROS 1 `.bag` (or `.bag.active`) file; other types than ROS 2's by its own definitions."""

    def __init__(self, path: Path) -> None:
        """Walk through a file and note where its messages are.

        Raises:
            InputError: it can't be read, or is encrypted.
        """
        self.path = path
        self.damage: list[str] = []
        self.metadata: dict[str, dict[str, str]] = {}
        self._topic_of: dict[int, str] = {}
        self._types: dict[str, str] = {}
        self._definitions: dict[str, str] = {}
        self._messages: dict[str, list[tuple[int, memoryview]]] = {}
        try:
            data = memoryview(path.read_bytes())
        except OSError as error:
            raise InputError(f"can't read '{path}': {error.strerror}") from error
        self._packed = len(data)
        self._allowance = Allowance(path, unpacking_limit(self._packed))
        self._walk(data[len(MAGIC) :], len(MAGIC), inside_chunk=False)
        self.topics = {
            topic: _stream(typename, [time for time, _ in self._messages.get(topic, [])])
            for topic, typename in sorted(self._types.items())
        }

    def messages(self, topics: Collection[str]) -> dict[str, RawMessages]:
        """Read the messages of some topics, turned into CDR."""
        by_topic: dict[str, RawMessages] = {}
        for topic in (name for name in topics if name in self.topics):
            typename, store = self.topics[topic].typename, self._store(topic)
            recorded = self._messages.get(topic, [])
            times: list[int] = []
            messages: list[bytes] = []
            for time, raw in recorded:
                try:
                    messages.append(bytes(store.ros1_to_cdr(raw, typename)))
                    times.append(time)
                except Exception:  # generated code fails in many ways on bytes that don't fit
                    continue
            lost = len(recorded) - len(messages)
            if lost:
                self.damage.append(f"{lost} messages of topic {topic} don't fit their type")
            by_topic[topic] = in_log_order(times, times, messages)
        return by_topic

    def types(self, topic: str) -> Types:
        """Return a topic's type in the form of ROS 2, where that has none as the file does."""
        return self._store(topic).fielddefs

    def _store(self, topic: str) -> Typestore:
        """Return the types of ROS 2, with what the file itself defines for a topic.

        Raises:
            InputError: the type is not known, nor is its definition in the file.
        """
        typename = self.topics[topic].typename
        if typename in known_types() or typename not in self._definitions:
            super().types(topic)
            return type_store()
        return extended_store(typename, self._definitions[typename])

    def _walk(self, data: memoryview, offset: int, *, inside_chunk: bool) -> None:
        where = f"chunk at byte {offset}: byte" if inside_chunk else "byte"
        start = 0 if inside_chunk else offset
        at = 0
        try:
            for at, header, body in _records(data):
                (kind,) = struct.unpack("<B", header.get("op", b"\0"))
                if kind == _CHUNK and not inside_chunk:
                    self._chunk(header, body, start + at)
                elif kind == _CONNECTION:
                    self._connect(header, body)
                elif kind == _MESSAGE:
                    seconds, rest = struct.unpack("<II", header["time"])
                    topic = self._topic_of[_LENGTH.unpack(header["conn"])[0]]
                    self._messages.setdefault(topic, []).append((seconds * SECOND_NS + rest, body))
                elif header.get("encryptor"):
                    name = header["encryptor"].decode("ascii", "replace")
                    raise InputError(f"'{self.path}' is encrypted ({name}); accepted: a plain bag")
                elif header.get("index_pos") == bytes(8):
                    self.damage.append("the bag was never closed; what was written is read")
        except _Cut as cut:
            self.damage.append(
                f"{cut} at {where} {start + cut.at}; the records before it are read"
            )
        except (KeyError, struct.error):
            self.damage.append(
                f"{where} {start + at}: a record that is none; the rest is left out"
            )

    def _chunk(self, header: dict[str, bytes], body: memoryview, offset: int) -> None:
        how = header.get("compression", b"none").decode("ascii", "replace")
        if how != "none":
            (size,) = _LENGTH.unpack(header["size"])
            if not implausible(size, self._packed):
                self._allowance.take(size)
            try:
                if how not in ("bz2", "lz4"):
                    raise ValueError(f"compression '{how}' is none of none, bz2, lz4")
                if implausible(size, self._packed):
                    raise ValueError(f"it states {size} bytes, from {len(body)}")
                body = memoryview(UNPACK[how](body, size))
            except (ValueError, MemoryError) as error:
                self.damage.append(f"chunk at byte {offset} is corrupt: {error}")
                return
        self._walk(body, offset, inside_chunk=True)

    def _connect(self, header: dict[str, bytes], body: memoryview) -> None:
        fields = _fields(body)
        topic = header["topic"].decode("utf-8", "replace")
        topic = "/" + re.sub(r"/+", "/", topic).strip("/")
        self._topic_of[_LENGTH.unpack(header["conn"])[0]] = topic
        self._types[topic] = fields["type"].decode("utf-8", "replace")
        text = fields.get("message_definition", b"").decode("utf-8", "replace")
        if text.strip():
            self._definitions.setdefault(_long_name(self._types[topic]), text)


class _Cut(Exception):
    """The data end within a record that begins at `at`."""

    def __init__(self, at: int) -> None:
        super().__init__("the file is cut off")
        self.at = at


def _records(data: memoryview) -> Iterator[tuple[int, dict[str, bytes], memoryview]]:
    """Yield place, header fields and body of each record; a body that is cut off is kept short.

    Raises:
        _Cut: the data end within a record; a chunk of which a part is there has been yielded.
    """
    at = 0
    while at < len(data):
        if at + 4 > len(data):
            raise _Cut(at)
        head_end = at + 4 + int(_LENGTH.unpack_from(data, at)[0])
        if head_end + 4 > len(data):
            raise _Cut(at)
        header = _fields(data[at + 4 : head_end])
        end = head_end + 4 + int(_LENGTH.unpack_from(data, head_end)[0])
        if end > len(data):
            if header.get("op") == bytes([_CHUNK]):
                yield at, header, data[head_end + 4 :]
            raise _Cut(at)
        yield at, header, data[head_end + 4 : end]
        at = end


def _fields(data: memoryview) -> dict[str, bytes]:
    """Read `name=value` fields, each behind its length.

    Raises:
        struct.error: a length that does not fit.
    """
    fields: dict[str, bytes] = {}
    at = 0
    if not data:
        raise struct.error("no fields")
    while at < len(data):
        end = at + 4 + int(_LENGTH.unpack_from(data, at)[0])
        if end > len(data):
            raise struct.error("a field is longer than what holds it")
        name, _, value = bytes(data[at + 4 : end]).partition(b"=")
        fields[name.decode("ascii", "replace")] = value
        at = end
    return fields


def _stream(typename: str, times_ns: list[int]) -> TopicSummary:
    """Describe the messages of a type in its ROS 1 form, as `geometry_msgs/PoseStamped`."""
    first, last = min(times_ns, default=0), max(times_ns, default=0)
    return TopicSummary(_long_name(typename), len(times_ns), first, last)


def _long_name(typename: str) -> str:
    return typename.replace("/", "/msg/", 1)
