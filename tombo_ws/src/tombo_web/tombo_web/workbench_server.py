"""Serves the workbench: its page, and answers to its requests, in JSON or as files."""

from __future__ import annotations

import json
from typing import Any, Final

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import Library
from tombo_web.server import Access, page_response, serve_page
from tombo_web.workbench import Workbench
from tombo_web.workbench_page import workbench_page

LARGEST_REQUEST: Final = 131_072
"""Bytes: a table of a blade and some numbers."""


class WorkbenchServer:
    """Answers the page's requests, each by a function of `Workbench`."""

    def __init__(self, bench: Workbench, access: Access, page: str) -> None:
        """Serve a workbench.

        Args:
            bench: what computes.
            access: who may see the page and ask.
            page: the HTML text.
        """
        self._bench, self._access, self._page = bench, access, page
        self.app = Starlette(
            routes=[
                Route("/", self._index),
                Route("/page/{number:int}", self._result),
                Route("/ask/{what}", self._ask, methods=["POST"]),
            ]
        )

    async def _index(self, request: Request) -> Response:
        return page_response(self._access, request, self._page)

    async def _result(self, request: Request) -> Response:
        page = self._bench.page(request.path_params["number"])
        if page is None:
            return PlainTextResponse("no such page; accepted: one of the last results", 404)
        return page_response(self._access, request, page)

    async def _ask(self, request: Request) -> Response:
        if not self._access.sees(request):
            return PlainTextResponse("accepted: the address with its token", 403)
        try:
            values = await _values(request)
            what = request.path_params["what"]
            answer = await run_in_threadpool(self._bench.answer, what, values)
        except InputError as error:
            # With a status of its own the browser's console would call it an error.
            return JSONResponse({"error": str(error)})
        if isinstance(answer, bytes):
            named = {"Content-Disposition": 'attachment; filename="propeller.zip"'}
            return Response(answer, media_type="application/octet-stream", headers=named)
        return JSONResponse(answer, headers={"Cache-Control": "no-store"})


async def _values(request: Request) -> dict[str, Any]:
    """Return the JSON object of a request.

    Raises:
        InputError: it is none, or too large; data beyond the bound is not read.
    """
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > LARGEST_REQUEST:
            raise InputError(f"request: too large; accepted: up to {LARGEST_REQUEST} bytes")
    try:
        values = json.loads(body)
    except (ValueError, RecursionError):
        values = None
    if not isinstance(values, dict):
        raise InputError("request: no JSON object; accepted: an object")
    return values


def serve_workbench(library: Library, host: str, port: int) -> None:
    """Print the page's address and serve it.

    Args:
        library: materials, blades, configurations, measurements.
        host: where; others than this machine's own names need the token.
        port: 0: a free one.

    Raises:
        InputError: the port is taken, or the address is not this machine's.
    """

    def application(access: Access) -> Starlette:
        bench = Workbench(library)
        bench.answer("curves", {})  # loads the compiled laws before somebody waits for them
        return WorkbenchServer(bench, access, workbench_page(library)).app

    serve_page("workbench", host, port, application)
