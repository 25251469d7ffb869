"""Two recordings compared topic by topic: every message, every field, to the last bit.

Messages are paired by the stamp of their header; without a header, by the first stamp inside the
message (`/tf`, `/markers`); without any, by publish time. The k-th message of a stamp belongs to
the k-th of the same stamp in the other recording; messages of one stamp are put in order of their
content, so the order of receipt does not matter. Log and publish times, and the metadata of the
files, are not compared. NaN equals NaN, 0.0 does not equal -0.0.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columns import ColumnTable
from tombo_bag.flight_time import FLIGHT_METADATA
from tombo_bag.recording import Recording
from tombo_dynamics.arrays import Times
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.time_base import SECOND_NS

PROCESS_TOPICS = ("/clock", "/diagnostics", "/events/write_split", "/parameter_events", "/rosout")
"""Topics about the processes that ran, not about the flight: compared only where asked for."""

_NO_FIELDS = ("log_time_ns", "publish_time_ns", "stamp_ns")

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class FieldDifference:
    """One field that differs.

    Attributes:
        field: its path in the message, as `pose.position.x`; an array of numbers is one field.
        messages: number of paired messages in which it differs.
        first_ns: stamp of the first of them.
        largest: largest absolute difference, in the unit of the field; None if there is none
            between finite numbers (texts, sequences of different length, NaN against a number).
    """

    field: str
    messages: int
    first_ns: int
    largest: float | None


@dataclass(frozen=True)
class TopicComparison:
    """What differs on one topic.

    Attributes:
        topic: its name.
        types: message type in A and in B; None where the topic is not recorded.
        messages_a: number of messages in A that can be read.
        messages_b: the same in B.
        only_a_ns: stamps of messages without a partner in B.
        only_b_ns: stamps of messages without a partner in A.
        fields: fields that differ, in the order of the message.
    """

    topic: str
    types: tuple[str | None, str | None]
    messages_a: int
    messages_b: int
    only_a_ns: Times
    only_b_ns: Times
    fields: tuple[FieldDifference, ...] = ()

    @property
    def equal(self) -> bool:
        """Whether nothing differs."""
        return self.first is None

    @cached_property
    def first(self) -> tuple[int, str] | None:
        """Stamp [ns] of the first difference, and what differs there."""
        firsts = [(field.first_ns, field.field) for field in self.fields]
        if len(set(self.types) - {None}) > 1:
            stamps = np.concatenate([self.only_a_ns, self.only_b_ns])
            return int(stamps.min()), f"type: {self.types[0]} in A, {self.types[1]} in B"
        for name, stamps in (("A", self.only_a_ns), ("B", self.only_b_ns)):
            if len(stamps):
                firsts.append((int(stamps.min()), f"message in {name} only"))
        return min(firsts, key=lambda item: item[0], default=None)

    @property
    def largest(self) -> FieldDifference | None:
        """The field with the largest difference of numbers."""
        numbers = [field for field in self.fields if field.largest is not None]
        return max(numbers, key=lambda field: field.largest or 0.0, default=None)


@dataclass(frozen=True)
class Comparison:
    """Two recordings, compared.

    Attributes:
        topics: the topics that were compared, sorted by name.
        left_out: topics of `PROCESS_TOPICS` that are recorded and were not asked for.
        epoch_ns: stamp of flight time 0; without a flight's metadata, the earliest stamp.
        damage: unreadable parts of either file, a line each.
    """

    topics: tuple[TopicComparison, ...]
    left_out: tuple[str, ...]
    epoch_ns: int
    damage: tuple[str, ...]

    @property
    def equal(self) -> bool:
        """Whether all compared topics are equal."""
        return all(topic.equal for topic in self.topics)

    def seconds(self, stamp_ns: int) -> float:
        """Return a stamp [ns] as flight time [s]."""
        return (stamp_ns - self.epoch_ns) / 1e9

    def as_list(self) -> list[dict[str, Any]]:
        """Return a mapping for each topic, as `compare.json` has it."""
        return [self._as_mapping(topic) for topic in self.topics]

    def _as_mapping(self, topic: TopicComparison) -> dict[str, Any]:
        first, largest = topic.first, topic.largest
        return {
            "topic": topic.topic,
            "messages_a": topic.messages_a,
            "messages_b": topic.messages_b,
            "equal": topic.equal,
            "first_difference_s": first and self.seconds(first[0]),
            "first_difference": first and first[1],
            "largest": largest and largest.largest,
            "largest_field": largest and largest.field,
            "only_in_a": len(topic.only_a_ns),
            "only_in_b": len(topic.only_b_ns),
            "fields": [
                {
                    "field": field.field,
                    "messages": field.messages,
                    "first_difference_s": self.seconds(field.first_ns),
                    "largest": field.largest,
                }
                for field in topic.fields
            ],
        }


def compare_recordings(a: str | Path, b: str | Path, topics: Sequence[str] = ()) -> Comparison:
    """Compare two recordings.

    Args:
        a: a file, a bag's folder, or a folder of results with `flight.mcap`.
        b: the same.
        topics: what to compare; if empty, all topics of both but `PROCESS_TOPICS`.

    Raises:
        InputError: a recording can't be read, or neither has one of the topics.
    """
    with Recording(_bag(a)) as first, Recording(_bag(b)) as second:
        recorded = sorted({*first.topics, *second.topics})
        for name in topics:
            if name not in recorded:
                raise unknown_name(f"topic in '{a}' and '{b}'", name, recorded)
        chosen = [n for n in recorded if n in topics or (not topics and n not in PROCESS_TOPICS)]
        for recording in (first, second):
            with suppress(InputError):  # of one topic: the others are loaded one by one
                recording.load(chosen)
        unread = {**_unread(a, first, chosen), **_unread(b, second, chosen)}
        if unread and topics:
            raise InputError(next(iter(unread.values())))
        chosen = [name for name in chosen if name not in unread]
        compared = tuple(_compare(first, second, name) for name in chosen)
        return Comparison(
            compared,
            tuple(n for n in recorded if n in PROCESS_TOPICS and n not in chosen),
            _epoch(first, second, chosen),
            (
                *(f"{a}: {line}" for line in first.damage),
                *(f"{b}: {line}" for line in second.damage),
                *(f"{name} is not compared: {why}" for name, why in unread.items()),
            ),
        )


def _unread(path: str | Path, recording: Recording, topics: Iterable[str]) -> dict[str, str]:
    """Return topic → why its messages can't be read."""
    unread = {}
    for name in topics:
        try:
            if name in recording.topics:
                recording.columns(name)
        except InputError as error:
            unread[name] = f"'{path}': {error}"
    return unread


