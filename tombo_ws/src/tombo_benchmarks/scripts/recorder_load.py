"""What the recorder loses under load, and what it costs.

    python recorder_load.py [--seconds 60] [--burst-ms 0]

Two processes publish four topics at 1 kHz and some slow ones, on a DDS domain of their own; the
recorder runs beside them as it does in a flight. Then the file is read with three libraries and
the messages are counted.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from random import randrange
from typing import Any

import numpy as np
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from tombo_bag.columnar_cdr import layout
from tombo_bag.formats.reader import Bag
from tombo_bag.formats.rolling_sink import NOTES
from tombo_bag.topics import (
    BATTERY,
    COLLISION_EVENT,
    IMU,
    MISSION_SETPOINT,
    MOCAP_POSE,
    RATES_SETPOINT,
    ROTOR_COMMAND,
    TOPICS,
    TRUE_ODOMETRY,
    TRUE_ROTORS,
    TopicSpec,
)
from tombo_flight.suite.nodes import local_discovery

PROCESSES: tuple[tuple[TopicSpec, ...], ...] = (
    (IMU, TRUE_ROTORS, MOCAP_POSE, BATTERY),
    (TRUE_ODOMETRY, ROTOR_COMMAND, RATES_SETPOINT, MISSION_SETPOINT, COLLISION_EVENT),
)
EVENT_HZ = 0.5
FASTEST_HZ = {TRUE_ROTORS.name: 1000.0, TRUE_ODOMETRY.name: 1000.0}
"""As fast as `truth_rate` goes."""
VARIANTS = 500
MS = 1_000_000


def say(text: str = "") -> None:
    """Write a line."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def varied(spec: TopicSpec, kind: Any) -> list[Any]:
    """Return messages full of random numbers, which compress no better than real ones."""
    from rclpy.serialization import deserialize_message

    shape = layout(spec.typename, {"header": {"frame_id": "map"}})
    records = shape.records(VARIANTS)
    rng = np.random.default_rng(0)
    for leaf in shape.leaves:
        if leaf.dtype.kind == "f" and leaf.count != 0:
            records[leaf.path] = rng.normal(size=records[leaf.path].shape)
    block = records.view(f"V{records.dtype.itemsize}")
    return [deserialize_message(data, kind) for data in block.tolist()]


def publish(names: list[str], seconds: float, burst_ms: int) -> None:
    """Be a publishing process: print how many messages of each topic were sent."""
    import rclpy

    from tombo_ros.conversion import to_time
    from tombo_ros.pacing import sleep_until
    from tombo_ros.topic import TopicPublisher

    rclpy.init()
    node = rclpy.create_node("load")
    specs = [TOPICS[name] for name in names]
    outputs = [TopicPublisher(node, spec) for spec in specs]
    variants = [varied(spec, output.kind) for spec, output in zip(specs, outputs, strict=True)]
    rates = [FASTEST_HZ.get(spec.name, spec.rate_hz or EVENT_HZ) for spec in specs]
    periods = [max(round(1000 / rate), 1) for rate in rates]
    sent = [0] * len(specs)
    say("ready")
    sys.stdin.readline()
    start = time.monotonic_ns()
    for tick in range(round(seconds * 1000)):
        due = tick if not burst_ms else tick - tick % burst_ms
        sleep_until(start + due * MS)
        stamp = to_time(time.time_ns())
        for i, period in enumerate(periods):
            if tick % period == 0:
                message = variants[i][tick % VARIANTS]
                message.header.stamp = stamp
                outputs[i].publish(message)
                sent[i] += 1
    took = (time.monotonic_ns() - start) * 1e-9
    time.sleep(0.5)
    say(" ".join([f"{took:.3f}", *map(str, sent)]))
    rclpy.shutdown()


