"""Two recordings compared topic by topic: every message, every field, to the last bit.

Messages are paired by the stamp of their header; without a header, by the first stamp inside the
message (`/tf`, `/markers`); without any, by publish time. The k-th message of a stamp belongs to
the k-th of the same stamp in the other recording; messages of one stamp are put in order of their
content, so the order of receipt does not matter. Log and publish times, and the metadata of the
files, are not compared. NaN equals NaN, 0.0 does not equal -0.0.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
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
        first_difference_s: flight time of the first of them.
        largest: largest absolute difference, in the unit of the field; None if there is none
            between finite numbers (texts, sequences of different length, NaN against a number).
    """

    field: str
    messages: int
    first_difference_s: float
    largest: float | None


@dataclass(frozen=True)
class TopicComparison:
    """Differences of one topic.

    Attributes:
        topic: its name.
        messages_a: number of messages in A that can be read.
        messages_b: the same in B.
        only_in_a: number of messages without a partner in B.
        only_in_b: number of messages without a partner in A.
        equal: nothing differs.
        first_difference_s: flight time of the first difference.
        first_difference: what differs there.
        largest: largest of the differences of all fields, each in its unit.
        fields: fields that differ, in the order of the message.
    """

    topic: str
    messages_a: int
    messages_b: int
    only_in_a: int
    only_in_b: int
    equal: bool
    first_difference_s: float | None
    first_difference: str | None
    largest: float | None
    fields: tuple[FieldDifference, ...]


@dataclass(frozen=True)
class Comparison:
    """Two recordings, compared.

    Attributes:
        topics: the topics that were compared, sorted by name.
        damage: unreadable parts of either file, a line each.
    """

    topics: tuple[TopicComparison, ...]
    damage: tuple[str, ...]

    @property
    def equal(self) -> bool:
        """Whether all compared topics are equal."""
        return all(topic.equal for topic in self.topics)


def compare_recordings(a: str | Path, b: str | Path, topics: Sequence[str] = ()) -> Comparison:
    """Compare two recordings.

    Flight time begins at the epoch of a flight's metadata, else at the earliest log time.

    Args:
        a: a file, a bag's folder, or a folder of results with `flight.mcap`.
        b: the same.
        topics: what to compare; if empty, all topics of both but `PROCESS_TOPICS`.

    Raises:
        InputError: a recording, or one of the topics given, can't be read, or neither has it.
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
        epoch_ns = _epoch(first, second, chosen)
        compared, unread = list[TopicComparison](), list[str]()
        for name in chosen:
            try:
                compared.append(_compare(first, second, name, epoch_ns))
            except InputError as error:
                if topics:
                    raise
                unread.append(f"{name} is not compared: {error}")
        damage = (
            *(f"{a}: {line}" for line in first.damage),
            *(f"{b}: {line}" for line in second.damage),
            *unread,
        )
        return Comparison(tuple(compared), damage)


def _bag(path: str | Path) -> Path:
    flight = Path(path) / "flight.mcap"
    return flight if flight.is_file() else Path(path)


def _epoch(first: Recording, second: Recording, topics: Sequence[str]) -> int:
    for recording in (first, second):
        text = recording.metadata.get(FLIGHT_METADATA, {}).get("epoch_ns", "")
        if text.isdecimal():
            return int(text)
    streams = [r.topics[n] for r in (first, second) for n in topics if n in r.topics]
    return min((stream.first_ns for stream in streams if stream.count), default=0)


def _compare(first: Recording, second: Recording, topic: str, epoch_ns: int) -> TopicComparison:
    types = [_type(recording, topic) for recording in (first, second)]
    tables = [r.columns(topic) if topic in r.topics else _EMPTY for r in (first, second)]
    stamps = [_stamps(table) for table in tables]
    times_s = [(stamp - epoch_ns) / 1e9 for stamp in stamps]
    (rows_a, rows_b), left = _pair(tables, stamps)
    firsts: list[tuple[float, str]] = []
    fields: list[FieldDifference] = []
    if None not in types and types[0] != types[1]:
        earliest_s = float(np.concatenate(times_s).min())
        firsts.append((earliest_s, f"type: {types[0]} in A, {types[1]} in B"))
        rows_a = rows_b = rows_a[:0]
    at_s = times_s[0][rows_a]
    for path in dict.fromkeys(name for table in tables for name in table):
        if path in _NO_FIELDS:
            continue
        whole = [
            table[path] if path in table else _absent(other[path], len(table["log_time_ns"]))
            for table, other in (tables, tables[::-1])
        ]
        values = whole[0][rows_a], whole[1][rows_b]
        differs = _differs(*values)
        if differs.any():
            earliest_s, count = float(at_s[differs].min()), int(differs.sum())
            fields.append(FieldDifference(path, count, earliest_s, _largest(values, differs)))
    firsts += [(field.first_difference_s, field.field) for field in fields]
    for name, time_s, rows in zip("AB", times_s, left, strict=True):
        if len(rows):
            firsts.append((float(time_s[rows].min()), f"message in {name} only"))
    counts = (len(stamps[0]), len(stamps[1]), len(left[0]), len(left[1]))
    first_s, what = min(firsts, key=lambda item: item[0], default=(None, None))
    largest = max((f.largest for f in fields if f.largest is not None), default=None)
    return TopicComparison(topic, *counts, not firsts, first_s, what, largest, tuple(fields))


_EMPTY: ColumnTable = {name: np.zeros(0, np.int64) for name in ("log_time_ns", "publish_time_ns")}


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
        column = np.empty(number, object)
        column.fill(np.zeros(0))
        return column
    if like.dtype.kind == "U":
        return np.full(number, "")
    return np.full((number, *like.shape[1:]), np.nan)


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