def _bag(path: str | Path) -> Path:
    flight = Path(path) / "flight.mcap"
    return flight if flight.is_file() else Path(path)


def _epoch(first: Recording, second: Recording, topics: Iterable[str]) -> int:
    for recording in (first, second):
        text = recording.metadata.get(FLIGHT_METADATA, {}).get("epoch_ns", "")
        if text.isdecimal():
            return int(text)
    tables = [r.columns(n) for r in (first, second) for n in topics if n in r.topics]
    return min((int(_stamps(t).min()) for t in tables if len(t["log_time_ns"])), default=0)


def _compare(first: Recording, second: Recording, topic: str) -> TopicComparison:
    types = (_type(first, topic), _type(second, topic))
    none = np.zeros(0, np.int64)
    nothing: ColumnTable = {"log_time_ns": none, "publish_time_ns": none}
    tables = [r.columns(topic) if topic in r.topics else nothing for r in (first, second)]
    stamps = [_stamps(table) for table in tables]
    result = TopicComparison(topic, types, len(stamps[0]), len(stamps[1]), stamps[0], stamps[1])
    if None in types or types[0] != types[1]:
        return result
    (rows_a, rows_b), (left_a, left_b) = _pair(tables, stamps)
    at = stamps[0][rows_a]
    fields: list[FieldDifference] = []
    for path in dict.fromkeys(name for table in tables for name in table):
        if path in _NO_FIELDS:
            continue
        whole = [
            table[path] if path in table else _absent(other[path], len(table["log_time_ns"]))
            for table, other in (tables, tables[::-1])
        ]
        values = whole[0][rows_a], whole[1][rows_b]
        differs = _differs(*values)
        if not differs.any():
            continue
        fields.append(
            FieldDifference(
                path, int(differs.sum()), int(at[differs].min()), _largest(values, differs)
            )
        )
    return replace(
        result, only_a_ns=stamps[0][left_a], only_b_ns=stamps[1][left_b], fields=tuple(fields)
    )


