"""Steps 3 to 6 of docs/first_real_flight.md over a PX4 SITL: a script plays the person.

The commands are read from the page. The simulator is the vehicle: without thrust as long as the
propellers are off, moved by a simulated hand in step 4. `Driver` is the driver of the motion
capture, with its settings.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml

from tombo_benchmarks.docs.markdown import table_markdown
from tombo_benchmarks.px4.lockstep_px4 import ONBOARD_PORT
from tombo_benchmarks.px4.px4_process import Px4Process
from tombo_benchmarks.px4.terminal import Terminal
from tombo_dynamics.vehicle import ROTOR_NAMES
from tombo_flight.scenario import load_scenario, world_of
from tombo_flight.suite.nodes import free_domain, node_environment, udp_ports
from tombo_px4.bridge.vehicle_parameters import MOCAP_ONLY, SAFE_PARAMETERS
from tombo_px4.hil.flight import PX4_PORT, airframe_parameters

PAGE: Final = Path("docs/first_real_flight.md")
SCENARIO, VEHICLE = "first.yaml", "my_vehicle.yaml"
_URL: Final = "serial:///dev/ttyUSB0:921600"
_BLOCK: Final = re.compile(r"^```(\w+)\n(.*?)^```", re.M | re.S)
_INLINE: Final = re.compile(r"`([^`]*)`")
_COMMAND: Final = re.compile(r"ros2 service call .|tombo \w+ .")
_ESCAPE: Final = re.compile(r"\x1b\[[\d;?]*[A-Za-z]")
_PATIENCE_S = 180.0
_TRIES = 5
_STOPS_S = 1.0
"""The page: a kill stops the motors within this time."""
_HAND_AT_S = 70.0
_NO_PROPELLERS = {f"effects.weak_propeller.{rotor}": 1.0 for rotor in ROTOR_NAMES}
"""The motors turn, and nothing lifts."""
_NOISE = {"effects.mocap_noise.position": 5e-4, "effects.mocap_noise.attitude": 1e-3}
"""Of a motion capture [m], [rad]: no real pose stands still."""


def commands_of(page: str, step: int) -> list[str]:
    """Return the commands of a step of the page: lines of its blocks, then those in its text."""
    section = re.split(r"^## ", page, flags=re.M)[step + 1]
    assert section.startswith(f"{step}. "), section[:40]
    blocks = [text for kind, text in _BLOCK.findall(section) if kind == "sh"]
    inline = _INLINE.findall(_BLOCK.sub("", section))
    return [line for line in [*"".join(blocks).splitlines(), *inline] if _COMMAND.match(line)]


def scenario_of(page: str) -> str:
    """Return the scenario file of step 2."""
    return next(str(text) for kind, text in _BLOCK.findall(page) if kind == "yaml")


@dataclass(frozen=True)
class Outcome:
    """Result of a step of the page."""

    step: int
    does: str
    result: str
    as_written: bool


def fly_first(
    build: Path, folder: Path, instance: int, new_driver: Callable[[], Any]
) -> Iterator[Outcome]:
    """Do steps 3 to 6 of the page; yield what each has led to.

    Args:
        build: of PX4 (`px4_build`).
        folder: new; for all files.
        instance: of PX4.
        new_driver: makes the driver of the motion capture, in its environment.
    """
    page = PAGE.read_text(encoding="utf-8")
    folder.mkdir(parents=True)
    folder = folder.resolve()
    (folder / SCENARIO).write_text(scenario_of(page), encoding="utf-8")
    person = _Person(build, folder, instance)
    (folder / VEHICLE).write_text(person.vehicle_file, encoding="utf-8")
    with _environment(folder), new_driver() as driver:
        with person.vehicle(propellers=False):
            yield from person.steps_3_to_5(page, driver)
        with person.vehicle(propellers=True):
            yield from person.step_6(page)


class _Person:
    def __init__(self, build: Path, folder: Path, instance: int) -> None:
        self._build, self._folder, self._instance = build, folder, instance
        scenario = load_scenario(str(folder / SCENARIO))
        vehicle = scenario.vehicle
        self.vehicle_file = yaml.safe_dump(
            {
                "tombo_vehicle": 1,
                "name": "the simulated one",
                "vehicle": {"mass": vehicle.mass, "arm_length": vehicle.arm_length},
                "propeller": {"conf": scenario.propeller.conf},
            }
        )
        known = airframe_parameters(world_of(scenario), 0)
        # of the airframe alone: the page sets the others
        set_by_page = {**SAFE_PARAMETERS, **MOCAP_ONLY}
        self._airframe = {name: v for name, v in known.items() if name not in set_by_page}
        self._px4: ExitStack | None = None

    @contextmanager
    def vehicle(self, *, propellers: bool) -> Iterator[None]:
        """Run the simulator and PX4, which keeps its parameters."""
        values: dict[str, Any] = {"port": PX4_PORT + self._instance, **_NOISE}
        if not propellers:
            values |= {"hand_at": _HAND_AT_S, **_NO_PROPELLERS}
        words = ["-m", "tombo_px4.hil_sim_node", "--ros-args", "-r", "/mocap/pose:=/driver/pose"]
        for name, value in values.items():
            words += ["-p", f"{name}:={str(value).lower()}"]
        with (self._folder / f"sim-{propellers}.txt").open("wb") as log:
            sim = subprocess.Popen([sys.executable, *words], stdout=log, stderr=log)
        try:
            self.restart_px4()
            yield
        finally:
            self._stop_px4()
            sim.send_signal(signal.SIGINT)
            sim.wait(30.0)

    def restart_px4(self) -> None:
        """Switch it off and on."""
        self._stop_px4()
        self._px4 = ExitStack()
        folder = self._folder / "px4"
        self._px4.enter_context(Px4Process(self._build, folder, self._airframe, self._instance))

    def _stop_px4(self) -> None:
        if self._px4 is not None:
            self._px4.close()
            self._px4 = None

    def _tombo(self, command: str, *more: str) -> Terminal:
        """Type a command of the page, with the URL of this PX4 in place of the serial one."""
        words = shlex.split(
            command.replace(_URL, f"udpin://127.0.0.1:{ONBOARD_PORT + self._instance}")
        )
        assert words[0] == "tombo", command
        if "--px4" in words:
            words += ["--bridge", f"link.system={self._instance + 1}"]
        return Terminal([*words[1:], *more], self._folder, _PATIENCE_S)

    def steps_3_to_5(self, page: str, driver: Any) -> Iterator[Outcome]:
        """Prepare the vehicle, prove the axes, stop the motors."""
        command = commands_of(page, 3)[0]
        with self._tombo(command, "--json", "-o", "up") as up:
            up.wait(lambda e: "check.pose_wrong_frame" in _faults(e))
            yield Outcome(3, "frame_id world", "pose_wrong_frame names map", True)
            driver.frame = "map"
            up.wait(lambda e: "parameters_at_start" in _faults(e))
            self.restart_px4()
            up.skip()
            last = up.wait(lambda e: "check.axes_unproven" in _faults(e) and _blockers(e) == 1)
            yield Outcome(3, "PX4 restarted", f"left: {', '.join(_faults(last))}", True)
            up.wait(lambda e: _blockers(e) == 0)
            yield Outcome(4, "turned and carried by hand", "nothing forbids to arm", True)
            yield from self._step_5(page, up, driver)

    def _step_5(self, page: str, up: Terminal, driver: Any) -> Iterator[Outcome]:
        arm, kill = commands_of(page, 5)[:2], commands_of(page, 5)[-1]
        for does, stop in (
            ("kk", lambda: up.press("kk")),
            ("px4/kill", lambda: driver.call(kill)),
        ):
            yield self._stopped(does, arm, driver, stop)
        driver.on = False
        driver.until(lambda: not driver.status.ready)
        for command in arm:
            obeyed, said = driver.call(command)
        yield Outcome(5, "markers covered", said, not obeyed and "no mocap pose" in said)
        driver.on = True
        yield self._stopped("Ctrl-C", arm, driver, lambda: up.press("\x03"), 20.0)

    def _stopped(
        self,
        does: str,
        arm: Sequence[str],
        driver: Any,
        stop: Callable[[], object],
        within_s: float = _STOPS_S,
    ) -> Outcome:
        """Arm, stop the motors, and say how long it took."""
        for _ in range(_TRIES):  # a pose that is late on a busy machine forbids arming, too
            driver.until(lambda: driver.status.ready and not driver.status.armed)
            answers = [driver.call(command) for command in arm]
            if all(obeyed for obeyed, _ in answers):
                break
        else:
            return Outcome(5, does, "; ".join(said for _, said in answers), False)
        driver.until(lambda: max(driver.rotor_speed) > 0.0)
        began_s = time.monotonic()
        stop()
        driver.until(lambda: max(driver.rotor_speed) < _STANDS_RAD_S)
        took_s = time.monotonic() - began_s
        return Outcome(5, does, f"motors stand after {took_s:.1f} s", took_s <= within_s)

    def step_6(self, page: str) -> Iterator[Outcome]:
        """Hover, and diagnose the flight."""
        fly, diagnose = (c for c in commands_of(page, 6) if c.startswith("tombo "))
        with self._tombo(fly) as flight:
            flight.wait_for_text("Is the flight space clear?")
            flight.press("y\n")
            code = flight.exit_code(2.0 * _PATIENCE_S)
            yield Outcome(6, "hover", _last_line(flight.text), code == 0)
        with self._tombo(diagnose) as diagnosis:
            code = diagnosis.exit_code(2.0 * _PATIENCE_S)
            yield Outcome(6, "diagnose", _last_line(diagnosis.text), code == 0)


_STANDS_RAD_S = 20.0
"""A rotor that idles turns at 100 rad/s."""


def _last_line(text: str) -> str:
    """Return the last line of text, without cursor movements."""
    lines = _ESCAPE.sub("", text).replace("\r", "\n").splitlines()
    return next((line.strip() for line in reversed(lines) if line.strip()), "")


def _bridge(event: Mapping[str, Any]) -> Mapping[str, Any]:
    found: Mapping[str, Any] = event.get("nodes", {}).get("px4_bridge", {}).get("values", {})
    return found


def _faults(event: Mapping[str, Any]) -> list[str]:
    """Return the faults of the bridge that are active."""
    values = _bridge(event)
    prefix = "fault."
    return [
        key.removeprefix(prefix)
        for key, text in values.items()
        if key.startswith(prefix) and str(text).startswith("active")
    ]


def _blockers(event: Mapping[str, Any]) -> int:
    """Return how many findings forbid to arm; warnings come and go with the machine's load."""
    found = _bridge(event).get("findings")
    return -1 if found is None else str(found).count("blocks: ")


@contextmanager
def _environment(folder: Path) -> Iterator[None]:
    """Set what all processes need: a domain, and a place for the proof of the axes."""
    before = dict(os.environ)
    domain = None if "ROS_DOMAIN_ID" in before else free_domain(os.getpid(), udp_ports())
    os.environ.update(node_environment(before, folder / "ros", domain))
    os.environ["XDG_CONFIG_HOME"] = str(folder / "config")
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def table(outcomes: Sequence[Outcome]) -> str:
    """Return the table of the steps."""
    head = ("step", "done", "seen", "as written")
    rows = [[str(o.step), o.does, o.result, "yes" if o.as_written else "no"] for o in outcomes]
    return table_markdown(head, rows)
