"""Damage to a file, drawn from a seed: bytes anywhere, or within what the format packs."""

from __future__ import annotations

import gzip
import random
import re
import shutil
import sqlite3
import struct
from contextlib import closing
from pathlib import Path

from mcap.writer import CompressionType, Writer

from tombo_bag.formats.reader import Bag

_NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63 - 1,
            2**63, 2**64 - 1)  # fmt: skip
_WORDS = (
    *("", "0", "-1", "nan", ".nan", ".inf", "1e400", "1e-400", "9" * 400, "0x" + "f" * 90),
    *("1:1:1:1", "null", "~", "true", "[]", "{}", "[", "{", "]", ": ", "- ", "*a", "&a ", "<<: "),
    *("!!int ''", "!!timestamp x", "!!binary é", "!!float x", "!!python/name:os.system", "'", '"'),
    *("\0", "\ufeff", "\u2028", "\t", "../../x.yaml", "/dev/null", "a" * 3000, "2020-13-45", "%"),
    *("---", "...", "#", "|", ">", "? ", "@", "`", "1e18", "-1e18", "1_000", "0b1", "é", "☃"),
)
_TOKEN = re.compile(r"[\w.+-]+|[^\w\s]")


def mutated(source: Path, target: Path, form: str, seed: int) -> bool:
    """Write a damaged copy of a file; return whether the payload of messages alone was changed."""
    rng = random.Random(seed)
    if form == "mcap" and rng.random() < 0.5:
        return _mcap(source, target, rng)
    if form == "sqlite" and source.suffix == ".db3" and rng.random() < 0.6:
        _sqlite(source, target, rng)
    elif form == "gzip" and rng.random() < 0.6:
        text = _text(gzip.decompress(source.read_bytes()), rng)
        target.write_bytes(gzip.compress(text, 1))
    elif form == "text" and rng.random() < 0.8:
        target.write_bytes(_text(source.read_bytes(), rng))
    else:
        target.write_bytes(_bytes(source.read_bytes(), rng))
    return False


def _bytes(raw: bytes, rng: random.Random) -> bytes:
    """Change bytes, numbers and spans of bytes."""
    data = bytearray(raw)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        at = rng.randrange(len(data) + 1)
        if rng.random() < 0.3:
            at = min(at, rng.choice((64, 512, 4096)))
        kind = rng.randrange(8)
        if kind == 0 and at < len(data):
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 1 and at < len(data):
            data[at] = rng.randrange(256)
        elif kind in (2, 3):
            size = rng.choice((1, 2, 4, 8))
            number = (rng.choice(_NUMBERS) + rng.choice((0, 0, -1, 1))) % 2 ** (8 * size)
            data[at : at + size] = number.to_bytes(size, rng.choice(("little", "little", "big")))
        elif kind == 4:
            del data[at : at + rng.choice((1, 4, 100, 4096))]
        elif kind == 5:
            part = data[at : at + rng.choice((1, 8, 100, 2000))]
            data[at:at] = part * rng.choice((1, 2, 20))
        elif kind == 6:
            other = rng.randrange(len(data) + 1)
            size = rng.choice((8, 64, 1000))
            data[at : at + size] = data[other : other + size]
        elif rng.random() < 0.4:
            del data[at:]
        else:
            data[at : at + 16] = rng.randbytes(16)
        if not data:
            data += b"\0"
    return bytes(data)


def _text(raw: bytes, rng: random.Random) -> bytes:
    """Change words, lines and the nesting of a text."""
    text = raw.decode("utf-8", "replace")
    for _ in range(rng.choice((1, 1, 2, 3))):
        lines = text.split("\n")
        i = rng.randrange(len(lines))
        kind = rng.randrange(7)
        if kind in (0, 1, 2):
            tokens = list(_TOKEN.finditer(lines[i]))
            if tokens:
                token = rng.choice(tokens)
                word = rng.choice(_WORDS)
                lines[i] = lines[i][: token.start()] + word + lines[i][token.end() :]
        elif kind == 3:
            lines[i : i + 1] = lines[i : i + 1] * rng.choice((0, 2, 2, 300))
        elif kind == 4:
            lines[i] = rng.choice((" ", "  ", "\t", "- ")) + lines[i]
        elif kind == 5:
            j = rng.randrange(len(lines))
            lines[i], lines[j] = lines[j], lines[i]
        else:
            lines[i] = lines[i] + " " + rng.choice(("[" * 3000, "{a: " * 500, rng.choice(_WORDS)))
        text = "\n".join(lines)
    return text.encode("utf-8", "surrogatepass")


