"""The node suite in real time: loop rates, lateness, latency, losses, CPU; and how it ends.

    python node_suite.py [--seconds 60] [--shutdowns 20] [--busy 0] [--live ROUNDS]

The paper's flight from take-off on; figures are those that the nodes publish on /diagnostics.
`--busy N` runs N processes beside them that never sleep, each worth a core. `--live ROUNDS` asks
instead what `tombo live` costs: in each round the suite flies with the page at 30 Hz and one
client, and without it, in turn; a status on /diagnostics five times a second tells the time from
an event to the page.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import rclpy

from tombo_bag.formats.reader import Bag
from tombo_bag.topics import DIAGNOSTICS
from tombo_flight.scenario import load_scenario
from tombo_flight.suite.node_diagnostics import Loop
from tombo_flight.suite.nodes import SUITE, local_discovery
from tombo_flight.suite.running import RunningSuite, SuiteConfig
from tombo_ros.loop_statistics import LoopStatistics
from tombo_ros.pacing import Priority, request_realtime_priority, sleep_until
from tombo_ros.topic import TopicPublisher

LOOPS = {
    "controller: rate loop": 1000.0,
    "controller: attitude loop": 250.0,
    "controller: position loop": 50.0,
    "sim: loop": 1000.0,
    "estimator: loop": 250.0,
    "detector: loop": 200.0,
    "reaction: loop": 200.0,
    "mission: loop": 50.0,
    "recorder: loop": 200.0,
}
"""Name → rate [Hz]."""
MOST_LATER, MOST_CPU, MOST_MS = 0.10, 0.15, 100.0
"""What is asked of the page: lateness at 99 %, share of a core, event to page at 95 %."""
PATIENCE_S = 120.0
NAME = "node_suite"
_EVENT = re.compile(NAME + r": \w+, (\d+)")


@contextlib.contextmanager
def running_suite() -> Iterator[tuple[RunningSuite, Path]]:
    """Start the suite and wait until every node reports; give it with its recording."""
    with tempfile.TemporaryDirectory() as name:
        bag = Path(name) / "flight.mcap"
        recording = {"single_file": str(bag)}
        config = SuiteConfig(load_scenario(), 0, Path(name) / "suite", recording)
        with RunningSuite(config) as suite:
            while not suite.node_diagnostics.nodes.keys() >= SUITE.keys():
                suite.poll(0.05)
            yield suite, bag


def cpu_s(pid: int) -> float:
    """Return the CPU time that a process has used [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def loops_of(suite: RunningSuite) -> dict[str, Loop]:
    """Return the loops as they are reported, by the names of `LOOPS`."""
    nodes = suite.node_diagnostics.nodes.items()
    return {f"{node}: {loop.name}": loop for node, status in nodes for loop in status.loops}


@contextlib.contextmanager
def busy_cores(number: int) -> Iterator[None]:
    """Keep so many processes computing."""
    spin = [sys.executable, "-c", "while True: pass"]
    processes = [subprocess.Popen(spin) for _ in range(number)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def bare_loop(seconds: float) -> None:
    """Print how late a loop of 1 kHz with nothing in it runs here and now, for comparison."""
    watch = LoopStatistics()
    granted = request_realtime_priority(Priority(50, 50), set())
    deadline = time.monotonic_ns() + 1_000_000
    for _ in range(round(seconds * 1000)):
        sleep_until(deadline)
        woke = time.monotonic_ns()
        watch.ran(woke, woke - deadline)
        deadline += 1_000_000
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    late = watch.metrics()
    print(
        f"bare loop ({granted}): p50 {late['jitter_p50_us']:.0f}, "
        f"p99 {late['jitter_p99_us']:.0f}, max {late['jitter_max_us']:.0f} us late"
    )


def measure(seconds: float) -> None:
    """Run the suite and print its figures."""
    with running_suite() as (suite, bag):
        pids = {name: pid for name, pid in suite.status().pids.items() if name in SUITE}
        began, before = time.monotonic(), {name: cpu_s(pid) for name, pid in pids.items()}
        while (took := time.monotonic() - began) < seconds:
            suite.poll(0.25)
        used = {name: (cpu_s(pid) - before[name]) / took for name, pid in pids.items()}
        began = time.monotonic()
        unwell = [f"{end.name}: {end.exit_text}" for end in suite.stop()]
        ended_s = time.monotonic() - began
        written = sum(topic.count for topic in Bag(bag).topics.values())
    nodes = suite.node_diagnostics.nodes
    print("scheduling:", {name: nodes[name].values.get("scheduling") for name in SUITE})
    print("loop                        rate Hz    off %   p50 us   p99 us   max us  missed")
    loops = loops_of(suite)
    for name, wanted in LOOPS.items():
        rate = loops[name].number("rate_hz")
        late = [loops[name].number(f"jitter_{share}_us") for share in ("p50", "p99", "max")]
        print(f"{name:26} {rate:9.3f} {100.0 * (rate / wanted - 1.0):8.3f} "
              f"{late[0]:8.0f} {late[1]:8.0f} {late[2]:8.0f} "
              f"{loops[name].number('missed'):7.0f}")  # fmt: skip
    keys = {share: f"latency_gyro_to_command_{share}_us" for share in ("p50", "p99", "max")}
    latency = {share: nodes["sim"].values.get(key) for share, key in keys.items()}
    print(f"gyro to command, across processes [us]: {latency}")
    for name in SUITE:
        if nodes[name].level:
            print(f"{name}: {nodes[name].message}")
    recorder = nodes["recorder"].values
    print(f"recorder: {recorder.get('messages')} messages, {recorder.get('lost')} lost, "
          f"{recorder.get('rate_hz')} a second; {written} in the file")  # fmt: skip
    print("CPU, share of one core:", {name: round(share, 2) for name, share in used.items()})
    print(f"end: {ended_s:.2f} s; not well: {unwell or 'none'}")


def end_again_and_again(times: int) -> None:
    """Start and end the suite, many times."""
    worst, good = 0.0, 0
    for number in range(times):
        with running_suite() as (suite, _):
            began = time.monotonic()
            unwell = suite.stop()
            took = time.monotonic() - began
        worst = max(worst, took)
        good += not unwell and took < 3.0
        print(f"\r{number + 1} of {times} ended, {good} well", end="", flush=True)
    print(f": within 3 s, exit code 0; the slowest took {worst:.2f} s")


class LivePage:
    """The server as a process, and a client that notes when events come."""

    def __init__(self, folder: Path) -> None:
        self._log = folder / "live.log"
        with self._log.open("wb") as log:
            command = [sys.executable, "-m", "tombo_bringup.cli.main", "live", "--port", "0"]
            self._process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
        self.came: dict[int, float] = {}
        """Number of the event → when it came [s]."""
        self.frames = 0
        self._thread = threading.Thread(target=self._receive, args=(self._address(),), daemon=True)
        self._thread.start()

    def _address(self) -> str:
        end = time.monotonic() + PATIENCE_S
        while not (match := re.search(r"http(://\S+?)/\?(\S+)", self._log.read_text())):
            if self._process.poll() is not None or time.monotonic() > end:
                raise SystemExit(self._log.read_text())
            time.sleep(0.05)
        return f"ws{match[1]}/stream?{match[2]}"

    def _receive(self, address: str) -> None:
        from websockets.exceptions import ConnectionClosed
        from websockets.sync.client import connect

        with contextlib.suppress(ConnectionClosed), connect(address, max_size=None) as stream:
            for text in stream:
                now = time.monotonic()
                message = json.loads(text)
                self.frames += message["kind"] == "frame"
                for change in message.get("changes", ()):
                    if match := _EVENT.match(change["text"]):
                        self.came.setdefault(int(match[1]), now)

    def cpu_s(self) -> float:
        """Return the server's CPU time so far [s]."""
        return cpu_s(self._process.pid)

    def end(self) -> None:
        """End server and client."""
        self._process.terminate()
        self._process.wait(30)
        self._thread.join(30)


def fly_beside(page: LivePage | None, seconds: float, seed: int) -> dict[str, Any]:
    """Fly once with events; return the lateness of each loop [us], and what the page took."""
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

    sent: dict[int, float] = {}
    draw = Random(seed)
    context: Any = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node(NAME, context=context)
    publisher = TopicPublisher(node, DIAGNOSTICS)
    with running_suite() as (suite, _):
        began = time.monotonic()
        cpu, frames = (page.cpu_s(), page.frames) if page is not None else (0.0, 0)
        while (took := time.monotonic() - began) < seconds:
            suite.poll(0.2 * draw.uniform(0.5, 1.5))
            sent[len(sent)] = time.monotonic()
            status = DiagnosticStatus(level=b"\x00", name=NAME, message=str(len(sent) - 1))
            publisher.publish(DiagnosticArray(status=[status]))
        flown: dict[str, Any] = {
            "late_us": {
                name: loop.number("jitter_p99_us") for name, loop in loops_of(suite).items()
            }
        }
        if page is not None:
            flown |= {"cpu": (page.cpu_s() - cpu) / took, "events": len(sent)}
            flown["frames_hz"] = (page.frames - frames) / took
            time.sleep(0.5)
            came = [1e3 * (page.came[k] - t) for k, t in sent.items() if k in page.came]
            flown["event_ms"] = came
    node.destroy_node()
    rclpy.shutdown(context=context)
    return flown


def live_cost(rounds: int, seconds: float) -> bool:
    """Fly with and without the page in turn, and print; return whether all is as asked."""
    flights: dict[bool, list[dict[str, Any]]] = {True: [], False: []}
    for number in range(rounds):
        for with_page in (number % 2 == 0, number % 2 == 1):
            with tempfile.TemporaryDirectory() as name:
                page = LivePage(Path(name)) if with_page else None
                try:
                    flights[with_page].append(fly_beside(page, seconds, number))
                finally:
                    if page is not None:
                        page.end()
            words = "with" if with_page else "without"
            load = os.getloadavg()[0]
            print(f"round {number + 1}, {words} the page: load average {load:.1f}", flush=True)
    print("late at 99 % [us]           without    with   later")
    worst = 0.0
    for loop in LOOPS:
        without, beside = (
            float(np.median([flown["late_us"].get(loop, np.nan) for flown in flights[with_page]]))
            for with_page in (False, True)
        )
        later = beside / without - 1.0
        worst = later if np.isnan(later) else max(worst, later)
        print(f"{loop:26} {without:9.0f} {beside:7.0f} {later:7.1%}")
    pages = flights[True]
    cpu = float(np.median([flown["cpu"] for flown in pages]))
    events = [ms for flown in pages for ms in flown["event_ms"]]
    late_ms = float(np.percentile(events, 95)) if events else float("nan")
    print(f"latest loop: {worst:.1%} later (asked: {MOST_LATER:.0%})")
    print(f"CPU of the server: {cpu:.1%} of a core (asked: {MOST_CPU:.0%}), "
          f"{np.median([flown['frames_hz'] for flown in pages]):.1f} frames a second")  # fmt: skip
    print(f"event to page: p50 {np.median(events):.0f}, p95 {late_ms:.0f} ms "
          f"(asked: {MOST_MS:.0f}), {len(events)} of {sum(flown['events'] for flown in pages)} "
          "events came")  # fmt: skip
    return bool(worst <= MOST_LATER and cpu <= MOST_CPU and late_ms <= MOST_MS)


def main() -> int:
    """Measure; return 0 if all is as asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--shutdowns", type=int, default=20)
    parser.add_argument("--busy", type=int, default=0)
    parser.add_argument("--live", type=int, default=0, metavar="ROUNDS")
    given = parser.parse_args()
    os.environ["ROS_DOMAIN_ID"] = str(40 + os.getpid() % 50)
    os.environ.update(local_discovery(os.environ))
    if given.live > 0:
        return 0 if live_cost(given.live, given.seconds) else 1
    if given.seconds > 0:
        with busy_cores(given.busy):
            bare_loop(0.25 * given.seconds)
            measure(given.seconds)
            bare_loop(0.25 * given.seconds)
    if given.shutdowns > 0:
        end_again_and_again(given.shutdowns)
    return 0


if __name__ == "__main__":
    sys.exit(main())
