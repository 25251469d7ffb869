"""Checks by the machine in the steps of a first flight.

Functions that decide (`find_…`) are pure; functions that take a session ask the vehicle, or start
the command that already does it.
"""

from __future__ import annotations

import json
import math
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from tombo_bringup.lab_file import Lab
from tombo_control.safety.params import FlightVolume
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import ROTOR_NAMES, SPIN
from tombo_flight.process.output_folder import make_numbered
from tombo_flight.scenario import load_scenario
from tombo_flight.suite.px4_connection import Px4Connection, link_key, px4_connection, vehicle_on
from tombo_px4.bridge.vehicle_parameters import parameter_file, parse_assignments
from tombo_px4.frames import PX4_ROTORS
from tombo_px4.link.messages import is_killed
from tombo_px4.link.vehicle_link import VehicleLink
from tombo_px4.modes import Result

HOVER, KILL = "hover", "kill"
"""Folders of the two flights."""
_STAMP_KEYS = ("clock", "arrival_stamps")
"""Findings of `tombo check mocap` that are about clocks."""
_CLOCK_OFF_S = 2e-3
"""A vehicle at 1 m/s moves by 2 mm in it: the noise of the poses."""
_LEAST_CHARGE = 0.5
"""Share of the charge: two flights of a minute end far above PX4's limits."""
_BATTERY_LIMITS = ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR", "COM_LOW_BAT_ACT")
_FENCE = ("GF_ACTION", "GF_MAX_HOR_DIST", "GF_MAX_VER_DIST")
_FENCE_ACTIONS = (2, 5)
"""Hold and land; return climbs, and terminate drops the vehicle."""
_OVER_NET_M = 1.0
_LARGEST_M = 1e3
"""Wider than any lab: such a volume is the default of a scenario."""
_SWITCHED_S = 60.0
"""Time for the person to switch the kill switch, each way."""
_AXES_S = 120.0
_TURNS_S, _TURNS_AT = 2.0, 0.1
"""Time and throttle of a motor's test."""
_DIRECTIONS = {1.0: "ccw", -1.0: "cw"}
_TAKES_OFF_S = 12.0
"""From the mission's begin to hover: arming, PX4's ramp, climb."""
_SLOW_CLIMB_S = 12.0
"""More for a set point 0.12 m above the ground: PX4 1.17 in SITL left it after up to 19 s."""
_LANDS_S = 25.0
_LEAST_HEIGHT_M, _DOWN_M = 0.06, 0.03
"""Heights over the ground: a body at 0.3 m has its legs some 0.12 m above it."""
_FALLS_S = 1.0
"""A fall from 0.3 m takes 0.25 s, and the poses are at 30 Hz."""
_SAID_LATE_S = 0.5
"""Longest time between the end of the rotors and PX4's text about it."""


@dataclass(frozen=True)
class Outcome:
    """Result of a check."""

    failure: str
    """Empty: it is passed."""
    observation: str = ""
    figures: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Session:
    """Lab, vehicle and person that the checks work with.

    Attributes:
        file: the lab file.
        lab: its content.
        folder: of the recordings.
        ask: returns the answer of the person to a question of a step.
        say: shows a text to the person.
        domain: ROS_DOMAIN_ID of the motion capture; None: that of the environment.
        listen_s: time in which the motion capture is heard [s].
        hover_s: time of the hover [s].
        settings: KEY=VALUE of both flights.
    """

    file: Path
    lab: Lab
    folder: Path
    ask: Callable[[str, str], str]
    say: Callable[[str], object]
    domain: int | None = None
    listen_s: float = 20.0
    hover_s: float = 20.0
    settings: tuple[str, ...] = ()

    @property
    def px4(self) -> Px4Connection:
        """How PX4 is reached."""
        return px4_connection(self.lab.url, self.lab.bridge)

    @contextmanager
    def vehicle(self) -> Iterator[VehicleLink]:
        """Open a link to the vehicle, while no bridge uses it.

        Raises:
            InputError: as `vehicle_on`: the vehicle is missing.
        """
        params = self.px4.link
        with VehicleLink(params, link_key(params), time.time_ns) as link:
            vehicle_on(link, params)
            yield link

    @property
    def volume(self) -> FlightVolume:
        """The volume of the lab."""
        return load_scenario("hover", self.lab.settings, None, self.lab.vehicle or None).volume

    def command_line(self, command: str, *more: str) -> list[str]:
        """Return the command line of a command of the suite."""
        domain = [] if self.domain is None else ["--domain", str(self.domain)]
        arguments = [*command.split(), *domain, *more, "--json"]
        return [sys.executable, "-m", "tombo_bringup.cli.main", *arguments]

    def run(self, command: Sequence[str]) -> tuple[int, Any, str]:
        """Return exit code, JSON on standard output, and the last line on standard error."""
        with TemporaryFile("w+", encoding="utf-8") as out:
            process = subprocess.Popen(
                command, stdout=out, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True
            )
            assert process.stderr is not None
            said = ""
            for line in process.stderr:
                said = line.strip().removeprefix("Error: ") or said
                self.say(f"  {line.rstrip()}")
            code = process.wait()
            out.seek(0)
            text = out.read()
        try:
            return code, json.loads(text), said
        except ValueError:
            return code, None, said or text.strip()[-300:]


