"""How fast the simulator link runs in lockstep with a scripted PX4 in a process of its own.

    python hil_lockstep.py [SECONDS]

The peer is the tests' one, in Python: it costs about as much as the simulator, so a real PX4,
which answers in 0.05 ms, goes faster. Where the simulator's own time goes is measured without it.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tombo_flight.scenario import load_scenario, world_of
from tombo_px4.hil.flight import HilFlight, MotorCommands
from tombo_px4.hil.link import HilLink
from tombo_px4.hil.lockstep import HilSimulator
from tombo_px4.hil.params import HilParams
from tombo_sim.world import World

PEER = Path(__file__).parents[4] / "tombo_ws/src/tombo_px4/test/autopilot" / "hil_peer.py"
PARTS = 5000


def say(text: str = "") -> None:
    """Write a line."""
    sys.stdout.write(text + "\n")


def fly(world: World, rate: float, seconds: float) -> None:
    """Fly with a peer and print a row of the table."""
    link = HilLink(0)
    hil = HilSimulator(world, 0, HilParams(rate=rate, mocap=True).check(), link, speed=0.0)
    peer = subprocess.Popen([sys.executable, str(PEER), str(link.port), str(seconds)])
    waits = []
    began = cpu = 0.0
    try:
        while peer.poll() is None and 1e-6 * hil.flight.time_us < seconds:
            if hil.advance(time.monotonic_ns()):
                if hil.answered == 10 and began == 0.0:
                    began, cpu = time.perf_counter(), time.process_time()
                    start_us = hil.flight.time_us
                sent = time.perf_counter()
            else:
                hil.wait(time.monotonic_ns(), 0.1)
                if hil.answered > 10:
                    waits.append(time.perf_counter() - sent)
        took, used = time.perf_counter() - began, time.process_time() - cpu
        simulated = 1e-6 * (hil.flight.time_us - start_us)
        p50, p99 = (1e3 * np.percentile(waits, share) for share in (50, 99))
        row = (
            f"{rate:.0f}",
            f"{simulated:.0f}",
            f"{hil.missed}",
            f"{simulated / took:.1f}",
            f"{hil.steps / took:.0f}",
            f"{1e6 * used / hil.steps:.0f}",
            f"{p50:.2f} / {p99:.2f}",
        )
        say(f"| {' | '.join(row)} |")
    finally:
        peer.kill()
        peer.wait(10)
        link.close()


def each(action: Callable[[], object]) -> float:
    """Return how long one call takes [us]."""
    action()
    start = time.perf_counter()
    for _ in range(PARTS):
        action()
    return 1e6 * (time.perf_counter() - start) / PARTS


def main() -> None:
    """Measure and print."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    world = world_of(load_scenario("paper_collision"))
    say(
        "| rate [Hz] | simulated [s] | missed | times real time | steps/s | CPU a step [us] |"
        " answer p50 / p99 [ms] |"
    )
    say("|---|---|---|---|---|---|---|")
    for rate in (250.0, 500.0, 1000.0):
        fly(world, rate, seconds)
    say()
    flight = HilFlight(world, 0, HilParams())
    plant = flight.simulator.plant
    motors = MotorCommands([0.4] * 4, armed=True)
    flight.step(motors)  # the slow sensors have a first reading
    now = (flight._mav, flight.time_us, plant)
    say("Parts of a step of 4 ms [us]:")
    for name, action in (
        ("one tick of physics (four a step)", lambda: flight.simulator.advance(flight.rotors)),
        ("controls to rotor speeds", lambda: flight.controls.speeds(motors.controls, True)),
        ("IMU, averaged", flight.sensors.inertial),
        ("HIL_SENSOR, encoded", flight._sensor),
        ("magnetometer and barometer (every fifth)", lambda: flight.sensors.slow(plant)),
        ("HIL_STATE_QUATERNION, encoded (200 Hz)", lambda: flight.sensors.truth(*now)),
        ("HIL_GPS, encoded (10 Hz)", lambda: flight.sensors.gps(*now)),
    ):
        say(f"  {name}: {each(action):.1f}")


if __name__ == "__main__":
    main()
