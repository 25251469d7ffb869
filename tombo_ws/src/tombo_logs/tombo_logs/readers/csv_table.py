"""A table of numbers as text, plain or gzip: of a damaged one, the rows that are whole.

Tables of flights, of thrust stands and of flap videos are read here alone. Cells are parted by
commas, semicolons or tabs. Numbers have decimal points; where cells are not parted by commas and
no number has a point, decimal commas are read, and it is said.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tombo_bag.formats.unpacking import GZIP_MAGIC, Allowance, unpack_file
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_logs.readers.mocap_exports import as_table

_BETWEEN_CELLS = rb"(?:^|[;\t])\s*[-+]?\d+%b\d+(?:[eE][-+]?\d+)?\s*(?=[;\t]|$)"
_DECIMAL_COMMA = re.compile(_BETWEEN_CELLS % b",", re.MULTILINE)
_DECIMAL_POINT = re.compile(_BETWEEN_CELLS % rb"\.", re.MULTILINE)
_SPACED = re.compile(
    rb"\s*(?:[^\s,;\d]+ +)+[^\s,;\d]+[ \t]*\n[ \t]*(?:[-+.\deE]+ +)+[-+.\deE]+[ \t]*\n"
)
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
    """What of the file is lost."""
    remarks: tuple[str, ...] = ()
    """How its numbers are understood, where that is not plain."""
    mapping: str = ""
    """Text of the mapping that belongs to an export of motion-capture software."""

    def numbers(self, wanted: Collection[str]) -> tuple[dict[str, Array], tuple[str, ...]]:
        """Read some columns; other values are NaN. Also returns the unreadable cells.

        Raises:
            InputError: no row is whole, or a column's name is there twice.
        """
        for name in sorted(wanted):
            if self.columns.count(name) > 1:
                raise InputError(f"'{self.path}' has column '{name}' twice; accepted: once")
        import pandas  # slow to load, and most logs are not tables

        indices = {name: self.columns.index(name) for name in wanted}
        lines = self.body.replace(b'"', b"").splitlines()
        rows = [r for r in lines if r.strip() and not r.lstrip().startswith(b"#")]
        widths = [row.count(self.delimiter.encode()) + 1 for row in rows]
        whole, width = rows, max(widths, default=0)
        if min(widths, default=0) <= max(indices.values(), default=0):  # some lack the last one
            width = len(self.columns)
            whole = [row for row, n in zip(rows, widths, strict=True) if n == width]
        if not whole:
            raise InputError(f"'{self.path}' holds a header and no row of numbers")
        cells = pandas.read_csv(
            io.BytesIO(b"\n".join(whole)),
            sep=self.delimiter,
            names=range(width),
            usecols=sorted(indices.values()),
            na_values=sorted(_NOTHING),
            skipinitialspace=True,
            quoting=csv.QUOTE_NONE,
            encoding_errors="replace",
            low_memory=False,
        )
        numbers = cells.apply(pandas.to_numeric, errors="coerce").astype(np.float64)
        text = int((numbers.isna() & cells.notna()).to_numpy().sum())
        damage = []
        if len(whole) < len(rows):
            short = len(rows) - len(whole)
            damage.append(f"{short} of {len(rows)} rows have too few or too many cells")
        if text:
            damage.append(f"{text} cells are no numbers")
        values = numbers.where(np.isfinite(numbers))
        read = {name: values[i].to_numpy() for name, i in indices.items()}
        return read, tuple(damage)

    def number_columns(self) -> tuple[str, ...]:
        """Return columns that begin with numbers or empty cells and whose name is there once."""
        count, names = len(self.columns), Counter(self.columns)
        text: set[int] = set()
        for line in self.body[:200_000].decode("utf-8", "replace").splitlines()[:200]:
            cells = line.split(self.delimiter)
            if len(cells) == count:
                text |= {i for i, cell in enumerate(cells) if _number(cell) is None}
        return tuple(
            name
            for i, name in enumerate(self.columns)
            if i not in text and name and names[name] == 1
        )


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
    if raw.startswith(GZIP_MAGIC):
        out = io.BytesIO()
        wrong = unpack_file(io.BytesIO(raw), out, Allowance(path))
        raw = out.getvalue()
        if wrong and not raw:
            raise InputError(f"'{path}' can't be unpacked: {wrong}")
        damage = (wrong,) if wrong else ()
    if not raw.strip():
        raise InputError(f"'{path}' is empty; accepted: a table of numbers with a header")
    raw = raw.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"\0" in raw[:4096]:
        raise InputError(f"'{path}' starts with bytes {raw[:8].hex(' ')}: no table of text")
    if not raw.endswith(b"\n"):
        # a row that is cut within its last number looks whole
        whole, _, rest = raw.rpartition(b"\n")
        if damage:
            raw, damage = whole, (*damage, f"its last row, '{_shown(rest)}', is not whole")
    try:
        raw, mapping = as_table(raw) or (raw, "")
    except InputError as error:
        raise InputError(f"'{path}': {error}") from error
    return replace(_plain_table(path, raw, damage), mapping=mapping)


def _plain_table(path: Path, raw: bytes, damage: tuple[str, ...]) -> CsvTable:
    if _SPACED.match(raw):  # columns parted by spaces alone
        raw = re.sub(rb"(?<=\S)[ \t]+(?=\S)", b",", raw)
    remark, at = "", 0
    while at < len(raw):
        end = raw.find(b"\n", at) + 1 or len(raw)
        line = raw[at:end].decode("utf-8", "replace").strip()
        if line and not line.startswith(("#", "%")):
            if _is_header_of(remark, line):
                return _header(path, remark, raw[at:], damage)  # as in "#timestamp [ns],x [m]"
            return _header(path, line, raw[end:], damage)
        remark, at = line.lstrip("#% ") or remark, end
    raise InputError(f"'{path}' has no header; accepted: a first line with names of columns")


def _is_header_of(remark: str, row: str) -> bool:
    """Return whether a remark names the cells of a row, which has numbers, and maybe texts."""
    names, cells = _cells(remark), _cells(row)
    numbers = [number for cell in cells if (number := _number(cell)) is not None]
    named = sum(_number(name) is None for name in names)
    has_numbers = bool(np.isfinite(numbers).any())
    return len(names) == len(cells) > 1 and has_numbers and 2 * named > len(names)


def _header(path: Path, line: str, body: bytes, damage: tuple[str, ...]) -> CsvTable:
    delimiter, columns = _delimiter(line), tuple(_cells(line))
    if len(columns) < 2 or _is_numbers(line):
        raise InputError(
            f"'{path}' starts with '{_shown(line.encode())}'; accepted: a header with the names "
            "of columns, parted by commas, semicolons or tabs"
        )
    body, remarks = _with_points(body) if delimiter != "," else (body, ())
    return CsvTable(path, columns, delimiter, body, damage, remarks)


def _with_points(body: bytes) -> tuple[bytes, tuple[str, ...]]:
    """Return rows whose cells are not parted by commas with decimal points, and a remark on it."""
    if b"," not in body or not (comma := _DECIMAL_COMMA.search(body)):
        return body, ()
    cell = _shown(comma[0].lstrip(b";\t"))
    if point := _DECIMAL_POINT.search(body):
        other = _shown(point[0].lstrip(b";\t"))
        return body, (
            f"'{cell}' has a comma and '{other}' a point: numbers with commas are left out; "
            "accepted: decimal points, or decimal commas, throughout",
        )
    return body.replace(b",", b"."), (f"decimal commas are read as points, as in '{cell}'",)


def _delimiter(line: str) -> str:
    return max(",;\t", key=line.count)


def _cells(line: str) -> list[str]:
    return [cell.strip().strip('"').strip() for cell in line.split(_delimiter(line))]


def _is_numbers(line: str) -> bool:
    return all(_number(cell) is not None for cell in _cells(line))


def _shown(text: bytes) -> str:
    return text[:40].decode("utf-8", "replace").strip()