def cpu_seconds(process: int) -> float:
    """Return the CPU time a process has used."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure(seconds: float, burst_ms: int, folder: Path) -> bool:
    """Run publishers and recorder; print the figures; return whether nothing was lost."""
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(randrange(100, 200)),
        **local_discovery(os.environ),
    }
    bag = folder / "load"
    recorder = subprocess.Popen(
        [
            *(Path(sys.prefix) / "lib/tombo_ros/recorder_node", "--ros-args"),
            *("-p", f"output:={bag}", "--log-level", "warn"),
        ],
        env=environment,
    )
    publishers = [
        subprocess.Popen(
            [
                *(sys.executable, __file__, "--seconds", str(seconds)),
                *("--burst-ms", str(burst_ms), "--publish", *(spec.name for spec in specs)),
            ],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for specs in PROCESSES
    ]
    sent: dict[str, int] = {}
    longest = 0.0
    try:
        for publisher in publishers:
            assert publisher.stdout is not None
            publisher.stdout.readline()
        time.sleep(2.0)
        before, began = cpu_seconds(recorder.pid), time.monotonic()
        for publisher in publishers:
            assert publisher.stdin is not None
            publisher.stdin.write("go\n")
            publisher.stdin.flush()
        for publisher, specs in zip(publishers, PROCESSES, strict=True):
            assert publisher.stdout is not None
            time_taken, *numbers = publisher.stdout.readline().split()
            longest = max(longest, float(time_taken))
            sent |= {spec.name: int(n) for spec, n in zip(specs, numbers, strict=True)}
            say(f"{time_taken} s of {', '.join(spec.name for spec in specs)}")
        share = (cpu_seconds(recorder.pid) - before) / (time.monotonic() - began)
        recorder.terminate()
        recorder.wait(timeout=10)
    finally:
        for process in (*publishers, recorder):
            if process.poll() is None:
                process.kill()
            process.wait()
    return report(bag, sent, share, longest)


def report(bag: Path, sent: dict[str, int], share: float, seconds: float) -> bool:
    """Print asked, received, lost; compare three readers; return whether all is there."""
    with AnyReader([bag]) as reader:
        by_rosbags = {c.topic: c.msgcount for c in reader.connections}
        read = dict.fromkeys(by_rosbags, 0)
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            read[connection.topic] += 1
    by_mcap: dict[str, int] = dict.fromkeys(by_rosbags, 0)
    by_tombo: dict[str, int] = dict.fromkeys(by_rosbags, 0)
    for path in bag.glob("*.mcap"):
        with path.open("rb") as file:
            for _, channel, _ in make_reader(file, validate_crcs=True).iter_messages():
                by_mcap[channel.topic] += 1
        found = Bag(path, check=True)
        assert not found.damage, found.damage
        for name, topic in found.topics.items():
            by_tombo[name] += topic.count
    notes = found.metadata[NOTES]
    say()
    say(f"{'topic':24}{'sent':>8}{'received':>10}{'lost':>6}")
    whole = True
    for name, number in sent.items():
        say(f"{name:24}{number:8}{read.get(name, 0):10}{number - read.get(name, 0):6}")
        whole &= read.get(name) == number == by_rosbags[name] == by_mcap[name] == by_tombo[name]
    asked, received = sum(sent.values()), sum(read[name] for name in sent)
    say(f"{'all':24}{asked:8}{received:10}{asked - received:6}")
    say()
    say(f"rate                {asked / seconds:.0f} messages/s")
    say(f"lost, says recorder {notes['lost']}")
    say(f"CPU of the recorder {100 * share:.1f} % of a core")
    size = sum(path.stat().st_size for path in bag.glob("*.mcap"))
    say(f"size                {size / 1e6:.1f} MB")
    same = by_rosbags == read == by_mcap == by_tombo
    say(f"rosbags, mcap and tombo_bag {'count the same' if same else 'DIFFER'}")
    return whole and same


def main() -> int:
    """Run as a program."""
    parser = argparse.ArgumentParser(description=__doc__, add_help=True)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--burst-ms", type=int, default=0, help="publish so many ticks at once")
    parser.add_argument("--publish", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.publish:
        publish(options.publish, options.seconds, options.burst_ms)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        return 0 if measure(options.seconds, options.burst_ms, Path(folder)) else 1


if __name__ == "__main__":
    sys.exit(main())
