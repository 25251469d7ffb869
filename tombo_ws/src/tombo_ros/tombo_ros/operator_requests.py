"""What an operator asks of running nodes: hold, land, kill, by their services."""

from __future__ import annotations

import time
from typing import Any

import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger

_OFFERED_BY = {"kill": "controller"}
"""Request → node with that service, where it is not the mission."""
_PX4_SERVICES = "px4"
"""Over PX4 all requests are for its own modes; the bridge offers them there."""
_ANSWER_S = 6.0
"""A request without an answer for so long has failed."""


class OperatorRequests:
    """Calls the operator's services, without waiting for them."""

    def __init__(self, node: Node, *, px4: bool) -> None:
        self._node = node
        self._px4 = px4
        self._clients: dict[str, Any] = {}
        self._open: list[tuple[str, Any, float]] = []
        self._rest = ""

    def read(self, data: str) -> list[dict[str, Any]]:
        """Call what whole lines ask for; return what can't be called."""
        *lines, self._rest = (self._rest + data).split("\n")
        return [answer for line in lines if line.strip() for answer in self._call(line.strip())]

    def _call(self, request: str) -> list[dict[str, Any]]:
        offered_by = _PX4_SERVICES if self._px4 else _OFFERED_BY.get(request, "mission")
        name = f"{offered_by}/{request}"
        client = self._clients.get(name)
        if client is None:
            client = self._clients[name] = self._node.create_client(Trigger, name)
            client.wait_for_service(timeout_sec=0.5)
        if not client.service_is_ready():
            return [_answer(request, False, f"no node offers {name}")]
        future = client.call_async(Trigger.Request())
        self._open.append((request, future, time.monotonic() + _ANSWER_S))
        return []

    def answers(self) -> list[dict[str, Any]]:
        """Return what has been answered, or has not within 6 s."""
        if not self._open:
            return []
        rclpy.spin_once(self._node, timeout_sec=0.0)
        found, still = [], []
        for request, future, end_s in self._open:
            if future.done():
                result = future.result()
                found.append(_answer(request, result.success, result.message))
            elif time.monotonic() > end_s:
                found.append(_answer(request, False, f"no answer within {_ANSWER_S:g} s"))
            else:
                still.append((request, future, end_s))
        self._open = still
        return found


def _answer(request: str, success: bool, message: str) -> dict[str, Any]:
    return {"answer": {"request": request, "success": bool(success), "message": str(message)}}
