"""Serves a source of messages as the live page, until the process is asked to stop."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import Any

from starlette.applications import Starlette

from tombo_web.live_page import live_page
from tombo_web.live_session import LiveSession, MessageSource
from tombo_web.server import Access, LiveServer, serve_page


@dataclass(frozen=True)
class Address:
    """Where a page is served."""

    host: str
    port: int
    """0: a free one."""
    foxglove: int | None = None
    """Port of Foxglove's server; None: without."""


def serve_live(
    source: MessageSource,
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
    with ExitStack() as stack:

        def application(access: Access) -> Starlette:
            session, publish = LiveSession(source, title, obstacle), None
            if address.foxglove is not None:
                from tombo_web.foxglove_stream import FoxgloveStream

                stream = stack.enter_context(
                    closing(FoxgloveStream(address.host, address.foxglove))
                )
                publish = stream.publish
            return LiveServer(session, access, live_page(title, scenario or {}), publish).app

        serve_page("live", address.host, address.port, application)
