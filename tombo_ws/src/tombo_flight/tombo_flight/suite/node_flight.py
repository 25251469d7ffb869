"""One flight by the nodes, with the files of a headless flight."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from tombo_bag.flight import Flight
from tombo_bag.flight_time import FLIGHT_METADATA
from tombo_bag.recording import Recording
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import Phase
from tombo_dynamics.time_base import EPOCH_NS
from tombo_flight.flight import as_flown
from tombo_flight.flight_output import SCENARIO_FILE, draw_pictures, flight_summary, write_scenario
from tombo_flight.json_text import as_json
from tombo_flight.process.stop_signals import Stopped, StopSignals
from tombo_flight.progress import ProgressCallback
from tombo_flight.recorded_flight import read_flight
from tombo_flight.scenario import Scenario, world_of
from tombo_flight.suite.node_diagnostics import node_metrics
from tombo_flight.suite.nodes import HIL_SIM, PX4_SUITE, free_domain, udp_ports
from tombo_flight.suite.px4_connection import Px4Connection
from tombo_flight.suite.px4_flight import BridgeMonitor, px4_metrics
from tombo_flight.suite.running import LOGS, RunningSuite, SuiteConfig
from tombo_flight.suite.supervisor import ProcessExit
from tombo_sim.flight_setup import begin
from tombo_sim.ground_truth import FlightEndDetector

if TYPE_CHECKING:
    from tombo_flight.process.output_folder import OutputFolder

NODES_LOG = "nodes.log"
"""Log of all nodes, kept if one of them ended by itself."""
_NEEDED = ("sim", "px4_bridge", "recorder")
"""Without these, where they belong to the flight, it is over."""
_LOOK_S = 0.05
_START_S = 60.0
"""Wall time after which a simulator without messages is given up."""
_NOTHING_SEEN = (
    f"nothing was seen of a vehicle for {_START_S:.0f} s: neither ground truth nor poses of a "
    "motion capture (/mocap/pose)"
)
_SILENT_S = 5.0
_LIFTED_M = 0.1
_COMES_DOWN_S = 21.0
"""A little longer than the bridge stays with a vehicle that lands."""
_RELAYED_S = 5.0
"""Wait for the bridge's last status, which the monitor forwards."""


@dataclasses.dataclass
class NodeRun:
    """Events of the processes of a flight by nodes.

    Attributes:
        wall_s: how long the flight took.
        interrupted: it was ended from outside before its time.
        refused: why the vehicle did not take off; empty: it did.
        left_armed: that the vehicle is armed still, and in what mode; empty: it is not.
        loss: which loss has ended a flight over PX4; empty: none has.
        died: nodes that ended by themselves.
        warnings: (node, line) of their logs: warnings and errors.
    """

    wall_s: float = 0.0
    interrupted: bool = False
    refused: str = ""
    left_armed: str = ""
    loss: str = ""
    died: list[ProcessExit] = dataclasses.field(default_factory=list)
    warnings: list[tuple[str, str]] = dataclasses.field(default_factory=list)


class NotFlown(Exception):
    """The vehicle stayed on the ground, and why."""


class FlightMonitor:
    """Follows a flight by the monitor's messages; tells when it is over."""

    def __init__(self, scenario: Scenario) -> None:
        self._flight_end = FlightEndDetector(scenario.vehicle.leg_height)
        self._lifted_m = scenario.vehicle.leg_height + _LIFTED_M
        self.airborne = False
        """It has left the ground."""
        self._began_ns: int | None = None
        self.now_ns = 0
        """Stamp of the last state."""
        self._end_s = scenario.duration
        self.phase: int | None = None
        """Phase of the mission; None: not reported yet."""

    @property
    def flown_s(self) -> float:
        """Flight time: from the mission's first word; before it, from the first true pose."""
        return 0.0 if self._began_ns is None else (self.now_ns - self._began_ns) * 1e-9

    @property
    def over(self) -> bool:
        """Landed, crashed, or the duration is over."""
        return self.flown_s >= self._end_s

    def see(self, state: dict[str, Any]) -> None:
        """Take a state of the flight: stamp_ns, height_m, upright, phase (None: not known)."""
        self.now_ns = int(state["stamp_ns"])
        phase = state["phase"]
        if self._began_ns is None or (self.phase is None and phase is not None):
            self._began_ns = self.now_ns
        self.phase = phase
        self.airborne |= float(state["height_m"]) > self._lifted_m
        more_s = self._flight_end.watch(
            float(state["height_m"]),
            float(state["upright"]),
            Phase.IDLE if phase is None else phase,
        )
        if more_s is not None:
            self._end_s = min(self._end_s, self.flown_s + more_s)


