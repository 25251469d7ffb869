"""Measured flights from files: recordings of ROS messages, PX4 logs, tables."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from tombo_bag.flight import Flight
from tombo_bag.formats.chunks import MAGIC as MCAP_MAGIC
from tombo_bag.formats.sqlite_files import SQLITE_MAGIC
from tombo_bag.formats.unpacking import GZIP_MAGIC, ZSTD_MAGIC
from tombo_bag.recording import SUFFIXES, first_bytes
from tombo_dynamics.errors import InputError
from tombo_flight.recorded_flight import read_flight
from tombo_logs.readers.bag_log import read_bag
from tombo_logs.readers.csv_log import read_csv
from tombo_logs.readers.csv_mapping import LogMapping, load_mapping
from tombo_logs.readers.tlog import read_tlog
from tombo_logs.readers.ulog import MAGIC as ULOG_MAGIC
from tombo_logs.readers.ulog import read_ulog
from tombo_px4.telemetry_log import is_tlog

READABLE = "MCAP, rosbag2 folder, ROS 1 bag, PX4 ULog, telemetry log (tlog), CSV, CSV.gz"
_BAG_MAGIC = (MCAP_MAGIC, SQLITE_MAGIC, b"#ROSBAG", ZSTD_MAGIC)
_LOG_SUFFIXES = (*SUFFIXES, ".ulg", ".tlog", ".csv", ".csv.gz", ".tsv")
_ENDINGS = (".gz", ".csv", ".ulg", ".tlog", ".bag", ".zstd", ".mcap", ".db3")
_GENERIC_NAME = re.compile(r"(flight|log|bag|rosbag|record(ing)?|data)?[0_-]*", re.IGNORECASE)


def read_logs(
    paths: Sequence[Path],
    mapping: Path | str | None = None,
    names: Mapping[str, str] | None = None,
) -> list[Flight]:
    """Read flights, in the order given; of a folder that is not a recording, each log in it.

    `mapping` is a mapping file, or the name of a shipped one: for tables, and of recordings and
    PX4 logs its `turn_deg` and airframe. `names`: topic as recorded → name in this suite.

    Raises:
        InputError: a path that can't be read, or a flight given twice.
    """
    use = None if mapping is None else load_mapping(mapping)
    files = [log for path in paths for log in logs_in(Path(path))]
    if not files:
        raise InputError(f"no logs given; accepted: {READABLE}")
    twice = [path for path, n in Counter(path.resolve() for path in files).items() if n > 1]
    if twice:
        raise InputError(
            f"'{twice[0]}' is given twice; accepted: each flight once, else its errors count as "
            "confirmed by another"
        )
    named = zip(files, flight_names(files), strict=True)
    return [read_log(path, name, use, names) for path, name in named]


def read_single_log(
    path: Path, mapping: Path | str | None = None, names: Mapping[str, str] | None = None
) -> Flight:
    """Read the only flight of a path; arguments as of `read_logs`.

    Raises:
        InputError: as `read_logs`, or it is a folder of several.
    """
    flights = read_logs([path], mapping, names)
    if len(flights) > 1:
        raise InputError(f"'{path}' holds {len(flights)} logs; accepted: one")
    return flights[0]


def read_log(
    path: Path,
    name: str,
    mapping: LogMapping | None = None,
    names: Mapping[str, str] | None = None,
) -> Flight:
    """Read one flight; the kind of the file is found from its first bytes.

    Raises:
        InputError: it can't be read; states the reason and the accepted values.
    """
    kind = kind_of(path)
    if kind == "table":
        return read_csv(path, name, mapping)
    if kind == "recording":
        log = read_bag(path, name, names, mapping)
    else:
        log = read_ulog(path, name, mapping) if kind == "ulog" else read_tlog(path, name)
    return _adapted(log, mapping)


def kind_of(path: Path) -> str:
    """Return the kind of a file: "recording", "table", "ulog" or "tlog".

    Raises:
        InputError: it can't be read, is empty, or none of them.
    """
    start = b"" if path.is_dir() else first_bytes(path, READABLE)
    if not start or start.startswith(_BAG_MAGIC) or MCAP_MAGIC.startswith(start):
        return "recording"
    if start.startswith(ULOG_MAGIC):
        return "ulog"
    if is_tlog(start):
        return "tlog"
    text = start.removeprefix(b"\xef\xbb\xbf")
    if start.startswith(GZIP_MAGIC) or not any(byte < 9 or 13 < byte < 32 for byte in text):
        return "table"
    raise InputError(
        f"'{path}' starts with bytes {start[:8].hex(' ')}: no log that is known; accepted: "
        f"{READABLE}"
    )


def logs_in(path: Path) -> list[Path]:
    """Return the path itself, or the logs of a folder that is not a recording."""
    if not path.exists():
        raise InputError(f"'{path}' does not exist; accepted: {READABLE}")
    if not path.is_dir() or (path / "metadata.yaml").is_file():
        return [path]
    files = sorted(p for p in path.iterdir() if p.name.endswith(_LOG_SUFFIXES))
    if not files:
        raise InputError(f"folder '{path}' holds no logs; accepted: {READABLE}")
    bags = [p for p in files if p.name.endswith(SUFFIXES)]
    if bags == files and (len(bags) == 1 or _pieces(bags)):
        return [path]
    return files


def _pieces(bags: Sequence[Path]) -> bool:
    """Return whether files are one recording, cut by its recorder: name_0, name_1 and so on."""
    stems = {p.name.split(".")[0].rpartition("_")[::2] for p in bags}
    name, _ = next(iter(stems))
    return stems == {(name, str(i)) for i in range(len(bags))}


def flight_names(paths: Sequence[Path]) -> list[str]:
    """Return a name for each path: that of the file, with folders or a number where it is twice.

    A file with a generic name that is alone in its folder has the folder's name.
    """
    alone = Counter(path.absolute().parent for path in paths)
    parts = [_parts(path, alone[path.absolute().parent] == 1) for path in paths]
    for depth in range(1, max(map(len, parts), default=0) + 1):
        names = ["/".join(p[-depth:]) for p in parts]
        if len(set(names)) == len(names):
            return names
    return [f"{'/'.join(p[-1:])}#{k}" for k, p in enumerate(parts, 1)]


def _parts(path: Path, alone: bool) -> tuple[str, ...]:
    """Return the folders of a path and its name without endings."""
    *folders, name = path.absolute().parts[1:]
    while name.endswith(_ENDINGS):
        name = name.rpartition(".")[0]
    if alone and folders and _GENERIC_NAME.fullmatch(name) and not path.is_dir():
        return tuple(folders)
    return (*folders, name)


def _adapted(log: Flight, mapping: LogMapping | None) -> Flight:
    """Apply to a recording what a mapping says of its rigid body and vehicle."""
    if mapping is None:
        return log
    series = dict(log.series)
    if any(mapping.turn_deg) and "attitude" in series:
        series["attitude"] = mapping.turn_attitude(series["attitude"])
    return replace(log.with_series(series), airframe=mapping.airframe or log.airframe)


def read_every_topic(
    path: Path, mapping: Path | str | None = None, names: Mapping[str, str] | None = None
) -> list[Flight]:
    """Read flights with all that they hold: of a recording of the suite every topic it knows.

    Other logs are read as by `read_logs`. Channels are (N, width) in both.

    Raises:
        InputError: as `read_logs`.
    """
    if mapping is None and not names:
        try:
            flight = read_flight(path)
            rows = {
                k: replace(s, values=s.values.reshape(len(s.t), -1))
                for k, s in flight.series.items()
            }
            return [replace(flight, topics={**flight.topics, **flight.with_series(rows).topics})]
        except InputError:  # a log of other software
            pass
    return read_logs([path], mapping, names)
