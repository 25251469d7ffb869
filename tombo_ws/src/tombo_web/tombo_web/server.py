"""Serves one page and its stream on this machine, or with a token on others; the live page."""

from __future__ import annotations

import asyncio
import json
import secrets
import socket
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import ExitStack, asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlsplit

import uvicorn
from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from tombo_dynamics.errors import InputError
from tombo_web.live_page import live_page
from tombo_web.live_session import FRAME_HZ, LiveSession

_QUEUED: Final = 15
"""Frames that a slow page may be behind; older ones are left out."""
_LONGEST_REQUEST: Final = 4096
_LOCAL: Final = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True)
class Access:
    """Clients that may see a page, and clients that may command.

    On this machine everybody sees; elsewhere who has the token. Commands need the token and the
    page's own origin everywhere: another page of the same browser has neither.
    """

    host: str
    port: int
    token: str

    @property
    def url(self) -> str:
        """The address of the page, with its token."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.port}/?token={self.token}"

    def sees(self, connection: HTTPConnection) -> bool:
        """Return whether a client may see the page: by its name for the server and its token.

        The name keeps out pages whose own name was turned to this address.
        """
        name = urlsplit(f"//{connection.headers.get('host', '')}").hostname or ""
        if self._has_token(connection):
            return True
        return self.host in _LOCAL and name in _LOCAL and self._is_same_origin(connection, True)

    def commands(self, connection: HTTPConnection) -> bool:
        """Return whether a client may command the vehicle."""
        return self._has_token(connection) and self._is_same_origin(connection, False)

    def _has_token(self, connection: HTTPConnection) -> bool:
        given = connection.query_params.get("token", "")
        return secrets.compare_digest(given.encode(), self.token.encode())

    @staticmethod
    def _is_same_origin(connection: HTTPConnection, without: bool) -> bool:
        """Return whether a request is of the page itself; `without`: result without an origin."""
        origin = connection.headers.get("origin")
        if origin is None:
            return without
        return bool(urlsplit(origin).netloc == connection.headers.get("host", ""))


def bound_socket(host: str, port: int) -> socket.socket:
    """Return a socket that listens at an address.

    Raises:
        InputError: the address is not this machine's, or taken.
    """
    if not host.strip():
        raise InputError(f"--host '{host}': accepted: an address of this machine, as 127.0.0.1")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen()  # until then another server can take the port, too
    except (OSError, TypeError, UnicodeError) as error:  # also of an invalid host name
        listener.close()
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"{host}:{port}: {reason}; accepted: an address of this machine and a free port"
        ) from error
    return listener


def serve_page(
    name: str, host: str, port: int, application: Callable[[Access], Starlette]
) -> None:
    """Print a page's address, and serve it until the process is asked to stop.

    Args:
        name: text printed before the address.
        host: where; others than this machine's own names need the token.
        port: 0: a free one.
        application: made for who may see the page.

    Raises:
        InputError: the port is taken, or the address is not this machine's.
    """
    listener = bound_socket(host, port)
    access = Access(host, listener.getsockname()[1], secrets.token_urlsafe(18))
    config = uvicorn.Config(
        application(access), log_level="warning", ws="websockets-sansio",
        ws_max_size=_LONGEST_REQUEST, timeout_graceful_shutdown=1,
    )  # fmt: skip
    print(f"{name}: {access.url}  (Ctrl-C ends it)", flush=True)
    with suppress(KeyboardInterrupt):  # how the server ends
        uvicorn.Server(config).run(sockets=[listener])


def page_response(access: Access, request: Request, page: str) -> Response:
    """Return a page, or a refusal for a client that may not see it."""
    if not access.sees(request):
        return PlainTextResponse("accepted: the address with its token", 403)
    return HTMLResponse(page, headers={"Cache-Control": "no-store",
                                       "Referrer-Policy": "no-referrer"})  # fmt: skip


class LiveServer:
    """Makes frames at 30 Hz and sends them to every page."""

    def __init__(
        self,
        session: LiveSession,
        access: Access,
        page: str,
        publish: Callable[[LiveSession], None] | None = None,
    ) -> None:
        """Serve a session.

        Args:
            session: source and view.
            access: who may see and command.
            page: the HTML text.
            publish: called after each frame, as to pass the messages on to Foxglove.
        """
        self._session, self._access, self._page = session, access, page
        self._publish = publish
        self._clients: set[asyncio.Queue[str]] = set()
        self._begun = not session.source.seekable or publish is not None
        """A recording is played from when the first page is open."""
        self.app = Starlette(
            routes=[Route("/", self._index), WebSocketRoute("/stream", self._stream)],
            lifespan=self._lifespan,
        )

    async def _index(self, request: Request) -> Response:
        return page_response(self._access, request, self._page)

    @asynccontextmanager
    async def _lifespan(self, app: Starlette) -> AsyncIterator[None]:
        frames = asyncio.create_task(self._make_frames())
        yield
        frames.cancel()

    async def _make_frames(self) -> None:
        due = last = time.monotonic()
        while True:
            due = max(due + 1.0 / FRAME_HZ, time.monotonic() - 1.0 / FRAME_HZ)
            await asyncio.sleep(max(0.0, due - time.monotonic()))
            now = time.monotonic()
            frame, last = self._session.advance(now - last if self._begun else 0.0), now
            if self._publish is not None:
                self._publish(self._session)
            for answer in self._session.answers():
                self._send(answer)
            if self._session.sought():
                self._send(self._session.hello())
            self._send(frame)

    def _send(self, message: dict[str, Any]) -> None:
        if not self._clients:
            return
        text = json.dumps(message, separators=(",", ":"))
        for queue in self._clients:
            _put(queue, text)

    async def _stream(self, client: WebSocket) -> None:
        if not self._access.sees(client):
            await client.close(1008)
            return
        await client.accept()
        queue: asyncio.Queue[str] = asyncio.Queue(_QUEUED)
        queue.put_nowait(json.dumps(self._session.hello(), separators=(",", ":")))
        self._clients.add(queue)
        self._begun = True
        sending = asyncio.create_task(_send_all(client, queue))
        try:
            while True:
                message = await client.receive()
                if message["type"] == "websocket.disconnect":
                    break
                _put(queue, json.dumps(self._answer(message.get("text") or "", client)))
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            self._clients.discard(queue)
            sending.cancel()

    def _answer(self, text: str, client: WebSocket) -> dict[str, Any]:
        try:
            request = json.loads(text)
            if not isinstance(request, dict):
                raise InputError("accepted: an object with 'do' and 'value'")
            trusted = self._access.commands(client)
            return self._session.obey(request, time.monotonic(), trusted=trusted)
        except (InputError, ValueError, RecursionError) as error:  # the last: lists in lists
            return {"kind": "refused", "message": str(error)}


def _put(queue: asyncio.Queue[str], text: str) -> None:
    if queue.full():
        queue.get_nowait()
    queue.put_nowait(text)


async def _send_all(client: WebSocket, queue: asyncio.Queue[str]) -> None:
    while True:
        await client.send_text(await queue.get())


@dataclass(frozen=True)
class Address:
    """Where a page is served."""

    host: str
    port: int
    """0: a free one."""
    foxglove: int | None = None
    """Port of Foxglove's server; None: without."""


def serve_live(
    source: Any,
    title: str,
    address: Address,
    scenario: Mapping[str, Any] | None = None,
    obstacle: Mapping[str, float] | None = None,
) -> None:
    """Print the page's address and serve it.

    Args:
        source: what gives messages, a `Playback` or `LiveTopics`.
        title: shown on the page.
        address: where.
        scenario: of the flight, for the lengths of the vehicle; None: the default vehicle.
        obstacle: x_m, y_m, radius_m, top_m of the cylinder, where the source says nothing of it.

    Raises:
        InputError: a port is taken, or the address is not this machine's.
    """
    session, page = LiveSession(source, title, obstacle), live_page(title, scenario or {})
    with ExitStack() as stack:
        publish = None
        if address.foxglove is not None:
            from tombo_web.foxglove_stream import FoxgloveStream

            stream = FoxgloveStream(address.host, address.foxglove)
            stack.callback(stream.close)
            publish = stream.publish
        serve_page(
            "live", address.host, address.port,
            lambda access: LiveServer(session, access, page, publish).app,
        )  # fmt: skip
