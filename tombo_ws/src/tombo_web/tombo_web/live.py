"""Serves a source of messages as the live page, until the process is asked to stop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tombo_web.live_page import live_page
from tombo_web.live_session import LiveSession, Source
from tombo_web.server import Access, LiveServer, bound_socket


@dataclass(frozen=True)
class Address:
    """Where a page is served."""

    host: str
    port: int
    """0: a free one."""
    foxglove: int | None = None
    """Port of Foxglove's server; None: without."""


def serve_live(
    source: Source,
    title: str,
    address: Address,
    scenario: Mapping[str, Any] | None = None,
    obstacle: Mapping[str, float] | None = None,
) -> None:
    """Print the page's address and serve it.

    Args:
        source: what gives messages.
        title: shown on the page.
        address: where.
        scenario: of the flight, for the lengths of the vehicle; None: the default vehicle.
        obstacle: x_m, y_m, radius_m, top_m of the cylinder, where the source says nothing of it.

    Raises:
        InputError: a port is taken, or the address is not this machine's.
    """
    listener = bound_socket(address.host, address.port)
    access = Access.new(address.host, listener.getsockname()[1])
    session = LiveSession(source, title, obstacle)
    stream: Any = None
    if address.foxglove is not None:
        from tombo_web.foxglove_stream import FoxgloveStream

        stream = FoxgloveStream(address.host, address.foxglove)
    publish = None if stream is None else stream.publish
    server = LiveServer(session, access, live_page(title, scenario or {}), publish)
    print(f"live: {access.url}  (Ctrl-C ends it)", flush=True)
    try:
        server.run(listener)
    except KeyboardInterrupt:  # how the server ends
        pass
    finally:
        if stream is not None:
            stream.close()
