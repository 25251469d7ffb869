"""A flight of the bridge and the simulated PX4, without sockets, in made-up time."""

import copy
import copyreg
import struct
from functools import lru_cache

import numpy as np
from pymavlink.dialects.v20 import common as mav

from modified_px4 import ModifiedPx4
from tombo_dynamics.messages import Phase, PositionSetpoint
from tombo_px4.bridge.bridge import Bridge
from tombo_px4.bridge.bridge_params import SIMULATED, BridgeParams, LinkParams
from tombo_px4.link.mavlink_link import Received
from tombo_px4.link.timesync import TimeSync

NOW = 1_763_700_000_000_000_000
MS = 1_000_000
STEP = 4 * MS
ZERO = np.zeros(3)
copyreg.pickle(struct.Struct, lambda packer: (struct.Struct, (packer.format,)))  # for `hovering`
BOOT = 20_000 * MS


def synced(rtt_ns=300_000):
    """Clocks that know each other: PX4's reads BOOT when ours reads NOW."""
    sync = TimeSync()
    for k in range(20):
        at = NOW - (21 - k) * 100 * MS
        sync.request(at)
        sync.reply(at - NOW + BOOT + rtt_ns // 2, at, at + rtt_ns)
    assert sync.converged
    return sync


class Flight:
    """Bridge and PX4 with a way of 0.3 to 1 ms between them, mocap at 50 Hz, a mission."""

    def __init__(self, writes=None, mocap_late_ms=15, limits=None, proofs=(), px4=None, **params):
        params = {"axes_evidence": SIMULATED, **params}
        self.bridge = Bridge(
            BridgeParams(**params), LinkParams(), 1.3, writes, proofs=proofs, limits=limits
        )
        self.now = NOW
        self.px4 = ModifiedPx4(NOW, **(px4 or {}))
        self.phase, self.goal = Phase.IDLE, self.px4.place
        self.mocap_late = mocap_late_ms * MS
        self.mocap_shift = 0
        self.mocap_on = self.mission_on = True
        self.as_mocap = lambda place, attitude: (place, attitude)
        self.seen = {"odometry": [], "imu": [], "battery": [], "texts": [], "replies": []}
        self.events, self.out = [], None
        self._rng = np.random.default_rng(0)
        self._to_px4, self._to_us, self._poses = [], [], []
        self._k = 0
        self._packs, self._parses = mav.MAVLink(None, 1, 1), mav.MAVLink(None)

    def _wire(self, message):
        return self._parses.parse_buffer(bytearray(message.pack(self._packs)))[0]

    def _delay(self):
        return int(self._rng.uniform(0.3, 1.0) * MS)

    def step(self):
        self.now += STEP
        self._k += 1
        now = self.now
        while self._to_px4 and self._to_px4[0][0] <= now:
            arrival, message = self._to_px4.pop(0)
            self.px4.take(message, arrival)
        for message in self.px4.fly(now):
            self._to_us.append((now + self._delay(), message))
        for arrival, message in [x for x in self._to_us if x[0] <= now]:
            self.bridge.take(Received(self._wire(message), arrival, 1, 1, None))
        self._to_us = [x for x in self._to_us if x[0] > now]
        if self._k % 5 == 0:
            place = self.px4.place + self._rng.normal(0, 0.0005, 3)
            self._poses.append((now + self.mocap_late, now, place, self.px4.attitude))
        while self._poses and self._poses[0][0] <= now:
            arrival, captured, place, attitude = self._poses.pop(0)
            if self.mocap_on:
                shown = self.as_mocap(place, attitude)
                self.bridge.pose(captured + self.mocap_shift, arrival, "map", *shown)
        if self._k % 5 == 2 and self.mission_on:
            self.bridge.stream.setpoint(
                PositionSetpoint(now, self.goal, ZERO, ZERO, 0.0, self.phase), now
            )
        self.out = self.bridge.tick(now)
        for message in self.out.messages:
            self._to_px4.append((now + self._delay(), self._wire(message)))
        for name, found in self.seen.items():
            found += getattr(self.out, name)
        self.events += self.out.events

    def set_clock(self, by):
        """Set the system's clock, of bridge and mocap, by some ns; PX4's own clock goes on."""
        self.now += by
        self.px4.ahead_ns -= by
        self._to_px4 = [(due + by, message) for due, message in self._to_px4]
        self._to_us = [(due + by, message) for due, message in self._to_us]
        self._poses = [(due + by, captured, *pose) for due, captured, *pose in self._poses]

    def run(self, seconds):
        for _ in range(round(seconds * 250)):
            self.step()
        return self

    def until(self, condition, patience_s=15.0):
        for _ in range(round(patience_s * 250)):
            self.step()
            if condition(self):
                return self
        raise AssertionError(f"never: {self.out.status} {self.out.faults}")

    def stage(self, stage, patience_s=15.0):
        return self.until(lambda f: f.bridge.session.stage == stage, patience_s)

    def take_off(self):
        self.until(lambda f: f.out.status.ready)
        self.phase, self.goal = Phase.TAKEOFF, np.array([0.0, 0.0, 1.5])
        self.until(lambda f: f.px4.place[2] > 1.4, 25.0)
        self.phase = Phase.HOVER
        return self.run(2.0)

    def ask(self, kind):
        number = self.bridge.session.request(kind)
        self.until(lambda f: any(r.number == number for r in f.seen["replies"]))
        return next(r for r in self.seen["replies"] if r.number == number)


@lru_cache
def _hovering(limits):
    return Flight(limits=limits).take_off()


def hovering(limits=None):
    """A flight in hover at 1.5 m."""
    return copy.deepcopy(_hovering(limits))
