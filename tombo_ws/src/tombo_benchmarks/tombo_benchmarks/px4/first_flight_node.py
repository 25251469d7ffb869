"""`tombo first-flight` over a PX4, in a lab without and with each of the planted faults.

    python -m tombo_benchmarks.px4.first_flight_node BUILD|simulated FOLDER INSTANCE [ROW ...]

This process is the lab: motion capture, hand, remote control, and the person who is asked.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import rclpy
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from tombo_bag.topics import MOCAP_POSE
from tombo_benchmarks.docs.markdown import table_markdown
from tombo_benchmarks.px4.lockstep_px4 import ONBOARD_PORT
from tombo_benchmarks.px4.px4_process import Px4Process
from tombo_bringup.first_flight.steps import STEPS
from tombo_flight.scenario import load_scenario, world_of
from tombo_flight.suite.nodes import free_domain, node_environment, udp_ports
from tombo_flight.suite.px4_connection import free_udp_port
from tombo_flight.yaml_file import yaml_of
from tombo_px4.bridge.vehicle_parameters import MOCAP_ONLY
from tombo_px4.hil.flight import PX4_PORT, airframe_parameters
from tombo_px4.link.mavlink_link import Link
from tombo_px4.link.messages import MessageTarget, fail_battery, is_armed, override_channels
from tombo_ros.topic import PolledSubscription, TopicPublisher

_KILL_CHANNEL: Final = 8
_GROUND_PORT: Final = 18570
"""Where PX4 instance 0 hears a ground station."""
_VOLUME = {"x_min": -2.0, "x_max": 2.0, "y_min": -1.5, "y_max": 1.5, "z_max": 2.5, "margin": 0.3}
_FENCE = {"GF_ACTION": 5, "GF_MAX_HOR_DIST": 4.0, "GF_MAX_VER_DIST": 3.0}
_REMOTE = {"COM_RC_IN_MODE": 3, "RC_CHAN_CNT": 18, "RC_MAP_ROLL": 1, "RC_MAP_PITCH": 2,
           "RC_MAP_THROTTLE": 3, "RC_MAP_YAW": 4}  # fmt: skip
_ROTORS = ["front_right ccw", "rear_left ccw", "front_left cw", "rear_right cw"]
_CONFIRMED = ("mocap", "kill_switch", "axes", "propellers", "hover", "kill", "obstacle")
FAULTS: Final = {
    "": "", "wrong order of rotors": "rotors", "y up": "mocap", "no kill switch": "kill_switch",
    "old parameters": "parameters", "body that does not move": "mocap", "low battery": "battery",
    "clock": "clocks", "chrony without a source": "clocks", "volume missing": "lab",
}  # fmt: skip
"""Fault → step that must stop it; without a fault all steps are passed.

