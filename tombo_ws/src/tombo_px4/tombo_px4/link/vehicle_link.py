"""Questions to a PX4 on its link, while no bridge uses it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Self

from pymavlink.dialects.v20 import common as mav

from tombo_px4.bridge.bridge_params import LinkParams
from tombo_px4.link import messages
from tombo_px4.link.mavlink_link import Link, closed_on_error
from tombo_px4.link.messages import MessageTarget, decode_parameter
from tombo_px4.modes import Result

_LOOK_S = 0.1
PATIENCE_S = 10.0
"""A vehicle that boots says nothing for some seconds."""
_HEARTBEAT_S = 0.5
_ANSWER_S = 0.5
_TRIES = 4


def open_link(params: LinkParams, key: bytes | None, clock: Callable[[], int]) -> Link:
    """Open the link to the vehicle of the parameters, with a key to sign with or None.

    Raises:
        InputError: as `Link`.
    """
    return Link(
        params.url,
        system=params.own_system,
        component=params.own_component,
        clock=clock,
        accept_system=params.system,
        accept_component=params.component,
        key=key,
        allow_remote=params.allow_remote,
    )


class VehicleLink:
    """An open link to the vehicle that a bridge with these parameters flies; a context manager.

    Args:
        params: of the link.
        key: to sign with (32 bytes), or None.
        clock: returns the time [ns].
        patience_s: how long to wait for its HEARTBEAT.
        stop: ends any waiting.

    Attributes:
        heartbeat: its first HEARTBEAT; None: it did not come in time.
        link: that is open.
    """

    def __init__(
        self,
        params: LinkParams,
        key: bytes | None,
        clock: Callable[[], int],
        patience_s: float = PATIENCE_S,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        self._clock, self._stop = clock, stop
        self._target = MessageTarget(params.system, params.component)
        self._spoken_s = -math.inf
        self.link = open_link(params, key, clock)
        with closed_on_error(self.link):  # a listener knows its peer with the first message
            self.heartbeat = self.wait("HEARTBEAT", patience_s)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Close the link."""
        self.link.close()

    def wait(
        self, kind: str, patience_s: float, accept: Callable[[Any], object] = lambda message: True
    ) -> Any | None:
        """Return the next message of a kind that is accepted; None: none came in time."""
        end_s = 1e-9 * self._clock() + patience_s
        while (now_s := 1e-9 * self._clock()) < end_s and not self._stop():
            if now_s - self._spoken_s >= _HEARTBEAT_S:
                self._spoken_s = now_s
                # PX4 acts on the loss of a ground station, when this link is closed
                self.link.send(messages.heartbeat(mav.MAV_TYPE_ONBOARD_CONTROLLER))
            self.link.wait(_LOOK_S)
            for message in (received.message for received in self.link.receive()):
                if message.get_type() == kind and accept(message):
                    return message
        return None

    def parameters(self, names: Sequence[str]) -> dict[str, float]:
        """Return the values of PX4's parameters; unanswered ones are left out."""
        known: dict[str, float] = {}
        for name in _TRIES * list(names):
            if name not in known:
                self.link.send(messages.read_parameter(self._target, name))
                answer = self.wait("PARAM_VALUE", _ANSWER_S, partial(_is_of, name))
                known |= {} if answer is None else {name: decode_parameter(answer).value}
        return known

    def test_motor(self, motor: int, throttle: float, seconds: float) -> Result | None:
        """Turn a motor, from 1 on, of a disarmed vehicle; throttle 0 to 1."""
        return self.command(mav.MAV_CMD_ACTUATOR_TEST, throttle, seconds, 0.0, 0.0, float(motor))

    def command(self, number: int, *values: float) -> Result | None:
        """Return PX4's answer to a command; None: it did not answer."""
        self.link.send(messages.command(self._target, number, *values))
        answer = self.wait("COMMAND_ACK", 4.0 * _ANSWER_S, lambda m: m.command == number)
        return None if answer is None else Result(answer.result)


def _is_of(name: str, message: Any) -> bool:
    return bool(message.param_id == name)
