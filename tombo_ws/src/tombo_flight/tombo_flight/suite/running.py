"""The running suite: its processes, their messages, and the state of the flight."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeVar

from tombo_dynamics.errors import InputError, unknown_name
from tombo_flight.scenario import Scenario
from tombo_flight.several_vehicles import vehicle_names
from tombo_flight.suite.node_diagnostics import NodeDiagnostics
from tombo_flight.suite.nodes import (
    BRIDGE,
    HIGHEST_DOMAIN,
    MONITOR,
    SUITE,
    groups,
    monitor_program,
    node_environment,
    node_program,
    suite_of,
)
from tombo_flight.suite.parameter_yaml import (
    bridge_parameters,
    parameter_yaml,
    several_parameters,
    suite_parameters,
)
from tombo_flight.suite.status_table import SuiteState
from tombo_flight.suite.supervisor import ProcessExit, Program, Supervisor, json_object
from tombo_sim.wiring import CORES

PARAMETERS: Final = "parameters.yaml"
LOGS: Final = "log"
_Value = TypeVar("_Value")
FASTEST: Final = 20.0
_OTHERS_COME_S: Final = 30.0
"""Whoever has not come by then has failed: all code is compiled before."""


@dataclass(frozen=True)
class SuiteConfig:
    """What to run, checked.

    Attributes:
        scenario: what to fly.
        seed: of the simulator's random draws.
        folder: of parameters and logs; made when it isn't there, refused when there is something.
        recording: parameters of the recorder.
        without: nodes to leave out.
        speed: of simulated time against real time.
        lockstep: all nodes run the ticks of the headless flight, as fast as they can.
        domain: ROS_DOMAIN_ID; None: that of this process.
        monitor: arguments of the monitor.
        suite: which nodes there are, name → module; None: those of `SUITE`.
        more: further parameters of nodes, over those of the scenario.
        vehicles: number of vehicles, each in a namespace; 0: one, without.

    Raises:
        InputError: unknown node, or a value out of bounds.
    """

    scenario: Scenario
    seed: int
    folder: Path
    recording: dict[str, Any]
    without: tuple[str, ...] = ()
    speed: float = 1.0
    lockstep: bool = False
    domain: int | None = None
    monitor: tuple[str, ...] = ()
    suite: Mapping[str, str] | None = None
    more: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    vehicles: int = 0

    def __post_init__(self) -> None:
        for name in self.without:
            if name not in self.modules:
                raise unknown_name("node", name, self.modules)
        if not self.nodes:
            raise InputError("no node is left to start; accepted: at least one")
        if not 0.01 <= self.speed <= FASTEST:
            raise InputError(
                f"speed {self.speed:g}: out of bounds; accepted: a number from 0.01 to {FASTEST:g}"
            )
        if self.domain is not None and not 0 <= self.domain <= HIGHEST_DOMAIN:
            raise InputError(
                f"domain {self.domain}: out of bounds; accepted: a whole number from 0 to "
                f"{HIGHEST_DOMAIN}"
            )
        if self.folder.exists() and (
            not self.folder.is_dir() or any(True for _ in self.folder.iterdir())
        ):
            raise InputError(
                f"folder '{self.folder}': not empty; accepted: a folder, new or empty"
            )

    @property
    def modules(self) -> Mapping[str, str]:
        """Name → module of the nodes there are."""
        if self.vehicles:
            return suite_of(self.vehicles)
        return SUITE if self.suite is None else self.suite

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of the nodes to start."""
        return tuple(name for name in self.modules if name not in self.without)

    @property
    def hosted(self) -> Mapping[str, Sequence[str]]:
        """Process → the nodes in it, where it is not a node itself."""
        return groups(self.vehicles) if self.vehicles else {}


@dataclass(frozen=True)
class SuiteUpdate:
    """Changes since the last call.

    Attributes:
        ended: nodes that ended by themselves.
        warnings: (node, line) of the logs: warnings and errors.
        flight: the newest state of the flight, as the monitor tells it; None: no news. Of several
            vehicles that of one of them.
        px4: the newest state of the bridge to PX4; None: no news.
        answers: results of requests to the mission: request, success, message.
    """

    ended: list[ProcessExit]
    warnings: list[tuple[str, str]]
    flight: dict[str, Any] | None
    px4: dict[str, Any] | None = None
    answers: list[dict[str, Any]] = field(default_factory=list)


