"""Requests of an operator to running nodes: take off, hold, land, abort, kill, by services."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger

from tombo_bag.topics import PX4_STATUS

SERVICES = {
    "takeoff": ("mission/takeoff",),
    "abort": ("controller/abort", "mission/abort"),
    "hold": ("mission/hold",),
    "land": ("controller/abort", "mission/land"),
    "kill": ("controller/kill",),
}
"""Request → services that are called together; it is obeyed if one of them obeys. The node with
the last word before the rotors needs no other; the mission is called so that it does not go on."""
PX4_SERVICES = {
    "takeoff": ("mission/takeoff",),
    "abort": ("px4/abort", "mission/land"),
    "hold": ("px4/hold",),
    "land": ("px4/land", "mission/land"),
    "kill": ("px4/kill",),
}
"""The same over PX4, where the bridge has the last word."""
_INSTEAD = {"hold": "land"}
"""Request that no node obeys → what is asked then."""
_ANSWER_S, _PX4_ANSWER_S = 2.5, 6.0
"""A node's loop answers within 2 s; PX4 confirms, refuses, and is asked again."""
_MEET_S = 0.5
"""Wait for a service that the node has not met yet."""


@dataclass
class _Request:
    """A request under way."""

    name: str
    as_asked: str
    """Name of the operator's own request."""
    end_s: float
    calls: dict[str, Any] = field(default_factory=dict)
    """Service → future of its answer."""
    refusals: list[str] = field(default_factory=list)


class OperatorRequests:
    """Calls the operator's services, without waiting for their answers."""

    def __init__(self, node: Node) -> None:
        """Meet the nodes: make it some seconds before the first request."""
        self._node = node
        names = {
            name
            for of in (SERVICES, PX4_SERVICES)
            for services in of.values()
            for name in services
        }
        self._clients = {name: node.create_client(Trigger, name) for name in sorted(names)}
        self._open: list[_Request] = []
        self._rest = ""

    def offered(self, name: str) -> bool:
        """Return whether a node offers a service of a request."""
        services = (*SERVICES[name], *PX4_SERVICES[name])
        return any(self._clients[service].service_is_ready() for service in services)

    def read(self, data: str) -> list[dict[str, Any]]:
        """Call what whole lines ask for; return the refusals of requests that can't be called."""
        *lines, self._rest = (self._rest + data).split("\n")
        return [answer for line in lines if line.strip() for answer in self._begin(line.strip())]

    def _begin(self, name: str, as_asked: str = "", because: str = "") -> list[dict[str, Any]]:
        """Call the services of a request; return the answer if none of them can be called."""
        px4 = self._node.count_publishers(PX4_STATUS.name) > 0
        patience_s = _PX4_ANSWER_S if px4 else _ANSWER_S
        request = _Request(name, as_asked or name, time.monotonic() + patience_s)
        request.refusals += [because] if because else []
        for service in (PX4_SERVICES if px4 else SERVICES)[name]:
            client = self._clients[service]
            if client.service_is_ready() or client.wait_for_service(timeout_sec=_MEET_S):
                request.calls[service] = client.call_async(Trigger.Request())
            else:
                request.refusals.append(f"no node offers {service}")
        if not request.calls:
            return self._refused(request)
        self._open.append(request)
        return []

    def answers(self) -> list[dict[str, Any]]:
        """Return the answers, also of services that did not answer in time."""
        for _ in range(sum(len(request.calls) for request in self._open)):
            rclpy.spin_once(self._node, timeout_sec=0.0)
        under_way, self._open = self._open, []
        return [answer for request in under_way for answer in self._poll(request)]

    def _poll(self, request: _Request) -> list[dict[str, Any]]:
        """Return the answer to a request, if it is known by now: that of the first that obeys."""
        late = time.monotonic() > request.end_s
        while request.calls:
            service, future = next(iter(request.calls.items()))
            if not (late or future.done()):
                self._open.append(request)
                return []
            del request.calls[service]
            result = future.result() if future.done() else None
            said = "no answer" if result is None else result.message
            if result is not None and result.success:
                told = [*request.refusals, f"{service}: {said or 'obeyed'}"]
                return [_answer(request.as_asked, True, "; ".join(told))]
            request.refusals.append(f"{service}: {said}")
        return self._refused(request)

    def _refused(self, request: _Request) -> list[dict[str, Any]]:
        """Begin the substitute request, or return the refusal."""
        text = "; ".join(request.refusals)
        instead = _INSTEAD.get(request.name)
        if instead is None:
            return [_answer(request.as_asked, False, text)]
        return self._begin(instead, request.as_asked, f"{text}; {instead} instead")


def _answer(request: str, success: bool, message: str) -> dict[str, Any]:
    return {"answer": {"request": request, "success": success, "message": message}}
