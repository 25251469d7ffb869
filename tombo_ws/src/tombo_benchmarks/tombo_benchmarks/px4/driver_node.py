"""The lab of a rehearsed first flight: motion capture, hand, remote control; plays the person."""

from __future__ import annotations

import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import rclpy
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from tombo_bag.topics import MOCAP_POSE
from tombo_benchmarks.px4.first_flight import KILL_CHANNEL, rehearse, table
from tombo_px4.link.mavlink_link import Link
from tombo_px4.link.messages import MessageTarget, fail_battery, is_armed, override_channels
from tombo_ros.topic import PolledSubscription, TopicPublisher

_FLIES_M = 0.28
"""Height of base_link [m]: its legs are below it."""
_RC_S = 0.05
_QUICK = "--quick"
_LOW, _MIDDLE, _HIGH = 1000, 1500, 2000
"""us: of a channel."""


class LabDriver:
    """Passes poses on to `/mocap/pose`, and acts as the person; use as a context manager.

    Attributes:
        armed: a HEARTBEAT has said so.
    """

    def __init__(self, fault: str, remote_url: str, system: int) -> None:
        self.armed = False
        self._fault, self._system = fault, system
        self._killed = self._kills_in_flight = self._proves = False
        self._first: Any = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._remote = Link(remote_url, system=255, component=1, clock=time.time_ns)

    def __enter__(self) -> LabDriver:
        """Start."""
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("driver")
        self._poses = PolledSubscription(self._node, replace(MOCAP_POSE, name="/driver/pose"), 20)
        self._out = TopicPublisher(self._node, MOCAP_POSE)
        self._hand = self._node.create_client(Trigger, "sim/hand")
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        """End."""
        self._stop.set()
        self._thread.join()
        self._remote.close()
        self._node.destroy_node()
        rclpy.shutdown()

    def act(self, line: str) -> None:
        """Do what a line of `tombo first-flight` asks the person for."""
        if "carry the vehicle about now" in line or (
            "are not proven" in line and not self._proves
        ):
            self._proves = "are not proven" in line
            self._hand.wait_for_service(10.0)
            self._hand.call_async(Trigger.Request())
        if "kill switch of the remote control" in line:
            self._killed = line.rstrip().endswith("on.")
        self._kills_in_flight |= "Switch the kill switch on as soon as" in line

    def _run(self) -> None:
        sent_s = 0.0
        while not self._stop.is_set():
            for taken in self._poses.take():
                message = taken.message
                self._killed |= self._kills_in_flight and message.pose.position.z > _FLIES_M
                self._out.publish(self._spoilt(message))
            for message in (received.message for received in self._remote.receive()):
                if message.get_type() == "HEARTBEAT" and message.get_srcSystem() == self._system:
                    self.armed |= is_armed(message)
            if time.monotonic() - sent_s > _RC_S:
                sent_s = time.monotonic()
                self._speak()
            rclpy.spin_once(self._node, timeout_sec=0.0)
            time.sleep(0.002)

    def _speak(self) -> None:
        """Send the channels of the remote control."""
        channels = [_MIDDLE, _MIDDLE, _LOW, *(5 * [_MIDDLE]), *(10 * [_LOW])]
        channels[KILL_CHANNEL - 1] = _HIGH if self._killed else _LOW
        target = MessageTarget(self._system, 1)
        self._remote.send(override_channels(target, channels))
        if self._fault == "low battery":
            self._remote.send(fail_battery(target))

    def _spoilt(self, message: Any) -> Any:
        """Return a pose as the motion capture of a lab with a fault sends it."""
        p, q = message.pose.position, message.pose.orientation
        if self._fault == "y up":
            p.y, p.z = p.z, -p.y
            q.y, q.z = q.z, -q.y
        if self._fault == "body that does not move":
            self._first = self._first or (p.x, p.y, p.z, q.x, q.y, q.z, q.w)
            noise = 1e-4 * (message.header.stamp.nanosec % 7)
            p.x, p.y, p.z, q.x, q.y, q.z, q.w = self._first
            p.x += noise
        if self._fault == "clock":
            message.header.stamp.sec += 1
        return message


def main() -> int:
    """Rehearse a first flight, and each fault; return 1 if one does not go as it must."""
    build, folder, instance, *rows = (word for word in sys.argv[1:] if word != _QUICK)
    outcomes = []
    place = None if build == "simulated" else Path(build)
    more = ("--seconds", "4", "--hover", "2") if _QUICK in sys.argv else ()
    for outcome in rehearse(place, Path(folder), int(instance), rows, LabDriver, more):
        outcomes.append(outcome)
        print(outcome.line, flush=True)
    print(f"\n{table(outcomes)}")
    return int(not all(outcome.as_wanted for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
