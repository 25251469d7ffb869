"""The driver of a motion capture, and a terminal with `ros2`; does the steps of `first_flight`."""

from __future__ import annotations

import shlex
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import rclpy
import yaml
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool, Trigger

from tombo_bag.topics import MOCAP_POSE, PX4_STATUS, TRUE_ROTORS
from tombo_benchmarks.px4.first_flight import fly_first, table
from tombo_bringup.cli.errors import print_error
from tombo_ros.topic import PolledSubscription, TopicPublisher

PATIENCE_S = 180.0
"""The longest wait."""


class Driver:
    """The driver of the motion capture, and a terminal with `ros2`; use as a context manager.

    Attributes:
        frame: `frame_id` of its poses; at first that of VRPN's driver.
        on: the markers are seen.
        status: the newest of `/px4/status`.
        rotor_speed: of the true rotors [rad/s].
    """

    def __init__(self) -> None:
        self.frame, self.on = "world", True
        self.status: Any = None
        self.rotor_speed: Sequence[float] = (0.0,)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._call: tuple[Any, Any] | None = None

    def __enter__(self) -> Driver:
        """Start."""
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("driver")
        self._poses = PolledSubscription(self._node, replace(MOCAP_POSE, name="/driver/pose"), 20)
        self._out = TopicPublisher(self._node, MOCAP_POSE)
        self._states = PolledSubscription(self._node, PX4_STATUS)
        self._rotors = PolledSubscription(self._node, TRUE_ROTORS, 1)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        """End."""
        self._stop.set()
        self._thread.join()
        self._node.destroy_node()
        rclpy.shutdown()

    def _run(self) -> None:
        while not self._stop.is_set():
            for taken in self._poses.take():
                taken.message.header.frame_id = self.frame
                if self.on:
                    self._out.publish(taken.message)
            for taken in self._states.take():
                self.status = taken.message
            newest = self._rotors.newest()
            self.rotor_speed = self.rotor_speed if newest is None else newest.message.speed
            rclpy.spin_once(self._node, timeout_sec=0.0)
            time.sleep(0.002)

    def until(self, condition: Callable[[], object]) -> None:
        """Wait.

        Raises:
            TimeoutError: it does not come.
        """
        end_s = time.monotonic() + PATIENCE_S
        while self.status is None or not condition():
            if time.monotonic() > end_s:
                raise TimeoutError(f"waited too long; PX4 and bridge: {self.status}")
            time.sleep(0.005)

    def call(self, command: str) -> tuple[bool, str]:
        """Do what `ros2 service call NAME TYPE [VALUES]` does; return the answer."""
        _, _, _, name, kind, *values = shlex.split(command)
        service: Any = {"Trigger": Trigger, "SetBool": SetBool}[kind.rpartition("/")[2]]
        request = service.Request(**(yaml.safe_load(values[0]) if values else {}))
        client = self._node.create_client(service, name)
        client.wait_for_service(PATIENCE_S)
        future = client.call_async(request)
        self.until(future.done)
        return future.result().success, future.result().message


def main() -> int:
    """Do the steps of docs/first_real_flight.md; return 1 if one is not as it is written."""
    build, folder, instance = sys.argv[1:]
    outcomes = []
    try:
        for outcome in fly_first(Path(build), Path(folder), int(instance), Driver):
            outcomes.append(outcome)
            state = "as written" if outcome.as_written else "NOT as written"
            print(f"step {outcome.step}, {outcome.does}: {state}: {outcome.result}", flush=True)
    except TimeoutError as error:
        print_error(str(error))
        return 1
    print(f"\n{table(outcomes)}")
    return int(not all(outcome.as_written for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
