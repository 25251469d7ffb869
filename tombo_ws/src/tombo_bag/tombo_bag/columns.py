"""Messages read back as columns: N messages of one type as one array per number and string."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columnar_cdr import Layout, Leaf, layout_of
from tombo_bag.schemas import Types
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.time_base import SECOND_NS

ColumnTable: TypeAlias = dict[str, NDArray[Any]]


class TopicColumns(ColumnTable):
    """The columns of a topic; one that is not there is bad input, which may lack anything."""

    def __init__(
        self,
        topic: str,
        columns: Mapping[str, NDArray[Any]],
        names: Mapping[str, str] | None = None,
    ) -> None:
        """Take columns; `names`: path in the messages → the name that a column has instead."""
        super().__init__(columns)
        self.topic = topic
        self._paths = {name: path for path, name in (names or {}).items()}

    def __missing__(self, name: str) -> NDArray[Any]:
        """Raise the error that names the column and the topic."""
        raise unknown_name(f"column of {self.topic}", self._paths.get(name, name), self)


_ELEMENT = re.compile(r"(.+)\[(\d+)\]")


@dataclass(frozen=True)
class ShapeGroup:
    """Messages of one shape: which ones, and their (N, size) bytes."""

    layout: Layout
    rows: NDArray[np.intp]
    block: NDArray[np.uint8]

    @cached_property
    def records(self) -> NDArray[np.void]:
        """The messages as a structured array."""
        return self.block.view(self.layout.dtype).ravel()


def columns_of(
    typename: str, messages: list[bytes], types: Types, lost: list[int] | None = None
) -> ColumnTable:
    """Take messages apart: path (as `pose.position.x`) → array with one row per message.

    Messages of different shape (texts or sequences of different length) stand together all the
    same. Where a message lacks a path that others have, its number is NaN and its text is empty.
    An array or sequence of numbers is one column (N, k); if the lengths differ, an object array.

    Places of messages that don't fit their type go to `lost`; these have no row.

    Raises:
        InputError: without `lost`, a message doesn't fit its type.
    """
    groups = grouped_by_shape(typename, messages, types, lost)
    if lost:
        there = np.delete(np.arange(len(messages)), lost)
        return columns_of(typename, [messages[i] for i in there], types)
    table: ColumnTable = {}
    leaves: dict[str, dict[int, Leaf]] = {}
    for i, group in enumerate(groups):
        for leaf in group.layout.leaves:
            leaves.setdefault(leaf.path, {})[i] = leaf
    for are_texts, column in ((False, _numbers), (True, _texts)):
        for path, of in leaves.items():
            if next(iter(of.values())).is_text == are_texts:
                table[path] = column(path, of, groups, len(messages))
    if "header.stamp.sec" in table and "header.stamp.nanosec" in table:
        seconds = table["header.stamp.sec"].astype(np.int64)
        table["stamp_ns"] = seconds * SECOND_NS + table["header.stamp.nanosec"]
    return table


def grouped_by_shape(
    typename: str, messages: list[bytes], types: Types, lost: list[int] | None = None
) -> list[ShapeGroup]:
    """Put messages of one shape together; the others go to `lost`, else it raises."""
    sizes = np.fromiter(map(len, messages), np.intp, len(messages))
    left = np.ones(len(messages), bool)
    groups: list[ShapeGroup] = []
    while left.any():
        row = int(np.argmax(left))
        first = messages[row]
        try:
            shape = layout_of(typename, first, types)
        except InputError:
            if lost is None:
                raise
            lost.append(row)
            left[row] = False
            continue
        rows = np.flatnonzero(left & (sizes == len(first)))
        joined = b"".join(messages if len(rows) == len(messages) else [messages[i] for i in rows])
        block: NDArray[np.uint8]
        block = np.frombuffer(joined, np.uint8).reshape(len(rows), len(first))
        fits = shape.same_shape(block)
        if not fits.all():
            rows, block = rows[fits], np.ascontiguousarray(block[fits])
        left[rows] = False
        groups.append(ShapeGroup(shape, rows, block))
    return groups


def _numbers(
    path: str, leaves: Mapping[int, Leaf], groups: list[ShapeGroup], number: int
) -> NDArray[Any]:
    leaf = next(iter(leaves.values()))
    counts = {leaf.count for leaf in leaves.values()}
    complete = len(leaves) == len(groups)
    if len(counts) == 1 and (complete or leaf.count is None):
        shape = (number,) if leaf.count is None else (number, leaf.count)
        column = np.zeros(shape, leaf.dtype) if complete else np.full(shape, np.nan)
        if leaf.count != 0:
            for i in leaves:
                column[groups[i].rows] = groups[i].records[path]
        return column
    ragged = np.empty(number, object)
    for i, group in enumerate(groups):
        filled = i in leaves and leaves[i].count
        values = group.records[path] if filled else np.zeros((len(group.rows), 0), leaf.dtype)
        for row, value in zip(group.rows, values, strict=True):
            ragged[row] = value
    return ragged


def _texts(
    path: str, leaves: Mapping[int, Leaf], groups: list[ShapeGroup], number: int
) -> NDArray[Any]:
    column = np.full(number, "", object)
    for i, leaf in leaves.items():
        if leaf.dtype.itemsize:
            raw = groups[i].records[path].tolist()
            words = {word: word.decode("utf-8", "replace") for word in set(raw)}
            column[groups[i].rows] = [words[word] for word in raw]
    return column.astype(np.str_)


def stacked_columns(
    table: Mapping[str, NDArray[Any]], names: Sequence[str], what: str
) -> NDArray[np.float64]:
    """Return (N, k): columns of numbers by name, as `data[2]`; with a minus before it, negative.

    Raises:
        InputError: `what` has no such column.
    """
    return np.column_stack([_column(table, name, what) for name in names])


def number_columns(table: Mapping[str, NDArray[Any]]) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield all columns of numbers, those of an array one by one; each (N,)."""
    for name, values in table.items():
        if values.dtype.kind not in "fiub":
            continue
        if values.ndim == 1:
            yield name, values.astype(np.float64)
        elif values.ndim == 2:
            for i, column in enumerate(values.T):
                yield f"{name}[{i}]", column.astype(np.float64)


def _column(table: Mapping[str, NDArray[Any]], name: str, what: str) -> NDArray[np.float64]:
    if name not in table and name.startswith("-"):
        return -_column(table, name[1:], what)
    column = table.get(name)
    element = _ELEMENT.fullmatch(name)
    if column is None and element is not None:
        array = table.get(element[1])
        if array is not None and array.ndim == 2 and int(element[2]) < array.shape[1]:
            column = array[:, int(element[2])]
    if column is None or column.ndim != 1 or column.dtype.kind not in "fiub":
        raise unknown_name(f"column of {what}", name, [n for n, _ in number_columns(table)])
    return np.asarray(column, np.float64)
