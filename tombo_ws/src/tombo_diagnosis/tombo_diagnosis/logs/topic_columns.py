"""Columns of a table by name: with a minus before it, or one of an array as `data[2]`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.logs.csv_mapping import ChannelMap
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import unknown_name

_ELEMENT = re.compile(r"(.+)\[(\d+)\]")


def columns_at(table: Mapping[str, NDArray[Any]], channel: ChannelMap, what: str) -> Array:
    """Return (N, k): the columns of a channel.

    Raises:
        InputError: `what` has no such column.
    """
    return np.column_stack([_column(table, name, what) for name in channel.columns])


def number_columns(table: Mapping[str, NDArray[Any]]) -> Iterator[tuple[str, Array]]:
    """Yield all columns of numbers, those of an array one by one; each (N,)."""
    for name, values in table.items():
        if values.dtype.kind not in "fiub":
            continue
        if values.ndim == 1:
            yield name, values.astype(np.float64)
        elif values.ndim == 2:
            for i, column in enumerate(values.T):
                yield f"{name}[{i}]", column.astype(np.float64)


def _column(table: Mapping[str, NDArray[Any]], name: str, what: str) -> Array:
    if name not in table and name.startswith("-"):
        return -_column(table, name[1:], what)
    found = table.get(name)
    element = _ELEMENT.fullmatch(name)
    if found is None and element is not None:
        array = table.get(element[1])
        if array is not None and array.ndim == 2 and int(element[2]) < array.shape[1]:
            found = array[:, int(element[2])]
    if found is None or found.ndim != 1 or found.dtype.kind not in "fiub":
        raise unknown_name(f"column of {what}", name, [n for n, _ in number_columns(table)])
    return np.asarray(found, np.float64)
