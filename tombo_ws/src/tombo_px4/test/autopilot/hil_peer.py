"""A scripted PX4 for the tests: its side of the simulator link, and a pilot that flies by it.

The pilot knows only what HIL_SENSOR and HIL_GPS say, in NED and FRD, and mixes as PX4's quad-x: if
a sign or a frame were wrong it would fall. Polled; run as a program it is a peer of its own:

    python hil_peer.py PORT SECONDS
"""

from __future__ import annotations

import contextlib
import math
import select
import socket
import sys
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common

MAVLINK = common
G = 9.80665
MIXER = ((-1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, -1.0), (-1.0, -1.0, -1.0))
"""Roll, pitch, yaw of PX4's motors 1 to 4, quad-x, FRD."""
_EARTH = 6_371_000.0


def clamp(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def rotate(q: list[float], v: Any) -> tuple[float, float, float]:
    """NED from FRD."""
    w, x, y, z = q
    tx = 2.0 * (y * v[2] - z * v[1])
    ty = 2.0 * (z * v[0] - x * v[2])
    tz = 2.0 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )


def multiply(a: Any, b: Any) -> list[float]:
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]


class Pilot:
    """Estimates and flies, in PX4's frames."""

    HOVER = 0.46
    ALIGN = 100
    """Steps at rest before it arms."""

    def __init__(self, declination_deg: float = 3.3, use_gps: bool = True) -> None:
        self.declination = math.radians(declination_deg)
        self.use_gps = use_gps
        self.q = [1.0, 0.0, 0.0, 0.0]
        self.velocity = [0.0, 0.0, 0.0]
        self.position = [0.0, 0.0, 0.0]
        self.sum = [0.0, 0.0, 0.0]
        self.goal = (0.0, 0.0, -2.0)
        """NED from where it started."""
        self.heading: float | None = None
        """None: as it stood."""
        self.integral = 0.0
        self.steps = 0
        self.last_us = 0
        self.ground: float | None = None
        self.home: tuple[float, float] | None = None
        self.mag = (0.0, 0.0, 0.0)

    @property
    def armed(self) -> bool:
        return self.steps > self.ALIGN

    @property
    def yaw(self) -> float:
        w, x, y, z = self.q
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    def gps(self, message: Any) -> None:
        if not self.use_gps:
            return
        lat, lon = 1e-7 * message.lat, 1e-7 * message.lon
        if self.home is None:
            self.home = (lat, lon)
        north = math.radians(lat - self.home[0]) * _EARTH
        east = math.radians(lon - self.home[1]) * _EARTH * math.cos(math.radians(lat))
        for i, (place, speed) in enumerate(((north, message.vn), (east, message.ve))):
            self.position[i] += 0.2 * (place - self.position[i])
            self.velocity[i] += 0.2 * (0.01 * speed - self.velocity[i])

    def sensor(self, message: Any) -> list[float]:
        """Take a HIL_SENSOR; return the controls of four motors."""
        self.steps += 1
        force = (message.xacc, message.yacc, message.zacc)
        rates = (message.xgyro, message.ygyro, message.zgyro)
        dt = 1e-6 * (message.time_usec - self.last_us)
        self.last_us = message.time_usec
        slow = message.fields_updated == 0x1FFF
        if slow:
            self.mag = (message.xmag, message.ymag, message.zmag)
        if not self.armed:
            self._align(force, message)
            return [0.0] * 4
        self._predict(force, rates, dt)
        if slow:
            self._correct(message)
        return self._control(rates, dt)

    def _align(self, force: Any, message: Any) -> None:
        for i in range(3):
            self.sum[i] += force[i]
        fx, fy, fz = self.sum
        roll, pitch = math.atan2(-fy, -fz), math.atan2(fx, math.hypot(fy, fz))
        cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
        cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
        level = [cr * cp, sr * cp, cr * sp, -sr * sp]
        north, east, _ = rotate(level, self.mag)
        yaw = self.declination - math.atan2(east, north)
        self.q = multiply([math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)], level)
        self.ground = message.pressure_alt if self.ground is None else self.ground
        self.ground += 0.1 * (message.pressure_alt - self.ground)
        if self.steps == self.ALIGN and self.heading is None:
            self.heading = self.yaw

    def _predict(self, force: Any, rates: Any, dt: float) -> None:
        half = [0.5 * dt * r for r in rates]
        q = multiply(self.q, [1.0, *half])
        n = 1.0 / math.sqrt(sum(v * v for v in q))
        self.q = [n * v for v in q]
        north, east, down = rotate(self.q, force)
        for i, a in enumerate((north, east, down + G)):
            self.velocity[i] += a * dt
            self.position[i] += self.velocity[i] * dt

    def _correct(self, message: Any) -> None:
        north, east, _ = rotate(self.q, self.mag)
        error = 0.05 * math.remainder(self.declination - math.atan2(east, north), 2.0 * math.pi)
        self.q = multiply([math.cos(0.5 * error), 0.0, 0.0, math.sin(0.5 * error)], self.q)
        high = -(message.pressure_alt - self.ground) - self.position[2]
        self.position[2] += 0.06 * high
        self.velocity[2] += 0.05 * high

    def _control(self, rates: Any, dt: float) -> list[float]:
        wanted = []
        for i, limit in enumerate((1.0, 1.0, 1.0)):
            error = self.goal[i] - self.position[i] if self.use_gps or i == 2 else 0.0
            if not self.use_gps and i < 2:
                wanted.append(0.0)
                continue
            speed = clamp(0.9 * error, limit)
            wanted.append(clamp(2.5 * (speed - self.velocity[i]), 4.0))
        self.integral = clamp(self.integral + 0.3 * wanted[2] * dt, 3.0)
        thrust = (-wanted[0], -wanted[1], G - wanted[2] - self.integral)
        size = math.sqrt(sum(v * v for v in thrust))
        down = [v / size for v in (thrust[0], thrust[1], thrust[2])]
        # the shortest turn from "down" of the vehicle to where its thrust must come from
        bx, by, bz = rotate(self.q, (0.0, 0.0, 1.0))
        ex = by * down[2] - bz * down[1]
        ey = bz * down[0] - bx * down[2]
        ez = bx * down[1] - by * down[0]
        conjugate = [self.q[0], -self.q[1], -self.q[2], -self.q[3]]
        tilt = rotate(conjugate, (ex, ey, ez))
        turn = math.remainder((self.heading or 0.0) - self.yaw, 2.0 * math.pi)
        roll = 0.11 * (7.0 * tilt[0] - rates[0])
        pitch = 0.11 * (7.0 * tilt[1] - rates[1])
        yaw = clamp(0.2 * (clamp(2.0 * turn, 1.0) - rates[2]), 0.15)
        lift = self.HOVER * size / G
        return [
            min(max(lift + 0.707 * (m[0] * roll + m[1] * pitch) + m[2] * yaw, 0.0), 1.0)
            for m in MIXER
        ]


