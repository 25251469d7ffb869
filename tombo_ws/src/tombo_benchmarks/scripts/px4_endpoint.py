"""What the simulated PX4 costs in real time, and how soon it answers.

    python px4_endpoint.py [SECONDS]

`tombo px4` runs as a process of its own. A client answers its TIMESYNC, sends poses and set
points at 50 Hz, gets ODOMETRY at 100 Hz and the IMU at 250 Hz, and flies in OFFBOARD; then
somebody floods the port with set points that are refused. Processor time is that of one core.
"""

from __future__ import annotations

import math
import os
import socket
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[4] / "tombo_ws/src/tombo_px4/test/autopilot"))

from endpoint_bench import ARM, OFFBOARD, POSITION_MASK, SET_MODE, Client
from px4_process import px4_process

LIMIT = 0.35
"""Share of a core that one client may cost."""
FLOOD_HZ = 5_000
_ASK_S = 0.01


def say(text: str = "") -> None:
    """Write a line."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def processor_s(pid: int) -> float:
    """Return the processor time that a process has used [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Pilot(Client):
    """Streams poses and set points, answers and asks for the time."""

    def __init__(self, port: int) -> None:
        super().__init__()
        self.socket.close()
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.bind(("127.0.0.1", port))
        self.there = ("127.0.0.1", port + 40)
        self.round_trips: list[float] = []
        self.asked = 0
        self.got: dict[str, int] = {}
        self.flies = False
        self.floods = False
        self._next_stream = self._next_ask = self._next_flood = 0.0

    def run(self, seconds: float) -> None:
        """Speak and listen for so long."""
        end = time.monotonic() + seconds
        while (now := time.monotonic()) < end:
            for message in self.collect():
                self.hear(message)
            self.seen.clear()
            if self.flies and now >= self._next_stream:
                self._next_stream = now + 0.02
                self.stream()
            if now >= self._next_ask:
                self._next_ask = now + _ASK_S
                self.asked += 1
                self.send(self.mav.timesync_encode(0, time.time_ns()))
            if self.floods and now >= self._next_flood:
                self._next_flood = now + 0.002
                for _ in range(FLOOD_HZ // 500):
                    self.send(self.set_point(77, 0.0, 0.0, 0.0))
            time.sleep(0.0003)

    def hear(self, message: Any) -> None:
        """Count, and deal with TIMESYNC."""
        kind = message.get_type()
        self.got[kind] = self.got.get(kind, 0) + 1
        if kind == "TIMESYNC":
            if message.tc1 == 0:
                self.send(self.mav.timesync_encode(time.time_ns(), message.ts1))
            else:
                self.round_trips.append(1e-6 * (time.time_ns() - message.ts1))

    def set_point(self, frame: int, north: float, east: float, down: float) -> Any:
        """Return a position set point."""
        return self.mav.set_position_target_local_ned_encode(
            0, 1, 1, frame, POSITION_MASK, north, east, down, *6 * [0.0], 1.57, 0.0
        )

    def stream(self) -> None:
        """Send a pose, which GPS makes useless but not cheaper, and a set point on a circle."""
        angle = 0.5 * time.monotonic()
        self.send(
            self.mav.odometry_encode(
                time.time_ns() // 1000, 1, 12, 50.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0],
                *6 * [0.0], 21 * [math.nan], 21 * [math.nan], 0, 2, 100,
            ),
            self.set_point(1, math.cos(angle) - 1.0, math.sin(angle), -1.0),
        )  # fmt: skip


def percentile(values: list[float], share: float) -> float:
    """Return the value that a share of them does not exceed."""
    ordered = sorted(values)
    return ordered[min(int(share * len(ordered)), len(ordered) - 1)] if ordered else math.nan


def measure(name: str, pid: int, pilot: Pilot, seconds: float) -> float:
    """Run for so long and print a line; return the share of a core that was used."""
    pilot.round_trips.clear()
    pilot.got.clear()
    pilot.asked = 0
    began, used = time.monotonic(), processor_s(pid)
    pilot.run(seconds)
    share = (processor_s(pid) - used) / (time.monotonic() - began)
    trips = pilot.round_trips
    answered = 100.0 * len(trips) / max(pilot.asked, 1)
    say(
        f"{name:<34} {100.0 * share:5.1f} %  {sum(pilot.got.values()) / seconds:6.0f}/s  "
        f"answered {answered:5.1f} %, p50 {percentile(trips, 0.5):.2f} ms, "
        f"p99 {percentile(trips, 0.99):.2f} ms, most {percentile(trips, 1.0):.1f} ms"
    )
    return share


def main() -> None:
    """Measure and print."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    with px4_process("no_obstacle", "--param", "EKF2_EV_CTRL=0") as px4:
        pid = px4.process.pid
        pilot = Pilot(px4.port)
        say(f"{'':<34}   core   messages  time requests at 100 Hz")
        measure("a client that listens", pid, pilot, seconds)
        for number, interval in ((331, 10_000.0), (105, 4_000.0)):
            pilot.command(511, float(number), interval)
        pilot.flies = True
        pilot.run(1.0)
        pilot.command(SET_MODE, *OFFBOARD)
        pilot.command(ARM, 1.0)
        pilot.run(5.0)
        share = measure("flying, poses, 250 Hz of IMU", pid, pilot, seconds)
        pilot.floods = True
        measure(f"flying, {FLOOD_HZ} bad set points a second", pid, pilot, seconds)
        say()
        say(f"one client: {100.0 * share:.0f} % of a core, wanted: below {100.0 * LIMIT:.0f} %")


if __name__ == "__main__":
    main()