# --- Lab, motion capture, clocks -----------------------------------------------------------------


def check_lab(session: Session) -> Outcome:
    """Ask `tombo lab check`."""
    run = replace(session, domain=None).command_line("lab check", str(session.file))
    _, items, said = session.run(run)
    if items is None:
        return Outcome(said)
    return Outcome(
        "; ".join(item["lacks"] for item in items if item["lacks"]), "nothing is lacking"
    )


def _listen(session: Session, seconds: float) -> tuple[dict[str, str], Mapping[str, Any], str]:
    """Return key → message of the findings, the figures, and an error, of `tombo check mocap`."""
    _, found, said = session.run(session.command_line("check mocap", "--seconds", str(seconds)))
    if found is None:
        return {}, {}, said
    return {f["key"]: f["message"] for f in found["findings"]}, found["figures"], ""


def check_mocap(session: Session) -> Outcome:
    """Ask `tombo check mocap` while the vehicle is carried."""
    findings, figures, error = _listen(session, session.listen_s)
    wrong = [text for key, text in findings.items() if key not in _STAMP_KEYS]
    rate = figures.get("rate_hz") or math.nan
    return Outcome(error or "; ".join(wrong), f"{rate:.0f} poses in a second", figures)


def check_clocks(session: Session) -> Outcome:
    """Compare the stamps with their arrival, and ask chrony where it is installed."""
    findings, _, error = _listen(session, max(0.25 * session.listen_s, 2.0))
    stamps = [text for key, text in findings.items() if key in _STAMP_KEYS]
    tracking = ""
    if shutil.which("chronyc"):
        words = ["chronyc", "-c", "tracking"]
        tracking = subprocess.run(words, capture_output=True, text=True).stdout
    text = error or "; ".join(stamps) or (find_clock_fault(tracking) if tracking else "")
    return Outcome(text, "stamps agree; chrony follows" if tracking else "stamps agree; no chrony")


def find_clock_fault(tracking: str) -> str:
    """Return why the clock of this computer is not set; "" if it is.

    Args:
        tracking: line of `chronyc -c tracking`; its fields 4 and 13 are the offset [s] and the
            leap status (chrony's own documentation).
    """
    fields = tracking.strip().split(",")
    try:
        offset_s, leap = float(fields[4]), fields[13]
    except (IndexError, ValueError):
        return f"chrony says '{tracking.strip()}'; expected: the line of `chronyc -c tracking`"
    if leap == "Not synchronised":
        return "chrony follows no clock"
    if abs(offset_s) > _CLOCK_OFF_S:
        return f"the clock is {1e3 * offset_s:.1f} ms off; expected: {1e3 * _CLOCK_OFF_S:g} ms"
    return ""


# --- PX4 -----------------------------------------------------------------------------------------