def _mcap(source: Path, target: Path, rng: random.Random) -> bool:
    """Write a recording anew with damaged messages, times, types or topics, and checksums."""
    bag = Bag(source)
    payload = rng.random() < 0.5
    kind = "payload" if payload else rng.choice(("time", "schema", "topic", "metadata", "length"))
    chosen = rng.choice(sorted(bag.topics))
    compression = rng.choice(list(CompressionType)[:3])
    with target.open("wb") as file:
        writer = Writer(file, chunk_size=rng.choice((2000, 1 << 20)), compression=compression)
        writer.start("ros2", "")
        for name, values in bag.metadata.items():
            if kind == "metadata":
                values = {
                    k: _text(v.encode(), rng).decode("utf-8", "replace") for k, v in values.items()
                }
            writer.add_metadata(name, dict(values))
        for topic, raw in bag.messages(list(bag.topics)).items():
            found = next(c for c in bag._map.channels.values() if c.topic == topic)
            schema = bag._map.schemas[found.schema_id]
            text, name = schema.data, topic
            if kind == "schema" and topic == chosen:
                text = _text(text, rng)
            if kind == "topic" and topic == chosen:
                name = _text(topic.encode(), rng).decode("utf-8", "replace")
            number = writer.register_schema(schema.name, schema.encoding, text)
            channel = writer.register_channel(name, "cdr", number)
            hit = rng.randrange(len(raw.messages)) if len(raw.messages) else 0
            for i, (time, data) in enumerate(
                zip(raw.log_times_ns.tolist(), raw.messages, strict=True)
            ):
                if topic == chosen and (i == hit or rng.random() < 0.02):
                    if payload:
                        data = _same_size(data, rng)
                    elif kind == "length":
                        data = _bytes(data, rng)
                    elif kind == "time":
                        time = rng.choice(_NUMBERS)
                writer.add_message(channel, time, data, rng.choice((time, 0)))
        writer.finish()
    return payload


def _same_size(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 4, 30))):
        if rng.random() < 0.5 and len(changed) > 12:
            at = rng.randrange(4, len(changed) - 8)
            changed[at : at + 8] = struct.pack(
                "<d", rng.choice((1e308, -1e308, float("nan"), float("inf"), 0.0))
            )
        elif changed:
            changed[rng.randrange(len(changed))] = rng.randrange(256)
    return bytes(changed)


_VALUES = (
    *("NULL", "''", "'x'", "0", "-1", "9e999", "-9e999", "1.5", "9223372036854775807", "x'00'"),
    *("zeroblob(1000000)", "randomblob(40)", "'" + "a" * 5000 + "'", "-9223372036854775808"),
)
_ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT"


def _sqlite(source: Path, target: Path, rng: random.Random) -> None:
    """Change values, or the tables themselves."""
    shutil.copyfile(source, target)
    table = rng.choice(
        ("topics", "messages", "messages", "schema", "metadata", "message_definitions")
    )
    with closing(sqlite3.connect(target)) as file:
        try:
            columns = [row[1] for row in file.execute(f"PRAGMA table_info({table})")]
            kind = rng.randrange(10)
            if kind < 7 and columns:
                few = rng.choice(("", "WHERE rowid % 7 = 3", "WHERE rowid = 1"))
                value = rng.choice(_VALUES)
                file.execute(f"UPDATE {table} SET {rng.choice(columns)} = {value} {few}")
            elif kind == 7:
                file.execute(f"DROP TABLE {table}")
            elif kind == 8:
                file.execute(f"ALTER TABLE {table} DROP COLUMN {rng.choice(columns)}")
            else:
                file.execute(f"ALTER TABLE {table} RENAME TO other")
                rows = ", ".join(f"x AS {c}" for c in columns)
                file.execute(f"CREATE VIEW {table} AS {_ENDLESS} {rows} FROM c")
            file.commit()
        except sqlite3.Error:
            file.rollback()
