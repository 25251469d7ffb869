"""A table of numbers as text, plain or gzip: of a damaged one, the rows that are whole.

Tables of flights, of thrust stands and of flap videos are read here alone. Cells are parted by
commas, semicolons or tabs. Numbers have decimal points; where cells are not parted by commas and
no number has a point, decimal commas are read, and a remark says so.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tombo_bag.formats.unpacking import GZIP_MAGIC, unpack_file
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_logs.readers.mocap_exports import as_table

_CELL = rb"(?:^|[;\t])\s*[-+]?\d+%b\d+(?:[eE][-+]?\d+)?\s*(?=[;\t]|$)"
_DECIMAL_COMMA = re.compile(_CELL % b",", re.MULTILINE)
_DECIMAL_POINT = re.compile(_CELL % rb"\.", re.MULTILINE)
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
    """Descriptions of lost parts of the file."""
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
                text |= {i for i, cell in enumerate(cells) if not _is_number(cell)}
        return tuple(
            name
            for i, name in enumerate(self.columns)
            if i not in text and name and names[name] == 1
        )


def _is_number(cell: str) -> bool:
    """Return whether a cell is empty or a number."""
    text = cell.strip().strip('"')
    try:
        float(text)
    except ValueError:
        return text.lower() in _NOTHING
    return True


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
        wrong = unpack_file(io.BytesIO(raw), out)
        raw = out.getvalue()
        if wrong and not raw:
            raise InputError(f"'{path}' can't be unpacked: {wrong}")
        if wrong:
            # a row that is cut within its last number looks whole
            raw, damage = raw[: raw.rfind(b"\n") + 1], (wrong,)
    raw = raw.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if not raw.strip():
        raise InputError(f"'{path}' is empty; accepted: a table of numbers with a header")
    if b"\0" in raw[:4096]:
        raise InputError(f"'{path}' starts with bytes {raw[:8].hex(' ')}: no table of text")
    try:
        raw, mapping = as_table(raw) or (raw, "")
    except InputError as error:
        raise InputError(f"'{path}': {error}") from error
    if _SPACED.match(raw):  # columns parted by spaces alone
        raw = re.sub(rb"(?<=\S)[ \t]+(?=\S)", b",", raw)
    header, body = _header(path, raw)
    remarks: tuple[str, ...] = ()
    delimiter = _delimiter(header)
    if delimiter != "," and _DECIMAL_COMMA.search(body) and not _DECIMAL_POINT.search(body):
        body, remarks = body.replace(b",", b"."), ("decimal commas are read as points",)
    return CsvTable(path, tuple(_cells(header)), delimiter, body, damage, remarks, mapping)


def _header(path: Path, raw: bytes) -> tuple[str, bytes]:
    """Return the line with the names of the columns, and the rows below it.

    It may be a remark, as `#timestamp [ns],x [m]`, above rows of as many cells.

    Raises:
        InputError: there is none.
    """
    remark, at = "", 0
    while at < len(raw):
        end = raw.find(b"\n", at) + 1 or len(raw)
        line = raw[at:end].decode("utf-8", "replace").strip()
        cells = _cells(line)
        if line and not line.startswith(("#", "%")):
            if any(map(_is_number, filter(None, cells))) and len(_cells(remark)) == len(cells) > 1:
                return remark, raw[at:]
            if len(cells) > 1 and not all(map(_is_number, cells)):
                return line, raw[end:]
            break
        remark, at = line.lstrip("#% ") or remark, end
    raise InputError(
        f"'{path}' has no header; accepted: a header with the names of columns, parted by commas, "
        "semicolons or tabs"
    )


def _delimiter(line: str) -> str:
    return max(",;\t", key=line.count)


def _cells(line: str) -> list[str]:
    return [cell.strip().strip('"').strip() for cell in line.split(_delimiter(line))]