def check_parameters(session: Session) -> Outcome:
    """Compare PX4's parameters with the file of `tombo px4 --write-params`, and the lab's own."""
    px4 = session.px4
    wanted = parameters_of(parameter_file()) | parse_assignments(px4.writes)
    with session.vehicle() as link:
        values = link.parameters(list(wanted))
    return Outcome(parameter_differences(values, wanted), f"{len(wanted)} are as in the file")


def parameters_of(text: str) -> dict[str, float]:
    """Return name → value of a file of parameters as QGroundControl loads it."""
    rows = (line.split("\t") for line in text.splitlines() if not line.startswith("#"))
    return {row[2]: float(row[3]) for row in rows}


def parameter_differences(values: Mapping[str, float], wanted: Mapping[str, float]) -> str:
    """Return in words which parameters are not as wanted; "" if all are."""
    lacks = [
        f"{name} is {f'{values[name]:g}' if name in values else 'not known to PX4'}, not {value:g}"
        for name, value in wanted.items()
        if not math.isclose(values.get(name, math.nan), value, rel_tol=1e-5, abs_tol=1e-5)
    ]
    return "; ".join(lacks)


def check_battery(session: Session) -> Outcome:
    """Read charge and limits of the battery."""
    with session.vehicle() as link:
        status = link.wait("SYS_STATUS", 5.0)
        limits = link.parameters(_BATTERY_LIMITS)
    remaining = -1 if status is None else status.battery_remaining
    charge = 0.01 * remaining if remaining >= 0 else math.nan
    volts = math.nan if status is None else 1e-3 * status.voltage_battery
    figures = {"charge": charge, "voltage_V": volts, **limits}
    return Outcome(find_battery_fault(charge, limits), f"{charge:.0%}, {volts:.1f} V", figures)


def find_battery_fault(charge: float, limits: Mapping[str, float]) -> str:
    """Return the fault of the battery for two short flights; "" without one.

    Args:
        charge: share of the full charge; NaN: not known.
        limits: PX4's parameters `BAT_LOW_THR` and so on.
    """
    if math.isnan(charge):
        return "PX4 does not know the charge of the battery"
    if charge < _LEAST_CHARGE:
        return f"the battery has {charge:.0%}; expected: {_LEAST_CHARGE:.0%} or more"
    *levels, action = (limits.get(name, math.nan) for name in _BATTERY_LIMITS)
    if not levels[0] > levels[1] > levels[2] > 0.0:
        shown = ", ".join(f"{level:g}" for level in levels)
        return f"PX4's limits BAT_LOW_THR, … are {shown}; expected: falling"
    if action not in (2.0, 3.0):
        return f"COM_LOW_BAT_ACT is {action:g}; expected: 2, a critical battery lands"
    return ""


def check_kill_switch(session: Session) -> Outcome:
    """See PX4 report that the kill switch was switched on, then off."""
    with session.vehicle() as link:
        mapped = link.parameters(["RC_MAP_KILL_SW"]).get("RC_MAP_KILL_SW", 0.0)
        if mapped == 0.0:
            return Outcome("RC_MAP_KILL_SW is 0: PX4 knows no kill switch")
        for way, killed in (("on", True), ("off", False)):
            session.say(f"Switch the kill switch of the remote control {way}.")
            seen = link.wait("HEARTBEAT", _SWITCHED_S, partial(_shows_kill, killed))
            if seen is None:
                return Outcome(f"PX4 did not report within {_SWITCHED_S:g} s that it is {way}")
    return Outcome("", "switched on and off")


def _shows_kill(killed: bool, heartbeat: Any) -> bool:
    return is_killed(heartbeat) == killed


def check_geofence(session: Session) -> Outcome:
    """Compare PX4's geofence with the volume of the lab."""
    with session.vehicle() as link:
        fence = link.parameters(_FENCE)
    faults = find_fence_faults(fence, session.volume)
    return Outcome(faults, "PX4's fence is around the volume", fence)


