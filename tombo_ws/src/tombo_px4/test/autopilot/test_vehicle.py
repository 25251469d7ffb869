"""The vehicle on its own: arms, takes off, holds, goes, returns, lands, disarms."""

import numpy as np
import pytest
from vehicle_bench import GROUND, Flight, motion, ready

from tombo_px4.autopilot.commander import TakeoffState
from tombo_px4.modes import AUTO_HOLD, AUTO_LAND, AUTO_TAKEOFF, OFFBOARD, MavLandedState, Result

pytestmark = pytest.mark.slow


def taken_off() -> Flight:
    flight = ready()
    flight.take_off()
    flight.fly(7.0)
    return flight


@pytest.mark.parametrize("height", [None, 1.5])
def test_takes_off_and_holds(height):
    flight = ready()
    flight.vehicle.parameters.store("MIS_TAKEOFF_ALT", 3.0)
    flight.take_off(height)
    assert flight.vehicle.landed == MavLandedState.ON_GROUND
    assert flight.fly(2.7)[:, 2].max() < GROUND  # spins up, then pushes ever harder
    flight.fly(1.0)
    assert flight.vehicle.mode == AUTO_TAKEOFF
    assert flight.vehicle.landed == MavLandedState.TAKEOFF
    flight.fly(6.0)
    rows = flight.fly(4.0)
    assert flight.vehicle.mode == AUTO_HOLD and flight.vehicle.landed == MavLandedState.IN_AIR
    assert flight.vehicle.takeoff_state == TakeoffState.FLIGHT
    wanted = 3.0 if height is None else height
    assert np.abs(rows[:, 2] - flight.vehicle.home[2] - wanted).max() < 0.1
    assert np.ptp(rows[:, :2], axis=0).max() < 0.15
    assert flight.heard("Armed by") and flight.heard("Takeoff detected")


def test_lands_and_disarms():
    flight = taken_off()
    place = flight.body[:2]
    assert flight.vehicle.set_mode(AUTO_LAND) == Result.ACCEPTED
    flight.fly(1.0)
    assert flight.vehicle.mode == AUTO_LAND and flight.vehicle.landed == MavLandedState.LANDING
    touch = []
    flight.fly_until(lambda: bool(touch.append(flight.body[5]) or not flight.vehicle.armed), 12.0)
    assert min(touch) > -1.0 and np.linalg.norm(flight.body[:2] - place) < 0.3
    assert flight.vehicle.landed == MavLandedState.ON_GROUND and flight.body[2] < GROUND
    assert flight.vehicle.mode == AUTO_HOLD  # the one before
    assert flight.heard("Landing detected") and flight.heard("Disarmed by landing")
    flight.fly(0.5)
    assert flight.rotors.max() < 20.0


def run(seed: int) -> bytes:
    flight = Flight(seed=seed)
    flight.fly(1.5)
    flight.take_off()
    rows = flight.fly(3.0)
    flight.fly(0.2, motion(velocity=[0.5, 0, 0]))
    flight.vehicle.set_mode(OFFBOARD)
    return rows.tobytes() + flight.fly(1.0).tobytes() + "".join(flight.texts).encode()


def test_the_same_calls_give_the_same_bytes():
    assert run(3) == run(3) != run(4)
