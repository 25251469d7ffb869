"""The node suite in real time: loop rates, jitter, latency, losses, CPU; and how it ends.

    python node_suite.py [--seconds 60] [--shutdowns 20] [--busy 0]

All nodes and the recorder run as processes on a DDS domain of their own, the paper's flight from
take-off on; figures are those that the nodes publish on /diagnostics. `--busy N` runs N processes
beside them that never sleep, each worth a core.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import rclpy

from tombo_bag.formats.reader import Bag
from tombo_bag.topics import DIAGNOSTICS
from tombo_flight.scenario import load_scenario
from tombo_flight.suite.nodes import SUITE, local_discovery
from tombo_flight.suite.parameter_yaml import parameter_yaml, suite_parameters
from tombo_ros.loop_statistics import LoopStatistics
from tombo_ros.pacing import Priority, request_realtime_priority, sleep_until
from tombo_ros.topic import PolledSubscription

LOOPS = (
    ("controller: rate loop", 1000.0),
    ("controller: attitude loop", 250.0),
    ("controller: position loop", 50.0),
    ("sim: loop", 1000.0),
    ("estimator: loop", 250.0),
    ("detector: loop", 200.0),
    ("reaction: loop", 200.0),
    ("mission: loop", 50.0),
    ("recorder: loop", 200.0),
)


class Suite:
    """All processes of the suite."""

    def __init__(self, folder: Path) -> None:
        file = folder / "suite.yaml"
        file.write_text(parameter_yaml(suite_parameters(load_scenario(), 0)))
        self.logs = {name: folder / f"{name}.log" for name in SUITE}
        self.bag = folder / "flight.mcap"
        self.processes = {}
        for name, module in SUITE.items():
            more = ["-p", f"single_file:={self.bag}"] if name == "recorder" else []
            command = [sys.executable, "-m", module, "--ros-args", "--params-file", str(file)]
            with self.logs[name].open("wb") as log:
                self.processes[name] = subprocess.Popen(
                    [*command, *more], stdout=log, stderr=subprocess.STDOUT, start_new_session=True
                )

    def running(self) -> bool:
        """Return whether all loops have begun."""
        return all("running" in log.read_text() for log in self.logs.values())

    def cpu_s(self) -> dict[str, float]:
        """Return the CPU time of each node so far [s]."""
        ticks = os.sysconf("SC_CLK_TCK")
        used = {}
        for name, process in self.processes.items():
            fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
            used[name] = (int(fields[11]) + int(fields[12])) / ticks
        return used

    def end(self) -> tuple[float, set[int], bool]:
        """Send SIGINT to all; return seconds taken, exit codes, whether any complained."""
        began = time.monotonic()
        for process in self.processes.values():
            process.send_signal(signal.SIGINT)
        codes = {process.wait(30) for process in self.processes.values()}
        took = time.monotonic() - began
        return took, codes, any("Traceback" in log.read_text() for log in self.logs.values())


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
    command = (
        "SCHED_FIFO"
        if request_realtime_priority(Priority(50, 50), set()).startswith("FIFO")
        else "normal"
    )
    deadline = time.monotonic_ns() + 1_000_000
    for _ in range(round(seconds * 1000)):
        sleep_until(deadline)
        woke = time.monotonic_ns()
        watch.ran(woke, woke - deadline)
        deadline += 1_000_000
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    found = watch.metrics()
    print(
        f"bare loop ({command}): p50 {found['jitter_p50_us']:.0f}, "
        f"p99 {found['jitter_p99_us']:.0f}, max {found['jitter_max_us']:.0f} us late"
    )


def measure(seconds: float) -> None:
    """Run the suite and print its figures."""
    reports: dict[str, dict[str, str]] = {}
    with tempfile.TemporaryDirectory() as name:
        suite = Suite(Path(name))
        context: Any = rclpy.Context()
        rclpy.init(context=context)
        node = rclpy.create_node("bench", context=context)
        diagnostics = PolledSubscription(node, DIAGNOSTICS, 200)
        while not suite.running():
            time.sleep(0.05)
        began, before = time.monotonic(), suite.cpu_s()
        while time.monotonic() - began < seconds + 3.0:
            time.sleep(0.25)
            for taken in diagnostics.take():
                for status in taken.message.status:
                    reports[status.name] = {pair.key: pair.value for pair in status.values}
        used = {n: (s - before[n]) / (seconds + 3.0) for n, s in suite.cpu_s().items()}
        node.destroy_node()
        rclpy.shutdown(context=context)
        took, codes, complained = suite.end()
        topics = Bag(suite.bag).topics
        written = sum(topic.count for topic in topics.values())
    print("scheduling:", {name: reports[name].get("scheduling") for name in SUITE})
    print("loop                        rate Hz    off %   p50 us   p99 us   max us  missed")
    for loop, wanted in LOOPS:
        r = {key: float(value) for key, value in reports[loop].items()}
        off = 100.0 * (r["rate_hz"] / wanted - 1.0)
        print(
            f"{loop:26} {r['rate_hz']:9.3f} {off:8.3f} {r['jitter_p50_us']:8.0f} "
            f"{r['jitter_p99_us']:8.0f} {r['jitter_max_us']:8.0f} {r['missed']:7.0f}"
        )
    sim = reports["sim"]
    shares = {key: sim.get(f"latency_gyro_to_command_{key}_us") for key in ("p50", "p99", "max")}
    print(f"gyro to command, across processes [us]: {shares}")
    for name in SUITE:
        faults = {key: text for key, text in reports[name].items() if key.startswith("fault.")}
        if faults:
            print(f"{name}: {faults}")
    recorder = reports["recorder"]
    print(f"recorder: {recorder.get('messages')} messages, {recorder.get('lost')} lost", end="")
    print(f", {recorder.get('rate_hz')} a second; {written} in the file")
    print("CPU, share of one core:", {name: round(share, 2) for name, share in used.items()})
    print(f"end: {took:.2f} s, exit codes {sorted(codes)}, tracebacks: {complained}")


def end_again_and_again(times: int) -> None:
    """Start and end the suite, many times."""
    worst, good = 0.0, 0
    for number in range(times):
        with tempfile.TemporaryDirectory() as name:
            suite = Suite(Path(name))
            while not suite.running():
                time.sleep(0.05)
            time.sleep(0.2)
            took, codes, complained = suite.end()
        worst = max(worst, took)
        good += codes == {0} and not complained and took < 3.0
        print(f"\r{number + 1} of {times} ended, {good} well", end="", flush=True)
    print(f": within 3 s, exit 0, no traceback; the slowest took {worst:.2f} s")


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--shutdowns", type=int, default=20)
    parser.add_argument("--busy", type=int, default=0)
    wanted = parser.parse_args()
    os.environ["ROS_DOMAIN_ID"] = str(40 + os.getpid() % 50)
    os.environ.update(local_discovery(os.environ))
    if wanted.seconds > 0:
        with busy_cores(wanted.busy):
            bare_loop(0.25 * wanted.seconds)
            measure(wanted.seconds)
            bare_loop(0.25 * wanted.seconds)
    if wanted.shutdowns > 0:
        end_again_and_again(wanted.shutdowns)


if __name__ == "__main__":
    main()