def find_fence_faults(fence: Mapping[str, float], volume: FlightVolume) -> str:
    """Return the faults of PX4's geofence around a volume; "" without one."""
    diagonal = math.hypot(volume.x_max - volume.x_min, volume.y_max - volume.y_min)
    highest = volume.z_max + _OVER_NET_M
    faults = []
    if diagonal > _LARGEST_M:
        faults.append("the lab has no volume")
    if fence.get("GF_ACTION") not in _FENCE_ACTIONS:
        faults.append(f"GF_ACTION is {fence.get('GF_ACTION', math.nan):g}, set it to 5 (land)")
    for name, most in (("GF_MAX_HOR_DIST", diagonal), ("GF_MAX_VER_DIST", highest)):
        value = fence.get(name, math.nan)
        if not 0.0 < value <= most:
            faults.append(f"{name} is {value:g}; expected: above 0, at most {most:.1f} m")
    return "; ".join(faults)


def check_rotors(session: Session) -> Outcome:
    """Turn one motor after the other, and compare what the person has seen."""
    answers = []
    for motor in range(1, len(PX4_ROTORS) + 1):
        with session.vehicle() as link:
            result = link.test_motor(motor, _TURNS_AT, _TURNS_S)
        if result != Result.ACCEPTED:
            return Outcome(f"PX4 does not turn motor {motor}: {result and result.name}")
        names = ", ".join(ROTOR_NAMES)
        answers.append(
            session.ask(
                "rotors",
                f"Motor {motor} turned for {_TURNS_S:g} s. Which rotor ({names}), and seen from"
                " above cw or ccw?",
            )
        )
        if fault := find_rotor_fault(answers):
            return Outcome(fault)
    return Outcome("", ", ".join(answers))


def find_rotor_fault(answers: Sequence[str]) -> str:
    """Return which motor of PX4 has a wrong place or direction; "" if all are right."""
    for motor, answer in enumerate(answers):
        rotor = PX4_ROTORS[motor]
        wanted = f"{ROTOR_NAMES[rotor]} {_DIRECTIONS[float(SPIN[rotor])]}"
        if " ".join(answer.lower().split()) != wanted:
            return f"motor {motor + 1} is '{answer}'; expected: '{wanted}'"
    return ""


# --- Nodes and flights ---------------------------------------------------------------------------


def check_axes(session: Session) -> Outcome:
    """Run the bridge without a mission until no finding blocks arming."""
    folder = make_numbered(session.folder / "axes")
    words = ("up hover --lab", str(session.file), "--px4", "--without", "mission")
    command = session.command_line(words[0], *words[1:], "-o", str(folder))
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        begun_s, heard, free, text = time.monotonic(), False, 0, "the bridge has said nothing"
        try:
            for line in process.stdout:
                event = json.loads(line) if line.startswith("{") else {}
                if event.get("event") == "ended" and event["node"] == "px4_bridge":
                    text = f"the bridge has ended, {event['how']}; its log: {event['log']}"
                    break
                if event.get("event") != "status":
                    continue
                values = event["nodes"]["px4_bridge"]["values"]
                text, before = blockers_of(values), text
                if values.get("mode") and not heard:  # nodes that compile take minutes to start
                    begun_s, heard = time.monotonic(), True
                if values.get("mode") and text != before:
                    session.say(f"  {text or 'nothing forbids to arm'}")
                free = 0 if text else free + 1
                if free == 2 or time.monotonic() - begun_s > _AXES_S:
                    break
        finally:
            process.send_signal(signal.SIGINT)
            process.stdout.read()
    return Outcome(text if free < 2 else "", "nothing forbids to arm")


def blockers_of(values: Mapping[str, Any]) -> str:
    """Return the findings that block arming, of the bridge's diagnostics; "" without any."""
    if not values.get("mode"):
        return "the bridge does not hear PX4"
    findings = str(values.get("findings", "")).split(" | ")
    return "; ".join(f.removeprefix("blocks: ") for f in findings if f.startswith("blocks: "))


