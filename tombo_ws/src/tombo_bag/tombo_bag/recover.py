"""Makes a proper file of a damaged one: everything whole, with indexes and summary."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tombo_bag.mcap_sink import Columns, McapSink
from tombo_bag.reader import Bag, Damage


@dataclass(frozen=True)
class Recovery:
    """What was saved from a file: number of messages, and what is missing."""

    messages: int
    damage: tuple[Damage, ...]


def recover(source: str | Path, target: str | Path) -> Recovery:
    """Copy every whole message of a file, damaged or not, to a new one.

    Raises:
        InputError: the source is no MCAP file, or the target can't be written.
    """
    bag = Bag(source, check=True)
    parts: list[Columns] = []
    with McapSink(target) as sink:
        for record in bag.metadata:
            sink.add_metadata(record.name, record.metadata)
        for number, channel in sorted(bag.channels.items()):
            schema = bag.schemas.get(channel.schema_id)
            copy = sink.add_foreign_channel(
                channel.topic,
                schema.name if schema else "",
                schema.encoding if schema else "",
                schema.data if schema else b"",
                channel.message_encoding,
                channel.metadata,
            )
            raw = bag.messages(number)
            parts.append(Columns(copy, raw.log_times_ns, raw.messages, raw.publish_times_ns))
        sink.write_columns(*parts)
    return Recovery(sum(len(part.messages) for part in parts), bag.damage)