def _type(recording: Recording, topic: str) -> str | None:
    stream = recording.topics.get(topic)
    return None if stream is None or not stream.count else stream.typename


def _stamps(table: ColumnTable) -> Times:
    if "stamp_ns" in table:
        return np.asarray(table["stamp_ns"], np.int64)
    for path in table:
        if path.endswith("stamp.sec") and not np.isnan(table[path]).any():
            seconds = table[path].astype(np.int64)
            rest = table[path.removesuffix("sec") + "nanosec"].astype(np.int64)
            return np.asarray(seconds * SECOND_NS + rest)
    return np.asarray(table["publish_time_ns"], np.int64)


def _pair(tables: Sequence[ColumnTable], stamps: Sequence[Times]) -> tuple[list[Rows], list[Rows]]:
    """Return the paired rows of both tables, by time, and the rows without a partner."""
    orders = [_order(table, at) for table, at in zip(tables, stamps, strict=True)]
    at = [stamp[order] for stamp, order in zip(stamps, orders, strict=True)]
    # the same stamp's first, second ... message: its place since the stamp's first one
    turns = [np.arange(len(s)) - np.searchsorted(s, s) for s in at]
    most = max((int(turn.max()) for turn in turns if len(turn)), default=0) + 1
    _, number = np.unique(np.concatenate(at), return_inverse=True)
    keys = number * most + np.concatenate(turns)
    a, b = keys[: len(at[0])], keys[len(at[0]) :]
    places = np.intersect1d(a, b, assume_unique=True, return_indices=True)[1:]
    paired = [order[place] for order, place in zip(orders, places, strict=True)]
    left = [np.delete(order, place) for order, place in zip(orders, places, strict=True)]
    return paired, left


def _order(table: ColumnTable, stamps: Times) -> Rows:
    """Sort by stamp, and messages of the same stamp by content."""
    if len(np.unique(stamps)) == len(stamps):
        return np.argsort(stamps)
    fields = [column for name, column in table.items() if name not in _NO_FIELDS]
    numbers = [part for c in fields if c.dtype != object for part in np.atleast_2d(c.T)]
    order: Rows = np.lexsort([*reversed(numbers), stamps])
    return order


def _absent(like: NDArray[Any], number: int) -> NDArray[Any]:
    """Return a column for a recording in which no message has the field; as `columns_of`."""
    if like.dtype == object:
        return _ragged(np.zeros(0) for _ in range(number))
    if like.dtype.kind == "U":
        return np.full(number, "")
    return np.full((number, *like.shape[1:]), np.nan)


def _ragged(rows: Iterable[NDArray[Any]]) -> NDArray[Any]:
    items = list(rows)
    column = np.empty(len(items), object)
    column[:] = items
    return column


def _plain(column: NDArray[Any]) -> bool:
    return column.dtype.kind in "biuf" and column.ndim <= 2


def _differs(a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell for each row whether it differs, to the last bit."""
    if object in (a.dtype, b.dtype) or a.shape != b.shape:
        rows = zip(a, b, strict=True)
        return np.array([x.shape != y.shape or _differs(x, y).any() for x, y in rows], bool)
    if a.dtype != b.dtype and a.dtype.kind != "U":
        a, b = a.astype(np.float64), b.astype(np.float64)
    different = a != b
    if a.dtype.kind == "f":
        different = (different & ~(np.isnan(a) & np.isnan(b))) | (
            (a == 0.0) & (b == 0.0) & (np.signbit(a) != np.signbit(b))
        )
    return np.asarray(different.any(axis=tuple(range(1, different.ndim))))


def _largest(values: tuple[NDArray[Any], NDArray[Any]], differs: NDArray[Any]) -> float | None:
    """Return the largest difference between finite numbers."""
    a, b = (column[differs] for column in values)
    if not (_plain(a) and _plain(b) and a.shape == b.shape):
        return None
    with np.errstate(invalid="ignore", over="ignore"):
        size = np.abs(b.astype(np.float64) - a.astype(np.float64))
    finite = size[np.isfinite(size)]
    return float(finite.max()) if finite.size else None
