"""`tombo first-flight` over a PX4, in a lab without and with each of the planted faults."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

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

KILL_CHANNEL: Final = 8
_GROUND_PORT: Final = 18570
"""Where PX4 instance 0 hears a ground station."""
_VOLUME = {"x_min": -2.0, "x_max": 2.0, "y_min": -1.5, "y_max": 1.5, "z_max": 2.5, "margin": 0.3}
_FENCE = {"GF_ACTION": 5, "GF_MAX_HOR_DIST": 4.0, "GF_MAX_VER_DIST": 3.0}
_REMOTE = {"COM_RC_IN_MODE": 3, "RC_CHAN_CNT": 18, "RC_MAP_ROLL": 1, "RC_MAP_PITCH": 2,
           "RC_MAP_THROTTLE": 3, "RC_MAP_YAW": 4}  # fmt: skip
_TURNED = ["front_right ccw", "rear_left ccw", "front_left cw", "rear_right cw"]
_ASKED = ("mocap", "kill_switch", "axes", "propellers", "hover", "kill", "obstacle")
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


@dataclass(frozen=True)
class Outcome:
    """What became of a rehearsal."""

    fault: str
    stopped: str
    """Step that has failed; empty: none."""
    said: str
    armed: bool
    """By a HEARTBEAT of PX4, at any time."""

    @property
    def as_wanted(self) -> bool:
        """All steps are passed without a fault; with one it is stopped, and never armed."""
        return self.stopped == FAULTS[self.fault] and self.armed == (self.fault == "")

    @property
    def line(self) -> str:
        """Text about it."""
        state = "as wanted" if self.as_wanted else "NOT as wanted"
        armed = "armed" if self.armed else "never armed"
        fault, stopped = self.fault or "no fault", self.stopped or "–"
        return f"{fault}: {state}, {armed}, stopped by {stopped}: {self.said}"


def rehearse(
    build: Path | None, folder: Path, instance: int, rows: Sequence[str],
    driver: Callable[[str, str, int], Any], more: Sequence[str] = (),
) -> Iterator[Outcome]:  # fmt: skip
    """Do a first flight with each fault; `build`: of PX4, None simulates one."""
    for fault, stops in FAULTS.items():
        if not rows or any(word in (fault or "no fault") for word in rows):
            place = folder / (fault.replace(" ", "_") or "good")
            yield _rehearse(build, place.resolve(), instance, fault, stops, driver, more)


def _rehearse(build: Path | None, folder: Path, instance: int, fault: str, stops: str,
              driver: Callable[[str, str, int], Any], more: Sequence[str]) -> Outcome:  # fmt: skip
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
    turned = list(reversed(_TURNED)) if fault == "wrong order of rotors" else _TURNED
    answers = {**dict.fromkeys(_ASKED, "yes"), "rotors": ["yes", *turned]}
    (folder / "lab.yaml").write_text(yaml_of(lab), encoding="utf-8")
    (folder / "answers.yaml").write_text(yaml_of(answers), encoding="utf-8")
    parameters = {
        **_FENCE,
        "SYS_FAILURE_EN": 1,
        "RC_MAP_KILL_SW": 0 if fault == "no kill switch" else KILL_CHANNEL,
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
        person = stack.enter_context(driver(fault, f"udpout://127.0.0.1:{remote}", system))
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
        [o.fault or "none", o.stopped or "none", o.said, words[o.armed], words[o.as_wanted]]
        for o in outcomes
    ]
    return table_markdown(head, rows)
