"""A table of numbers as text, plain or gzip: of a damaged one, the rows that are whole."""

from __future__ import annotations

import io
import re
import zlib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError

_GZIP = b"\x1f\x8b"
_LARGEST = 2_000_000_000
"""Bytes that an unpacked table may have."""
_DECIMAL_COMMA = re.compile(rb"(?:^|[;\t])\s*-?\d+,\d+(?:[eE][-+]?\d+)?\s*(?:[;\t]|$)")
_NOTHING = {"", "nan", "none", "null", "na", "n/a", "-nan", "nil"}


@dataclass(frozen=True)
class CsvTable:
    """The text of a table and its columns; `numbers` reads them."""

    path: Path
    columns: tuple[str, ...]
    delimiter: str
    body: bytes
    """Below the header."""
    damage: tuple[str, ...]

    def numbers(self, wanted: Collection[str]) -> tuple[dict[str, Array], tuple[str, ...]]:
        """Read some columns; what is no number is NaN. Also returns what could not be read.

        Raises:
            InputError: no row is whole.
        """
        indices = {name: self.columns.index(name) for name in wanted}
        order = sorted(indices.values())
        if not self.body.strip():
            raise InputError(f"'{self.path}' holds a header and no row of numbers")
        try:
            values = np.loadtxt(
                io.BytesIO(self.body), delimiter=self.delimiter, usecols=order, ndmin=2,
                encoding="utf-8",
            )  # fmt: skip
            damage: tuple[str, ...] = ()
        except (ValueError, UnicodeDecodeError):
            values, damage = self._row_by_row(order)
        if not values.size:
            raise InputError(f"'{self.path}' holds a header and no row of numbers")
        values[np.isinf(values)] = np.nan
        return {name: values[:, order.index(i)] for name, i in indices.items()}, damage

    def number_columns(self) -> tuple[str, ...]:
        """Return columns that begin with numbers or empty cells and whose name is there once."""
        count = len(self.columns)
        text: set[int] = set()
        for line in self.body[:200_000].decode("utf-8", "replace").splitlines()[:200]:
            cells = line.split(self.delimiter)
            if len(cells) == count:
                text |= {i for i, cell in enumerate(cells) if _number(cell) is None}
        return tuple(
            name
            for i, name in enumerate(self.columns)
            if i not in text and name and self.columns.count(name) == 1
        )

    def _row_by_row(self, order: list[int]) -> tuple[Array, tuple[str, ...]]:
        rows, short, text = [], 0, 0
        for line in self.body.decode("utf-8", "replace").splitlines():
            if not line.strip() or line.lstrip().startswith("#"):
                continue
            cells = line.split(self.delimiter)
            if len(cells) != len(self.columns):
                short += 1
                continue
            row = [_number(cells[i]) for i in order]
            text += sum(value is None for value in row)
            rows.append([np.nan if value is None else value for value in row])
        damage = []
        if short:
            damage.append(f"{short} of {len(rows) + short} rows have too few or too many cells")
        if text:
            damage.append(f"{text} cells are no numbers")
        return np.array(rows, np.float64).reshape(len(rows), len(order)), tuple(damage)


def _number(cell: str) -> float | None:
    text = cell.strip().strip('"')
    if text.lower() in _NOTHING:
        return float("nan")
    try:
        return float(text)
    except ValueError:
        return None


def open_table(path: Path) -> CsvTable:
    """Read a CSV or CSV.gz file up to its header.

    Raises:
        InputError: empty, binary, or without a header.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"can't read '{path}': {error.strerror}") from error
    damage: tuple[str, ...] = ()
    if raw.startswith(_GZIP):
        raw, damage = _unpack(raw, path)
    if not raw.strip():
        raise InputError(f"'{path}' is empty; accepted: a table of numbers with a header")
    raw = raw.removeprefix(b"\xef\xbb\xbf")
    if b"\0" in raw[:4096]:
        raise InputError(f"'{path}' starts with bytes {raw[:8].hex(' ')}: no table of text")
    if not raw.endswith(b"\n"):
        # a row that is cut within its last number looks whole
        whole, _, rest = raw.rpartition(b"\n")
        if damage:
            raw, damage = whole, (*damage, f"its last row, '{_shown(rest)}', is not whole")
    remark = ""
    while raw:
        first, _, rest = raw.partition(b"\n")
        line = first.decode("utf-8", "replace").strip()
        if line and not line.startswith(("#", "%")):
            if remark and _is_numbers(line) and len(_cells(line)) == len(_cells(remark)):
                return _header(path, remark, raw, damage)  # as in "#timestamp [ns],x [m]"
            return _header(path, line, rest, damage)
        remark, raw = line.lstrip("#% ") or remark, rest
    raise InputError(f"'{path}' has no header; accepted: a first line with names of columns")


def _header(path: Path, line: str, body: bytes, damage: tuple[str, ...]) -> CsvTable:
    delimiter, columns = _delimiter(line), tuple(_cells(line))
    if delimiter != "," and _DECIMAL_COMMA.search(body.partition(b"\n")[0]):
        body = body.replace(b",", b".")
    if len(columns) < 2 or _is_numbers(line):
        raise InputError(
            f"'{path}' starts with '{_shown(line.encode())}'; accepted: a header with the names "
            "of columns, parted by commas, semicolons or tabs"
        )
    return CsvTable(path, columns, delimiter, body, damage)


def _delimiter(line: str) -> str:
    return max(",;\t", key=line.count)


def _cells(line: str) -> list[str]:
    return [cell.strip().strip('"').strip() for cell in line.split(_delimiter(line))]


def _is_numbers(line: str) -> bool:
    return all(_number(cell) is not None for cell in _cells(line))


def _unpack(raw: bytes, path: Path) -> tuple[bytes, tuple[str, ...]]:
    unpacker, parts = zlib.decompressobj(wbits=31), []
    try:
        while raw:
            parts.append(unpacker.decompress(raw, _LARGEST))
            if not unpacker.eof:
                break
            raw = unpacker.unused_data
            unpacker = zlib.decompressobj(wbits=31) if raw else unpacker
    except zlib.error as error:
        if parts and unpacker.eof is False and not raw.startswith(_GZIP):
            return b"".join(parts), ("bytes behind its end are left out",)
        whole = b"".join(parts) + _salvaged(raw)
        if not whole:
            raise InputError(f"'{path}' can't be unpacked: {error}") from error
        return whole, (f"the compressed file is damaged ({error}); read up to there",)
    if not unpacker.eof:
        return b"".join(parts), ("the compressed file is cut off; read up to there",)
    return b"".join(parts), ()


def _salvaged(raw: bytes) -> bytes:
    """Unpack piece by piece up to the damage."""
    unpacker, parts = zlib.decompressobj(wbits=31), []
    try:
        for start in range(0, len(raw), 4096):
            parts.append(unpacker.decompress(raw[start : start + 4096]))
    except zlib.error:
        pass
    return b"".join(parts)


def _shown(text: bytes) -> str:
    return text[:40].decode("utf-8", "replace").strip()