def fly_nodes_and_save(
    folder: OutputFolder,
    scenario: Scenario,
    seed: int,
    stop: StopSignals,
    *,
    speed: float,
    domain: int | None,
    on_progress: ProgressCallback,
    lockstep: bool = False,
    px4: Px4Connection | None = None,
    notice: Callable[[str], None] = lambda text: None,
) -> tuple[Flight, NodeRun]:
    """Fly a scenario with all nodes and write its files into an output folder.

    Args:
        folder: where the files go; the caller publishes it.
        scenario: what to fly; `warm_up_nodes` first.
        seed: of the simulator's random draws. In real time no two flights are equal.
        stop: a request to stop ends the flight; its data until then are kept.
        speed: of simulated time against real time.
        lockstep: run the ticks of the headless flight, as fast as the machine can.
        domain: ROS_DOMAIN_ID; None: one of its own, or with a vehicle that is there already that
            of this process.
        on_progress: receives the progress.
        px4: fly over MAVLink.
        notice: called with texts that the user should see at once.

    Raises:
        InputError: `speed` or `domain` is out of bounds, or simulator or recorder did not run.
        NotFlown: PX4 did not take off; recording and logs are in the folder.
        Stopped: a stop came before anything was recorded.
        OSError: the files can't be written.
    """
    bag = folder / "flight.mcap"
    mode = "nodes" if px4 is None else "px4"
    with TemporaryDirectory(prefix="tombo-") as scratch:
        metadata = Path(scratch) / "metadata.json"
        record = _metadata(scenario, seed, mode)
        if lockstep:  # time 0 is the simulator's first tick, as in the headless flight
            record[FLIGHT_METADATA]["epoch_ns"] = str(EPOCH_NS)
        metadata.write_text(json.dumps(record), encoding="utf-8")
        config = SuiteConfig(
            scenario=scenario,
            seed=seed,
            folder=Path(scratch) / "suite",
            recording={"output": str(bag.absolute()), "metadata_file": str(metadata)},
            speed=speed,
            lockstep=lockstep,
            domain=_domain(px4) if domain is None else domain,
            monitor=_monitor_arguments(px4),
            **({} if px4 is None else over_mavlink(px4)),
        )
        on_progress("starting the nodes", 0.0)
        flown = _fly(config, stop, on_progress, notice)
        if flown.died or flown.refused:
            _collect_logs(config.folder / LOGS, folder / NODES_LOG)
    if flown.refused:
        raise NotFlown(flown.refused)
    on_progress("reading flight.mcap", 1.0)
    flight = _summarize(flown, bag, mode)
    write_scenario(folder / SCENARIO_FILE, scenario, seed)
    text = as_json(flight.summary)
    (folder / "summary.json").write_text(text, encoding="utf-8", newline="\n")
    if not flown.interrupted:
        draw_pictures(flight, folder, stop, on_progress)
    return flight, flown


def _domain(px4: Px4Connection | None) -> int | None:
    """Return a domain of the flight's own; a vehicle that is there has its mocap in ours."""
    own = px4 is None or px4.simulated
    return free_domain(os.getpid(), udp_ports()) if own else None


def over_mavlink(px4: Px4Connection) -> dict[str, Any]:
    """Return the changes of a suite configuration that flies over MAVLink."""
    suite = dict(PX4_SUITE)
    if px4.hil_port:
        suite["sim"] = HIL_SIM
    return {"suite": suite, "without": () if px4.simulated else ("sim",), "more": px4.parameters}


def _monitor_arguments(px4: Px4Connection | None) -> tuple[str, ...]:
    """Return the monitor's reports: the arguments of `monitor_node`."""
    if px4 is None:
        return ("--flight",)
    return ("--flight", "--px4", *(() if px4.simulated else ("--mocap",)))


def _metadata(scenario: Scenario, seed: int, mode: str) -> dict[str, dict[str, str]]:
    """Return the metadata of the recorder, as in a headless flight."""
    flown = as_flown(scenario, seed, begin(world_of(scenario), seed))
    return {
        FLIGHT_METADATA: {
            "scenario": json.dumps(flown, sort_keys=True),
            "seed": str(seed),
            "mode": mode,
        }
    }


