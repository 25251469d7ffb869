"""The messages of the live page for Foxglove and Lichtblick, by Foxglove's own server."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import foxglove
from tombo_bag.message_codec import FORMS, MessageCodec
from tombo_bag.schemas import schema_text
from tombo_bag.topics import TOPICS
from tombo_dynamics.errors import InputError
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.time_base import SECOND_NS
from tombo_web.live_session import LiveSession


class FoxgloveStream:
    """Sends every message whose type a core has, as the ROS 2 message that it is."""

    def __init__(self, host: str, port: int) -> None:
        """Serve at an address.

        Raises:
            InputError: the address is taken or not this machine's.
        """
        try:
            self._server = foxglove.start_server(name="tombo live", host=host, port=port)
        except (RuntimeError, OSError) as error:
            raise InputError(f"--foxglove {port}: {error}; accepted: a free port") from error
        self.port = self._server.port
        self._channels: dict[str, tuple[Any, MessageCodec]] = {}

    def publish(self, session: LiveSession) -> None:
        """Send the messages of the last frame."""
        for message in session.messages:
            spec = TOPICS.get(message.topic)
            if spec is None or spec.typename not in FORMS:
                continue
            channel, codec = self._channel(message.topic, spec.typename)
            if channel.has_sinks():
                data = codec.encode(_dataclass(codec, message.fields, message.time_s))
                channel.log(data, log_time=round(message.arrival_s * SECOND_NS))

    def close(self) -> None:
        """End the server."""
        self._server.stop()

    def _channel(self, topic: str, typename: str) -> tuple[Any, MessageCodec]:
        if topic not in self._channels:
            text = schema_text(typename).encode()
            schema = foxglove.Schema(name=typename, encoding="ros2msg", data=text)
            channel = foxglove.Channel(topic, schema=schema, message_encoding="cdr")
            self._channels[topic] = (channel, MessageCodec(typename))
        return self._channels[topic]


def _dataclass(codec: MessageCodec, fields: Mapping[str, Any], time_s: float) -> Any:
    """Return the message of fields; absent fields have the type's defaults."""
    kind = FORMS[codec.typename].kind
    names = {field.name for field in dataclasses.fields(kind)}
    given = {name: fields[name] for name in names if name in fields}
    given.setdefault("stamp_ns", round(time_s * SECOND_NS))
    if "frame_id" in names:
        given.setdefault("frame_id", FRAME_MAP)
    return kind(**given)
