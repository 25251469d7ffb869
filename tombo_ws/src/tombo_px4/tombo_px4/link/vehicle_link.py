"""Questions to a PX4 on its link, while no bridge uses it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from pymavlink.dialects.v20 import common as mav

from tombo_px4.bridge.bridge_params import LinkParams
from tombo_px4.link import messages
from tombo_px4.link.mavlink_link import Link
from tombo_px4.link.messages import MessageTarget, int_of_float
from tombo_px4.modes import Result

_LOOK_S = 0.1
_PATIENCE_S = 10.0
_HEARTBEAT_S = 0.5
_ANSWER_S = 0.5
_TRIES = 4


class VehicleLink:
    """A link to the vehicle that a bridge with these parameters flies; use as a context manager.

    Args:
        params: of the link.
        key: to sign with (32 bytes), or None.
        clock: returns the time [ns].
    """

    def __init__(self, params: LinkParams, key: bytes | None, clock: Callable[[], int]) -> None:
        self._params, self._key, self._clock = params, key, clock
        self._target = MessageTarget(params.system, params.component)
        self._spoken_s = -math.inf

    def __enter__(self) -> VehicleLink:
        """Open the link, and wait for the vehicle."""
        params = self._params
        self._link = Link(
            params.url,
            system=params.own_system,
            component=params.own_component,
            clock=self._clock,
            accept_system=params.system,
            accept_component=params.component,
            key=self._key,
            allow_remote=params.allow_remote,
        )
        self.wait("HEARTBEAT", _PATIENCE_S)  # a listener knows its peer then
        return self

    def __exit__(self, *error: object) -> None:
        """Close the link."""
        self._link.close()

    def wait(
        self, kind: str, patience_s: float, accept: Callable[[Any], object] = lambda message: True
    ) -> Any | None:
        """Return the next message of a kind that is accepted; None: none came in time."""
        end_s = 1e-9 * self._clock() + patience_s
        while (now_s := 1e-9 * self._clock()) < end_s:
            if now_s - self._spoken_s >= _HEARTBEAT_S:
                self._spoken_s = now_s
                self._link.send(messages.heartbeat())
            self._link.wait(_LOOK_S)
            for message in (received.message for received in self._link.receive()):
                if message.get_type() == kind and accept(message):
                    return message
        return None

    def parameters(self, names: Sequence[str]) -> dict[str, float]:
        """Return the values of PX4's parameters; those that it does not answer are left out."""
        values: dict[str, float] = {}
        for name in names:
            for _ in range(_TRIES):
                self._link.send(messages.read_parameter(self._target, name))
                answer = self.wait("PARAM_VALUE", _ANSWER_S, partial(_is_of, name))
                if answer is not None:
                    values[name] = _value(answer)
                    break
        return values

    def test_motor(self, motor: int, throttle: float, seconds: float) -> Result | None:
        """Turn a motor, from 1 on, of a disarmed vehicle; throttle 0 to 1."""
        return self.command(mav.MAV_CMD_ACTUATOR_TEST, throttle, seconds, 0.0, 0.0, float(motor))

    def command(self, number: int, *values: float) -> Result | None:
        """Return PX4's answer to a command; None: it did not answer."""
        self._link.send(messages.command(self._target, number, *values))
        answer = self.wait("COMMAND_ACK", 4.0 * _ANSWER_S, lambda m: m.command == number)
        return None if answer is None else Result(answer.result)


def _is_of(name: str, message: Any) -> bool:
    return bool(message.param_id == name)


def _value(message: Any) -> float:
    """Return the value of PARAM_VALUE: PX4 sends a whole number by its bytes."""
    if message.param_type != mav.MAV_PARAM_TYPE_INT32:
        return float(message.param_value)
    return float(int_of_float(message.param_value))