def _fly(
    config: SuiteConfig,
    stop: StopSignals,
    on_progress: ProgressCallback,
    notice: Callable[[str], None],
) -> NodeRun:
    """Run the suite until the flight is over."""
    flown = NodeRun()
    watch = FlightMonitor(config.scenario)
    needed = [name for name in config.nodes if config.lockstep or name in _NEEDED]
    bridge = BridgeMonitor() if "px4_bridge" in config.nodes else None
    with RunningSuite(config) as suite:
        heard_s = began_s = time.monotonic()
        patience_s = _START_S
        # in lockstep the simulator ends the flight at its last tick, whatever the monitor sees
        while config.lockstep or not watch.over or not (bridge is None or bridge.at_rest):
            news = suite.poll(_LOOK_S)
            flown.warnings += news.warnings
            now_s = time.monotonic()
            if news.flight is not None:
                if patience_s == _START_S:
                    began_s, patience_s = now_s, _SILENT_S
                heard_s = now_s
                watch.see(news.flight)
                on_progress("flying", watch.flown_s / config.scenario.duration)
            if bridge is not None:
                bridge.see(
                    news.px4, watch.phase, now_s, over=watch.over, airborne=watch.airborne,
                    bridge=suite.node_diagnostics.nodes.get("px4_bridge"),
                )  # fmt: skip
                flown.refused, flown.loss = bridge.refusal, bridge.loss
            flown.interrupted = stop.requested()
            gone = [name for name in needed if name not in suite.running]
            if patience_s == _START_S and now_s - heard_s > patience_s:
                flown.refused = flown.refused or _NOTHING_SEEN
            if flown.interrupted or flown.refused or gone or now_s - heard_s > patience_s:
                break
        # who stops a simulated flight waits for nothing; in all else a vehicle may be in the air
        left = bridge is not None and bridge.armed
        left &= not (flown.interrupted and "sim" in needed)
        lands = left and "px4_bridge" in suite.running
        if bridge is not None and left:
            if lands:
                _land_by_bridge(suite, bridge, stop, notice)
            if bridge.armed:
                flown.left_armed = f"the vehicle is still armed, in mode {bridge.mode}"
        flown.wall_s = time.monotonic() - began_s
        suite.stop()
        flown.died = [
            end
            for end in suite.ended.values()
            if not (lands and end.name == "px4_bridge" and end.code == 0)  # it was told to
            and not (config.lockstep and end.name == "sim" and end.code == 0)  # the flight is over
        ]
    return flown


def _land_by_bridge(
    suite: RunningSuite, bridge: BridgeMonitor, stop: StopSignals, notice: Callable[[str], None]
) -> None:
    """End the bridge alone: it commands the landing, and poses go on until it is over.

    One more signal than there was ends the waiting.
    """
    try:
        interrupted = stop.requested()
        end_s = time.monotonic() + _COMES_DOWN_S
        suite.send_signal("px4_bridge", signal.SIGINT)
        again = " again" if interrupted else ""
        if bridge.mode in ("offboard", "land"):
            notice(f"landing; Ctrl-C{again} leaves it to PX4")
        else:
            notice(f"armed in mode {bridge.mode}: poses go on; Ctrl-C{again} leaves it to PX4")
        while bridge.armed and (now_s := time.monotonic()) < end_s:
            if stop.requested() and not interrupted:
                return
            bridge.see(suite.poll(_LOOK_S).px4, None, now_s, over=True)
            if "px4_bridge" not in suite.running:
                end_s = min(end_s, now_s + _RELAYED_S)
    except KeyboardInterrupt:  # the second Ctrl-C; the data until then are kept
        return


def _collect_logs(logs: Path, target: Path) -> None:
    """Put the logs of all nodes into one file."""
    parts = [
        f"== {path.stem}\n{path.read_text(encoding='utf-8', errors='replace')}"
        for path in sorted(logs.glob("*.log"))
    ]
    target.write_text("\n".join(parts), encoding="utf-8")


def _summarize(flown: NodeRun, bag: Path, mode: str) -> Flight:
    """Return the flight of the recording, with its summary.

    Raises:
        InputError: there is nothing in it.
        Stopped: the same, because a stop came early.
    """
    try:
        record = read_flight(bag, flown.wall_s)
        with Recording(bag) as recording:
            metrics = node_metrics(recording)
            if mode == "px4":
                metrics["px4"] = px4_metrics(recording, record) | {"loss": flown.loss or None}
            messages = sum(stream.count for stream in recording.topics.values())
    except InputError as error:
        if flown.interrupted:
            raise Stopped from error
        for end in flown.died:
            if end.name in _NEEDED:
                words = f": {end.last_log_lines[-1]}" if end.last_log_lines else ""
                raise InputError(f"{end.name} has ended, {end.exit_text}{words}") from error
        raise
    died = {end.name: end.exit_text for end in flown.died}
    more = {"mode": mode, **metrics, "died": died}
    record = dataclasses.replace(record, summary={**record.summary, **more})
    summary = flight_summary(record, interrupted=flown.interrupted, recorded_messages=messages)
    return dataclasses.replace(record, summary=summary)