class RunningSuite:
    """Use as a context manager: entering starts the nodes, leaving ends them (`Supervisor`)."""

    def __init__(self, config: SuiteConfig) -> None:
        """Write the parameter file.

        Raises:
            OSError: the folder can't be written.
        """
        self.nodes = config.nodes
        self.node_diagnostics = NodeDiagnostics()
        self._hosted = config.hosted
        self._flights: dict[str, tuple[Mapping[str, Any], float]] = {}
        """Vehicle → its newest state, and when it came."""
        self.ended: dict[str, ProcessExit] = {}
        """Nodes that ended by themselves."""
        config.folder.mkdir(parents=True, exist_ok=True)
        logs = config.folder / LOGS
        environment = node_environment(os.environ, logs / "ros", config.domain)
        programs = _programs(config)
        self._supervisor = Supervisor(programs, logs, environment)
        self._began_s = time.monotonic()

    def __enter__(self) -> RunningSuite:
        """Start the nodes."""
        self._supervisor.__enter__()
        self._began_s = time.monotonic()
        return self

    def __exit__(self, *error: object) -> None:
        """End the nodes."""
        self._supervisor.__exit__(*error)

    @property
    def uptime_s(self) -> float:
        """Time since the start."""
        return time.monotonic() - self._began_s

    @property
    def running(self) -> set[str]:
        """Names of the nodes that run."""
        return set(self._supervisor.running) - {MONITOR}

    def poll(self, wait_s: float) -> SuiteUpdate:
        """Wait a while for news and return them."""
        poll = self._supervisor.poll(wait_s)
        said = [json_object(line) for _, line in poll.lines]
        now_s = time.monotonic()
        for message in said:
            vehicle = message.get("vehicle", "")
            if "diagnostics" in message:
                self.node_diagnostics.take(message["diagnostics"], now_s, vehicle)
            if message.get("flight"):
                self._flights[vehicle] = message["flight"], now_s
        newest = {key: value for message in said for key, value in message.items()}
        flight = newest.get("flight")
        ended = [end for end in poll.ended if end.name != MONITOR]
        self.ended |= {end.name: end for end in ended}
        warnings = list(poll.warnings)
        for end in poll.ended:
            if end.name == MONITOR:
                words = f" ({end.last_log_lines[-1]})" if end.last_log_lines else ""
                warnings.append((MONITOR, f"ended, {end.exit_text}: no status any more{words}"))
        answers = [message["answer"] for message in said if "answer" in message]
        return SuiteUpdate(ended, warnings, flight, newest.get("px4"), answers)

    def status(self) -> SuiteState:
        """Return the suite as it is now."""
        now = time.monotonic()
        return SuiteState(
            tuple(node for name in self.nodes for node in self._nodes_of(name)),
            self._by_node(self._supervisor.running),
            self._by_node(self.ended),
            self.node_diagnostics,
            now,
            self.uptime_s,
            {name: (flight, now - came_s) for name, (flight, came_s) in self._flights.items()},
        )

    def _nodes_of(self, name: str) -> Sequence[str]:
        return self._hosted.get(name, (name,))

    def _by_node(self, processes: Mapping[str, _Value]) -> dict[str, _Value]:
        return {node: of for name, of in processes.items() for node in self._nodes_of(name)}

    def request(self, name: str) -> bool:
        """Ask the nodes for hold, land or kill; False: there is nobody to pass it on."""
        return self._supervisor.send(MONITOR, name)

    def send_signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to one node, if it runs; the others go on."""
        pid = self._supervisor.running.get(name)
        if pid is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, number)

    def stop(self) -> list[ProcessExit]:
        """End the nodes, and return the nodes that did not end cleanly."""
        return [end for end in self._supervisor.stop() if end.code != 0 and end.name != MONITOR]


def _programs(config: SuiteConfig) -> Sequence[Program]:
    if config.vehicles:
        parameters = several_parameters(
            config.scenario, config.seed, config.vehicles, lockstep=config.lockstep
        )
    else:
        parameters = suite_parameters(
            config.scenario, config.seed, speed=config.speed, lockstep=config.lockstep
        )
    if not config.lockstep:
        cores = (core.name for core in CORES)
        others = " ".join(cores if config.vehicles else config.nodes).replace("sim ", "")
        for node in [node for node in parameters if node.rpartition("/")[2] == "sim"]:
            parameters[node] |= {"starts_after": others, "start_patience": _OTHERS_COME_S}
    parameters["recorder"] |= config.recording
    if BRIDGE in config.nodes:
        parameters[BRIDGE] = bridge_parameters(config.scenario)
    for node, values in config.more.items():
        for name in [name for name in parameters if name.endswith(f"/{node}")] or [node]:
            parameters[name] = {**parameters.get(name, {}), **values}
    file = config.folder / PARAMETERS
    comment = f"The parameters with which {config.scenario.name}, seed {config.seed}, was started."
    file.write_text(parameter_yaml(parameters, comment), encoding="utf-8")
    programs = [
        node_program(name, file.resolve(), config.modules, config.hosted.get(name, ()))
        for name in config.nodes
    ]
    vehicles = [f"--vehicle={name}" for name in vehicle_names(config.vehicles)]
    return [*programs, monitor_program(*config.monitor, *vehicles)]