def _fly(session: Session, name: str, height: float, hover_s: float) -> tuple[int, Any, str]:
    """Fly `hover` over PX4 at a height, into a folder of its own."""
    land_s = _TAKES_OFF_S + hover_s
    settings = (
        *session.settings,
        f"mission.height={height}",
        f"mission.land_time={land_s}",
        f"duration={land_s + _LANDS_S}",
    )
    words = [word for setting in settings for word in ("--set", setting)]
    where = ("--lab", str(session.file), "--px4", "--yes", "--force")
    output = ("-o", str(session.folder / name))
    return session.run(session.command_line("fly hover", *where, *words, *output))


def check_hover(session: Session) -> Outcome:
    """Hover at 0.5 m, land, disarm."""
    code, summary, said = _fly(session, HOVER, 0.5, session.hover_s)
    if code or summary is None:
        return Outcome(said or "the flight has failed")
    return Outcome("" if summary["landed"] else "it did not land", _flight_text(summary))


def _flight_text(summary: Mapping[str, Any]) -> str:
    rms = summary.get("hover_rms_m")
    text = "" if rms is None else f", {1e3 * rms:.0f} mm RMS from the set point"
    return f"flown for {summary['px4']['armed_duration_s']:.0f} s{text}"


def check_kill(session: Session) -> Outcome:
    """Hover at 0.3 m; the person switches the rotors off."""
    from tombo_flight.recorded_flight import read_flight

    session.say("It takes off to 0.3 m. Switch the kill switch on as soon as it hovers.")
    _, summary, said = _fly(session, KILL, 0.3, _SLOW_CLIMB_S + session.hover_s)
    if summary is None:
        return Outcome(said or "the flight has failed")
    texts = summary["px4"]["status_texts"]
    killed_s = next((t for t, text in texts if text.startswith("Kill engaged")), math.nan)
    flight = read_flight(session.folder / KILL / "flight.mcap")
    height = flight.log["position"][:, 2]
    figures = fall_of(flight.t, height - height[0], killed_s)
    shown = "{height_m:.2f} m above the ground, which it reached {down_s:.1f} s later"
    return Outcome(find_kill_fault(**figures), f"rotors off {shown.format(**figures)}", figures)


def fall_of(t: Array, height: Array, killed_s: float) -> dict[str, float]:
    """Return `height_m` where the rotors were switched off, and `down_s` until it was down.

    Args:
        t: (N,) [s].
        height: (N,) over the ground [m].
        killed_s: when PX4 said so [s]; NaN: never.

    Returns:
        Both NaN if PX4 did not say so; `down_s` is infinite if it did not come down.
    """
    before = (t > killed_s - _SAID_LATE_S) & (t <= killed_s)
    down = t[(t > killed_s) & (height < _DOWN_M)]
    return {
        "height_m": float(height[before].max()) if before.any() else math.nan,
        "down_s": float(down[0] - killed_s) if down.size else math.inf,
    }


def find_kill_fault(height_m: float, down_s: float) -> str:
    """Return why a flight does not show that the kill switch works; "" if it does.

    Args:
        height_m: over the ground, where the rotors were switched off; NaN: PX4 did not say so.
        down_s: from there to the ground.
    """
    if math.isnan(height_m):
        return "PX4 did not report the kill switch in this flight; switch it while it hovers"
    if height_m < _LEAST_HEIGHT_M:
        return f"it was {height_m:.2f} m above the ground; switch it while it hovers"
    if down_s > _FALLS_S:
        return f"it came down {down_s:.1f} s later; expected: within {_FALLS_S:g} s, as it falls"
    return ""


def check_diagnosis(session: Session) -> Outcome:
    """Diagnose the hover."""
    vehicle = ["--vehicle", session.lab.vehicle] if session.lab.vehicle else []
    log = session.folder / HOVER / "flight.mcap"
    words = replace(session, domain=None).command_line("diagnose", str(log), *vehicle)
    code, found, said = session.run([*words, "-o", str(session.folder / "diagnosis"), "--force"])
    if code or found is None:
        return Outcome(said or "no diagnosis")
    causes = ", ".join(cause["effect"] for cause in found["causes"])
    verdict = f"{found['verdict']}{': ' * bool(causes)}{causes}"
    return Outcome("", verdict, {"report": f"{session.folder}/diagnosis"})