No simulation shows the order of the rotors: there the person's answer says what was seen.
"""
_CHRONYC = """#!/bin/sh
echo 7F7F0101,,0,0,0,0,0,0,0,0,0,0,0,Not synchronised
"""
"""Answers as chrony does that follows no clock."""
_FLIES_M = 0.28
"""Height of base_link [m]: its legs are below it."""
_RC_S = 0.05
_QUICK = "--quick"
_LOW, _MIDDLE, _HIGH = 1000, 1500, 2000
"""us: of a channel."""


@dataclass(frozen=True)
class Outcome:
    """Result of a rehearsal."""

    fault: str
    stopped: str
    """Step that has failed; empty: none."""
    message: str
    armed: bool
    """By a HEARTBEAT of PX4, at any time."""

    @property
    def as_wanted(self) -> bool:
        """All steps are passed without a fault; with one it is stopped, and never armed."""
        return self.stopped == FAULTS[self.fault] and self.armed == (self.fault == "")

    @property
    def line(self) -> str:
        """The result in one line."""
        state = "as wanted" if self.as_wanted else "NOT as wanted"
        armed = "armed" if self.armed else "never armed"
        fault, stopped = self.fault or "no fault", self.stopped or "–"
        return f"{fault}: {state}, {armed}, stopped by {stopped}: {self.message}"


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
        channels[_KILL_CHANNEL - 1] = _HIGH if self._killed else _LOW
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


def rehearse(
    build: Path | None, folder: Path, instance: int, fault: str, more: Sequence[str]
) -> Outcome:
    """Do a first flight in a lab with a fault; `build`: of PX4, None simulates one."""
    folder.mkdir(parents=True)
    port = free_udp_port() if build is None else ONBOARD_PORT + instance
    remote = free_udp_port() if build is None else _GROUND_PORT + instance
    system = 1 if build is None else instance + 1
    lab = {"tombo_lab": 1, "vehicle": "tombo_s500", "volume": _VOLUME,
           "mocap": {"system": "ros", "topic": "/driver/pose", "body": "lab_1"},
           "px4": {"url": f"udpin://127.0.0.1:{port}", "parameters": ["safe", "mocap"],
                   "bridge": {"link": {"system": system}}}}  # fmt: skip
    if fault == "volume missing":
        del lab["volume"]
    rotors = list(reversed(_ROTORS)) if fault == "wrong order of rotors" else _ROTORS
    answers = {**dict.fromkeys(_CONFIRMED, "yes"), "rotors": ["yes", *rotors]}
    (folder / "lab.yaml").write_text(yaml_of(lab), encoding="utf-8")
    (folder / "answers.yaml").write_text(yaml_of(answers), encoding="utf-8")
    parameters = {
        **_FENCE,
        "SYS_FAILURE_EN": 1,
        "RC_MAP_KILL_SW": 0 if fault == "no kill switch" else _KILL_CHANNEL,
    }
    if fault == "old parameters":
        parameters["COM_OBL_RC_ACT"] = 0
    environment = node_environment(os.environ, folder / "ros", None)
    if "ROS_DOMAIN_ID" not in environment:
        environment["ROS_DOMAIN_ID"] = str(free_domain(os.getpid(), udp_ports()))
    os.environ.update(environment, XDG_CONFIG_HOME=str(folder / "config"))
    path = os.environ["PATH"]
    if fault == "chrony without a source":
        path = f"{folder}{os.pathsep}{path}"
        (folder / "chronyc").write_text(_CHRONYC, encoding="ascii")
        (folder / "chronyc").chmod(0o700)
    values: dict[str, Any] = {
        "effects.mocap_noise.position": 5e-4,
        "effects.mocap_noise.attitude": 1e-3,
    }
    if build is None:
        module = "px4_sim_node"
        values |= {"onboard_url": f"udpout://127.0.0.1:{port}",
                   "ground_url": f"udpin://127.0.0.1:{remote}"}  # fmt: skip
        values |= {f"px4.{name}": value for name, value in parameters.items()}
    else:
        module, values["port"] = "hil_sim_node", PX4_PORT + instance
    words = ["-m", f"tombo_px4.{module}", "--ros-args", "-r", "/mocap/pose:=/driver/pose"]
    words += [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
    command = ["-m", "tombo_bringup.cli.main", "first-flight", "--lab", "lab.yaml", "--json",
               "--answers", "answers.yaml", "-o", "flight", *more]  # fmt: skip
    with ExitStack() as stack, (folder / "sim.txt").open("wb") as log:
        sim = stack.enter_context(
            subprocess.Popen([sys.executable, *words], stdout=log, stderr=log)
        )
        stack.callback(sim.send_signal, signal.SIGINT)
        if build is not None:
            world = world_of(load_scenario("hover"))
            known = airframe_parameters(world, 0)
            px4 = {**known, **MOCAP_ONLY, **_REMOTE, **parameters}
            stack.enter_context(Px4Process(build, folder / "px4", px4, instance))
        person = stack.enter_context(LabDriver(fault, f"udpout://127.0.0.1:{remote}", system))
        flight = subprocess.Popen(
            [sys.executable, *command], cwd=folder, text=True, env={**os.environ, "PATH": path},
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        assert flight.stdout is not None and flight.stderr is not None
        said = ""
        for said in flight.stderr:
            print(f"  {said.rstrip()}", flush=True)
            person.act(said)
        text = flight.stdout.read()
    done = json.loads(text)["steps"] if text.startswith("{") else {}
    mends = {step.key: step.mend for step in STEPS}
    for key, step in done.items():
        if not step["passed"]:
            return Outcome(fault, key, f"{step['said']}. To mend: {mends[key]}", person.armed)
    last = "all steps are passed" if len(done) == len(STEPS) else ""
    return Outcome(fault, "" if last else "–", last or said.strip(), person.armed)


def table(outcomes: Sequence[Outcome]) -> str:
    """Return the table of the rehearsals."""
    head = ("fault", "stopped by step", "message", "armed", "as wanted")
    words = {True: "yes", False: "no"}
    rows = [
        [o.fault or "none", o.stopped or "none", o.message, words[o.armed], words[o.as_wanted]]
        for o in outcomes
    ]
    return table_markdown(head, rows)


def main() -> int:
    """Rehearse a first flight, and each fault; return 1 if one does not go as it must."""
    build, folder, instance, *rows = (word for word in sys.argv[1:] if word != _QUICK)
    outcomes = []
    place = None if build == "simulated" else Path(build)
    more = ("--seconds", "4", "--hover", "2") if _QUICK in sys.argv else ()
    for fault in FAULTS:
        if rows and not any(word in (fault or "no fault") for word in rows):
            continue
        kept = Path(folder).resolve() / (fault.replace(" ", "_") or "good")
        outcomes.append(rehearse(place, kept, int(instance), fault, more))
        print(outcomes[-1].line, flush=True)
    print(f"\n{table(outcomes)}")
    return int(not all(outcome.as_wanted for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