class Peer:
    """PX4's side of the socket."""

    def __init__(self, port: int, pilot: Pilot | None = None, silent: int = 9) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=5.0)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket.setblocking(False)
        self.pilot = pilot or Pilot()
        self.silent = silent
        """So many HIL_SENSOR go unanswered first, as when PX4 boots."""
        self.out = common.MAVLink(None, srcSystem=1, srcComponent=1)
        self.parser = common.MAVLink(None)
        self.answer: Callable[[Any, list[float]], bytes | None] = self.controls
        self.heard: list[Any] = []
        """All messages, if `keep`."""
        self.keep = False
        self.sensors = 0
        self.gap_us = 0
        """Longest step of time."""
        self._last_us = 0
        self.socket.sendall(
            self.out.heartbeat_encode(6, 12, 0, 0, 0).pack(self.out)
            + self.out.command_long_encode(0, 0, 511, 0, 115, 5e3, 0, 0, 0, 0, 0).pack(self.out)
        )

    def controls(
        self,
        sensor: Any,
        values: list[float],
        shift_us: int = 0,
        armed: bool | None = None,
        flags: int = 1,
    ) -> bytes:
        armed = self.pilot.armed if armed is None else armed
        message = self.out.hil_actuator_controls_encode(
            sensor.time_usec + shift_us,
            values + [0.0] * (16 - len(values)),
            0x81 if armed else 0x01,
            flags,
        )
        return bytes(message.pack(self.out))

    def pump(self) -> bool:
        """Take what has come and answer it; False: the simulator has gone."""
        try:
            data = self.socket.recv(65_536)
        except BlockingIOError:
            return True
        except OSError:
            return False
        if not data:
            return False
        for message in self.parser.parse_buffer(data) or []:
            if self.keep:
                self.heard.append(message)
            kind = message.get_type()
            if kind == "HIL_GPS":
                self.pilot.gps(message)
            elif kind == "HIL_SENSOR":
                self._sensor(message)
        return True

    def _sensor(self, message: Any) -> None:
        self.sensors += 1
        self.gap_us = max(self.gap_us, message.time_usec - self._last_us)
        self._last_us = message.time_usec
        values = self.pilot.sensor(message)
        if self.sensors <= self.silent:
            return
        data = self.answer(message, values)
        if data is not None:
            self.socket.sendall(data)

    def close(self) -> None:
        self.socket.close()


def main() -> None:
    """Fly until the simulator has gone, or the time is over."""
    port, seconds = int(sys.argv[1]), float(sys.argv[2])
    peer = Peer(port)
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
        while peer.pilot.last_us < 1e6 * seconds:
            select.select([peer.socket], [], [], 1.0)
            if not peer.pump():
                break
    peer.close()


if __name__ == "__main__":
    main()
