"""A recording written once more, with changes."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tombo_bag.flight_time import FLIGHT_METADATA
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.formats.reader import Bag
from tombo_dynamics.time_base import SECOND_NS


def every(topic: str, count: int) -> np.ndarray:
    return np.ones(count, bool)


def rewrite(
    source: Path,
    target: Path,
    *,
    metadata: dict[str, str],
    shift_s: int = 0,
    log_time: Callable[[np.ndarray], np.ndarray] = lambda stamps: stamps,
    keep: Callable[[str, int], np.ndarray] = every,
    edit: Callable[[str, list[bytes]], list[bytes]] = lambda topic, messages: messages,
) -> Path:
    """The same messages with other stamps, log times, losses, metadata and content."""
    bag = Bag(source)
    with McapSink(target) as sink:
        if metadata:
            sink.add_metadata(FLIGHT_METADATA, metadata)
        parts = []
        for topic, raw in bag.messages(bag.topics).items():
            typename = bag.topics[topic].typename
            there = keep(topic, len(raw.messages))
            if not there.any():
                continue
            times = log_time(raw.log_times_ns + shift_s * SECOND_NS)[there]
            kept = [data for data, wanted in zip(raw.messages, there, strict=True) if wanted]
            chosen = [shifted(data, typename, shift_s) for data in kept] if shift_s else kept
            chosen = edit(topic, chosen)
            parts.append(Columns(sink.add_channel(topic, typename), times, chosen))
        sink.write_columns(*parts)
    return target


def shifted(data: bytes, typename: str, shift_s: int) -> bytes:
    if typename.endswith(("TFMessage", "MarkerArray")):
        return data
    (seconds,) = struct.unpack_from("<i", data, 4)
    return data[:4] + struct.pack("<i", seconds + shift_s) + data[8:]


def metadata_of(path: Path, *left_out: str) -> dict[str, str]:
    found = Bag(path).metadata[FLIGHT_METADATA]
    return {key: value for key, value in found.items() if key not in left_out}
